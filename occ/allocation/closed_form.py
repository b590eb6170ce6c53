"""The box-limited allocation of least norm where at most one null torque exists: a clip of one scalar."""

from __future__ import annotations

import numpy as np

from occ.allocation.input_map import InputMap
from occ.allocation.residuals import residuals
from occ.allocation.result import REACH, Allocation, allocation_of, checked
from occ.errors import InputError

NO_EFFECT = 1e-12
"""A wheel whose share in the unit null torque is below this is not moved by it."""


def allocate(wheels: InputMap, wrench: np.ndarray, limit: float) -> Allocation:
    """M = M_min + nu n, nu = 0 clipped to the intersection of |M_min,i + nu n_i| <= limit over the wheels.

    M_min is orthogonal to n, so that |M|^2 = |M_min|^2 + nu^2: the least norm is the nu nearest to 0.  Three wheels
    have no null torque, and their only torques are either within the limit or not.

    Args:
        wheels: input map of three or four wheels.
        wrench: (3, N) [N, N, N m].
        limit: [N m], of every wheel.

    Returns:
        The allocation; NaN torques where the wrench is out of reach.

    Raises:
        InputError: more than four wheels, wrenches that are not finite or not (3, N), a limit that is not positive.
    """
    wrench, limit = checked(wheels, wrench, limit)
    if wheels.wheel_count > 4:
        raise InputError(
            f"the closed form is for three or four wheels, not {wheels.wheel_count}; should be the allocation by OSQP"
        )
    min_norm = wheels.min_norm @ wrench
    torque = min_norm.copy()
    if wheels.wheel_count == 4:
        null = wheels.null_torque[:, 0]
        moved = np.abs(null) > NO_EFFECT
        middle = min_norm[moved] / -null[moved, None]
        half = limit / np.abs(null[moved, None])
        lowest, highest = (middle - half).max(axis=0), (middle + half).min(axis=0)
        torque += null[:, None] * np.minimum(np.maximum(lowest, 0.0), highest)
    return allocation_of(wheels, min_norm, limit, torque)


def multipliers(wheels: InputMap, torque: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """lambda, mu with M + C_phi lambda + mu = 0, where one wheel at its limit holds the null torque: mu_i = -nu / n_i.

    Args:
        wheels: input map of three or four wheels.
        torque: (n, N) [N m] allocated torques.
        limit: [N m].

    Returns:
        Multipliers of the wrench (3, N) and of the limits (n, N); those of a torque that is not the solution prove
        nothing, which `residuals` shows.
    """
    bound = np.zeros_like(torque)
    if wheels.wheel_count == 4:
        null = wheels.null_torque[:, 0]
        pull = -(null @ torque)
        # A limit only holds back: its multiplier has the sign of the torque.
        holds = (np.abs(torque) >= limit * (1 - 2 * REACH)) & (pull * null[:, None] * torque > 0)
        score = np.where(holds, np.abs(null)[:, None], 0.0)
        wheel, sample = score.argmax(axis=0), np.arange(torque.shape[1])
        held = score[wheel, sample] > NO_EFFECT
        bound[wheel[held], sample[held]] = pull[held] / null[wheel[held]]
    return -wheels.min_norm.T @ (torque + bound), bound


def proven(wheels: InputMap, wrench: np.ndarray, torque: np.ndarray, limit: float) -> np.ndarray:
    """Whether each torque (n, N) is the allocation of its wrench (3, N), by its residuals; (N,)."""
    force, bound = multipliers(wheels, torque, limit)
    return np.array(
        [
            residuals(wheels, wrench[:, k], limit, torque[:, k], force[:, k], bound[:, k]).prove(limit)
            for k in range(torque.shape[1])
        ],
        dtype=bool,
    )
