"""Timings of atlases, run by `make benchmark`: points per second.

Each states the accuracy of what it has timed.  Run without `--benchmark-enable` they only check that answer.
"""

from __future__ import annotations

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from occ.atlas.least_work import least_work_columns
from occ.atlas.long_run import long_run_columns
from occ.atlas.points import Points
from occ.model.presets import youbot
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import yaw_coefficients
from occ.theory.dissipation import circle_energy
from occ.theory.equation import scaled_equation
from occ.theory.law_power import rotations
from occ.theory.long_run import LongRun, long_run
from occ.theory.orbits import one_turn, rotating_orbit

pytestmark = pytest.mark.benchmark
PAPER = yaw_coefficients(youbot(), (0.40, 0.05))


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

    power = benchmark.pedantic(work, rounds=3)
    # R_B = 0.6: 6.4 % above the least mean power.
    least = long_run(circle_energy(PAPER, 0.6, -0.4)).mean_power
    assert 100 * (power[0] / least - 1) == pytest.approx(6.4, abs=0.05)
    # To the tolerance of the motions: against samples of some of their turns.
    for k in range(0, count, count // 10):
        eq = scaled_equation(PAPER, radius[k], rate[k])
        orbit = rotating_orbit(eq)
        assert orbit is not None
        turn = one_turn(eq, orbit)
        dissipation = circle_energy(PAPER, radius[k], rate[k]).dissipation(turn.psi_tilde, turn.yaw_rate)
        assert power[k] == pytest.approx(float(np.sum(turn.share * dissipation)), rel=1e-9)
    assert np.isfinite(power).all()
    if benchmark.enabled:
        benchmark.extra_info["points_per_second"] = count / benchmark.stats.stats.min
        assert benchmark.stats.stats.min < count / 20_000


def test_every_column_of_the_long_run(benchmark: BenchmarkFixture) -> None:
    count = 100_000 if benchmark.enabled else 100
    radius, rate = circles(count, (0.05, 1.5))
    zero = np.zeros(count)
    point = np.array([zero + 0.40, zero + 0.05])
    points = Points(
        4, youbot().parameters()[None], zero.astype(int), point, radius, rate, zero, zero, zero, zero + 10.0
    )
    columns, _ = benchmark.pedantic(long_run_columns, (points,), rounds=1)
    assert columns["law_torque_Nm"][0] == pytest.approx(1.22530952523)


def test_least_work_of_a_finite_horizon(benchmark: BenchmarkFixture) -> None:
    """Law and exact least work of one lap."""
    count = 64 if benchmark.enabled else 2
    radius, rate = circles(count, (0.05, 1.5))
    zero = np.zeros(count)
    start = zero + np.pi / 2
    point, lap = np.array([zero + 0.40, zero + 0.05]), 2 * np.pi / np.abs(rate)
    points = Points(4, youbot().parameters()[None], zero.astype(int), point, radius, rate, start, zero, zero, lap)
    columns, reasons = benchmark.pedantic(least_work_columns, (points,), rounds=1)
    assert reasons == []
    assert columns["law_work_J"][0] == pytest.approx(201.389773055, abs=5e-10)
    assert columns["least_work_J"][0] == pytest.approx(200.32711903371, abs=5e-11)
    if benchmark.enabled:
        benchmark.extra_info["points_per_second"] = count / benchmark.stats.stats.min
