"""Torque ranges from the limits of a task, and arguments that cannot be meant: one clear line each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from occ.allocation import (
    LEAST_NORM,
    ElectricPower,
    TorqueRange,
    WeightedNorm,
    allocate,
    closed_form,
    input_map,
    torque_range,
)
from occ.allocation.osqp_qp import OsqpAllocator
from occ.allocation.ranges import NO_LIMIT
from occ.allocation.reference import Reference
from occ.allocation.result import question
from occ.errors import InputError
from occ.task import Limits
from tests.allocation.wrenches import youbot_map


class TestLimits:
    """What torque, power and voltage leave at a wheel rate."""

    RATES = np.array([[0.0, 5.0, -5.0, 20.0]])

    def test_torque(self) -> None:
        found = torque_range(Limits(torque=1.5, wheel_speed=1.0), self.RATES)
        assert np.all(found.upper == 1.5)
        assert np.all(found.lower == -1.5)

    def test_power(self) -> None:
        found = torque_range(Limits(torque=1.5, wheel_power=6.0), self.RATES)
        np.testing.assert_allclose(found.upper, [[1.5, 1.2, 1.2, 0.3]])
        np.testing.assert_allclose(found.lower, -found.upper)

    def test_voltage_is_less_where_the_motor_drives_and_more_where_it_brakes(self) -> None:
        found = torque_range(Limits(stall_torque=3.0, no_load_speed=10.0), self.RATES)
        np.testing.assert_allclose(found.upper, [[3.0, 1.5, 4.5, -3.0]])
        np.testing.assert_allclose(found.lower, [[-3.0, -4.5, -1.5, -9.0]])

    def test_a_wheel_too_fast_for_its_limit_brakes_as_hard_as_it_can(self) -> None:
        found = torque_range(Limits(torque=1.0, stall_torque=3.0, no_load_speed=10.0), np.array([[20.0, -20.0, 5.0]]))
        np.testing.assert_allclose(found.upper, [[-1.0, 1.0, 1.0]])
        np.testing.assert_allclose(found.lower, [[-1.0, 1.0, -1.0]])

    def test_none(self) -> None:
        assert torque_range(Limits(), self.RATES).upper.min() == NO_LIMIT

    def test_limits_that_are_infinite_are_none(self) -> None:
        wrench = youbot_map().wrench(np.array([[9.0, -3.0, 2.0, 1.0]]).T)
        free = TorqueRange(np.full((4, 1), -np.inf), np.full((4, 1), np.inf))
        np.testing.assert_allclose(allocate(youbot_map(), wrench, free).torque, youbot_map().min_norm @ wrench)

    def test_sides(self) -> None:
        range_ = TorqueRange(np.array([[-1.0], [-1.0], [-1.0]]), np.array([[2.0], [2.0], [2.0]]))
        assert range_.side(np.array([[2.0], [-1.0], [1.9]])).ravel().tolist() == [1, -1, 0]
        assert range_.excess(np.array([[2.5], [-1.25], [0.0]])).tolist() == [0.5]


def ways(wrench: Any, limits: Any, **more: Any) -> list[Callable[[], object]]:
    wheels = youbot_map()
    return [
        lambda: allocate(wheels, wrench, limits, **more),
        lambda: OsqpAllocator(wheels).allocate(wrench, limits),
    ]


def refused(call: Callable[[], object], *words: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


class TestBadInput:
    """Each refused with the name of what is wrong, its value and what would be right."""

    @pytest.mark.parametrize("limit", [0.0, -1.0, np.nan, np.inf, True, "1", None])
    def test_limits(self, limit: Any) -> None:
        for call in ways(np.zeros((3, 1)), limit):
            refused(call, "limit should be a positive finite number of N m", repr(limit))
        refused(lambda: Reference(youbot_map()).solve(np.zeros(3), limit), "limit")

    @pytest.mark.parametrize(
        ("lower", "upper", "words"),
        [
            (np.ones((4, 2)), -np.ones((4, 2)), ("wheel 1 at sample 0", "in this order", "1 and -1")),
            (-np.ones((4, 2)), np.full((4, 2), np.nan), ("wheel 1 at sample 0", "nan")),
            (-np.ones((4, 3)), np.ones((4, 3)), ("limits.lower", "(4, 1) or (4, 2)", "(4, 3)")),
            (-np.ones((3, 1)), np.ones((3, 1)), ("limits.lower", "(3, 1)")),
            (-np.ones((4, 1)), np.ones((4, 2)), ("one shape", "(4, 1)", "(4, 2)")),
            ([-1.0] * 4, [1.0] * 4, ("limits.lower", "(4, 1)")),
        ],
    )
    def test_ranges(self, lower: Any, upper: Any, words: tuple[str, ...]) -> None:
        for call in ways(np.zeros((3, 2)), TorqueRange(lower, upper)):
            refused(call, *words)

    @pytest.mark.parametrize(
        ("wrench", "words"),
        [
            (np.zeros(3), ("wrench", "(3, N)", "(3,)")),
            (np.zeros((4, 2)), ("wrench", "(4, 2)")),
            (np.array([[0.0, 0], [0, np.nan], [0, 0]]), ("wrench should be finite", "sample 1", "nan")),
            (np.array([[np.inf], [0], [0]]), ("finite", "sample 0")),
            ([[1, 2], [3]], ("numbers",)),
            ([["a"], ["b"], ["c"]], ("numbers",)),
        ],
    )
    def test_wrenches(self, wrench: Any, words: tuple[str, ...]) -> None:
        for call in ways(wrench, 1.0):
            refused(call, *words)

    def test_rates(self) -> None:
        wrench = np.zeros((3, 2))
        refused(lambda: allocate(youbot_map(), wrench, 1.0, ElectricPower()), "rates", "rad/s", "ElectricPower")
        for rates in (np.zeros((4, 3)), np.zeros(4), np.zeros((3, 2))):
            refused(lambda r=rates: allocate(youbot_map(), wrench, 1.0, ElectricPower(), r), "rates", "(4, 2)")
        refused(
            lambda: allocate(youbot_map(), wrench, 1.0, ElectricPower(), np.full((4, 2), np.nan)), "rates", "finite"
        )

    def test_weights_of_another_wheel_set(self) -> None:
        norm = WeightedNorm((1.0, 2.0, 3.0))
        refused(lambda: allocate(youbot_map(), np.zeros((3, 1)), 1.0, norm), "weights should be 4 numbers", "not 3")

    def test_closed_form_of_five_wheels(self) -> None:
        wheels = input_map(np.vstack([youbot_map().wheel_rates, [20.0, 0.0, 3.0]]))
        asked = question(wheels, np.zeros((3, 1)), 1.0, LEAST_NORM)
        refused(lambda: closed_form.solve(asked), "three or four wheels, not 5")
