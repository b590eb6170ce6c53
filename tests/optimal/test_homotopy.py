"""Least work as the limit of a vanishing copper loss."""

from __future__ import annotations

import numpy as np
import pytest

from occ.optimal.collocation import Collocation
from occ.optimal.homotopy import CopperLossLimit, copper_loss_limit
from occ.task import Limits
from tests.tasks import LAP, paper_task


# The infima of the errata's check values, known to 12 digits and more.
@pytest.mark.parametrize(
    ("duration", "infimum"),
    [(LAP, 200.327119033710), pytest.param(30.0, 377.321044772185, marks=pytest.mark.slow)],
)
def test_the_limit_is_the_infimum_of_the_work(duration: float, infimum: float) -> None:
    found = copper_loss_limit(paper_task(duration), Collocation(objective="work", tolerance=1e-8))
    assert isinstance(found, CopperLossLimit), found
    assert np.all(np.diff(found.costs) < 0)
    assert found.costs[-1] > infimum
    # The last cost is 1e-6 above; the limit is closer by far, though the infimum itself is not attained.
    assert found.limit == pytest.approx(infimum, rel=2e-9)
    assert found.uncertainty < 1e-6


def test_a_problem_without_a_solution_is_said() -> None:
    task = paper_task(3.0, limits=Limits(torque=0.2))
    reason = copper_loss_limit(task, Collocation(objective="work"), count=2)
    assert isinstance(reason, str)
    assert "times the copper loss" in reason
