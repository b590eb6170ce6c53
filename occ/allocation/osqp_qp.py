"""The best allocation by OSQP for any number of wheels; nothing that OSQP says is believed.

A torque is taken if residuals recomputed from the problem alone prove it; a wrench is out of reach if a certificate
proves it; everything else has failed, whatever the solver's status.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from occ.allocation.criteria import LEAST_NORM, Criterion
from occ.allocation.criteria.base import Programme
from occ.allocation.input_map import InputMap
from occ.allocation.ranges import NO_LIMIT, TorqueRange
from occ.allocation.reach import tolerance
from occ.allocation.residuals import certified, proven_excess, residuals
from occ.allocation.result import Allocation, Question, question

NEAR_LIMIT = 1e-5
"""A wheel this near to its limit, relative to it, is tried on it where the solver's own polishing has failed."""
FAR = 1e6
"""Limits beyond so many times the torques are no limits for the solver."""
SETTINGS: dict[str, Any] = {
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "eps_prim_inf": 1e-9,
    "eps_dual_inf": 1e-9,
    "polishing": True,
    "polish_refine_iter": 10,
    "check_termination": 5,
    # By iterations and not by the clock: the same problem gives the same numbers on every run.
    "adaptive_rho_interval": 25,
    "max_iter": 20_000,
    "warm_starting": True,
    "verbose": False,
}


