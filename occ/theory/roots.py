"""Roots of many functions at once, each in a bracket of its own, with few calls of NumPy beside those of the function.

Source: Chandrupatla, A new hybrid quadratic/bisection algorithm, Advances in Engineering Software 28 (1997).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

MOST_STEPS = 200
TIGHT = 4e-16
"""Relative width at which a bracket is closed."""
TINY = 1e-290
"""Keeps a slope or a width of zero from dividing."""


class Bracket(NamedTuple):
    """Two ends, and the values there: one positive and one not."""

    x: np.ndarray  # (2, N)
    f: np.ndarray  # (2, N)


def closed(f: Callable[[np.ndarray, np.ndarray], np.ndarray], bracket: Bracket) -> np.ndarray:
    """The roots down to rounding, by inverse quadratic interpolation and bisection.

    Args:
        f: of places (n,) and of the numbers (n,) of the brackets that they belong to.
        bracket: of each root; of the values only the signs have to be exact.

    Returns:
        (N,) the roots: of the two ends of a closed bracket the one at which f is not negative.
    """
    # The third point is the second one as long as there is no other.
    x, values = (item[[0, 1, 1]] for item in bracket)
    root, rows = np.where(values[0] >= 0, x[0], x[1]), np.arange(x.shape[1])
    for _ in range(MOST_STEPS):
        width = np.abs(x[1] - x[0]) + TINY
        least = TIGHT * np.abs(np.where(np.abs(values[0]) < np.abs(values[1]), x[0], x[1])) / width
        left = (least < 0.5) & (values[0] != 0)
        if not left.all():
            rows, x, values, least = rows[left], x[:, left], values[:, left], least[left]
            if not rows.size:
                break
        share = np.minimum(np.maximum(_interpolated(x, values), least), 1 - least)
        place = x[0] + share * (x[1] - x[0])
        here = f(place, rows)
        same = (here > 0) == (values[0] > 0)
        x = np.array([place, np.where(same, x[1], x[0]), np.where(same, x[0], x[1])])
        values = np.array([here, np.where(same, values[1], values[0]), np.where(same, values[0], values[1])])
        root[rows] = np.where(here >= 0, place, x[1])
    return root


def _interpolated(x: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Share of the bracket at which the inverse of a parabola is zero; the middle where that cannot be trusted."""
    with np.errstate(all="ignore"):
        place, level = (x[0] - x[1]) / (x[2] - x[1]), (f[0] - f[1]) / (f[2] - f[1])
        trusted = (level * level < place) & ((1 - level) ** 2 < 1 - place)
        share = f[0] / (f[1] - f[0]) * (f[2] / (f[1] - f[2]))
        share += (x[2] - x[0]) / (x[1] - x[0]) * (f[0] / (f[2] - f[0])) * (f[1] / (f[2] - f[1]))
    return np.where(trusted & np.isfinite(share), share, 0.5)
