"""The best allocation where at most one null torque exists, M = M_min + nu n: a clip of one scalar."""

from __future__ import annotations

import numpy as np

from occ.allocation.criteria.slopes import NO_EFFECT
from occ.allocation.result import Allocation, Question
from occ.errors import InputError

BATCH = 8192
"""Samples that are solved at a time: so few that they stay in the cache, so many that the calls do not count."""


def solve(asked: Question) -> Allocation:
    """min f(M_min + nu n) over the nu with lower_i <= M_min,i + nu n_i <= upper_i for every wheel.

    f is convex along nu, so that the best admissible nu is the best one of all, clipped to the interval of the
    admissible ones; of several best ones it is the one nearest to 0, the least norm.  Three wheels have no null
    torque, and their only torques are either within the limits or not.

    Args:
        asked: about three or four wheels.

    Returns:
        The allocation; NaN torques where the wrench is out of reach.

    Raises:
        InputError: more than four wheels.
    """
    if asked.wheels.wheel_count > 4:
        raise InputError(f"the closed form is for three or four wheels, not {asked.wheels.wheel_count}")
    count = asked.min_norm.shape[1]
    if count <= BATCH:
        return _solve(asked)
    return Allocation.joined([_solve(asked.of(slice(k, k + BATCH))) for k in range(0, count, BATCH)])


def _solve(asked: Question) -> Allocation:
    wheels, m = asked.wheels, asked.min_norm
    if wheels.wheel_count == 3:
        return asked.answer(m)
    null = wheels.null_torque[:, 0]
    # In this sum a wheel that the null torque does not move has no part, and the zonotope decides for it.
    moved = np.abs(null) > NO_EFFECT
    low, high = _interval(null[moved], m[moved], asked.ranges.lower[moved], asked.ranges.upper[moved])
    first, last = asked.criterion.best_null(wheels, m, asked.rates)
    nu = np.minimum(np.maximum(first, 0.0), last)
    nu = np.minimum(np.maximum(nu, low), high)
    # At the border of reach rounding may exchange the ends of what is a point: the zonotope decides what it is.
    doubtful = np.flatnonzero(low > high) if moved.all() else np.arange(len(low))
    torque = null[:, None] * nu
    torque += m
    found = Allocation.of_all(torque)
    if doubtful.size:
        found.put(doubtful, asked.of(doubtful).answer(torque[:, doubtful]))
    return found


def _interval(
    null: np.ndarray, torque: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Ends (N,) of the nu that every wheel allows, the first beyond the second where there is none."""
    column = null[:, None]
    begin, end = np.where(column > 0, lower, upper) / column, np.where(column > 0, upper, lower) / column
    place = torque / column
    return (begin - place).max(axis=0), (end - place).min(axis=0)
