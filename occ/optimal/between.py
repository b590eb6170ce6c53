"""How large the limited quantities become between the nodes.

In each interval a quantity q is replaced by the polynomial p of degree n through its values at n + 1 Chebyshev points:
p = sum_j c_j cos(j a) with s = (1 - cos a) / 2.  Around each angle of a grid of spacing D Taylor's theorem says

    |p(a + b) - p - p' b - p'' b^2 / 2| <= sum_j j^3 |c_j| D^3 / 48,   |b| <= D / 2,

so that the largest value of p is *proven* to lie in an interval of that width (up to rounding).  How far q is from p is
*estimated* from the last coefficients; where that is not small, the interval is halved and looked at again.

This steers a search, at little cost; what it ends with is proven by `occ.optimal.limit_proof`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from occ.optimal.formulation import Formulation
from occ.optimal.limits import LimitedArcs
from occ.optimal.problem import Nodes, Numbers, flat
from occ.optimal.transcription import Transcription

DEGREE = 20
"""n."""
GRID = 256
"""Angles between 0 and pi at which the polynomial is looked at."""
TAIL = 4
"""Last coefficients from which the distance of a quantity from its polynomial is estimated."""
RESOLVED = 1e-9
"""That distance, relative to the limit, at which nothing is halved any more."""
HALVINGS = 5
"""At most."""

Sampler = Callable[[np.ndarray], np.ndarray]
"""s (m,) in [0, 1] -> (k, N, m) signed quantities in units of their limits, in every interval."""


def chebyshev_places(count: int = DEGREE) -> np.ndarray:
    """(n + 1,) s = (1 - cos(pi j / n)) / 2: Chebyshev's extreme points on [0, 1]."""
    return (1 - np.cos(np.pi * np.arange(count + 1) / count)) / 2


@cache
def _cosines() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Values -> c (n + 1, n + 1); c -> p, p', p'' with respect to the angle on the grid (n + 1, GRID + 1) each."""
    n = DEGREE
    j = np.arange(n + 1)
    halves = np.where((j == 0) | (j == n), 0.5, 1.0)
    to_coefficients = 2 / n * np.cos(np.pi * np.outer(j, j) / n) * np.outer(halves, halves)
    angle = np.outer(j, np.pi * np.arange(GRID + 1) / GRID)
    value, slope = np.cos(angle), -j[:, None] * np.sin(angle)
    return to_coefficients, value, slope, -(j[:, None] ** 2) * value


def largest_of_polynomial(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """max p <= max over the grid of (p + p' b + p'' b^2 / 2) + sum_j j^3 |c_j| D^3 / 48.

    Args:
        values: (..., n + 1) at the `chebyshev_places`.

    Returns:
        (...) Upper bounds of the largest p in each row, and estimates of the distance of the quantity from p.

    Source: Trefethen, Approximation Theory and Approximation Practice, chapters 3, 4 and 8.
    """
    to_coefficients, value, slope, bend = _cosines()
    c = values @ to_coefficients
    p, first, second = c @ value, c @ slope, c @ bend
    half = np.pi / GRID / 2
    top = np.where(second < 0.0, np.clip(-first / np.where(second < 0.0, second, -1.0), -half, half), 0.0)
    # Where the bend is upwards the ends of the cell are the highest.
    highest = np.where(
        second < 0.0, p + first * top + second * top**2 / 2, p + np.abs(first) * half + second * half**2 / 2
    )
    third = np.abs(c) @ np.arange(DEGREE + 1.0) ** 3
    # Sum of 2 |c_j| over j > n (aliasing counts each twice) where they go on like 1 / j^2, as behind a kink.
    rest = 2 * DEGREE / TAIL * np.abs(c[..., -TAIL:]).sum(axis=-1)
    return highest.max(axis=-1) + third * half**3 / 6, rest


def largest_values(sample: Sampler, first: np.ndarray) -> np.ndarray:
    """Upper bounds of |q| in each interval: proven for the polynomials, the distance of q from them added.

    Args:
        sample: the quantities.
        first: (k, N, n + 1) of them at the `chebyshev_places`.

    Returns:
        (k, N) bounds; tight where they are above 1, and at least the largest sample everywhere.
    """
    result = np.abs(first).max(axis=2)
    # |p| <= sum |c_j|: what stays below its limit by this needs no closer look.
    where = np.argwhere(np.abs(first @ _cosines()[0]).sum(axis=2) > 1.0 - RESOLVED)
    values, panels = first, 1
    for halving in range(HALVINGS + 1):
        if not len(where):
            break
        found, rest = _panels(values[tuple(where.T)].reshape(len(where), panels, DEGREE + 1))
        again = (rest > RESOLVED) & (found + rest > 1.0) & (halving < HALVINGS)
        done = tuple(where[~again].T)
        result[done] = np.maximum(result[done], (found + rest)[~again])
        where, panels = where[again], 2 * panels
        if len(where):
            places = (np.arange(panels)[:, None] + chebyshev_places()) / panels
            values = sample(places.ravel())
    return result


def _panels(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest |p| (r,) over panels, values (r, panels, n + 1), and largest distance of the quantity from p."""
    above, rest = largest_of_polynomial(values)
    below, _ = largest_of_polynomial(-values)
    return np.maximum(above, below).max(axis=1), rest.max(axis=1)


def limited_arcs(
    formulation: Formulation, transcription: Transcription, nodes: Nodes, numbers: Numbers
) -> LimitedArcs | None:
    """Limits, largest torque and clipped powers along a solution, between the nodes too.

    Args:
        formulation: of the task.
        transcription: of its problem.
        nodes: the solution.
        numbers: with which it was found.

    Returns:
        None where there is nothing of the kind.
    """
    shape = formulation.shape
    if not (len(formulation.hard_limits) or shape.slacks or shape.peaks):
        return None

    def at(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        state, control = formulation.between(transcription, numbers.edges, nodes, s)
        found = loads(formulation, transcription, (state, control, formulation.data(numbers.edges, s)))
        load, clipped = (values.reshape(len(values), transcription.intervals, len(s)) for values in found)
        return load, clipped

    s = chebyshev_places()
    load, clipped = at(s)
    at_nodes, _ = loads(formulation, transcription, (nodes.points, nodes.control, numbers.data))
    return LimitedArcs(
        t=numbers.edges[:-1, None] + np.diff(numbers.edges)[:, None] * s,
        load=np.abs(load),
        largest=largest_values(lambda places: at(places)[0], load),
        node_times=transcription.node_times(numbers.edges).ravel(),
        node_load=np.abs(at_nodes),
        hard=len(formulation.hard_limits),
        clipped=clipped,
    )


def loads(
    formulation: Formulation, transcription: Transcription, moments: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """quantity / limit of every limit, M / largest torque, and the clipped powers, all with their signs.

    Args:
        formulation: of the task.
        transcription: of its problem.
        moments: states (nx, N, m), controls (nu, N, m) and data (nd, N, m).

    Returns:
        (k, N m) and (j, N m).
    """
    values = formulation.hard_limits
    state, control, data = (flat(part) for part in moments)
    path = transcription.evaluate(state, control, data, formulation.parameters())[2]
    *_, slacks, peaks = formulation.shape.following()
    rows = len(path) - slacks - peaks
    load = path[: len(values)] / values[:, None]
    if peaks:
        # The rows are m - M, then m + M.
        load = np.concatenate([load, 1.0 - path[rows + slacks : rows + slacks + peaks // 2] / state[-1]])
    return load, control[len(control) - slacks :] - path[rows : rows + slacks]
