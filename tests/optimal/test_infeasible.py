"""Contradicting limits: named only where they do contradict each other, and with a number that is enough."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from occ.errors import Status
from occ.optimal.collocation import Collocation
from occ.optimal.elastic import Violation, away
from occ.optimal.problem import Row
from occ.referee import judge
from occ.task import Limits, Solution
from tests.tasks import paper_task


def solved(limits: Limits, **keys: Any) -> Solution:
    return Collocation(**({"objective": "torque_squared", "tolerance": 1e-4} | keys)).solve(paper_task(limits=limits))


def needed(message: str) -> float:
    """The number that the first condition is said to need."""
    found = re.search(r"needs (-?[\d.e+-]+) ", message)
    assert found is not None, message
    return abs(float(found[1]))


@pytest.mark.parametrize(("objective", "limit"), [("work", 7.7), ("torque_squared", 7.68)])
def test_a_motion_within_the_limits_is_found_where_the_first_start_leads_nowhere(objective: str, limit: float) -> None:
    limits = Limits(wheel_speed=limit)
    record = judge(paper_task(limits=limits), solved(limits, objective=objective))
    assert record.status is Status.OK, record.message


@pytest.mark.parametrize(
    ("quantity", "limit"),
    [
        ("torque", 0.8),
        pytest.param("wheel_speed", 7.6, marks=pytest.mark.slow),
        pytest.param("wheel_power", 4.9, marks=pytest.mark.slow),
        pytest.param("torque_rate", 0.15, marks=pytest.mark.slow),
    ],
)
def test_the_number_that_is_needed_is_enough_and_less_is_not(quantity: str, limit: float) -> None:
    refused = solved(Limits(**{quantity: limit}))
    assert refused.status is Status.INFEASIBLE, refused.message
    number = needed(refused.message)
    # What is needed at the nodes has to hold between them, too; a rate that jumps does so on a fine mesh only, so
    # that the number for it is known less exactly.
    slack = 0.01 if quantity == "torque_rate" else 1e-4
    assert solved(Limits(**{quantity: number * (1 + slack)})).status is Status.OK
    assert solved(Limits(**{quantity: number * (1 - 2e-3)})).status is Status.INFEASIBLE


def test_a_speed_limit_is_relaxed_as_such_and_not_as_its_square() -> None:
    # With B on its circle and one turn the slowest O is as near to the centre as it can be, all the time.
    slowest = 0.4 * (0.70 - np.hypot(0.40, 0.05))
    keys = {"end": "periodic", "start": "free", "winding": -1}
    refused = solved(Limits(platform_speed=0.1), **keys)
    assert refused.status is Status.INFEASIBLE
    assert f"platform speed needs {away(slowest, up=True):.4g} m/s at t = " in refused.message
    assert "; limit 0.1;" in refused.message
    part = float(refused.message.split("wider by ")[1].split(" %")[0]) / 100
    assert 0.1 * (1 + part) == pytest.approx(slowest, rel=1e-3)
    assert solved(Limits(platform_speed=slowest * (1 + 1e-3)), **keys).status is Status.OK


class TestGivenEnds:
    """What no torque can change is said at once."""

    def test_speeds_of_the_start(self) -> None:
        # Heading 0, no yaw rate: O is as fast as B, whose program moves with 0.28 m/s in the direction of x.
        refused = solved(Limits(platform_speed=0.1, wheel_speed=4.0))
        assert refused.status is Status.INFEASIBLE
        assert "platform speed needs 0.28 m/s at t = 0 s; limit 0.1" in refused.message
        assert f"wheel 1 speed needs {away(0.28 / 0.0475, up=True):.4g} rad/s at t = 0 s; limit 4" in refused.message
        assert refused.message.endswith("where the start is given")
        assert "rounds" not in refused.statistics
        assert solved(Limits(platform_speed=0.28)).status is Status.OK

    def test_speeds_of_the_laws_end(self) -> None:
        task = paper_task(limits=Limits(wheel_speed=30.0))
        player = Collocation(objective="torque_squared", end="law", tolerance=1e-4)
        law = player.posed(task)
        assert law is not None
        assert law.settings.ends.law_end is not None
        rates = np.abs(np.array(task.dynamics.coefficients.wheel_rates) @ law.settings.ends.law_end[3:])
        start = 0.28 / 0.0475
        assert rates.max() > 1.01 * start
        refused = solved(Limits(wheel_speed=0.995 * rates.max()), end="law")
        assert f"needs {away(rates.max(), up=True):.4g} rad/s at t = " in refused.message
        assert refused.message.endswith("where the law's end is asked for")


@pytest.mark.parametrize(("value", "bound", "words"), [(1.09004, 0.9, "1.091"), (-1.09004, -0.9, "-1.091")])
def test_printed_numbers_are_wide_enough(value: float, bound: float, words: str) -> None:
    assert f"needs {words} N m" in str(Violation(Row("torque", "N m", 1), value, bound, 0.0, 0.2))
    assert away(0.0, up=True) == 0.0
