"""What every allocation returns, and what every allocation asks of its arguments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.allocation.input_map import InputMap
from occ.errors import InputError

REACH = 1e-9
"""A wrench whose least possible largest torque passes the limit by less than this part of it counts as reachable."""


@dataclass(frozen=True, eq=False)
class Allocation:
    """Wheel torques for N wrenches.

    Args:
        torque: (n, N) [N m]; NaN where no torque was found.
        reachable: (N,) whether some torque within the limit makes the wrench.
        excess: (N,) [N m] by how much the least possible largest torque passes the limit; 0 where reachable.
        wheel: (N,) wheel (from 0) on which it does; -1 where reachable.
        failed: (N,) whether neither a torque nor its impossibility could be shown.
    """

    torque: np.ndarray
    reachable: np.ndarray
    excess: np.ndarray
    wheel: np.ndarray
    failed: np.ndarray


def allocation_of(
    wheels: InputMap, min_norm: np.ndarray, limit: float, torque: np.ndarray, failed: np.ndarray | None = None
) -> Allocation:
    """The result for given torques: reach, excess and wheel follow from the wrenches alone.

    Args:
        wheels: the input map.
        min_norm: (n, N) [N m] minimum-norm torques.
        limit: [N m].
        torque: (n, N) [N m], meaningless where out of reach.
        failed: (N,) see `Allocation`.

    Returns:
        The allocation.
    """
    excess = wheels.least_peak(min_norm) - limit
    reachable = excess <= REACH * limit
    wheel = np.full(len(reachable), -1)
    failed = np.zeros(len(reachable), dtype=bool) if failed is None else failed
    if not reachable.all():
        out = ~reachable
        wheel[out] = wheels.critical_wheel(min_norm[:, out])
        torque[:, out] = np.nan
    excess[reachable] = 0.0
    torque[:, failed] = np.nan
    return Allocation(torque, reachable & ~failed, excess, wheel, failed)


def checked(wheels: InputMap, wrench: np.ndarray, limit: float) -> tuple[np.ndarray, float]:
    """The arguments of an allocation as numbers that can be meant.

    Args:
        wheels: the input map.
        wrench: (3, N) [N, N, N m].
        limit: [N m].

    Returns:
        Wrench and limit.

    Raises:
        InputError: names what is wrong and what would be right.
    """
    try:
        wrench = np.asarray(wrench, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"wrench should be an array of numbers of the shape (3, N), not {wrench!r}") from error
    if wrench.ndim != 2 or len(wrench) != 3:
        raise InputError(f"wrench should have the shape (3, N), not {wrench.shape}")
    bad = ~np.isfinite(wrench).all(axis=0)
    if bad.any():
        raise InputError(f"wrench should be finite; sample {int(bad.argmax())} is {wrench[:, bad.argmax()].tolist()}")
    return wrench, checked_limit(limit)


def checked_limit(limit: float) -> float:
    """|M_i| <= limit [N m]; InputError where it is not a positive number."""
    if isinstance(limit, bool) or not isinstance(limit, int | float | np.number) or not 0 < limit < np.inf:
        raise InputError(f"limit should be a positive finite number of N m, not {limit!r}")
    return float(limit)
