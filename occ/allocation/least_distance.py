"""min |x| subject to A x <= b: the small quadratic programme behind many wheels and behind the closest wrench."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Nearest(NamedTuple):
    """A point and its multipliers.

    Args:
        x: (d,), or None where no point satisfies the inequalities.
        multipliers: (h,) u >= 0 with x = -A^T u; where there is no point, u with A^T u = 0 and b u < 0.
    """

    x: np.ndarray | None
    multipliers: np.ndarray


def least_distance(normals: np.ndarray, offsets: np.ndarray) -> Nearest:
    """min |x| subject to A x <= b, as a least-squares problem with unknowns that are not negative.

    Args:
        normals: A (h, d).
        offsets: b (h,).

    Returns:
        Point and multipliers, exact up to rounding: an active set that is finally solved for once more.

    Source: Lawson and Hanson, Solving Least Squares Problems, chapter 23, problem LDP.
    """
    from scipy.optimize import nnls

    violation = float(-offsets.min(initial=0.0))
    if violation <= 0:
        return Nearest(np.zeros(normals.shape[1]), np.zeros(len(offsets)))
    size = np.linalg.norm(normals, axis=1)
    size = np.where(size > 0, size, 1.0)
    rows, right = normals / size[:, None], offsets / size
    unit = float(-right.min())
    system = np.vstack([-rows.T, -right / unit])
    goal = np.zeros(len(system))
    goal[-1] = 1.0
    u, rest = nnls(system, goal, maxiter=50 * len(offsets))
    if rest < 1e-9:
        return Nearest(None, u / size)
    # |residual|^2 is what is left of the last equation.
    u *= unit / rest**2
    active = u > 0
    x = np.linalg.lstsq(rows[active], right[active], rcond=1e-12)[0]
    if np.abs(rows[active] @ x - right[active]).max(initial=0.0) > 1e-9 * unit:
        x = -rows.T @ u
    return Nearest(x, u / size)
