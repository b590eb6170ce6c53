"""Printed digits, the rounding box of (2.17), and the interval that a quantity reaches over it."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occ.model.presets import YouBot, youbot
from occ.paper.audit import preset_of
from occ.paper.numbers import PRINTED_NUMBERS
from occ.paper.printed import PARAMETERS, Box, Printed
from occ.paper.reach import reach


@pytest.mark.parametrize(("text", "half"), [("26.58", 0.005), ("-0.10", 0.005), ("0.1", 0.05), ("3", 0.5)])
def test_half_a_unit_of_the_last_digit(text: str, half: float) -> None:
    assert Printed(text).half == pytest.approx(half, rel=1e-14)


@pytest.mark.parametrize(
    ("value", "holds"), [(0.645, True), (0.6449, False), (0.655, True), (0.6551, False), (-0.65, False)]
)
def test_digits_hold_what_rounds_to_them(value: float, holds: bool) -> None:
    assert Printed("0.65").holds(value) is holds


def test_an_interval_meets_digits_only_where_they_have_a_number_in_common() -> None:
    printed = Printed("0.65")
    assert printed.meets(0.0, 0.6451)
    assert printed.meets(0.6549, 2.0)
    assert printed.meets(0.0, 2.0)
    assert not printed.meets(0.0, 0.6449)
    assert not printed.meets(0.6551, 2.0)


def test_the_parameters_are_those_of_the_platform() -> None:
    assert preset_of(PARAMETERS) == YouBot()


@given(st.lists(st.floats(-1, 1), min_size=12, max_size=12))
def test_the_box_moves_the_platform_as_the_preset_does(u: list[float]) -> None:
    box = Box(PARAMETERS)
    symbol = ca.SX.sym("u", 12)
    numbers = np.array(ca.Function("numbers", [symbol], [box.platform_numbers(symbol)])(u)).ravel()
    keys = dict(zip(PARAMETERS, (box.center + box.half * np.array(u)).tolist(), strict=True))
    center = keys.pop("mass_center_x"), keys.pop("mass_center_y")
    np.testing.assert_allclose(numbers, youbot(mass_center=center, **keys).parameters(), rtol=1e-13, atol=1e-16)


@settings(max_examples=8)
@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.lists(st.floats(-0.9, 0.9), min_size=4, max_size=4))
def test_the_ends_of_a_separable_quantity(slopes: list[float], middles: list[float]) -> None:
    # Linear terms have their extremes at vertices, the convex ones their minima inside and their maxima at vertices.
    u = ca.SX.sym("u", 8)
    a, m = np.array(slopes), np.array(middles)
    found = reach(ca.dot(a, u[:4]) + ca.sumsqr(u[4:] - m), u)
    assert found.nominal == pytest.approx((m**2).sum(), abs=1e-12)
    assert found.low == pytest.approx(-np.abs(a).sum(), abs=1e-7)
    assert found.high == pytest.approx(np.abs(a).sum() + ((1 + np.abs(m)) ** 2).sum(), abs=1e-7)
    assert found.stationary


def test_no_sample_of_the_box_lies_outside_of_what_is_reachable() -> None:
    rng = np.random.default_rng(5)
    u = ca.SX.sym("u", 12)
    numbers = Box(PARAMETERS).platform_numbers(u)
    samples = rng.uniform(-1, 1, (12, 2000)) ** 3
    samples = np.sign(samples) * np.abs(samples) ** (1 / 9)  # crowded towards the faces of the box
    for item in PRINTED_NUMBERS[3:]:
        value = item.value(numbers)
        found = reach(value, u)
        sampled = np.array(ca.Function("value", [u], [value]).map(2000)(samples))
        assert found.low <= sampled.min() < sampled.max() <= found.high, item.quantity
        # The interval is attained: the crowded samples come near to both ends.
        assert np.ptp(sampled) > 0.6 * (found.high - found.low), item.quantity
        assert found.stationary, item.quantity
