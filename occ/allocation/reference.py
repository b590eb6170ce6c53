"""Every allocation written as it is meant, in CVXPY with parameters: for tests and for readers."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from occ.allocation.criteria import LEAST_NORM, Criterion
from occ.allocation.input_map import InputMap
from occ.allocation.ranges import TorqueRange
from occ.allocation.result import Question, question

FAR = 100.0
"""Limits beyond so many times the torques are left out."""


class Written(NamedTuple):
    """What CVXPY found for one wrench.

    Args:
        torque: (n,) [N m]; None where there is none.
        value: f; infinite where the wrench is out of reach, NaN where the solver cannot tell.
        force: (3,) multipliers lambda of C_phi^T M = Pi.
    """

    torque: np.ndarray | None
    value: float
    force: np.ndarray | None


class Reference:
    """min f(M) subject to C_phi^T M = Pi, lower <= M <= upper; compiled once, solved for many parameters.

    Args:
        wheels: the input map.
        criterion: f.
    """

    def __init__(self, wheels: InputMap, criterion: Criterion = LEAST_NORM) -> None:
        import cvxpy as cp

        criterion.check(wheels.wheel_count)
        n = wheels.wheel_count
        self.wheels, self.criterion = wheels, criterion
        self._wrench, self._rates = cp.Parameter((3, 1)), cp.Parameter((n, 1))
        self._lower, self._upper = cp.Parameter((n, 1)), cp.Parameter((n, 1))
        self._torque = cp.Variable((n, 1))
        self._made = wheels.wheel_rates.T @ self._torque == self._wrench
        within = [self._torque >= self._lower, self._torque <= self._upper]
        self._problem = cp.Problem(cp.Minimize(criterion.written(self._torque, self._rates)), [self._made, *within])

    def solve(self, wrench: np.ndarray, limits: float | TorqueRange, rates: np.ndarray | None = None) -> Written:
        """One wrench.

        Args:
            wrench: (3,) [N, N, N m].
            limits: one limit [N m] of every wheel, or a range of each (n, 1).
            rates: (n,) [rad/s] phi', where f asks for them.

        Returns:
            Torque, value and multipliers.

        Raises:
            InputError: arguments that cannot be meant.
        """
        import cvxpy as cp

        columns = None if rates is None else np.asarray(rates)[..., None]
        asked = question(self.wheels, np.asarray(wrench)[..., None], limits, self.criterion, columns)
        self._wrench.value, self._rates.value = asked.wrench, asked.rates
        self._lower.value, self._upper.value = _near_limits(asked)
        status = _status(self._problem)
        if status != cp.OPTIMAL:
            return Written(None, np.inf if status == cp.INFEASIBLE else np.nan, None)
        force = np.asarray(self._made.dual_value)[:, 0]
        return Written(np.asarray(self._torque.value)[:, 0], float(self._problem.value), force)


def least_torques(asked: Question) -> np.ndarray:
    """min sum over samples of f(M) subject to C_phi^T M = Pi, lower <= M <= upper, as one problem.

    Args:
        asked: about wrenches in reach.

    Returns:
        (n, N) [N m]; NaN where the solver cannot tell.
    """
    import cvxpy as cp

    torque = cp.Variable(asked.min_norm.shape)
    lower, upper = _near_limits(asked)
    rates = np.broadcast_to(asked.rates, torque.shape)
    made = asked.wheels.wheel_rates.T @ torque == asked.wrench
    goal = cp.Minimize(asked.criterion.written(torque, rates))
    return _by_halves(least_torques, asked, cp.Problem(goal, [made, torque >= lower, torque <= upper]), torque)


def least_excess(asked: Question) -> np.ndarray:
    """min sum over samples of e >= 0 subject to C_phi^T M = Pi, lower - e <= M <= upper + e, as one problem.

    Args:
        asked: about any wrenches.

    Returns:
        (1, N) [N m] by how much every limit would have to be wider; NaN where the solver cannot tell.
    """
    import cvxpy as cp

    torque, excess = cp.Variable(asked.min_norm.shape), cp.Variable((1, asked.min_norm.shape[1]), nonneg=True)
    lower, upper = _near_limits(asked)
    made = asked.wheels.wheel_rates.T @ torque == asked.wrench
    wider = np.ones((asked.wheels.wheel_count, 1)) @ excess
    within = [torque >= lower - wider, torque <= upper + wider]
    return _by_halves(least_excess, asked, cp.Problem(cp.Minimize(cp.sum(excess)), [made, *within]), excess)


def _near_limits(asked: Question) -> tuple[np.ndarray, np.ndarray]:
    """An interior point is not helped by limits that are nowhere near."""
    far = FAR * max(1.0, float(np.abs(asked.min_norm).max()))
    lower, upper = asked.bounds
    return lower.clip(-far, far), upper.clip(-far, far)


def _status(problem: Any) -> str | None:
    """Solve, and say what became of it; None where the solver gave up."""
    import cvxpy as cp

    try:
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    except cp.SolverError:
        return None
    return str(problem.status)


def _by_halves(solve: Callable[[Question], np.ndarray], asked: Question, problem: Any, wanted: Any) -> np.ndarray:
    """(k, N) The variable that is wanted; where one sample spoils the problem of all the halves are solved alone."""
    import cvxpy as cp

    count = asked.min_norm.shape[1]
    if _status(problem) == cp.OPTIMAL:
        return np.asarray(wanted.value)
    if count == 1:
        return np.full(wanted.shape, np.nan)
    return np.hstack([solve(asked.of(slice(count // 2))), solve(asked.of(slice(count // 2, None)))])
