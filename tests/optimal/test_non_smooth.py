"""Objectives with kinks in exact slack form, the largest torque, and weighted sums."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from occ.errors import InputError, Status
from occ.model.presets import youbot
from occ.motion import RestToRestLine
from occ.objectives import COPPER_LOSS, objective
from occ.optimal.collocation import Collocation
from occ.optimal.cost import Aim, Weights
from occ.referee import judge
from occ.task import Limits, Task
from tests.tasks import paper_task

INFIMUM = 200.327119033710
"""[J] Least signed work of one lap, free end, from the check values of the errata."""

# Mass centre and B at O, heading along the way: F = m a + zeta v, M_i = F R / 4 and P_i = F v / 4, all wheels alike, so
# that no null torque and no rotation helps.  Little friction, so that the wheels brake in the second half.
LENGTH, DURATION, RADIUS, FRICTION = 1.5, 4.0, 0.0475, 0.011
MASS = 29.94 + 4 * 1.40 + 4 * 5.87e-3 / RADIUS**2
ZETA = 4 * FRICTION / RADIUS**2
STRAIGHT = Task(
    platform=youbot(mass_center=(0.0, 0.0), wheel_friction=FRICTION),
    point=(0.0, 0.0),
    motion=RestToRestLine(start=(0.0, 0.0), end=(LENGTH, 0.0), duration=DURATION),
    duration=DURATION,
)


class TestEasierAims:
    """What a search begins with."""

    def test_first_without_clipping_then_with_less_and_less_copper_loss(self) -> None:
        aim = Aim.weighted(Weights(positive_work=2.0, absolute_work=3.0, electric_drawn=4.0)).regularised(
            "tube", Limits()
        )
        signed, *rougher = aim.easier()
        assert signed.terms == ("work", "electric", "copper_loss")
        largest = max(5.0, rougher[0].weights[-1])
        assert signed.weights == pytest.approx((5 / largest, 4 / largest, rougher[0].weights[-1] / largest))
        assert [each.terms for each in rougher] == [aim.terms] * 2
        assert rougher[0].weights[-1] > rougher[1].weights[-1] > aim.weights[-1]

    def test_of_the_largest_torque(self) -> None:
        assert Aim.single("peak_torque").regularised("path", Limits()).easier()[0] == Aim(("copper_loss",), (1.0,))

    @pytest.mark.parametrize("name", ["work", "torque_squared", "electric"])
    def test_of_what_is_smooth(self, name: str) -> None:
        assert Aim.single(name).regularised("tube", Limits()).easier() == []


def way(t: float) -> tuple[float, float]:
    """Speed and force of the straight way."""
    u = t / DURATION
    speed = LENGTH / DURATION * 30 * u**2 * (1 - u) ** 2
    acceleration = LENGTH / DURATION**2 * 60 * u * (1 - u) * (1 - 2 * u)
    return speed, MASS * acceleration + ZETA * speed


def electric_power(t: float) -> float:
    speed, force = way(t)
    return force * speed + COPPER_LOSS * (force * RADIUS) ** 2 / 4


def positive_part(power: Callable[[float], float]) -> float:
    """Integral of max(power, 0) over the pieces between the sign changes."""
    times = np.linspace(0.0, DURATION, 2001)[1:-1]
    values = np.array([power(t) for t in times])
    changes = np.flatnonzero(values[1:] * values[:-1] < 0)
    edges = [0.0, *[brentq(power, times[k], times[k + 1], xtol=1e-14) for k in changes], DURATION]
    pieces = [quad(power, a, b, epsabs=1e-12)[0] for a, b in pairwise(edges)]
    return sum(max(piece, 0.0) for piece in pieces)


def mechanical_power(t: float) -> float:
    speed, force = way(t)
    return force * speed


def closed_form(name: str) -> float:
    if name == "electric_drawn":
        return positive_part(electric_power)
    if name == "peak_torque":
        times = np.linspace(0.0, DURATION, 400_001)
        return max(abs(way(t)[1]) for t in times) * RADIUS / 4
    return positive_part(mechanical_power)


class TestStraightWay:
    """Closed forms, with the sign of the power changing once."""

    @pytest.mark.parametrize("formulation", ["reduced", pytest.param("full", marks=pytest.mark.slow)])
    @pytest.mark.parametrize("name", ["positive_work", "bus_work", "peak_torque"])
    def test_has_its_closed_form(self, name: str, formulation: str) -> None:
        solution = Collocation(objective=name, formulation=formulation).solve(STRAIGHT)
        record = judge(STRAIGHT, solution)
        assert record.status is Status.OK, record.message
        assert record.measures[objective(name).column] == pytest.approx(closed_form(name), rel=2e-6)
        assert record.local_objective == name
        if name != "peak_torque":
            # One of p and p - P vanishes at every node.
            assert solution.statistics["complementarity_W"] < 1e-3

    @pytest.mark.slow
    def test_electric_energy_that_is_not_returned_is_better_spent_on_a_rotation(self) -> None:
        # The wheels brake with energy that would be lost: the straight way is no optimum, but nearly one.
        # Each to its tolerance of its own mesh: the agreement asked for is an order finer than the default.
        players = [
            Collocation(objective="electric_drawn", formulation=name, tolerance=1e-7) for name in ("reduced", "full")
        ]
        one, other = (judge(STRAIGHT, player.solve(STRAIGHT)).measures["electric_drawn_J"] for player in players)
        assert other == pytest.approx(one, rel=1e-7)
        assert closed_form("electric_drawn") * (1 - 1e-5) < one < closed_form("electric_drawn")

    @pytest.mark.slow
    def test_a_tight_tolerance_is_reached(self) -> None:
        # Every pair p, p - P is overpaid by the last barrier parameter; without a smaller one for a tighter tolerance
        # the error between nodes would grow with the mesh, from 2e-8 on.
        solution = Collocation(objective="electric_drawn", tolerance=1e-8).solve(STRAIGHT)
        record = judge(STRAIGHT, solution)
        assert record.status is Status.OK, record.message
        assert solution.statistics["error"] <= 1e-8
        loose = judge(STRAIGHT, Collocation(objective="electric_drawn").solve(STRAIGHT))
        assert loose.measures["electric_drawn_J"] == pytest.approx(record.measures["electric_drawn_J"], rel=2e-6)
        # Slacks over the powers that they stand for, summed over the nodes: what the error contains.
        assert max(r["intervals"] for r in solution.statistics["rounds"]) < 400

    @pytest.mark.slow
    def test_absolute_work_turns_to_brake_by_friction(self) -> None:
        # Work that the wheels take up counts, too: the floor's friction in a rotation is a cheaper brake.
        record = judge(STRAIGHT, Collocation(objective="absolute_work", tolerance=1e-3).solve(STRAIGHT))
        assert record.status is Status.OK, record.message
        straight = 2 * closed_form("positive_work") - quad(mechanical_power, 0.0, DURATION)[0]
        assert closed_form("positive_work") < record.measures["absolute_work_J"] < straight

    def test_differs_from_the_signed_work(self) -> None:
        assert closed_form("bus_work") > 1.3 * quad(mechanical_power, 0.0, DURATION)[0]


class TestCircle:
    """The paper's task, one lap."""

    def test_work_at_the_bus_is_the_least_signed_work(self) -> None:
        # It is never less, and here the total power stays positive but for the jump at the end.
        task = paper_task()
        solution = Collocation(objective="bus_work", tolerance=1e-6).solve(task)
        record = judge(task, solution)
        assert record.status is Status.OK, record.message
        # The added copper loss costs what the row says; the rest is the error between the nodes.
        excess, share = record.measures["bus_work_J"] - INFIMUM, solution.statistics["copper_loss_share"]
        assert 0.0 < share < excess < share + 1e-6 * INFIMUM
        assert f"raises the objective by about {share:.2g} J" in record.message

    @pytest.mark.slow
    def test_least_positive_work_is_near_the_least_signed_work(self) -> None:
        # With null torques the braking of single wheels can nearly be avoided.
        task = paper_task()
        record = judge(task, Collocation(objective="positive_work", tolerance=1e-5).solve(task))
        assert record.status is Status.OK, record.message
        assert INFIMUM < record.measures["positive_work_J"] < INFIMUM * (1 + 1e-4)

    def test_least_largest_torque_is_where_limits_become_infeasible(self) -> None:
        task = paper_task()
        record = judge(task, Collocation(objective="peak_torque").solve(task))
        assert record.status is Status.OK, record.message
        least = record.measures["peak_torque_Nm"]
        inside, outside = (paper_task(limits=Limits(torque=least * part)) for part in (1.002, 0.998))
        player = Collocation(objective="torque_squared", tolerance=1e-4)
        assert judge(inside, player.solve(inside)).status is Status.OK
        assert player.solve(outside).status is Status.INFEASIBLE


