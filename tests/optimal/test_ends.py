"""Ends of the horizon: periodic with windings, rest; starts given and free."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from occ.errors import InputError, Status
from occ.model.presets import youbot
from occ.motion import Ellipse, Line
from occ.optimal.collocation import Collocation
from occ.referee import judge
from occ.task import Limits, Start
from tests.tasks import paper_task


class TestPeriodic:
    """Values for one lap at the paper's task, from the issue that asks for these ends (exact minimum work)."""

    def test_with_a_free_start_is_the_steady_rotation_at_the_best_offset(self) -> None:
        task = paper_task()
        solution = Collocation(objective="work", end="periodic", start="free", winding=-1).solve(task)
        record = judge(task, solution)
        assert record.status is Status.OK, record.message
        assert (record.start, record.end) == ("free", "periodic")
        assert record.measures["work_J"] == pytest.approx(194.5082920, abs=5e-8)
        # Steady: the heading keeps its offset to the circle, so the yaw rate is the circle's rate all the time.
        assert solution.claimed is not None
        np.testing.assert_allclose(solution.claimed.state[5], -0.4, atol=1e-6)

    @pytest.mark.parametrize(("winding", "infimum"), [(0, 267.3555642), (-1, 287.3156002)])
    def test_return_to_the_given_start(self, winding: int, infimum: float) -> None:
        task = paper_task()
        solution = Collocation(objective="work", end="periodic", winding=winding).solve(task)
        record = judge(task, solution)
        assert record.status is Status.OK, record.message
        assert infimum - 5e-8 < record.measures["work_J"] < infimum * (1 + 1e-5)
        assert solution.claim.winding == winding
        assert abs(record.measures["kinetic_change_J"]) < 1e-6

    def test_a_phase_that_nothing_determines_is_chosen(self) -> None:
        # Another number of turns than the circle's: a motion that begins later costs the same, whatever comes first.
        keys = {"objective": "torque_squared", "end": "periodic", "start": "free", "winding": 0}
        costs = []
        for heading in (0.3, 2.0):
            task = paper_task(start=Start(heading=heading))
            solution = Collocation(tolerance=1e-7, **keys).solve(task)
            assert judge(task, solution).status is Status.OK, solution.message
            assert solution.start_state is not None
            assert solution.start_state[2] == pytest.approx(heading, abs=1e-12)
            costs.append(solution.statistics["claimed_cost"])
        assert costs[1] == pytest.approx(costs[0], rel=2e-7)

    @pytest.mark.parametrize(
        ("motion", "more"),
        [
            ({}, {"winding": -1}),
            ({}, {"winding": 0, "start": "given"}),
            ({}, {"winding": 0, "keep": "tube", "radius": 0.1}),
            ({"motion": Ellipse(semi_axes=(0.8, 0.4), rate=-0.4)}, {"winding": 0}),
        ],
        ids=["the circle's turns", "given start", "tube", "ellipse"],
    )
    def test_elsewhere_the_phase_is_left_open(self, motion: dict[str, Any], more: dict[str, Any]) -> None:
        keys = {"objective": "work", "end": "periodic", "start": "free"} | more
        formulation = Collocation(**keys).posed(paper_task(**motion), keys["winding"])
        assert formulation is not None
        assert not formulation.phase_is_open
        start, *_ = formulation.end_bounds()
        place = 2 if "keep" in keys else 0
        assert (start.upper - start.lower)[place] == (0.0 if keys["start"] == "given" else 2 * np.pi)

    @pytest.mark.slow
    def test_its_switching_times_stay_from_mesh_to_mesh(self) -> None:
        costs = []
        for heading in (0.0, 1.0):
            task = paper_task(start=Start(heading=heading), limits=Limits(wheel_power=8.0))
            player = Collocation(objective="work", end="periodic", start="free", winding=0)
            solution = player.solve(task)
            record = judge(task, solution)
            assert record.status is Status.OK, record.message
            assert solution.statistics["rounds"][-2]["intervals"] <= 100
            costs.append(record.measures["work_J"])
        # More than without the limit, 267.3555642 J, and the same wherever the motion begins.
        assert costs[0] > 267.3555642
        assert costs[1] == pytest.approx(costs[0], rel=1e-6)

    def test_any_winding_finds_the_better_one(self) -> None:
        task = paper_task()
        solution = Collocation(objective="work", end="periodic", winding="any").solve(task)
        assert solution.claim.winding == 0
        tried = solution.statistics["windings"]
        assert {-2, -1, 0, 1} == set(tried)
        assert tried[0] == min(cost for cost in tried.values() if cost is not None)

    def test_a_false_winding_is_found_by_the_referee(self) -> None:
        task = paper_task()
        solution = Collocation(objective="torque_squared", end="periodic", winding=0).solve(task)
        assert judge(task, solution).status is Status.OK
        record = judge(task, replace(solution, claim=replace(solution.claim, winding=-1)))
        assert record.status is Status.FAILED
        assert "full turns" in record.message

    def test_is_refused_on_a_horizon_that_is_no_whole_lap(self) -> None:
        with pytest.raises(InputError, match="whole number of laps"):
            Collocation(objective="work", end="periodic").solve(paper_task(10.0))

    def test_on_a_line_the_velocity_is_periodic(self) -> None:
        task = paper_task(6.0, motion=Line(velocity=(0.2, 0.0)), start=Start(heading=0.5))
        record = judge(task, Collocation(objective="torque_squared", end="periodic", winding=0).solve(task))
        assert record.status is Status.OK, record.message


