"""One function over many items, here or in worker processes; a worker that dies costs its own item only."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Died:
    """The worker process ended in the middle of an item, twice: once with others, once alone."""


def in_processes(
    function: Callable[[Item], Outcome], items: Sequence[Item], workers: int
) -> Generator[tuple[int, Outcome | Died], None, None]:
    """function(item) of each item in freshly started processes, each with one thread of linear algebra.

    Args:
        function: that a new process can import.
        items: plain data.
        workers: number of processes.

    Yields:
        Number of the item and its outcome, in the order in which they finish.
    """
    waiting = deque(enumerate(items))
    suspects: list[tuple[int, Item]] = []
    while waiting:
        with _pool(min(workers, len(waiting))) as pool:
            running: dict[Future[Outcome], tuple[int, Item]] = {}
            broken = False
            while running or (waiting and not broken):
                # No more than the workers can hold, so that few items are under suspicion when one of them dies.
                while waiting and len(running) < workers and not broken:
                    try:
                        running[pool.submit(function, waiting[0][1])] = waiting[0]
                        waiting.popleft()
                    except BrokenProcessPool:
                        broken = True
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number, item = running.pop(future)
                    if isinstance(future.exception(), BrokenProcessPool):
                        broken = True
                        suspects.append((number, item))
                    else:
                        yield number, future.result()
    for number, item in suspects:
        with _pool(1) as pool:
            try:
                outcome: Outcome | Died = pool.submit(function, item).result()
            except BrokenProcessPool:
                outcome = Died()
        yield number, outcome


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool whose processes are ended, not waited for, when the block is left by an exception."""
    before = set(multiprocessing.active_children())
    kept = {name: os.environ.get(name) for name in THREADS}
    # New processes read this when they load their libraries.
    os.environ.update(dict.fromkeys(THREADS, "1"))
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_leave_interrupts_to_parent)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - before:
            child.kill()
        raise
    finally:
        pool.shutdown()
        for name, value in kept.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def _leave_interrupts_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
