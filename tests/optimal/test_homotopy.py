"""Least work as the limit of a vanishing copper loss."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import occ
from occ.errors import InputError, Status
from occ.optimal.collocation import Collocation
from occ.optimal.homotopy import CopperLossLimit, copper_loss_limit
from occ.referee import judge
from occ.report.stored import load
from occ.report.words import answer
from occ.task import Limits, Solution
from tests.tasks import LAP, paper_task

PLAYER = Collocation(objective="work", homotopy=True)


# The infima of the errata's check values, known to 12 digits and more.
@pytest.mark.parametrize(
    ("duration", "infimum"),
    [(LAP, 200.327119033710), pytest.param(30.0, 377.321044772185, marks=pytest.mark.slow)],
)
def test_the_limit_is_the_infimum_of_the_work(duration: float, infimum: float) -> None:
    task = paper_task(duration)
    solution = PLAYER.solve(task)
    assert solution.status is Status.OK, solution.message
    found = solution.statistics["copper_loss_limit"]
    assert np.all(np.diff(found["costs_J"]) < 0)
    assert found["costs_J"][-1] > infimum
    # The last cost is 1e-6 above; the limit is closer by far, though the infimum itself is not attained.
    assert found["limit_J"] == pytest.approx(infimum, rel=2e-9)
    assert abs(found["limit_J"] - infimum) < found["uncertainty_J"] < 2e-6
    record = judge(task, solution)
    assert record.status is Status.OK, record.message
    assert infimum < record.measures["work_J"] < infimum * (1 + 1e-5)
    assert f"least work as the copper loss vanishes: {infimum:.3f}" in record.message
    # It is a point of another problem, on the way to the least work.
    assert record.local_objective is None


def test_the_shipped_report_has_the_limit_beside_the_exact_infimum() -> None:
    stored = load(Path(occ.__file__).parents[1] / "reports" / "vanishing_copper_loss")
    sentences = [line for line in answer(stored) if "as the copper loss vanishes" in line]
    for sentence, infimum in zip(sentences, ("200.3271190337", "377.3210447722"), strict=True):
        found = re.search(
            r"tends to ([\d.]+) J .* uncertain by ([\d.e-]+) J\); .* \(\*exact\*\) is ([\d.]+) J", sentence
        )
        assert found, sentence
        limit, uncertainty = float(found[1]), float(found[2])
        assert found[3] == infimum
        assert abs(limit - float(infimum)) <= 1.5 * uncertainty < 3e-6


def test_a_known_series_has_its_constant_as_limit() -> None:
    # J(k) = 7 + 3 k^(1/2) - 2 k + k^(3/2).
    def solve(weights: object) -> Solution:
        k = weights.copper_loss  # type: ignore[attr-defined]  # any object that has one
        cost = 7 + 3 * k**0.5 - 2 * k + k**1.5
        return Solution(control=None, start_state=None, statistics={"claimed_cost": cost})

    found = copper_loss_limit(solve)
    assert isinstance(found, CopperLossLimit)
    assert found.limit == pytest.approx(7.0, abs=1e-11)
    assert abs(found.limit - 7.0) <= found.uncertainty + 1e-12


def test_a_problem_without_a_solution_is_said() -> None:
    solution = PLAYER.solve(paper_task(3.0, limits=Limits(torque=0.2)))
    assert solution.status is Status.INFEASIBLE
    assert "times the copper loss" in solution.message


@pytest.mark.parametrize("objective", ["torque_squared", "positive_work"])
def test_other_objectives_have_no_such_limit(objective: str) -> None:
    with pytest.raises(InputError, match="homotopy should be left out where objective is"):
        Collocation(objective=objective, homotopy=True)
