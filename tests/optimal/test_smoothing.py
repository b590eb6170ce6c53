"""The copper loss that settles a non-smooth objective: what it costs is what the rows say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from occ.errors import Status
from occ.optimal import cost, smoothing
from occ.optimal.collocation import Collocation
from occ.referee import judge
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
