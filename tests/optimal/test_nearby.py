"""Searches that begin with a solution nearby: nothing is built, the same optima, and what cannot be a beginning."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from occ.errors import InputError, Status
from occ.laws import ServoLaw
from occ.model.presets import omni3, youbot
from occ.optimal.collocation import Collocation
from occ.optimal.nearby import Nearby
from occ.referee import judge
from occ.referee.replay import Replay
from occ.task import Limits, Solution, Task
from tests.tasks import paper_task

DURATION = 3.0


def limited(
    *,
    radius: float = 0.7,
    rate: float = -0.4,
    point: tuple[float, float] = (0.4, 0.05),
    friction: float = 0.11,
    torque: float = 1.1,
    duration: float = DURATION,
) -> Task:
    """Three seconds of the paper's circle, on which a torque limit of 1.1 N m binds."""
    platform = youbot(wheel_friction=friction)
    limits = Limits(torque=torque)
    return paper_task(duration, rate, radius, point=point, platform=platform, limits=limits)


CHANGES: dict[str, dict[str, Any]] = {
    "radius": {"radius": 0.72},
    "rate": {"rate": -0.41},
    "point": {"point": (0.41, 0.05)},
    "friction": {"friction": 0.115},
    "limit": {"torque": 1.12},
}


def refuse_to_build(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on no solver, no function and no derivative is made."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("built again")

    for name in ("nlpsol", "Function", "jacobian", "hessian", "gradient"):
        monkeypatch.setattr(ca, name, refuse)


class TestNothingIsBuilt:
    """A controller that has solved one task solves those nearby with the programs that are there."""

    @pytest.mark.parametrize(
        "keys",
        [
            {"objective": "work"},
            {"objective": "work", "formulation": "full", "tolerance": 1e-5},
            {"objective": "work", "solver": "fatrop"},
            {"objective": "torque_squared", "keep": "tube", "radius": 0.02, "tolerance": 1e-4},
        ],
        ids=["path", "full", "fatrop", "tube"],
    )
    def test_another_radius_rate_point_friction_or_limit_builds_nothing(
        self, keys: dict[str, Any], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        player = Collocation(starts=1, **keys)
        near, first = player.solve(limited()), {}
        assert near.status is Status.OK, near.message
        with monkeypatch.context() as patched:
            refuse_to_build(patched)
            for name, change in CHANGES.items():
                first[name] = player.solve(limited(**change), near)
        for name, solution in first.items():
            task = limited(**CHANGES[name])
            record = judge(task, solution)
            assert record.status is Status.OK, (name, record.message)
            assert "searched from a solution nearby only" in solution.message
        afar, measure = judge(task, player.solve(task)), keys["objective"]
        unit = {"work": "J", "torque_squared": "N2m2s"}[measure]
        tolerance = 2 * keys.get("tolerance", 1e-6)
        least = afar.measures[f"{measure}_{unit}"]
        assert record.measures[f"{measure}_{unit}"] == pytest.approx(least, rel=tolerance)

    def test_compiled_programs_are_there_for_meshes_of_any_size(self, monkeypatch: pytest.MonkeyPatch) -> None:
        player = Collocation(objective="torque_squared", solver="fatrop", compiled=True, starts=1)
        sizes = {each["intervals"] for each in player.solve(limited()).statistics["rounds"]}
        others = set()
        refuse_to_build(monkeypatch)
        for change in CHANGES.values():
            solution = player.solve(limited(**change))
            assert solution.status is Status.OK, solution.message
            assert not any("instead" in each for each in solution.statistics["rounds"])
            others |= {each["intervals"] for each in solution.statistics["rounds"]}
        # Otherwise this would show nothing that the test before does not.
        assert others - sizes


class TestNearby:
    """The motion and the mesh of a solution, on another horizon."""

    def test_mesh_motion_and_torques_are_those_of_the_solution(self) -> None:
        task = limited()
        solution = Collocation(objective="torque_squared", keep="tube", radius=0.02, tolerance=1e-4).solve(task)
        nearby = Nearby.of(solution, task)
        assert solution.control is not None
        assert solution.start_state is not None
        np.testing.assert_allclose(nearby.edges[1:-1], solution.control.knots, rtol=1e-15)
        t = np.linspace(0.0, DURATION, 50)
        state, torque = nearby.motion(t)
        true = Replay(task.platform, solution.control, solution.start_state, DURATION).at(t)
        np.testing.assert_allclose(state, true, atol=1e-6)
        np.testing.assert_allclose(torque, solution.control.torque(t, state), atol=1e-12)
        np.testing.assert_allclose(nearby(t)[:2], state[[2, 5]], atol=1e-12)

    def test_another_horizon_stretches_times_and_rates(self) -> None:
        solution = Collocation(objective="torque_squared", tolerance=1e-4).solve(limited())
        one, other = Nearby.of(solution, limited()), Nearby.of(solution, limited(duration=2 * DURATION))
        t = np.linspace(0.0, DURATION, 20)
        np.testing.assert_allclose(other.edges, 2 * one.edges, rtol=1e-12)
        np.testing.assert_allclose(other(2 * t), one(t) / np.array([[1.0], [2.0], [4.0]]), atol=1e-12)
        state, torque = other.motion(2 * t)
        np.testing.assert_allclose(state[:3], one.motion(t)[0][:3], atol=1e-12)
        np.testing.assert_allclose(state[3:], one.motion(t)[0][3:] / 2, atol=1e-12)
        np.testing.assert_allclose(torque, one.motion(t)[1], atol=1e-12)

    @pytest.mark.parametrize("keep", ["path", "ends"])
    def test_a_longer_horizon_is_reached_from_a_shorter_one(self, keep: str) -> None:
        player = Collocation(objective="torque_squared", keep=keep, tolerance=1e-4)
        task = limited(duration=3.2)
        solution = player.solve(task, player.solve(limited()))
        assert solution.status is Status.OK, solution.message
        alone = player.solve(task)
        claimed = solution.statistics["claimed_cost"]
        assert claimed == pytest.approx(alone.statistics["claimed_cost"], rel=2e-4)

    def test_the_winding_is_kept(self) -> None:
        player = Collocation(objective="work", end="periodic", winding="any", tolerance=1e-4)
        fixed = replace(player, winding=1).solve(paper_task())
        found = player.solve(paper_task(radius=0.72), fixed)
        assert found.status is Status.OK, found.message
        assert found.claim.winding == 1

    @pytest.mark.parametrize(
        "near",
        [
            ServoLaw().solve(paper_task()),
            Solution(control=None, start_state=None, status=Status.INFEASIBLE, message="no way"),
        ],
        ids=["law", "infeasible"],
    )
    def test_what_has_no_motion_is_refused(self, near: Solution) -> None:
        with pytest.raises(InputError, match="near should be a solution that collocation has found"):
            Collocation(objective="work").solve(paper_task(), near)

    def test_another_number_of_wheels_is_refused(self) -> None:
        near = Collocation(objective="torque_squared", tolerance=1e-3, starts=1).solve(limited())
        player = Collocation(objective="torque_squared", keep="tube", radius=0.01)
        with pytest.raises(InputError, match="near should be a solution for 3 wheels, not for 4"):
            player.solve(paper_task(DURATION, platform=omni3()), near)
