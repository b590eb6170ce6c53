"""Full comparisons, run by `make benchmark`: cases per second, parts of a case, and what a second worker brings.

A case is the servo law, least work and least squared torques under a torque limit, each replayed and measured by the
referee, and the exact least work: one point of `experiments/atlas_comparison.toml`.
"""

from __future__ import annotations

import json
import os
import resource
import time
from functools import cache
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from occ.atlas.comparison import Comparison
from occ.atlas.run import solve
from occ.experiment.load import load_experiment
from occ.experiment.pool import Engine
from occ.referee import judge
from occ.task import Solution, Task

pytestmark = pytest.mark.benchmark
EXPERIMENT = Path(__file__).parents[2] / "experiments" / "atlas_comparison.toml"
TIMED = "PYTEST_BENCHMARK_CASES"
"""Number of full comparisons that are timed with one worker and with two; few by default, 400 for the record."""


@cache
def comparisons(count: int) -> list[Comparison]:
    """So many points from all over the map."""
    experiment = load_experiment(EXPERIMENT)
    every = len(experiment.cases) // count
    return [Comparison(case, experiment.objectives) for case in experiment.cases[every // 2 :: every][:count]]


def test_cases_per_second_of_one_process(benchmark: BenchmarkFixture) -> None:
    items = comparisons(20 if benchmark.enabled else 1)

    def work() -> list[bytes]:
        return [solve(item) for item in items]

    found = benchmark.pedantic(work, rounds=3, warmup_rounds=1)
    for rows in map(json.loads, found):
        # The work of no row is below the exact least, and the accounts of energy close.
        assert all(row["work_gap_percent"] is None or row["work_gap_percent"] > -1e-6 for row in rows)
        assert all(abs(row["energy_residual_J"] or 0.0) < 1e-7 for row in rows)
    if benchmark.enabled:
        benchmark.extra_info["cases_per_second"] = len(items) / benchmark.stats.stats.min


@pytest.mark.parametrize("name", ["servo law", "min work", "min torque2"])
def test_referee(benchmark: BenchmarkFixture, name: str) -> None:
    item = comparisons(5)[3]
    task = item.case.task()
    solution = item.case.players()[name].solve(task)

    def work(task: Task, solution: Solution) -> float:
        return judge(task, solution).measures["energy_residual_J"]

    assert abs(benchmark(work, task, solution)) < 1e-9


def test_one_and_two_workers(benchmark: BenchmarkFixture) -> None:
    """Cases per second of two workers, how many times faster than one, and memory; starts and builds included."""
    items = comparisons(int(os.environ.get(TIMED, "40")) if benchmark.enabled else 2)
    seconds, processor, memory = {}, {}, {}
    for workers in (1, 2):
        engine = Engine(workers=workers)
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        outcomes = dict(engine.each(solve, items))
        seconds[workers] = time.perf_counter() - begin
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor[workers] = used.ru_utime - before
        memory[workers] = used.ru_maxrss / 1024
        assert sorted(outcomes) == list(range(len(items)))
        assert all(isinstance(outcome, bytes) for outcome in outcomes.values())
    benchmark.extra_info |= {
        "cases": len(items),
        "cases_per_second": {workers: len(items) / time for workers, time in seconds.items()},
        "processor_seconds_per_case": {workers: time / len(items) for workers, time in processor.items()},
        "times_faster": seconds[1] / seconds[2],
        # The largest of all workers up to then: with one, that of all cases.
        "memory_of_a_worker_MB": memory,
    }
    print("", *(f"{key}: {value}" for key, value in benchmark.extra_info.items()), sep="\n")
    benchmark.pedantic(solve, (items[0],), rounds=1)
