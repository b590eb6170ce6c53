"""Roots of many functions at once: known roots, hard functions, and how often each is called."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.theory.roots import MOST_STEPS, Bracket, closed
from tests.strategies import reals


def bracket(function: Callable[[np.ndarray, np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray) -> Bracket:
    ends = np.array([low, high])
    everyone = np.arange(len(low))
    return Bracket(ends, np.array([function(end, everyone) for end in ends]))


@given(st.lists(reals(-5.0, 5.0), min_size=1, max_size=7), st.sampled_from([1.0, -1.0]))
def test_odd_powers_and_steep_steps_have_their_roots_to_rounding(roots: list[float], sign: float) -> None:
    place = np.array(roots)
    power = 1 + 2 * (np.arange(len(roots)) % 3)

    def function(x: np.ndarray, which: np.ndarray) -> np.ndarray:
        return sign * (x - place[which]) ** power[which] * np.exp(3 * x)

    found = closed(function, bracket(function, place - 1.25, place + 2.5))
    assert found == pytest.approx(place, rel=1e-15, abs=1e-15)


def test_of_a_closed_bracket_the_end_that_is_not_negative_is_the_root() -> None:
    # A jump has no root: what is left is the pair of neighbours around it.
    jump = np.array([0.3, np.pi, -2.0 / 3.0])

    def function(x: np.ndarray, which: np.ndarray) -> np.ndarray:
        return np.where(x > jump[which], 1.0, -1.0)

    found = closed(function, bracket(function, jump - 1, jump + 7))
    assert (found > jump).all()
    assert found == pytest.approx(jump, rel=1e-15)


def test_smooth_functions_need_few_calls() -> None:
    calls = []

    def function(x: np.ndarray, which: np.ndarray) -> np.ndarray:
        calls.append(len(x))
        return np.cos(x) - 0.1 * which

    found = closed(function, bracket(function, np.zeros(8), np.full(8, 2.0)))
    assert found == pytest.approx(np.arccos(0.1 * np.arange(8)), rel=1e-15)
    assert len(calls) - 2 <= 10 < MOST_STEPS


def test_a_root_at_an_end_is_kept() -> None:
    low, high = np.array([1.0, 0.0]), np.array([2.0, 1.0])

    def function(x: np.ndarray, which: np.ndarray) -> np.ndarray:
        return np.where(which == 0, x - 1, 1 - x)

    assert closed(function, bracket(function, low, high)) == pytest.approx([1.0, 1.0], rel=1e-15)
