"""Interrupts that arrive where nobody passes them on."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def lasting_interrupts() -> Iterator[Callable[[], None]]:
    """Remember an interrupt from the keyboard that a solver swallows.

    An interrupt in the middle of compiled code ends up as a failed solve, or nowhere at all.

    Yields:
        A function that raises KeyboardInterrupt if there has been one; to be called before anything is stored.
    """
    seen = False

    def remember(number: int, frame: FrameType | None) -> None:
        nonlocal seen
        seen = True
        signal.default_int_handler(number, frame)

    def check() -> None:
        if seen:
            raise KeyboardInterrupt

    ours = threading.current_thread() is threading.main_thread()
    # Somebody who ignores or handles interrupts in another way keeps that way.
    ours = ours and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, remember)
    try:
        yield check
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
