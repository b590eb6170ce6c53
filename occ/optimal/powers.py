"""Polynomials (m, N, d) of x = 2 s - 1 in each of N intervals, by their coefficients of 1, x, .. x^(d - 1)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from math import comb

import numpy as np

UNIT = 2.0**-50
"""Eight rounding errors: an operation's own, four units in the last place at most, and those of a bound of it."""


def values_at(powers: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(m, N, p) Values at the places x (p,) in [-1, 1]."""
    return np.asarray(powers @ x ** np.arange(powers.shape[2])[:, None])


def size_of(powers: np.ndarray) -> np.ndarray:
    """(m, N) Sum of |coefficients|: no value on the interval is larger."""
    return np.asarray(np.abs(powers).sum(axis=2))


def chebyshev_coefficients(values: np.ndarray) -> np.ndarray:
    """(.., p) Coefficients in Chebyshev polynomials from values (.., p) at the places -cos(pi k / (p - 1)).

    Source: Trefethen, Approximation Theory and Approximation Practice, chapter 3.
    """
    degree = values.shape[-1] - 1
    j = np.arange(degree + 1)
    halves = np.where((j == 0) | (j == degree), 0.5, 1.0)
    # T_j(-x) = (-1)^j T_j(x): the places run from -1 to 1.
    signs = (-1.0) ** j
    return np.asarray(
        values @ (2 / degree * np.cos(np.pi * np.outer(j, j) / degree) * np.outer(halves, halves * signs))
    )


def lebesgue(degree: int) -> float:
    """2 / pi log(n + 1) + 1: a polynomial is at most so many times its largest value at the n + 1 Chebyshev points.

    Source: Trefethen, Approximation Theory and Approximation Practice, theorem 15.2.
    """
    return float(2 / np.pi * np.log(degree + 1) + 1)


def through(values: np.ndarray) -> np.ndarray:
    """(m, N, p) Polynomials of degree p - 1 with values (m, N, p) at the places -cos(pi k / (p - 1)).

    By way of Chebyshev polynomials, whose own coefficients are whole numbers: the equations of the powers would lose
    half of the digits.
    """
    return np.asarray(chebyshev_coefficients(values) @ _whole(values.shape[-1]))


@cache
def _whole(count: int) -> np.ndarray:
    """Coefficients of the first Chebyshev polynomials, one a row."""
    whole = np.zeros((count, count))
    for j in range(count):
        whole[j, : j + 1] = np.polynomial.chebyshev.cheb2poly(np.eye(count)[j, : j + 1])
    return whole


def derivative(powers: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(m, N, d - 1) Derivatives in time [1/s] on intervals with the edges (N + 1,) [s]."""
    half = np.diff(edges)[:, None] / 2
    return np.asarray(powers[:, :, 1:] * np.arange(1, powers.shape[2]) / half)


def integral(powers: np.ndarray, edges: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(m, N, d + 1) Integrals over time, continuous from one interval to the next, with values (m,) at the start."""
    half = np.diff(edges)[:, None] / 2
    result = np.zeros((*powers.shape[:2], powers.shape[2] + 1))
    result[:, :, 1:] = half * powers / np.arange(1, powers.shape[2] + 1)
    begins = values_at(result, np.array([-1.0]))[..., 0]
    changes = result.sum(axis=2) - begins
    before = np.concatenate([np.zeros((len(powers), 1)), np.cumsum(changes, axis=1)[:, :-1]], axis=1)
    result[:, :, 0] = start[:, None] + before - begins
    return result


def integral_slack(result: np.ndarray, edges: np.ndarray, slack: np.ndarray | float = 0.0) -> np.ndarray:
    """How far rounding may have moved an `integral`.

    Args:
        result: (m, N, d) the integrals.
        edges: (N + 1,) [s].
        slack: (m, N) how far it may have moved what was integrated.

    Returns:
        (m, N).
    """
    # A sum over intervals is rounded once in each; changes in them are sums of as many terms as there are coefficients.
    sums = np.arange(2, result.shape[1] + 2) * np.maximum.accumulate(size_of(result), axis=1)
    own = UNIT * (sums + result.shape[2] * np.cumsum(size_of(result[:, :, 1:]), axis=1))
    return np.asarray(own + np.cumsum(np.diff(edges) * (slack + np.zeros_like(own)), axis=1))


def stacked(rows: Iterable[np.ndarray]) -> np.ndarray:
    """(m, N, d) Polynomials (N, ..) of different degrees in one array."""
    listed = list(rows)
    longest = max(row.shape[-1] for row in listed)
    return np.stack([np.pad(row, ((0, 0), (0, longest - row.shape[-1]))) for row in listed])


def cut(powers: np.ndarray, panels: int) -> np.ndarray:
    """(m, N panels, d) The same polynomials on equal panels of each interval.

    x = c + w y on a panel: the coefficient of y^l is the sum of a_k (k over l) c^(k - l) w^l.
    """
    if panels == 1:
        return powers
    count, degree = powers.shape[1:]
    centres = (2 * np.arange(panels) + 1) / panels - 1
    shift = np.zeros((panels, degree, degree))
    for k in range(degree):
        for low in range(k + 1):
            shift[:, k, low] = comb(k, low) * centres ** (k - low) / panels**low
    return np.einsum("mrk,pkl->mrpl", powers, shift).reshape(len(powers), count * panels, degree)


@dataclass(frozen=True)
class Panels:
    """Polynomials in time on panels of intervals.

    Args:
        edges: (P + 1,) [s] of the panels.
        powers: (m, P, d) polynomials on them.
        slack: (m, P) how far they may be from those that were cut, in time.
        first: (N,) number of the first panel in each interval.
    """

    edges: np.ndarray
    powers: np.ndarray
    slack: np.ndarray
    first: np.ndarray

    @classmethod
    def of(cls, edges: np.ndarray, powers: np.ndarray, counts: np.ndarray) -> Panels:
        """Equal panels of intervals.

        Args:
            edges: (N + 1,) [s] of the intervals.
            powers: (m, N, d) polynomials on them.
            counts: (N,) panels of each.

        Returns:
            Panels whose slack is the rounding of their coefficients and of their edges.
        """
        parts = [cut(powers[:, k : k + 1], count) for k, count in enumerate(counts)]
        begins = [edges[k] + np.diff(edges)[k] * np.arange(count) / count for k, count in enumerate(counts)]
        late = UNIT * np.abs(edges[1:]) * size_of(derivative(powers, edges))
        slack = np.where(counts > 1, UNIT * powers.shape[2] * size_of(powers) + late, 0.0)
        first = np.cumsum(counts) - counts
        return cls(
            np.append(np.concatenate(begins), edges[-1]), np.concatenate(parts, axis=1), slack.repeat(counts, 1), first
        )

    def rows(self, count: int) -> Panels:
        """The first ones of the polynomials."""
        return replace(self, powers=self.powers[:count], slack=self.slack[:count])

    def largest(self, values: np.ndarray) -> np.ndarray:
        """(k, N) Largest value in each interval of values (k, P) in the panels."""
        return np.asarray(np.maximum.reduceat(values, self.first, axis=1))
