"""Wrench to wheel torques of three or four wheels as expressions: the closed forms without a loop or a branch."""

from __future__ import annotations

from functools import reduce
from itertools import combinations

import casadi as ca

from occ.errors import InputError
from occ.model.coefficients import Coefficients

UNMOVED = 1e-12
"""A wheel whose share in the null torque, relative to its norm, is below this is not moved by it."""
FAR = 1e30
"""[N m] No bound."""


def null_torque(k: Coefficients) -> ca.SX:
    """n_i = (-1)^i det(C_phi without row i) / |n|: C_phi^T n = 0.

    Args:
        k: matrices of a platform with three or four wheels.

    Returns:
        (4,), or (3,) zeros for three wheels.

    Raises:
        InputError: more than four wheels.
    """
    rates = k.wheel_rates
    count = rates.shape[0]
    if count > 4:
        raise InputError(f"the closed form of the allocation is for three or four wheels, not {count}")
    if count == 3:
        return ca.SX.zeros(3)
    rows = [[other for other in range(count) if other != i] for i in range(count)]
    minors = ca.vertcat(*((-1) ** i * ca.det(rates[row, :]) for i, row in enumerate(rows)))
    return minors / ca.norm_2(minors)


def box_torque(k: Coefficients, wrench: ca.SX, limit: ca.SX) -> ca.SX:
    """M = M_min + nu n with nu = 0 clipped to the intersection of |M_min,i + nu n_i| <= limit.

    Args:
        k: matrices of a platform with three or four wheels.
        wrench: (3,) [N, N, N m].
        limit: [N m], positive.

    Returns:
        (n,) [N m].  Where the intersection is empty some torque is beyond the limit.

    Raises:
        InputError: more than four wheels.

    Source: `occ.allocation.closed_form.solve`, which this repeats as an expression.
    """
    torque, null = k.min_norm @ wrench, null_torque(k)
    ranges = []
    for share, least in zip(ca.vertsplit(null), ca.vertsplit(torque), strict=True):
        moved = ca.fabs(share) > UNMOVED
        divisor = ca.if_else(moved, share, 1)
        middle, half = -least / divisor, limit / ca.fabs(divisor)
        ranges.append((ca.if_else(moved, middle - half, -FAR), ca.if_else(moved, middle + half, FAR)))
    lowest, highest = reduce(ca.fmax, [low for low, _ in ranges]), reduce(ca.fmin, [high for _, high in ranges])
    return torque + null * ca.fmin(ca.fmax(lowest, 0), highest)


def least_peak(k: Coefficients, wrench: ca.SX) -> ca.SX:
    """min over nu of max |M_min,i + nu n_i| = max over pairs of |M_i n_j - M_j n_i| / (|n_i| + |n_j|).

    Args:
        k: matrices of a platform with three or four wheels.
        wrench: (3,) [N, N, N m].

    Returns:
        [N m].

    Raises:
        InputError: more than four wheels.
    """
    torque, null = k.min_norm @ wrench, null_torque(k)
    if torque.shape[0] == 3:
        return ca.mmax(ca.fabs(torque))
    peak = ca.SX(0)
    for i, j in combinations(range(torque.shape[0]), 2):
        size = ca.fabs(null[i]) + ca.fabs(null[j])
        moved = size > UNMOVED
        pair = ca.fabs(torque[i] * null[j] - torque[j] * null[i]) / ca.if_else(moved, size, 1)
        peak = ca.fmax(peak, ca.if_else(moved, pair, 0))
    # A wheel that the null torque does not move keeps what it has.
    for share, least in zip(ca.vertsplit(null), ca.vertsplit(torque), strict=True):
        peak = ca.fmax(peak, ca.if_else(ca.fabs(share) > UNMOVED, 0, ca.fabs(least)))
    return peak
