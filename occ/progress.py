"""How far a run has come: a bar where somebody watches, a line now and then where the output is a file."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

EVERY = 15.0
"""[s] between two lines."""


class Progress:
    """Counts rows and failures and tells what is left.

    Args:
        rows: in all.
        show: called with the latest thing done after each step.
        now: a clock [s].
    """

    def __init__(self, rows: int, show: Callable[[Progress, str], None], now: Callable[[], float] = time.monotonic):
        self.rows, self.done, self.failed = rows, 0, 0
        self._show, self._now = show, now
        self._stored, self._begin = 0, now()

    def __call__(self, what: str, rows: int, failed: int = 0, stored: bool = False) -> None:
        """Take note of rows that are done.

        Args:
            what: case and controller, or the name of a figure.
            rows: how many that makes.
            failed: how many of them are not ok.
            stored: whether they were found and not made.
        """
        self.done += rows
        self.failed += failed
        self._stored += rows if stored else 0
        self._show(self, what)

    @property
    def rate(self) -> float:
        """[1/s] rows that were made, not found stored."""
        passed = self._now() - self._begin
        return (self.done - self._stored) / passed if passed > 0 else 0.0

    @property
    def remaining(self) -> float | None:
        """[s] None as long as nothing is known."""
        left = self.rows - self.done
        return 0.0 if not left else left / self.rate if self.rate else None

    def text(self) -> str:
        """``120 of 400 rows, 3 not ok, 12 a second, 23 s left``."""
        parts = [f"{self.done} of {self.rows} rows", f"{self.failed} not ok", f"{self.rate:.3g} a second"]
        if self.remaining is not None:
            parts.append(f"{_span(self.remaining)} left")
        return ", ".join(parts)


def _span(seconds: float) -> str:
    whole = round(seconds)
    if whole < 100:
        return f"{whole} s"
    return f"{whole // 60} min" if whole < 6000 else f"{whole / 3600:.1f} h"


@contextmanager
def progress_of(rows: int, stream: TextIO | None = None) -> Iterator[Progress]:
    """A bar on a terminal; elsewhere a line every `EVERY` seconds, so that what is quick is quiet.

    Args:
        rows: in all.
        stream: the error stream by default.

    Yields:
        To be told about each row.
    """
    out = stream or sys.stderr
    if not out.isatty():
        yield _lines(rows, out)
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    with Bar(
        BarColumn(), TextColumn("{task.description}", markup=False), console=Console(file=out), transient=True
    ) as bar:
        task = bar.add_task("", total=rows)

        def show(state: Progress, what: str) -> None:
            bar.update(task, completed=state.done, description=f"{state.text()}: {what}")

        yield Progress(rows, show)


def _lines(rows: int, out: TextIO) -> Progress:
    last = time.monotonic()

    def show(state: Progress, what: str) -> None:
        nonlocal last
        if time.monotonic() - last >= EVERY:
            last = time.monotonic()
            print(state.text(), file=out, flush=True)

    return Progress(rows, show)
