"""Least weighted norm of the torques of a wrench within limits: least distance in coordinates of the null torques."""

from __future__ import annotations

import numpy as np

from occ.allocation.input_map import PARALLEL, InputMap
from occ.allocation.least_distance import least_distance
from occ.allocation.reach import tolerance

WIDER = (0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 2.0)
"""Limits are widened by the least such part of what counts as rounding that leaves a torque."""


def least_norms(
    wheels: InputMap, torque: np.ndarray, lower: np.ndarray, upper: np.ndarray, weight: np.ndarray | None = None
) -> np.ndarray:
    """min sum w_i M_i^2 subject to C_phi^T M = Pi, lower <= M <= upper, at many samples.

    Args:
        wheels: n wheels.
        torque: (n, N) [N m] any torques of the wrenches.
        lower: (n, N) [N m].
        upper: (n, N) [N m].
        weight: w (n,), 1 where it is not given.

    Returns:
        (n, N) [N m]; NaN where there are none.
    """
    weight = np.ones(len(torque)) if weight is None else weight
    root = np.sqrt(weight)[:, None]
    step = root * wheels.null_torque
    best = torque - wheels.null_torque @ np.linalg.lstsq(step, root * torque, rcond=None)[0]
    slack = tolerance(torque)
    for k in np.flatnonzero(((best > upper) | (best < lower)).any(axis=0)):
        best[:, k] = least_norm(wheels.null_torque, torque[:, k], lower[:, k], upper[:, k], weight, float(slack[k]))
    return best


def least_norm(
    null: np.ndarray, torque: np.ndarray, lower: np.ndarray, upper: np.ndarray, weight: np.ndarray, slack: float
) -> np.ndarray:
    """min sum w_i M_i^2, M = torque + null nu, lower <= M <= upper.

    Args:
        null: (n, d) null torques.
        torque: (n,) [N m].
        lower: (n,) [N m].
        upper: (n,) [N m].
        weight: w (n,).
        slack: [N m] a limit may be passed by twice this, which is rounding, where there is no torque otherwise.

    Returns:
        (n,) [N m]; NaN where there are none.
    """
    root = np.sqrt(weight)
    q, r = np.linalg.qr(root[:, None] * null)
    step = np.linalg.solve(r.T, null.T).T
    best = torque - step @ (q.T @ (root * torque))
    moved = np.abs(step).max(axis=1, initial=0.0) > PARALLEL * np.abs(step).max(initial=0.0)
    room = np.stack([upper - best, best - lower])
    if room[:, ~moved].min(initial=0.0) < -2 * slack:
        return np.full(len(torque), np.nan)
    normals, offsets = np.vstack([step[moved], -step[moved]]), room[:, moved].ravel()
    # At the border of reach a range may be empty by rounding.
    for part in WIDER:
        found = least_distance(normals, offsets + part * slack)
        if found.x is not None:
            return best + step @ found.x
    return np.full(len(torque), np.nan)
