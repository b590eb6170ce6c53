"""The copper loss that settles an objective: what it costs is what the rows say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from occ.errors import Status
from occ.optimal import cost, smoothing
from occ.optimal.collocation import Collocation
from occ.optimal.cost import Aim
from occ.referee import judge
from occ.task import Limits
from tests.optimal.test_non_smooth import DURATION, LENGTH, MASS, STRAIGHT, ZETA
from tests.tasks import paper_task


def least_drawn() -> float:
    """[J] Least work at the bus between the ends of the straight way, with a platform that may jump to its speed.

    The floor takes zeta v^2; what the wheels take up at the end is lost.  So v is constant until t_1, and from there on
    the platform rolls without power, m v' = -zeta v: W = m v^2 / 2 + zeta v^2 t_1.
    """
    rate = ZETA / MASS

    def drawn(t_1: float) -> float:
        speed = LENGTH / (t_1 + (1 - np.exp(-rate * (DURATION - t_1))) / rate)
        return float((MASS / 2 + ZETA * t_1) * speed**2)

    return float(minimize_scalar(drawn, bounds=(0.0, DURATION), method="bounded", options={"xatol": 1e-10}).fun)


@pytest.mark.slow
def test_between_the_ends_it_is_what_the_closed_form_says() -> None:
    solution = Collocation(objective="bus_work", keep="ends", end="rest", tolerance=1e-4).solve(STRAIGHT)
    record = judge(STRAIGHT, solution)
    assert record.status is Status.OK, record.message
    excess = record.measures["bus_work_J"] - least_drawn()
    assert 0.0 < excess < 0.005 * least_drawn()
    assert solution.statistics["copper_loss_share"] == pytest.approx(excess, rel=0.1)
    # At a jump the share falls by half whenever the copper loss is a quarter: three times from 0.03 on.
    assert solution.statistics["copper_loss_factor"] == pytest.approx(0.03 / smoothing.RATIO**smoothing.LEVELS)


POWER = 4.0
"""[W] Limit of each wheel on the straight way."""


def straight_work_with_limited_power() -> float:
    """[J] Least work between the ends of the straight way, at rest there, with all wheels within `POWER`, no turn.

    From rest to rest the floor takes all of it, zeta v^2.  The speed that costs least is constant; to get there and
    back the wheels give and take all they may, m (v^2)' = 2 (+-4 P - zeta v^2), with a force that is unbounded at both
    ends.  A platform that turns, too, brakes a little sooner: wheels that stand may have any torque.
    """
    rate, most = 2 * ZETA / MASS, 4 * POWER / ZETA

    def way_and_work(speed: float) -> tuple[float, float]:
        begin = -np.log(1 - speed**2 / most) / rate
        stop = np.log(1 + speed**2 / most) / rate
        squares = (lambda t: most * (1 - np.exp(-rate * t)), begin), (lambda t: most * np.expm1(rate * t), stop)
        rest = DURATION - begin - stop
        way = rest * speed + sum(quad(lambda t, f=f: np.sqrt(f(t)), 0, end)[0] for f, end in squares)
        return way, ZETA * (rest * speed**2 + sum(quad(f, 0, end)[0] for f, end in squares))

    speed = brentq(lambda v: way_and_work(v)[0] - LENGTH, LENGTH / DURATION, 1.5 * LENGTH / DURATION, xtol=1e-13)
    return way_and_work(speed)[1]


@pytest.mark.parametrize(("levels", "tolerance"), [(0, 1e-3), pytest.param(3, 1e-5, marks=pytest.mark.slow)])
def test_work_with_limited_power_is_between_the_closed_forms(
    levels: int, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(smoothing, "LEVELS", levels)
    task = replace(STRAIGHT, limits=Limits(wheel_power=POWER))
    solution = Collocation(objective="work", keep="ends", end="rest", tolerance=tolerance).solve(task)
    record = judge(task, solution)
    assert record.status is Status.OK, record.message
    assert "limits of wheel power proven between nodes" in record.message
    work, share = record.measures["work_J"], solution.statistics["copper_loss_share"]
    # Without a limit the platform jumps to its speed and from it.
    least, most = ZETA * LENGTH**2 / DURATION, straight_work_with_limited_power()
    assert most < 1.05 * least
    assert least < work < most + share + tolerance * most
    assert share < (2e-3 if levels else 0.02) * work


@pytest.mark.parametrize("limits", [Limits(torque=2.0), Limits(wheel_power=9.0, torque=9.0), Limits(wheel_speed=9.0)])
def test_bounded_torques_need_no_copper_loss(limits: Limits) -> None:
    aim = Aim.single("work")
    assert aim.regularised("ends", limits) == aim
    assert aim.regularised("tube", Limits(wheel_power=9.0)).terms == ("work", "copper_loss")
    assert aim.regularised("path", Limits(wheel_power=9.0)) == aim


def test_no_effort_is_spared_where_it_costs_much(monkeypatch: pytest.MonkeyPatch) -> None:
    task, player = paper_task(2.0), Collocation(objective="bus_work", tolerance=1e-6)
    monkeypatch.setattr(cost, "REGULARISER", 0.03)
    monkeypatch.setattr(smoothing, "LEVELS", 0)
    first = player.solve(task)
    assert first.statistics["copper_loss_factor"] == 0.03
    value, share = first.statistics["without_copper_loss"], first.statistics["copper_loss_share"]
    assert "without any" not in first.message
    monkeypatch.setattr(smoothing, "BEARABLE", 0.1 * share / value)
    second = player.solve(task)
    assert second.statistics["copper_loss_factor"] < 0.03
    assert second.statistics["copper_loss_share"] < 0.1 * share
    monkeypatch.setattr(smoothing, "UTMOST_FINE", 2)
    third = player.solve(task)
    assert third.statistics["copper_loss_factor"] == 0.03
    # What the loss costs is as much as is said, or less.
    limit = float(third.message.split("without any the limit is about ")[1].split(" J")[0])
    assert limit == pytest.approx(value, abs=share / 5)
    assert limit < second.statistics["without_copper_loss"] + 0.1 * share


def test_it_is_lowered_until_it_costs_less_than_the_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    # No jumps here: the torques stay bounded, and what is said of the share is more than it is.
    task, tolerance = paper_task(3.0), 1e-6
    monkeypatch.setattr(cost, "REGULARISER", 0.03)
    lowered = Collocation(objective="bus_work", tolerance=tolerance).solve(task)
    monkeypatch.setattr(smoothing, "LEVELS", 0)
    first = Collocation(objective="bus_work", tolerance=tolerance).solve(task)
    monkeypatch.setattr(cost, "REGULARISER", 1e-4)
    least = judge(task, Collocation(objective="bus_work", tolerance=tolerance).solve(task)).measures["bus_work_J"]
    values = [judge(task, solution).measures["bus_work_J"] for solution in (lowered, first)]
    shares = [solution.statistics["copper_loss_share"] for solution in (lowered, first)]
    assert [solution.statistics["copper_loss_factor"] for solution in (lowered, first)] == [0.03 / 16, 0.03]
    assert shares[0] < tolerance * least < shares[1]
    for value, share in zip(values, shares, strict=True):
        assert least - tolerance * least < value < least + share + tolerance * least
    assert values[1] - least > 10 * shares[0]


def test_a_solution_without_such_a_loss_says_nothing_of_it() -> None:
    solution = Collocation(objective="torque_squared", tolerance=1e-4).solve(paper_task(2.0))
    assert "copper_loss_share" not in solution.statistics
    assert "copper loss" not in solution.message


def test_starts_that_meet_with_more_of_the_loss_are_solved_once_from_there_on() -> None:
    task = paper_task(3.0)
    solution = Collocation(objective="bus_work", tolerance=1e-4, starts=3).solve(task)
    one = Collocation(objective="bus_work", tolerance=1e-4).solve(task)
    assert solution.status is Status.OK, solution.message
    (minimum,) = solution.statistics["minima"]
    # Each on its own, and by way of the powers with their signs.
    assert len(minimum["starts"]) == 6
    # Two more solves of both kinds, and not on each of the levels that follow.
    assert len(solution.statistics["rounds"]) == len(one.statistics["rounds"]) + 4
    assert solution.statistics["claimed_cost"] == pytest.approx(one.statistics["claimed_cost"], rel=1e-9)