class TestFreeStart:
    """An unpaid initial kinetic energy is no optimum."""

    def test_needs_a_periodic_end(self) -> None:
        with pytest.raises(InputError, match="start"):
            Collocation(objective="work", start="free")

    def test_is_refused_by_the_referee_with_another_end(self) -> None:
        task = paper_task()
        solution = Collocation(objective="work", end="periodic", start="free", winding=-1).solve(task)
        record = judge(task, replace(solution, claim=replace(solution.claim, end="free")))
        assert record.status is Status.FAILED
        assert "kinetic energy" in record.message

    def test_winding_needs_a_periodic_end(self) -> None:
        with pytest.raises(InputError, match="winding"):
            Collocation(objective="work", winding=1)


class TestRest:
    """End at rest: B's program and the rotation stop."""

    def test_is_refused_where_the_program_moves_at_the_end(self) -> None:
        with pytest.raises(InputError, match="at rest at t = "):
            Collocation(objective="work", end="rest").solve(paper_task())

    def test_least_torque_to_stop_a_rotation_in_place(self) -> None:
        # B = O = C does not move; only the yaw rate does: I_a Omega' + mu Omega = M_Omega, from Omega_0 to rest at T,
        # with sum M^2 = M_Omega^2 R^2 / (4 (l + h)^2).  The least integral of M_Omega^2 has the Euler equation
        # Omega'' = k^2 Omega, k = mu / I_a: Omega = Omega_0 sinh k(T - t) / sinh kT, and is mu I_a Omega_0^2
        # (coth kT - 1) for M_Omega = I_a Omega' + mu Omega.
        horizon, omega_0 = 0.5, 1.0
        task = paper_task(
            horizon,
            platform=youbot(mass_center=(0.0, 0.0)),
            point=(0.0, 0.0),
            motion=Line(velocity=(0.0, 0.0)),
            start=Start(heading_rate=omega_0),
        )
        arm = 0.150 + 0.235
        inertia = 4.42 + 4 * arm**2 / 0.0475**2 * 5.87e-3
        friction = 4 * 0.110 * arm**2 / 0.0475**2 + 8 * 5.78e-3 * 0.235**2 / 0.014**2
        k = friction / inertia
        moment_squared = friction * inertia * omega_0**2 * (1 / np.tanh(k * horizon) - 1)
        record = judge(task, Collocation(objective="torque_squared", end="rest").solve(task))
        assert record.status is Status.OK, record.message
        least = moment_squared * 0.0475**2 / (4 * arm**2)
        assert record.measures["torque_squared_N2m2s"] == pytest.approx(least, rel=1e-8)
