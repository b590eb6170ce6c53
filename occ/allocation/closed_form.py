"""The best allocation where at most one null torque exists, M = M_min + nu n: a clip of one scalar."""

from __future__ import annotations

import numpy as np

from occ.allocation.criteria import LEAST_NORM, NO_EFFECT, Criterion
from occ.allocation.input_map import InputMap
from occ.allocation.ranges import TorqueRange
from occ.allocation.result import Allocation, Question, question
from occ.errors import InputError


def allocate(
    wheels: InputMap,
    wrench: np.ndarray,
    limits: float | TorqueRange,
    criterion: Criterion = LEAST_NORM,
    rates: np.ndarray | None = None,
) -> Allocation:
    """min f(M_min + nu n) over the nu with lower_i <= M_min,i + nu n_i <= upper_i for every wheel.

    f is convex along nu, so that the best admissible nu is the best one of all, clipped to the interval of the
    admissible ones; of several best ones it is the one nearest to 0, the least norm.  Three wheels have no null
    torque, and their only torques are either within the limits or not.

    Args:
        wheels: input map of three or four wheels.
        wrench: (3, N) [N, N, N m].
        limits: one limit [N m] of every wheel, or a range of each.
        criterion: f.
        rates: (n, N) [rad/s] phi', where f asks for them.

    Returns:
        The allocation; NaN torques where the wrench is out of reach.

    Raises:
        InputError: more than four wheels, or arguments that cannot be meant.
    """
    return solve(question(wheels, wrench, limits, criterion, rates))


def solve(asked: Question) -> Allocation:
    """The same with checked arguments."""
    wheels, m = asked.wheels, asked.min_norm
    if wheels.wheel_count > 4:
        raise InputError(
            f"the closed form is for three or four wheels, not {wheels.wheel_count}; should be the one for many wheels"
        )
    if wheels.wheel_count == 3:
        return asked.answer(m)
    null = wheels.null_torque[:, 0]
    # In this sum a wheel that the null torque does not move has no part, and the zonotope decides for it.
    moved = np.abs(null) > NO_EFFECT
    low, high = _interval(null[moved], m[moved], asked.ranges.lower[moved], asked.ranges.upper[moved])
    first, last = asked.criterion.best_null(wheels, m, asked.rates)
    nu = np.minimum(np.maximum(first, 0.0), last)
    nu = np.minimum(np.maximum(nu, low), high)
    gap = low - high
    if gap.max(initial=-np.inf) > 0 or not moved.all():
        # At the border of reach rounding may exchange the ends of what is a point.
        nu = np.where(gap > 0, (low + high) / 2, nu)
        return asked.answer(m + null[:, None] * nu)
    count = len(gap)
    torque = null[:, None] * nu
    torque += m
    return Allocation(
        torque, np.ones(count, dtype=bool), np.zeros(count), np.full(count, -1), np.zeros(count, dtype=bool)
    )


def _interval(
    null: np.ndarray, torque: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Ends (N,) of the nu that every wheel allows, the first beyond the second where there is none."""
    column = null[:, None]
    begin, end = np.where(column > 0, lower, upper) / column, np.where(column > 0, upper, lower) / column
    place = torque / column
    return (begin - place).max(axis=0), (end - place).min(axis=0)