class TestWeighted:
    """Sums of objectives."""

    def test_work_and_copper_loss_are_electric(self) -> None:
        task = paper_task(4.0)
        weights = Weights(work=1.0, copper_loss=1.0)
        one, other = (
            judge(task, player.solve(task)).measures["electric_J"]
            for player in (Collocation(objective="electric"), Collocation(objective="weighted", weights=weights))
        )
        assert other == pytest.approx(one, rel=1e-9)

    def test_a_heavier_torque_buys_less_torque_for_more_work(self, monkeypatch: pytest.MonkeyPatch) -> None:
        import casadi as ca

        task = paper_task(4.0)
        front = []
        for k, weight in enumerate((0.01, 0.1, 1.0)):
            player = Collocation(
                objective="weighted", weights=Weights(work=1.0, torque_squared=weight), intervals=32, tolerance=1e-4
            )
            record = judge(task, player.solve(task))
            assert record.status is Status.OK, record.message
            assert record.local_objective is None
            front.append([record.measures[name] for name in ("work_J", "torque_squared_N2m2s")])
            if not k:
                # Another weight is a number: nothing is built again.
                monkeypatch.setattr(ca, "nlpsol", None)
        work, torque = np.diff(np.array(front), axis=0).T
        assert np.all(work > 0)
        assert np.all(torque < 0)

    @pytest.mark.parametrize("keys", [{"objective": "weighted"}, {"objective": "work", "weights": Weights(work=1.0)}])
    def test_weights_go_with_the_weighted_objective(self, keys: dict[str, object]) -> None:
        with pytest.raises(InputError, match="weights"):
            Collocation(**keys)

    def test_weights_that_are_all_zero_or_negative_are_refused(self) -> None:
        with pytest.raises(InputError, match="all are zero"):
            Weights()
        with pytest.raises(InputError, match="work should be"):
            Weights(work=-1.0)
