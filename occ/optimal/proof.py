"""Proven largest values of analytic functions of time and of polynomials in time.

The largest value of q in an interval is at most that of the polynomial p through its values at Chebyshev points, which
`occ.optimal.between` bounds by Taylor's theorem, plus the largest distance |q - p|, which `occ.optimal.enclosure`
bounds on Bernstein ellipses, plus rounding.  Nothing of it is estimated.

Source: Trefethen, Approximation Theory and Approximation Practice, theorem 8.2; Moore, Kearfott, Cloud, Introduction to
    Interval Analysis, chapters 2 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from occ.optimal.between import DEGREE, HALVINGS, RESOLVED, chebyshev_places, largest_of_polynomial
from occ.optimal.enclosure import Balls, Enclosure
from occ.optimal.powers import UNIT, cut, lebesgue, size_of, values_at

RHOS = np.array([1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 40.0, 80.0])[:, None]
"""Ellipses; the best one counts."""


@dataclass(frozen=True)
class Quantities:
    """h(t, z(t)) with polynomials z and an analytic h: what is proven to stay within a limit.

    Args:
        function: CasADi (t, z, numbers) -> h (k,).
        edges: (N + 1,) [s] of the intervals.
        powers: (m, N, d) z as polynomials of x = 2 s - 1 in each interval.
        slack: (m, N) how far rounding may have moved them.
        numbers: (p,) of the function.
        scales: (k,) limits.
        smooth: (N,) of booleans: h is analytic in the interval.
    """

    function: ca.Function
    edges: np.ndarray
    powers: np.ndarray
    slack: np.ndarray
    numbers: np.ndarray
    scales: np.ndarray
    smooth: np.ndarray


@dataclass(frozen=True)
class Proven:
    """Bounds of the limited quantities, relative to their limits.

    Args:
        largest: (k, N) that |quantity| / limit provably does not pass in each interval.
        remainder: the largest distance from a polynomial that is contained in them.
    """

    largest: np.ndarray
    remainder: float


def proven(quantities: Quantities) -> Proven:
    """|h| <= max |p| + |h - p| + rounding in each interval, which is halved where that is not sharp.

    Args:
        quantities: h, with their limits.

    Returns:
        Upper bounds; infinite where h is not smooth.
    """
    count = len(quantities.edges) - 1
    largest = np.full((len(quantities.scales), count), np.inf)
    where, panels, remainder = np.arange(count), 1, 0.0
    for halving in range(HALVINGS + 1):
        found, rest = _panels(quantities, where, panels)
        again = ((rest > RESOLVED) & (found > 1.0)).any(axis=0) & (halving < HALVINGS)
        largest[:, where] = np.minimum(largest[:, where], found)
        remainder = max(remainder, float(rest[:, ~again].max(initial=0.0)))
        where, panels = where[again], 2 * panels
        if not where.size:
            break
    return Proven(np.where(quantities.smooth, largest, np.inf), remainder)


def _panels(quantities: Quantities, where: np.ndarray, panels: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds (k, r) over the panels of some intervals, and the part in them that is not the polynomial's."""
    middle, half, powers, slack = _cut(quantities, where, panels)
    count, degree = len(middle), np.arange(powers.shape[-1])
    numbers = [Balls.exact(number) for number in quantities.numbers]
    enclosure = Enclosure(quantities.function)
    # Values on an ellipse are among those on the disc around it, |x| <= R; rounding moves polynomials there as well.
    radius = (RHOS + 1 / RHOS) / 2
    swing = np.swapaxes(np.abs(powers[:, :, 1:]) @ (radius.T ** degree[1:, None]), 1, 2)
    swing += slack[:, None] * radius ** degree[-1]
    time = Balls(middle, half * radius + UNIT * middle)
    around = enclosure.around([time], [Balls(row[:, 0], r) for row, r in zip(powers, swing, strict=True)], numbers)
    spread = np.stack([np.broadcast_to(ball.radius, (len(RHOS), count)) for ball in around])
    distance = (np.nan_to_num(spread, nan=np.inf) * (4 * RHOS**-DEGREE / (RHOS - 1))).min(axis=1)

    x = 2 * chebyshev_places() - 1
    rounding = UNIT * len(degree) * values_at(np.abs(powers), np.abs(x)) + slack[..., None]
    time = Balls(middle[:, None] + half[:, None] * x, UNIT * (middle + half)[:, None])
    there = [Balls(v, r) for v, r in zip(values_at(powers, x), rounding, strict=True)]
    points = enclosure.at([time], there, numbers)
    scales = quantities.scales[:, None]
    value = np.stack([np.broadcast_to(ball.centre, (count, len(x))) for ball in points]) / scales[..., None]
    error = np.stack([np.broadcast_to(ball.radius, (count, len(x))) for ball in points]).max(axis=2)
    rest = (distance + lebesgue(DEGREE) * error) / scales + UNIT * DEGREE**2 * np.abs(value).max(axis=2)
    above, below = (largest_of_polynomial(sign * value)[0] for sign in (1.0, -1.0))
    both = np.maximum(above, below) + rest, rest
    found, rest = (part.reshape(len(value), len(where), panels).max(axis=2) for part in both)
    return found, rest


def _cut(
    quantities: Quantities, where: np.ndarray, panels: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Middles and half widths (r P,) [s] of the panels of some intervals, polynomials on them, and their slack."""
    edges, powers = quantities.edges, quantities.powers[:, where]
    half = np.diff(edges)[where] / 2
    middle = edges[where, None] + half[:, None] * (2 * np.arange(panels) + 1) / panels
    slack = size_of(powers) * UNIT * powers.shape[2] * (panels > 1) + quantities.slack[:, where]
    return middle.ravel(), np.repeat(half / panels, panels), cut(powers, panels), np.repeat(slack, panels, axis=1)
