"""Several starts: how many local minima there are, and the best of them."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from occ.errors import Status
from occ.model.presets import omni3
from occ.motion import Circle, Line
from occ.optimal.collocation import STARTS, Collocation
from occ.optimal.singular import layers
from occ.optimal.starts import found_in_words, mean_turning_rate, starts_of
from occ.referee import judge
from occ.task import Limits
from tests.tasks import paper_task


class TestSeveralStarts:
    """The reversed circle, rate +0.4, is known for its traps."""

    def test_find_several_minima_and_keep_the_best(self) -> None:
        task = paper_task(rate=0.4)
        player = Collocation(objective="torque_squared", starts=6)
        solution = player.solve(task)
        minima = solution.statistics["minima"]
        costs = [minimum["cost"] for minimum in minima]
        assert solution.status is Status.OK
        assert len(minima) >= 2
        assert costs == sorted(costs)
        assert costs[1] > 1.2 * costs[0]
        assert solution.statistics["claimed_cost"] == pytest.approx(costs[0], rel=1e-4)
        assert f"{len(minima)} distinct local minima from 6 starts" in solution.message
        assert sum(len(minimum["starts"]) for minimum in minima) <= 6

    def test_find_a_better_one_than_the_law_alone_does(self) -> None:
        task = paper_task(30.0, rate=0.4)
        alone, several = (
            judge(task, Collocation(objective="torque_squared", starts=count).solve(task)) for count in (1, 8)
        )
        assert several.measures["torque_squared_N2m2s"] < 0.99 * alone.measures["torque_squared_N2m2s"]

    def test_are_the_default_where_a_start_takes_milliseconds(self) -> None:
        task = paper_task(30.0, rate=0.4)
        left_out, alone, six = (
            Collocation(objective="torque_squared", tolerance=1e-4, **keys).solve(task)
            for keys in ({}, {"starts": 1}, {"starts": STARTS})
        )
        assert left_out.statistics["claimed_cost"] == six.statistics["claimed_cost"]
        assert left_out.statistics["claimed_cost"] < 0.99 * alone.statistics["claimed_cost"]
        assert f"from {STARTS} starts" in left_out.message
        assert alone.message.endswith("from one start")

    @pytest.mark.parametrize(
        ("objective", "sibling", "measure", "keys"),
        [
            ("torque_squared", "torque_squared", "torque_squared_N2m2s", {"keep": "tube", "radius": 0.01}),
            ("electric_drawn", "electric", "electric_drawn_J", {}),
            ("peak_torque", "torque_squared", "peak_torque_Nm", {}),
        ],
    )
    def test_elsewhere_the_minima_of_the_smooth_problem_on_the_path_are_followed(
        self, objective: str, sibling: str, measure: str, keys: dict[str, Any]
    ) -> None:
        # From the law's start these end at 2.3, 1.4 and 1.9 times of what is least.
        task = paper_task(10.0, rate=0.7, radius=0.4, platform=omni3(), motion=Circle(radius=0.4, rate=0.7))
        smooth = judge(task, Collocation(objective=sibling, tolerance=1e-4).solve(task))
        solution = Collocation(objective=objective, tolerance=1e-3, **keys).solve(task)
        found = judge(task, solution)
        assert found.status is Status.OK, found.message
        assert found.measures[measure] < smooth.measures[measure] * (1 + 1e-3)
        alone = Collocation(objective=objective, tolerance=1e-3, starts=1, **keys).solve(task)
        assert found.measures[measure] < 0.9 * judge(task, alone).measures[measure]
        assert "distinct local minima from" in solution.message
        assert "from one start" in alone.message

    def test_are_not_tried_where_the_law_leads_nowhere(self) -> None:
        task = paper_task(2.0, limits=Limits(torque=0.5))
        solution = Collocation(objective="torque_squared", tolerance=1e-3, iterations=20).solve(task)
        assert solution.status is not Status.OK
        assert solution.statistics["minima"] == []
        # Each start that fails would be one of them.
        assert sum(entry["intervals"] == 16 for entry in solution.statistics["rounds"]) < STARTS

    def test_of_one_minimum_say_so(self) -> None:
        task = paper_task(4.0)
        solution = Collocation(objective="torque_squared", starts=3).solve(task)
        assert "1 distinct local minima from 3 starts" in solution.message

    def test_of_no_minimum_say_so(self) -> None:
        assert "no start leads to a minimum" in found_in_words([], 6)


class TestStarts:
    """The guesses."""

    @pytest.mark.parametrize("count", [1, 2, 3, 4, 9])
    def test_are_as_many_as_asked_for_and_different(self, count: int) -> None:
        starts = starts_of(paper_task(), count, None)
        assert len(starts) == len({start.name for start in starts}) == count
        assert starts[0].name == "law"

    @pytest.mark.parametrize("turn", [None, -2 * np.pi])
    def test_of_a_longer_list_begin_with_those_of_a_shorter_one_and_go_around(self, turn: float | None) -> None:
        task = paper_task()
        names = [[start.name for start in starts_of(task, count, turn)] for count in range(1, 20)]
        for shorter, longer in pairwise(names):
            assert longer[:-1] == shorter
        assert ("law with +1 turn" in names[-1]) is (turn is None)
        headings = [
            start.rotation(np.zeros(1))[0, 0] for start in starts_of(task, 19, turn) if "constant" in start.name
        ]
        gaps = np.diff(np.sort(np.mod(headings[:16], 2 * np.pi)))
        np.testing.assert_allclose(gaps, 2 * np.pi / 16)

    def test_meet_the_turn_that_the_end_asks_for(self) -> None:
        task = paper_task()
        for start in starts_of(task, 5, -2 * np.pi):
            heading = start.rotation(np.array([0.0, task.duration]))[0]
            assert heading[1] - heading[0] == pytest.approx(-2 * np.pi)

    def test_turn_with_the_program(self) -> None:
        assert mean_turning_rate(paper_task()) == -0.4
        assert mean_turning_rate(paper_task(5.0, motion=Line(velocity=(0.2, 0.1)))) == 0.0


class TestLayers:
    """Jumps of the yaw rate in the minimum of the work."""

    def test_are_named_with_the_jump_that_the_kinetic_energy_pays_for(self) -> None:
        task = paper_task()
        solution = Collocation(objective="work").solve(task)
        assert "no curvature in the torques" in solution.message
        assert "at t = 0 s the yaw rate jumps" in solution.message
        assert "at t = 15.71 s the yaw rate jumps" in solution.message

    def test_are_told_from_arcs_by_the_growth_of_the_control_with_the_mesh(self) -> None:
        free, limited, smooth = (
            Collocation(objective=objective).solve(paper_task(limits=limits))
            for objective, limits in (("work", Limits()), ("work", Limits(torque=1.1)), ("torque_squared", Limits()))
        )
        # A jump that is spread over half the interval needs twice the torque, unless a limit holds it.
        assert free.statistics["control_growth"] == pytest.approx(2.0, abs=0.3)
        assert "the control in them grows with the mesh" in free.message
        for solution in (limited, smooth):
            assert solution.statistics["control_growth"] == pytest.approx(1.0, abs=0.05)
            assert "grows" not in solution.message

    def test_grow_steeper_with_the_mesh_while_the_cost_converges(self) -> None:
        task = paper_task()
        coarse, fine = (
            judge(task, Collocation(objective="work", tolerance=tolerance).solve(task)) for tolerance in (1e-5, 1e-7)
        )
        assert fine.measures["peak_torque_Nm"] > 2 * coarse.measures["peak_torque_Nm"]
        assert fine.measures["work_J"] == pytest.approx(coarse.measures["work_J"], rel=1e-5)

    def test_of_a_known_jump(self) -> None:
        edges = np.concatenate([[0.0], np.linspace(0.01, 10.0, 20)])
        rates = np.concatenate([[0.0], np.linspace(0.5, 0.7, 20)])
        (layer,) = layers(edges, rates)
        assert (layer.t, layer.width, layer.jump) == pytest.approx((0.0, 0.01, 0.5))

    def test_a_smooth_rotation_has_none(self) -> None:
        t = np.linspace(0.0, 10.0, 50)
        assert layers(t, np.sin(t)) == []
        solution = Collocation(objective="work", end="periodic", start="free", winding=-1).solve(paper_task())
        assert "without jumps" in solution.message
