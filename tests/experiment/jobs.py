"""Calls for the engines' tests, and a controller for every way in which a case can go wrong.

Processes of the engines import this module, so that it imports little.
"""

from __future__ import annotations

import gc
import math
import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.errors import InputError

if TYPE_CHECKING:
    from occ.atlas.comparison import Comparison


def work(item: Any) -> Any:
    """Doubles a number; other items go wrong in their own way."""
    if item == "exit":
        os._exit(3)
    if item == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if item == "sleeps":
        time.sleep(1000.0)
    if item == "hangs":
        # Deaf to everything but SIGKILL.
        for name in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM):
            signal.signal(name, signal.SIG_IGN)
        while True:
            pass
    if item == "memory":
        return len(bytearray(8 * 10**9))
    if item == "raises":
        raise ArithmeticError("of mine")
    if item == "unpicklable":
        raise _Unpicklable(lambda: None)
    if item == "input":
        raise InputError("of mine")
    if item == "prints":
        print("between the answers")
        os.write(1, b"and below Python")
        return "printed"
    if item == "threads":
        return os.environ["OPENBLAS_NUM_THREADS"]
    return 2 * item


def works(items: list[Any]) -> list[Any]:
    """`work` of each of them; all are lost with one that takes the process with it."""
    return [work(item) for item in items]


class _Unpicklable(Exception):
    def __init__(self, value: Any) -> None:
        super().__init__("of mine")
        self.value = value


def matrix_sums(seed: int) -> list[str]:
    """Numbers whose last bits depend on the order of sums in linear algebra."""
    a = np.random.default_rng(seed).normal(size=(300, 300))
    return [value.hex() for value in (float((a @ a).sum()), float(np.linalg.solve(a, a[0]).sum()), math.sin(seed))]


def resident_after(item: Comparison) -> int:
    """[bytes] Memory of this process after one more comparison."""
    import psutil

    from occ.atlas.comparison import compare

    rows = compare(item)
    assert all(row["status"] == "ok" for row in rows)
    gc.collect()
    return int(psutil.Process().memory_info().rss)


def touch_and_wait(folder: Path) -> str:
    """Says that it has begun, and takes some time."""
    (folder / f"begun-{os.getpid()}").touch()
    time.sleep(1000.0)
    return "done"
