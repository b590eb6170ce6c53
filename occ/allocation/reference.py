"""Every allocation written as it is meant, in CVXPY with parameters: for tests and for readers."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np

from occ.allocation.criteria import LEAST_NORM, Criterion
from occ.allocation.input_map import InputMap
from occ.allocation.ranges import TorqueRange
from occ.allocation.result import question

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
        self._wrench, self._rates = cp.Parameter(3), cp.Parameter(n)
        self._lower, self._upper = cp.Parameter(n), cp.Parameter(n)
        self._torque = cp.Variable(n)
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
        n = self.wheels.wheel_count
        self._wrench.value, self._rates.value = asked.wrench[:, 0], np.broadcast_to(asked.rates[:, 0], n)
        # An interior point is not helped by limits that are nowhere near.
        far = FAR * max(1.0, float(np.abs(asked.min_norm).max()))
        self._lower.value, self._upper.value = (
            b[:, 0].clip(-far, far) for b in (asked.ranges.lower, asked.ranges.upper)
        )
        try:
            with warnings.catch_warnings(action="ignore", category=UserWarning):
                value = self._problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
        except cp.SolverError:
            return Written(None, np.nan, None)
        if self._problem.status != cp.OPTIMAL:
            return Written(None, np.inf if self._problem.status == cp.INFEASIBLE else np.nan, None)
        return Written(np.asarray(self._torque.value), float(value), np.asarray(self._made.dual_value))
