"""Timings of atlases, run by `make benchmark`: points and cases per second, and what a second worker brings.

Each states the accuracy of what it has timed.  Run without `--benchmark-enable` they only check that answer.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from occ.atlas.comparison import Comparison
from occ.atlas.law import rotations
from occ.atlas.long_run import long_run_columns
from occ.atlas.points import Points
from occ.atlas.run import solve
from occ.experiment.load import load_experiment
from occ.experiment.pool import Engine
from occ.model.presets import youbot
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import yaw_coefficients
from occ.theory.dissipation import circle_energy
from occ.theory.equation import scaled_equation
from occ.theory.long_run import LongRun, long_run

pytestmark = pytest.mark.benchmark
ROOT = Path(__file__).parents[2]
PAPER = yaw_coefficients(youbot(), (0.40, 0.05))
TIMED = "PYTEST_BENCHMARK_CASES"
"""Number of full comparisons to time; few by default."""


def circles(count: int, radii: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Radii and rates, the paper's circle first."""
    random = np.random.default_rng(1)
    radius = random.uniform(*radii, count)
    rate = random.choice([-1.0, 1.0], count) * random.uniform(0.02, 1.5, count)
    radius[0], rate[0] = (0.7, -0.4) if radii[1] > 0.7 else (0.6, -0.4)
    return radius, rate


def test_a_million_least_mean_powers_and_steady_powers(benchmark: BenchmarkFixture) -> None:
    radius, rate = circles(1_000_000 if benchmark.enabled else 1000, (0.05, 1.5))

    def work() -> tuple[LongRun, np.ndarray]:
        energy = circle_energy(PAPER, radius, rate)
        return long_run(energy), energy.dissipation(circle_quantities(PAPER, radius, rate).stable_heading, rate)

    best, law = benchmark.pedantic(work, rounds=1)
    assert 100 * (law[0] / best.mean_power[0] - 1) == pytest.approx(0.1611, abs=5e-5)
    if benchmark.enabled:
        assert benchmark.stats.stats.min < 10.0


def test_mean_powers_of_rotating_laws(benchmark: BenchmarkFixture) -> None:
    count = 20_000 if benchmark.enabled else 100
    radius, rate = circles(count, (0.05, 0.62))

    def work() -> np.ndarray:
        return rotations(circle_energy(PAPER, radius, rate), scaled_equation(PAPER, radius, rate)).mean_power

    power = benchmark.pedantic(work, rounds=1)
    # R_B = 0.6: 6.4 % above the least mean power.
    least = long_run(circle_energy(PAPER, 0.6, -0.4)).mean_power
    assert 100 * (power[0] / least - 1) == pytest.approx(6.4, abs=0.05)
    assert np.isfinite(power).all()


def test_every_column_of_the_long_run(benchmark: BenchmarkFixture) -> None:
    count = 100_000 if benchmark.enabled else 100
    radius, rate = circles(count, (0.05, 1.5))
    zero = np.zeros(count)
    point = np.array([zero + 0.40, zero + 0.05])
    points = Points(
        4, youbot().parameters()[None], zero.astype(int), point, radius, rate, zero, zero, zero, zero + 10.0
    )
    columns = benchmark.pedantic(long_run_columns, (points,), rounds=1)
    assert columns["law_torque_Nm"][0] == pytest.approx(1.22530952523)


def test_full_comparisons_with_one_and_two_workers(benchmark: BenchmarkFixture) -> None:
    """Law, least work, least torque squared, referee and exact least work; cases per second and efficiency."""
    wanted = int(os.environ.get(TIMED, "8")) if benchmark.enabled else 1
    path = ROOT / "experiments" / "atlas_comparison.toml"
    cases = load_experiment(path).cases
    items = [Comparison(case, ("work", "torque_squared")) for case in cases[:: max(1, len(cases) // wanted)][:wanted]]
    seconds = {}
    for workers in (1, 2):
        engine = Engine(workers=workers, time_limit=600.0)
        begin = time.perf_counter()
        outcomes = dict(engine.each(solve, items)) if workers == 1 or benchmark.enabled else {}
        seconds[workers] = time.perf_counter() - begin
        assert all(isinstance(outcome, bytes) for outcome in outcomes.values())
    benchmark.extra_info["cases_per_second"] = {workers: len(items) / time for workers, time in seconds.items()}
    benchmark.extra_info["efficiency"] = seconds[1] / seconds[2]
    benchmark.pedantic(solve, (items[0],), rounds=1)
