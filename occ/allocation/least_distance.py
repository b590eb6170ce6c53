"""min |x| subject to A x <= b: the small quadratic programme behind many wheels and behind the closest wrench."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

ROUNDING = 1e-14
"""An inequality that is violated by less than this part of its terms is satisfied."""
DEPENDENT = 1e-13
"""A unit normal that leaves the span of the active ones by less than this lies in it."""
MOST_STEPS = 20
"""Inequalities that become active, for each one that there is; a few in all are usual."""


class Nearest(NamedTuple):
    """A point and its multipliers.

    Args:
        x: (d,), or None where no point satisfies the inequalities.
        multipliers: (h,) u >= 0 with x = -A^T u; where there is no point, u with A^T u = 0 and b u < 0.
    """

    x: np.ndarray | None
    multipliers: np.ndarray


class _Corner(NamedTuple):
    """The nearest point x (d,) of the active inequalities with their multipliers u; x is None where there is none."""

    x: np.ndarray | None
    active: list[int]
    u: np.ndarray


def least_distance(normals: np.ndarray, offsets: np.ndarray) -> Nearest:
    """min |x| subject to A x <= b by a dual active set: from x = 0 on, the most violated inequality becomes active.

    Each x is the nearest point of the active inequalities, and these are met up to rounding however nearly parallel
    they are.  (Least squares for the multipliers alone would lose as many digits as the multipliers are long.)

    Args:
        normals: A (h, d).
        offsets: b (h,).

    Returns:
        Point and multipliers, exact up to rounding.

    Source: Goldfarb and Idnani, A numerically stable dual method for solving strictly convex quadratic programs,
    Math. Programming 27 (1983).
    """
    size = np.sqrt((normals * normals).sum(axis=1))
    size[size == 0] = 1.0
    rows, right = normals / size[:, None], offsets / size
    x, corner = np.zeros(normals.shape[1]), _Corner(None, [], np.zeros(0))
    for _ in range(MOST_STEPS * len(right) + 1):
        room = right - rows @ x + ROUNDING * (np.abs(right) + np.abs(x).max(initial=0.0))
        if room.min(initial=0.0) >= 0:
            return Nearest(x, _spread(corner, size))
        corner = _enter(int(room.argmin()), rows, right, x, corner)
        if corner.x is None:
            return Nearest(None, _spread(corner, size))
        x = corner.x
    # Rounding goes round in circles: no point is known, and nothing is proven.
    return Nearest(None, np.zeros(len(right)))


def _enter(new: int, rows: np.ndarray, right: np.ndarray, x: np.ndarray, corner: _Corner) -> _Corner:
    """One more inequality becomes active; others that would need a negative multiplier leave on the way."""
    normal, own = rows[new], 0.0
    _, active, u = corner
    while True:
        q, r = np.linalg.qr(rows[active].T)
        # normal = N share + z, z normal to the active N; the second projection restores what rounding took.
        part = q.T @ normal
        z = normal - q @ part
        again = q.T @ z
        z -= q @ again
        share = np.linalg.solve(r, part + again)
        length = float(z @ z)
        full = float(normal @ x - right[new]) / length if length > DEPENDENT**2 else np.inf
        leaves = np.divide(u, share, out=np.full(len(u), np.inf), where=share > 0)
        step = min(full, leaves.min(initial=np.inf))
        if step == np.inf:
            return _Corner(None, [*active, new], np.append(-share, 1.0))
        u, own = u - step * share, own + step
        if full < np.inf:
            x = x - step * z
        if step == full:
            active, u = [*active, new], np.append(u, own)
            q, r = np.linalg.qr(rows[active].T)
            return _Corner(q @ np.linalg.solve(r.T, right[active]), active, u)
        first = int(leaves.argmin())
        active, u = active[:first] + active[first + 1 :], np.delete(u, first)


def _spread(corner: _Corner, size: np.ndarray) -> np.ndarray:
    """(h,) Multipliers of all inequalities, whose normals were divided by their size (h,)."""
    multipliers = np.zeros(len(size))
    multipliers[corner.active] = corner.u
    return multipliers / size