class OsqpAllocator:
    """min f(M) subject to C_phi^T M = Pi, lower_i <= M_i <= upper_i; one OSQP workspace, updated and warm-started.

    It is solved for torques in units of a typical one and with orthonormal equations (C_phi = Q R,
    Q^T M = R^-T Pi): all numbers are about 1, and the solver's tolerances are relative ones.

    Args:
        wheels: the input map, any number of wheels.
        criterion: f.

    Source: Stellato et al., OSQP: an operator splitting solver for quadratic programs, Math. Prog. Comp. 12 (2020).
    """

    def __init__(self, wheels: InputMap, criterion: Criterion = LEAST_NORM) -> None:
        criterion.check(wheels.wheel_count)
        self.wheels, self.criterion = wheels, criterion
        self._q, self._r = np.linalg.qr(wheels.wheel_rates)
        self._solver: Any = None

    def allocate(self, wrench: np.ndarray, limits: float | TorqueRange, rates: np.ndarray | None = None) -> Allocation:
        """Solve for many wrenches one after the other.

        Args:
            wrench: (3, N) [N, N, N m].
            limits: one limit [N m] of every wheel, or a range of each.
            rates: (n, N) [rad/s] phi', where f asks for them.

        Returns:
            The allocation; ``failed`` where neither the torque nor its impossibility is proven.

        Raises:
            InputError: arguments that cannot be meant.
        """
        return self.solve(question(self.wheels, wrench, limits, self.criterion, rates))

    def solve(self, asked: Question) -> Allocation:
        """The same with checked arguments."""
        unit = np.maximum(np.abs(asked.min_norm).max(axis=0), 1e-6)
        torque, force, certificate = self._run(asked, unit)
        # The wrench is restored exactly, so that no rounding of the solver moves the platform.
        null = self.wheels.null_torque
        torque = asked.min_norm + null @ (null.T @ torque)
        good = residuals(asked, torque, force).prove | certified(asked, torque).prove
        for k in np.flatnonzero(~good & np.isfinite(torque).all(axis=0)):
            one = asked.of(np.array([k]))
            tried = _on_limits(one, torque[:, [k]])
            if certified(one, tried).prove[0]:
                torque[:, k], good[k] = tried[:, 0], True
        for k in np.flatnonzero(~good & np.isfinite(certificate).all(axis=0)):
            certificate[:, k] = _off_unlimited(asked.of(np.array([k])), certificate[:, k])
        lacking = proven_excess(self.wheels, asked.wrench, asked.ranges, certificate)
        impossible = ~good & (lacking > tolerance(asked.min_norm))
        found = asked.answer(torque, ~good & ~impossible)
        # A proof of the one against the facets' word for the other is a contradiction: neither is believed.
        contradiction = (good & ~found.reachable & ~found.failed) | (impossible & found.reachable)
        return asked.answer(torque, found.failed | contradiction) if contradiction.any() else found

    def _run(self, asked: Question, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What OSQP returns: torques (n, N), multipliers of the wrench (3, N), certificates of impossibility (3, N)."""
        import osqp
        from scipy.sparse import csc_matrix

        program = _programme(asked, unit, self._q, self._r)
        wheels, samples = len(asked.min_norm), asked.min_norm.shape[1]
        size, rows = program.rows.shape[1], program.rows.shape[0]
        # One row a sample: OSQP reads the memory of a strided column as if it were contiguous, without a word.
        linear, low, high = (np.ascontiguousarray(part.T) for part in (program.linear, program.low, program.high))
        if self._solver is None and samples:
            self._solver = osqp.OSQP()
            quadratic = csc_matrix(np.diag(program.quadratic))
            self._solver.setup(quadratic, linear[0], csc_matrix(program.rows), low[0], high[0], **SETTINGS)
        solutions = np.full((size, samples), np.nan)
        duals, certificates = np.full((rows, samples), np.nan), np.zeros((rows, samples))
        for k in range(samples):
            self._solver.update(q=linear[k], l=low[k], u=high[k])
            answer = self._solver.solve(raise_error=False)
            for kept, given in ((solutions, answer.x), (duals, answer.y), (certificates, answer.prim_inf_cert)):
                if np.shape(given) == (len(kept),):
                    kept[:, k] = given
        equations = np.linalg.solve(self._r, np.hstack([duals[:3] * program.value_unit / unit, -certificates[:3]]))
        return solutions[:wheels] * unit, equations[:, :samples], equations[:, samples:]


def _programme(asked: Question, unit: np.ndarray, q: np.ndarray, r: np.ndarray) -> Programme:
    """The criterion's programme with the rows of wrench and limits before its own."""
    n = asked.wheels.wheel_count
    own = asked.criterion.programme(asked.rates, unit)
    rows = np.zeros((3 + n, len(own.quadratic)))
    rows[:, :n] = np.vstack([q.T, np.eye(n)])
    right = np.linalg.solve(r.T, asked.wrench) / unit
    lower, upper = (bound / unit for bound in asked.bounds)
    lower, upper = np.where(lower < -FAR, -np.inf, lower), np.where(upper > FAR, np.inf, upper)
    return own._replace(
        rows=np.vstack([rows, own.rows]),
        low=np.vstack([right, lower, own.low]),
        high=np.vstack([right, upper, own.high]),
    )


def _on_limits(asked: Question, torque: np.ndarray) -> np.ndarray:
    """The torques (n, 1) with the wheels that are near their limits exactly there, the null torque by least squares."""
    null = asked.wheels.null_torque
    lower, upper = asked.ranges.lower[:, :1], asked.ranges.upper[:, :1]
    near = NEAR_LIMIT * np.minimum(upper - lower, NO_LIMIT)
    goal = np.where(torque > upper - near, upper, np.where(torque < lower + near, lower, torque))
    held = (goal != torque)[:, 0]
    if not held.any():
        return torque
    nu = np.linalg.lstsq(null[held], (goal - asked.min_norm)[held], rcond=None)[0]
    return asked.min_norm + null @ nu


def _off_unlimited(asked: Question, certificate: np.ndarray) -> np.ndarray:
    """The certificate (3,) of one sample that does not load the wheels without a limit, which it may by rounding."""
    rows = asked.wheels.wheel_rates @ certificate
    most = np.where(rows > 0, asked.ranges.upper[:, 0], -asked.ranges.lower[:, 0])
    loose = (most >= NO_LIMIT) & (np.abs(rows) < NEAR_LIMIT * np.abs(rows).max())
    wheels = asked.wheels.wheel_rates[loose]
    return certificate - np.linalg.lstsq(wheels, rows[loose], rcond=None)[0] if loose.any() else certificate
