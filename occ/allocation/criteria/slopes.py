"""Slopes at a minimum: of the many that corners and limits allow, those that are normal to the null torques."""

from __future__ import annotations

import numpy as np

from occ.allocation.least_distance import least_distance

NO_EFFECT = 1e-12
"""A wheel whose share in the unit null torque is below this is not moved by it."""
ROUNDING = (0.0, *np.logspace(-14, -4, 11))
"""Slopes are known to such a part of the largest one; the least part that leaves any is taken."""


def nearest_to_zero(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The number between low and high that is nearest to zero."""
    return np.minimum(np.maximum(low, 0.0), high)


def balanced(low: np.ndarray, high: np.ndarray, null: np.ndarray) -> np.ndarray:
    """g (n, N) between low and high with n g = 0 for the one null torque n (n,), where there is one."""
    slope = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high, 0.0))
    up, down = high - slope, slope - low
    column = null[:, None]
    lacking = -(null @ slope)
    # What a wheel can still add to n g in the direction in which it lacks.
    room = np.abs(column) * np.where(np.sign(column) * np.sign(lacking) > 0, up, down)
    room = np.where(np.abs(column) > NO_EFFECT, room, 0.0)
    free = np.isinf(room)
    total = np.where(np.isinf(room), 0.0, room).sum(axis=0)
    share = np.divide(np.abs(lacking), total, out=np.zeros_like(total), where=total > 0)
    finite = np.where(free, 0.0, room) * np.minimum(share, 1.0)
    # Of the wheels at a limit one takes all of it, as a limit pulls as hard as it must.
    first = (np.cumsum(free, axis=0) == 1) & free
    added = np.where(free.any(axis=0), np.where(first, np.abs(lacking), 0.0), finite)
    safe = np.where(np.abs(column) > NO_EFFECT, column, 1.0)
    return slope + np.sign(lacking) * added / safe


def normal_slope(low: np.ndarray, high: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """g = Q mu between low and high: of all slopes that corners and limits allow one that no null torque feels.

    Of the three unknowns mu the inequalities are well posed, however nearly parallel wheels and null torques are.

    Args:
        low: (n,), infinite where nothing bounds the slope.
        high: (n,).
        basis: Q (n, 3) orthonormal slopes that no null torque feels.

    Returns:
        (n,) Up to rounding; zeros where there is none.
    """
    normals = np.vstack([basis, -basis])
    offsets = np.concatenate([high, -low])
    bounded = np.isfinite(offsets)
    normals, offsets = normals[bounded], offsets[bounded]
    size = np.abs(offsets).max(initial=0.0)
    for part in ROUNDING:
        mu = least_distance(normals, offsets + part * size).x
        if mu is not None:
            return np.asarray(basis @ mu)
    return np.zeros_like(low)
