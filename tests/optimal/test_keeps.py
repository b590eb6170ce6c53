"""Every objective with every way of keeping B's program, on every motion; ends and tubes as the torques hold them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from occ.errors import Status
from occ.model.presets import omni3, youbot
from occ.motion import Circle, Ellipse, FigureEight, RestToRestLine, SplineMotion
from occ.objectives import OBJECTIVES
from occ.optimal.collocation import Collocation
from occ.optimal.formulation import Formulation
from occ.referee import Record, examine, judge
from occ.task import Limits, Task
from occ.theory.dynamic_programming import DynamicProgram, least_work
from tests.tasks import POINT, paper_task

RADIUS = 0.02
MOTIONS = {
    "ellipse": (Ellipse(semi_axes=(0.7, 0.4), rate=-0.6, tilt=0.4), 4.0),
    "figure_eight": (FigureEight(semi_axes=(0.6, 0.3), rate=0.5), 4.0),
    "spline": (SplineMotion(points=((0.0, 0.0), (0.5, 0.3), (1.0, -0.1), (1.2, 0.5)), times=(0.0, 1.5, 3.0, 5.0)), 5.0),
    "rest_to_rest": (RestToRestLine(start=(0.0, 0.0), end=(0.6, 0.8), duration=4.0), 4.0),
}
PATIENCE = {"tolerance": 1e-4, "seconds": 600.0}
"""Short horizons and a coarse tolerance: what is looked for is failures, not digits."""


def task_of(name: str) -> Task:
    motion, duration = MOTIONS[name]
    return Task(platform=youbot(), point=POINT, motion=motion, duration=duration)


def solved(task: Task, objective: str, keep: str) -> Record:
    radius = RADIUS if keep == "tube" else None
    return judge(task, Collocation(objective=objective, keep=keep, radius=radius, **PATIENCE).solve(task))


CELLS = [
    pytest.param("figure_eight", "bus_work", ("path", "tube", "ends"), marks=pytest.mark.slow),
    pytest.param("figure_eight", "absolute_work", ("path",)),
    *[
        pytest.param(name, objective, ("path", "ends"), marks=pytest.mark.slow)
        for name, objective in (
            ("figure_eight", "positive_work"),
            ("spline", "positive_work"),
            ("rest_to_rest", "positive_work"),
            ("rest_to_rest", "electric_drawn"),
        )
    ],
    *[
        pytest.param(name, objective, ("path", "tube", "ends"), marks=pytest.mark.slow)
        for name, objective in (
            ("ellipse", "electric_drawn"),
            ("figure_eight", "electric"),
            ("figure_eight", "electric_drawn"),
        )
    ],
]


@pytest.mark.parametrize(("name", "objective", "keeps"), CELLS)
def test_less_to_keep_costs_no_more(name: str, objective: str, keeps: tuple[str, ...]) -> None:
    task = task_of(name)
    costs = []
    for keep in keeps:
        record = solved(task, objective, keep)
        assert record.status is Status.OK, f"{keep}: {record.message}"
        assert record.keep == keep
        costs.append(record.measures[OBJECTIVES[objective].column])
    # The path may leave its end as it likes; `ends` has B's velocity there, and so has the path.
    assert all(after < before * (1 + 1e-4) for before, after in pairwise(costs))


@pytest.mark.parametrize(("keep", "end"), [("tube", "free"), ("ends", "free"), ("tube", "law")])
def test_torques_of_a_coarse_solution_hold_what_is_claimed(keep: str, end: str) -> None:
    # The polynomials hold the tube and hit the end anyway; what the torques make of it is off by the error between
    # the nodes, far more than the referee lets pass.
    task = paper_task(4.0)
    radius = RADIUS if keep == "tube" else None
    coarse = {"tolerance": 1e-2, "intervals": 6, "degree": 3}
    if end == "free" and keep == "tube":
        coarse = {"tolerance": 1e-3, "intervals": 8}
    player = Collocation(objective="torque_squared", keep=keep, radius=radius, end=end, **coarse)
    verdict = examine(task, player.solve(task))
    assert verdict.record.status is Status.OK, verdict.record.message
    assert verdict.record.measures["replay_error_m"] < 1e-8


@pytest.mark.slow
def test_positive_work_in_a_tube_needs_a_soft_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    task = paper_task(4.0)
    keys = {"objective": "positive_work", "keep": "tube", "radius": RADIUS, "tolerance": 1e-3}
    soft = Collocation(**keys).solve(task)
    assert judge(task, soft).status is Status.OK
    monkeypatch.setattr(Formulation, "easier", lambda _: [])
    hard = Collocation(**keys).solve(task)
    assert soft.statistics["claimed_cost"] < hard.statistics.get("claimed_cost", math.inf) * (1 + 1e-4)
    iterations = [max(entry["iterations"] for entry in s.statistics["rounds"]) for s in (soft, hard)]
    assert 2 * iterations[0] < iterations[1]


class TestTorqueRate:
    """|dM/dt| with the torques as states of the full formulation."""

    @pytest.mark.slow
    def test_binds_alike_in_both_formulations(self) -> None:
        # Velocity and acceleration of B at every collocation point: the velocity alone leaves a problem of index 3.
        task = paper_task(4.0, limits=Limits(torque_rate=0.3))
        free = Collocation(objective="torque_squared", tolerance=1e-4)
        unlimited = judge(paper_task(4.0), free.solve(paper_task(4.0))).measures["torque_squared_N2m2s"]
        found = []
        for formulation in ("reduced", "full"):
            keys = {"tolerance": 1e-4, "seconds": 600.0}
            record = judge(task, Collocation(objective="torque_squared", formulation=formulation, **keys).solve(task))
            assert record.status is Status.OK, f"{formulation}: {record.message}"
            found.append(record.measures["torque_squared_N2m2s"])
        assert found[1] == pytest.approx(found[0], rel=2e-6)
        assert found[0] > unlimited * (1 + 1e-4)

    @pytest.mark.slow
    def test_binds_in_a_tube(self) -> None:
        limit = 2.0
        task = paper_task(4.0, limits=Limits(torque_rate=limit))
        player = Collocation(objective="torque_squared", keep="tube", radius=RADIUS, tolerance=1e-4, seconds=600.0)
        verdict = examine(task, player.solve(task))
        assert verdict.record.status is Status.OK, verdict.record.message
        assert verdict.replay is not None
        t = np.linspace(0.0, task.duration, 50_001)
        rates = np.abs(np.diff(verdict.replay.sample(t).torque, axis=1) / np.diff(t))
        assert 0.99 * limit < rates.max() <= limit * (1 + 1e-5)


class TestThreeOmniWheels:
    """Friction alike in all directions: Z_XX = 3/2 (mu_1 / R^2 + mu_2 / r^2), Z_33 = 3 mu_1 L^2 / R^2."""

    RATE = -0.6
    TASK = Task(
        platform=omni3(),
        point=(0.15, 0.05),
        motion=Circle(radius=0.5, rate=RATE, phase=math.pi / 2),
        duration=2 * math.pi / abs(RATE),
    )

    def test_the_best_rotation_has_the_centre_on_the_smallest_circle(self) -> None:
        friction = 1.5 * (0.020 / 0.050**2 + 2.0e-4 / 0.008**2)
        turning = 3 * 0.020 * 0.200**2 / 0.050**2
        smallest = 0.5 - math.hypot(*self.TASK.point)
        work = self.RATE**2 * (friction * smallest**2 + turning) * self.TASK.duration
        player = Collocation(objective="work", end="periodic", start="free", winding=-1)
        record = judge(self.TASK, player.solve(self.TASK))
        assert record.status is Status.OK, record.message
        assert record.measures["work_J"] == pytest.approx(work, rel=1e-8)

    def test_from_the_given_start_dynamic_programming_finds_no_less(self) -> None:
        record = judge(self.TASK, Collocation(objective="work").solve(self.TASK))
        program = least_work(self.TASK, DynamicProgram(steps=10, levels=3, points=240))
        assert record.measures["work_J"] == pytest.approx(program.work, rel=2e-6)
