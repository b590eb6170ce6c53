"""Exact least work, run by `make benchmark`: processor's time of each task, at the paper's circle and at random.

Median, nine in ten and longest are printed and in `extra_info`; without `--benchmark-enable` only a value is checked.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from occ.referee.reference import servo_end_state
from occ.theory.minimum_work import LeastWork, minimum_work
from tests.tasks import LAP, paper_task
from tests.theory.test_minimum_work import random_task

pytestmark = pytest.mark.benchmark
DURATIONS = (LAP, 30.0, 100.0, 600.0)
"""[s]"""
COUNT = 216
"""Random tasks."""
Solve = Callable[[], LeastWork]


def of_the_paper() -> Iterator[tuple[str, Solve]]:
    """All classes of ends, both directions of travel, one lap and long horizons."""
    for rate in (-0.4, 0.4):
        for duration in DURATIONS:
            task = paper_task(duration=duration, rate=rate)
            state, name = servo_end_state(task), f"{rate:+g} rad/s, {duration:.4g} s"
            yield f"{name}, free end", partial(minimum_work, task)
            yield f"{name}, the law's end", partial(minimum_work, task, "law", state)
        task = paper_task(rate=rate)
        yield f"{rate:+g} rad/s, return", partial(minimum_work, task, "periodic")
        yield f"{rate:+g} rad/s, cycle", partial(minimum_work, task, "periodic", free_start=True)


def at_random(count: int) -> Iterator[tuple[str, Solve]]:
    """Radius, rate, point, friction, start and horizon at random, the end free."""
    for seed in range(count):
        yield f"random {seed}", partial(minimum_work, random_task(seed))


def milliseconds(solve: Solve) -> float:
    """[ms] of the processor, the better of two calls."""
    times = []
    for _ in range(2):
        clock = time.process_time()
        solve()
        times.append(time.process_time() - clock)
    return 1e3 * min(times)


@pytest.mark.parametrize("name", ["paper", "random"])
def test_exact_least_work(benchmark: BenchmarkFixture, name: str) -> None:
    tasks = dict(of_the_paper() if name == "paper" else at_random(COUNT if benchmark.enabled else 4))
    assert minimum_work(paper_task()).work == pytest.approx(200.3271190337, rel=1e-12)
    spent = {key: milliseconds(solve) for key, solve in tasks.items()}
    values = np.array(list(spent.values()))
    slowest = max(spent, key=lambda key: spent[key])
    summary = {"median_ms": np.median(values), "nine_in_ten_ms": np.quantile(values, 0.9), "longest_ms": values.max()}
    benchmark.extra_info.update({key: float(value) for key, value in summary.items()} | {"slowest": slowest})
    print(
        f"\n{name}: {len(values)} tasks, " + ", ".join(f"{key} {value:.1f}" for key, value in summary.items()), slowest
    )
    benchmark.pedantic(tasks[slowest], rounds=5, warmup_rounds=1)
