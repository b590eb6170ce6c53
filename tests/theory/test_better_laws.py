"""Laws that the theory suggests: gaps to the least work, and motions that they should follow."""

from __future__ import annotations

import math

import pytest

from occ.allocation import Weighted
from occ.errors import InputError, Status
from occ.laws import ServoLaw
from occ.motion import Line
from occ.referee import judge
from occ.task import Task
from occ.theory.better_laws import BestOffset, SlowManifold
from occ.theory.coefficients import yaw_coefficients
from occ.theory.dissipation import circle_energy
from occ.theory.long_run import long_run
from occ.theory.minimum_work import minimum_work
from tests.tasks import LAP, paper_task


def work(player: object, task: Task) -> float:
    record = judge(task, player.solve(task))
    assert record.status is Status.OK, record.message
    return record.measures["work_J"]


def test_best_offset_needs_the_least_power_of_all_steady_rotations() -> None:
    # errata: best steady rotation, 12.3827824586 W.
    task = paper_task()
    assert work(BestOffset(), task) == pytest.approx(12.3827824586 * LAP, rel=1e-11)
    assert BestOffset().start(task).heading == pytest.approx(1.1488, abs=5e-5)


@pytest.mark.parametrize(
    ("duration", "rate", "percent"), [(LAP, -0.4, 0.01), (30.0, -0.4, 0.005), (LAP, 0.4, 0.02), (30.0, 0.4, 0.05)]
)
def test_slow_manifold_is_closer_to_the_least_work_than_the_law(duration: float, rate: float, percent: float) -> None:
    # One lap in the other direction is too short for the steady rotation: its manifold is 2.1 % above the least work.
    task = paper_task(duration, rate=rate)
    least = minimum_work(task).work
    gap = 100 * (work(SlowManifold(), task) / least - 1)
    assert 0 < gap < percent
    assert gap < 100 * (work(ServoLaw(), task) / least - 1)


def test_slow_manifold_keeps_turning_on_small_circles() -> None:
    # Two horizons: what the start costs falls out of the difference.
    radius = 0.3
    works = [work(SlowManifold(), paper_task(duration, radius=radius)) for duration in (20.0, 60.0)]
    energy = circle_energy(yaw_coefficients(paper_task().platform, (0.40, 0.05)), radius, -0.4)
    mean = float(long_run(energy).mean_power)
    swing = 4 * math.hypot(float(energy.drag[1]), float(energy.drag[2])) / 40.0
    assert (works[1] - works[0]) / 40.0 == pytest.approx(mean, abs=swing)


def test_slow_manifold_takes_the_cheaper_way_when_the_direction_of_travel_is_reversed() -> None:
    task = paper_task(100.0, rate=0.4)
    gap = 100 * (work(SlowManifold(), task) / minimum_work(task).work - 1)
    assert 0 < gap < 0.02


@pytest.mark.parametrize("law", [BestOffset(), SlowManifold()])
def test_only_a_circle_has_these_laws(law: BestOffset | SlowManifold) -> None:
    task = paper_task(motion=Line(velocity=(0.1, 0.0), start=(0.0, 0.0)))
    with pytest.raises(InputError, match="circle"):
        law.check(task)


@pytest.mark.parametrize("law", [BestOffset, SlowManifold])
def test_what_the_allocation_refuses_is_refused_before_anything_runs(law: type[BestOffset | SlowManifold]) -> None:
    with pytest.raises(InputError, match="weights should be 4 numbers"):
        law(allocation=Weighted(weights=(1.0, 2.0, 3.0))).check(paper_task())
