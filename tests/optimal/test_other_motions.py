"""The optimal controllers on other motions than the circle, and on a platform with three omni wheels."""

from __future__ import annotations

import math
from functools import cache

import pytest

from occ.errors import Status
from occ.laws import ServoLaw
from occ.model.presets import omni3, youbot
from occ.motion import MOTIONS, Circle, Ellipse, FigureEight, RestToRestLine, SplineMotion
from occ.optimal.collocation import Collocation
from occ.referee import Record, judge
from occ.task import Task
from tests.tasks import POINT

WAY = ((0.0, 0.0), (0.5, 0.3), (1.0, -0.1), (1.2, 0.5))
LOOP = ((0.6, 0.0), (0.1, 0.5), (-0.5, 0.1), (0.0, -0.4), (0.6, 0.0))
TASKS = {
    "ellipse": Task(
        platform=youbot(), point=POINT, motion=Ellipse(semi_axes=(0.7, 0.4), rate=-0.6, tilt=0.4), duration=6.0
    ),
    "figure_eight": Task(
        platform=youbot(), point=POINT, motion=FigureEight(semi_axes=(0.6, 0.3), rate=0.5), duration=7.0
    ),
    "spline": Task(
        platform=youbot(), point=POINT, motion=SplineMotion(points=WAY, times=(0.0, 2.0, 4.0, 7.0)), duration=7.0
    ),
    "closed spline": Task(
        platform=youbot(),
        point=POINT,
        motion=SplineMotion(points=LOOP, times=(0.0, 2.0, 4.0, 6.0, 8.0), closed=True),
        duration=9.0,
    ),
    "rest_to_rest": Task(
        platform=youbot(),
        point=POINT,
        motion=RestToRestLine(start=(0.0, 0.0), end=(0.6, 0.8), duration=4.0),
        duration=5.0,
    ),
    "omni3": Task(
        platform=omni3(),
        point=(0.15, 0.05),
        motion=Circle(radius=0.5, rate=-0.6, phase=math.pi / 2),
        duration=6.0,
    ),
}
COLUMN = {"work": "work_J", "torque_squared": "torque_squared_N2m2s"}


@cache
def of_the_law(name: str) -> Record:
    """The servo law on one of the tasks."""
    return judge(TASKS[name], ServoLaw().solve(TASKS[name]))


def test_every_motion_of_this_project_is_among_the_tasks_or_those_of_the_paper() -> None:
    kinds = {task.motion.kind for task in TASKS.values()} | {"circle", "line"}
    assert kinds == {motion.kind for motion in MOTIONS}


@pytest.mark.parametrize("objective", ["work", "torque_squared"])
@pytest.mark.parametrize("name", TASKS)
def test_the_optimum_is_ok_and_costs_no_more_than_the_law(name: str, objective: str) -> None:
    law = of_the_law(name)
    assert law.status is Status.OK, law.message
    record = judge(TASKS[name], Collocation(objective=objective).solve(TASKS[name]))
    assert record.status is Status.OK, record.message
    assert (record.keep, record.start, record.end) == ("path", "given", "free")
    assert record.measures[COLUMN[objective]] <= law.measures[COLUMN[objective]]


def test_a_straight_way_from_rest_to_rest_has_its_closed_form() -> None:
    # Mass centre and B at O, heading along the way: nothing turns the platform, F = m_a a + zeta v, M_i = F R / 4.
    # With v = (L / T) s'(u), a = (L / T^2) s''(u): int s'^2 du = 10/7, int s''^2 du = 120/7, int s' s'' du = 0.
    length, duration, radius = 1.5, 4.0, 0.0475
    task = Task(
        platform=youbot(mass_center=(0.0, 0.0)),
        point=(0.0, 0.0),
        motion=RestToRestLine(start=(0.0, 0.0), end=(length, 0.0), duration=duration),
        duration=duration,
    )
    mass = 29.94 + 4 * 1.40 + 4 * 5.87e-3 / radius**2
    zeta = 4 * 0.110 / radius**2
    velocity, acceleration = length**2 / duration * 10 / 7, length**2 / duration**3 * 120 / 7
    torque_squared = (mass**2 * acceleration + zeta**2 * velocity) * radius**2 / 4
    law = judge(task, ServoLaw().solve(task))
    assert law.measures["torque_squared_N2m2s"] == pytest.approx(torque_squared, rel=1e-9)
    assert law.measures["work_J"] == pytest.approx(zeta * velocity, rel=1e-9)
    found = judge(task, Collocation(objective="torque_squared").solve(task))
    assert found.status is Status.OK, found.message
    assert found.measures["torque_squared_N2m2s"] == pytest.approx(torque_squared, rel=1e-7)


def test_an_omni_platform_that_carries_b_in_its_middle_does_least_without_turning() -> None:
    # Friction is the same in all directions, so that the heading does not matter and every rotation costs more:
    # W = Z_XX v^2 T with Z_XX = 3/2 (mu_1 / R^2 + mu_2 / r^2); the kinetic energy at constant speed does not change.
    speed, duration = 0.3, 5.0
    task = Task(platform=omni3(), point=(0.0, 0.0), motion=Circle(radius=0.5, rate=speed / 0.5), duration=duration)
    work = 1.5 * (0.020 / 0.050**2 + 2.0e-4 / 0.008**2) * speed**2 * duration
    for player in (ServoLaw(), Collocation(objective="work")):
        record = judge(task, player.solve(task))
        assert record.status is Status.OK, record.message
        assert record.measures["work_J"] == pytest.approx(work, rel=1e-9)
