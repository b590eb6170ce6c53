"""Balls of functions on Bernstein ellipses and at points: they hold every value, rounding included."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occ.optimal.enclosure import Balls, Enclosure

EXPRESSIONS: dict[str, Callable[[Any, ModuleType], Any]] = {
    "polynomial": lambda x, _: 1.5 - x * (2.0 + 3.0 * x * x),
    "waves": lambda x, m: m.sin(3.0 * x) * m.cos(x) - 0.3 * m.cos(5.0 * x),
    "quotient": lambda x, _: (x - 0.2) / (7.0 - x) + 1.0 / (x + 8.0),
    "nested": lambda x, m: m.sin(x + 0.5 * m.cos(x * x)) + x + x,
    "square": lambda x, m: -m.cos(x) * m.cos(x) + (x * x) * (x * x),
}


def enclosure_of(expression: Callable[[Any, ModuleType], Any]) -> Enclosure:
    x = ca.SX.sym("x")
    return Enclosure(ca.Function("expression", [x], [expression(x, ca)]))


@pytest.mark.parametrize("expression", EXPRESSIONS.values(), ids=EXPRESSIONS.keys())
class TestDiscs:
    """Against values at complex points."""

    @settings(max_examples=25)
    @given(st.floats(-1.5, 1.5), st.floats(0.0, 0.9), st.integers(0, 2**31))
    def test_hold_every_value(
        self, expression: Callable[[Any, ModuleType], Any], centre: float, radius: float, seed: int
    ) -> None:
        rng = np.random.default_rng(seed)
        angles = rng.uniform(0.0, 2 * np.pi, 200)
        z = centre + radius * np.sqrt(rng.uniform(0.0, 1.0, 200)) * np.exp(1j * angles)
        z[:100] = centre + radius * np.exp(1j * angles[:100])
        (ball,) = enclosure_of(expression).around([Balls(np.array([centre]), np.array([radius]))])
        assert np.all(np.abs(expression(z, np) - ball.centre) <= ball.radius * (1 + 1e-12) + 1e-14)

    def test_are_no_larger_than_the_slope_says_where_they_are_small(
        self, expression: Callable[[Any, ModuleType], Any]
    ) -> None:
        centre, radius = 0.7, 1e-6
        (ball,) = enclosure_of(expression).around([Balls(np.array([centre]), np.array([radius]))])
        # Terms may cancel in the slope, not in the ball.
        assert ball.radius[0] < 60 * radius


@settings(max_examples=40)
@given(st.lists(st.integers(-(10**9), 10**9), min_size=2, max_size=9), st.integers(-(10**6), 10**6))
def test_rounding_is_inside(coefficients: list[int], numerator: int) -> None:
    # Horner's rule in rational arithmetic: numbers are exact, every operation of the balls is rounded.
    x = ca.SX.sym("x")
    value: Any = ca.SX(0.0)
    exact, at = Fraction(0), Fraction(numerator / 7.0)
    for k in coefficients:
        value = value * x + k / 3.0
        exact = exact * at + Fraction(k / 3.0)
    enclosure = Enclosure(ca.Function("horner", [x], [value]))
    (ball,) = enclosure.around([Balls.exact(float(at))])
    distance = abs(exact - Fraction(float(ball.centre)))
    assert distance <= Fraction(float(ball.radius))
    terms = sum(abs(Fraction(k / 3.0)) * abs(at) ** j for j, k in enumerate(reversed(coefficients)))
    assert float(ball.radius) <= 1e-13 * float(terms) + 1e-290


class TestChoices:
    """Between knots a motion is one analytic piece: that of the middle of the panel."""

    def test_are_those_of_the_middle(self) -> None:
        t = ca.SX.sym("t")
        pieces = ca.vertcat(ca.fmin(t, 1.0), ca.fmax(t, 1.0), ca.if_else(t < 1.0, t**2, 5.0), ca.floor(t))
        enclosure = Enclosure(ca.Function("pieces", [t], [pieces]))
        around = enclosure.around([Balls(np.array([0.5, 1.5]), np.array([0.7, 0.7]))])
        np.testing.assert_array_equal([ball.centre for ball in around], [[0.5, 1.0], [1.0, 1.5], [0.25, 5.0], [0, 1]])
        # At the knot and beyond it the piece of the panel goes on.
        at = enclosure.at([Balls(np.array([[0.5, 1.0, 1.2], [0.8, 1.0, 1.5]]), np.zeros((2, 3)))])
        expected = [
            [[0.5, 1.0, 1.2], [1.0, 1.0, 1.0]],
            [[1.0, 1.0, 1.0], [0.8, 1.0, 1.5]],
            [[0.25, 1.0, 1.44], [5.0, 5.0, 5.0]],
            [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]],
        ]
        for ball, wanted in zip(at, expected, strict=True):
            np.testing.assert_allclose(np.broadcast_to(ball.centre, (2, 3)), wanted, rtol=1e-14)

    def test_of_a_pole_or_an_unknown_operation_nothing_is_known(self) -> None:
        x = ca.SX.sym("x")
        enclosure = Enclosure(ca.Function("unknown", [x], [ca.vertcat(1 / x, ca.fabs(x), ca.sin(1 / x))]))
        balls = enclosure.around([Balls(np.array([0.5]), np.array([0.6]))])
        assert all(not np.isfinite(ball.radius).any() for ball in balls)
