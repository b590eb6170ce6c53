"""Calls for the engines' tests, and a controller for every way in which a case can go wrong.

Processes of the engines import this module, so that it imports little.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import signal
import subprocess
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.errors import InputError
from occ.experiment.child import Tell, unheard

if TYPE_CHECKING:
    from occ.atlas.comparison import Comparison
    from occ.task import Solution, Task


def work(item: Any, _: Tell = unheard) -> Any:
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


def works(items: list[Any], tell: Tell) -> list[Any]:
    """`work` of each of them, told one by one; those after one that takes the process with it are lost with it."""
    done = []
    for item in items:
        done.append(work(item))
        tell(done[-1:])
    return done


def noted(item: tuple[Path, list[Any]], tell: Tell) -> list[Any]:
    """`works` that leaves a line in a file for each that it begins with."""
    path, items = item
    done = []
    for one in items:
        with path.open("a") as file:
            print(one, file=file)
        done += works([one], tell)
    return done


def slowly(steps: int, tell: Tell) -> int:
    """Takes long, and tells every half of a second that it goes on."""
    for step in range(steps):
        time.sleep(0.5)
        tell(step)
    return steps


def process(_: object, __: Tell) -> int:
    """The process in which it is called."""
    return os.getpid()


def with_offspring(folder: Path, _: Tell) -> None:
    """Hangs, and has started something that does the same."""
    process = subprocess.Popen(["sleep", "1000"])
    (folder / "begun").write_text(f"{process.pid}")
    time.sleep(1000.0)


class _Unpicklable(Exception):
    def __init__(self, value: Any) -> None:
        super().__init__("of mine")
        self.value = value


def matrix_sums(seed: int, _: Tell) -> list[str]:
    """Numbers whose last bits depend on the order of sums in linear algebra."""
    a = np.random.default_rng(seed).normal(size=(300, 300))
    return [value.hex() for value in (float((a @ a).sum()), float(np.linalg.solve(a, a[0]).sum()), math.sin(seed))]


def resident_after(item: Comparison, _: Tell) -> int:
    """[bytes] Memory of this process after one more comparison."""
    import psutil

    from occ.atlas.comparison import compare

    rows = compare(item)
    assert all(row["status"] == "ok" for row in rows)
    gc.collect()
    return int(psutil.Process().memory_info().rss)


def law_that_crashes(item: Any, tell: Tell) -> bytes:
    """As `occ.atlas.run.solve`, but that the law ends the process on the circle of 0.7 m."""
    from occ.atlas.run import solve
    from occ.laws import ServoLaw

    honest = ServoLaw.solve

    def crash(law: ServoLaw, task: Task) -> Solution:
        if task.motion.radius == 0.7:
            ctypes.string_at(0)
        return honest(law, task)

    ServoLaw.solve = crash
    try:
        return solve(item, tell)
    finally:
        ServoLaw.solve = honest


def touch_and_wait(folder: Path, _: Tell) -> str:
    """Says that it has begun, and takes some time."""
    (folder / f"begun-{os.getpid()}").touch()
    time.sleep(1000.0)
    return "done"
