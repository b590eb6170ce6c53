"""The best allocation for any number of wheels, one small quadratic programme for each sample."""

from __future__ import annotations

import numpy as np

from occ.allocation.criteria import LEAST_NORM, Criterion, ElectricPower, LargestTorque, WeightedNorm, least_peak_rows
from occ.allocation.input_map import InputMap
from occ.allocation.least_distance import least_distance
from occ.allocation.osqp_qp import OsqpAllocator
from occ.allocation.ranges import NO_LIMIT, TorqueRange
from occ.allocation.reach import tolerance
from occ.allocation.result import Allocation, Question, question
from occ.errors import InputError


def allocate(
    wheels: InputMap,
    wrench: np.ndarray,
    limits: float | TorqueRange,
    criterion: Criterion = LEAST_NORM,
    rates: np.ndarray | None = None,
) -> Allocation:
    """min f(M) subject to C_phi^T M = Pi, lower_i <= M_i <= upper_i; of several best torques the one of least norm.

    Args:
        wheels: input map of any number of wheels.
        wrench: (3, N) [N, N, N m].
        limits: one limit [N m] of every wheel, or a range of each.
        criterion: f.
        rates: (n, N) [rad/s] phi', where f asks for them.

    Returns:
        The allocation; NaN torques where the wrench is out of reach, ``failed`` where nothing could be shown.

    Raises:
        InputError: arguments that cannot be meant.
    """
    return solve(question(wheels, wrench, limits, criterion, rates))


def solve(asked: Question) -> Allocation:
    """The same with checked arguments.

    The largest torque is a least norm within a smaller box, |M_i| <= t with the least possible t.  Where electric
    power is least, each wheel's distance from idling is unique, and the torques within these distances are a box, too.
    """
    criterion, m = asked.criterion, asked.min_norm
    lower, upper = (np.array(np.broadcast_to(bound, m.shape)) for bound in (asked.ranges.lower, asked.ranges.upper))
    failed = np.zeros(m.shape[1], dtype=bool)
    if isinstance(criterion, WeightedNorm):
        return _answer(asked, _least_norms(asked, lower, upper, criterion.of(len(m))[:, 0]), failed)
    if isinstance(criterion, LargestTorque):
        peak, _ = least_peak_rows(asked.wheels, m, asked.ranges)
        return _answer(asked, _least_norms(asked, np.maximum(lower, -peak), np.minimum(upper, peak)), failed)
    if isinstance(criterion, ElectricPower):
        return _least_electric(asked, criterion, lower, upper)
    raise InputError(f"no allocation of many wheels for {type(criterion).__name__}")


def _least_electric(asked: Question, criterion: ElectricPower, lower: np.ndarray, upper: np.ndarray) -> Allocation:
    """OSQP's distances from idling, which are unique, as limits of a least norm."""
    m = asked.min_norm
    found = OsqpAllocator(asked.wheels, criterion).solve(asked)
    idle = np.sort([np.zeros_like(m), np.broadcast_to(-asked.rates / criterion.loss, m.shape)], axis=0)
    away = np.nan_to_num(np.maximum(found.torque - idle[1], idle[0] - found.torque).clip(0.0), nan=NO_LIMIT)
    torque = _least_norms(asked, np.maximum(lower, idle[0] - away), np.minimum(upper, idle[1] + away))
    return _answer(asked, torque, found.failed)


def _least_norms(asked: Question, lower: np.ndarray, upper: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """(n, N) `least_norm` of each sample within its own limits (n, N)."""
    m, slack = asked.min_norm, tolerance(asked.min_norm)
    weight = np.ones(len(m)) if weight is None else weight
    columns = [
        least_norm(asked.wheels, m[:, k], lower[:, k], upper[:, k], weight, float(slack[k])) for k in range(m.shape[1])
    ]
    return np.column_stack(columns) if columns else m


def _answer(asked: Question, torque: np.ndarray, failed: np.ndarray) -> Allocation:
    """The answer; what no torque was found for although the facets say that there is one has failed."""
    answer = asked.answer(torque, failed)
    lost = answer.reachable & np.isnan(answer.torque).any(axis=0)
    return asked.answer(torque, failed | lost) if lost.any() else answer


def least_norm(
    wheels: InputMap, torque: np.ndarray, lower: np.ndarray, upper: np.ndarray, weight: np.ndarray, slack: float
) -> np.ndarray:
    """min sum w_i M_i^2 subject to C_phi^T M = Pi, lower <= M <= upper, in coordinates of the null torques.

    Args:
        wheels: n wheels.
        torque: (n,) [N m] any torques of the wrench.
        lower: (n,) [N m].
        upper: (n,) [N m].
        weight: w (n,).
        slack: [N m] a limit may be passed by twice this, which is rounding, where there is no torque otherwise.

    Returns:
        (n,) [N m]; NaN where there are none.
    """
    root = np.sqrt(weight)
    q, r = np.linalg.qr(root[:, None] * wheels.null_torque)
    step = np.linalg.solve(r.T, wheels.null_torque.T).T
    best = torque - step @ (q.T @ (root * torque))
    normals, offsets = np.vstack([step, -step]), np.concatenate([upper - best, best - lower])
    # At the border of reach a range may be empty by rounding.
    for wider in (0.0, 1e-4 * slack, 2 * slack):
        found = least_distance(normals, offsets + wider)
        if found.x is not None:
            break
    return np.full(len(torque), np.nan) if found.x is None else best + step @ found.x
