"""The best allocation by OSQP for any number of wheels; nothing that OSQP says is believed.

A torque is taken if residuals recomputed from the problem alone prove it; a wrench is out of reach if a certificate
proves it; everything else has failed, whatever the solver's status.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from occ.allocation.criteria import LEAST_NORM, Criterion, ElectricPower, LargestTorque, WeightedNorm
from occ.allocation.input_map import InputMap
from occ.allocation.ranges import NO_LIMIT, TorqueRange
from occ.allocation.reach import tolerance
from occ.allocation.residuals import certified, proven_excess, residuals
from occ.allocation.result import Allocation, Question, question
from occ.errors import InputError

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


class _Programme(NamedTuple):
    """min z P z / 2 + q z, l <= A z <= u: P, A fixed; q, l, u (.., N) of all samples; the first n of z are torques."""

    quadratic: np.ndarray
    rows: np.ndarray
    linear: np.ndarray
    low: np.ndarray
    high: np.ndarray
    # The multipliers of f are those of the programme times this.
    value_unit: np.ndarray


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


def _programme(asked: Question, unit: np.ndarray, q: np.ndarray, r: np.ndarray) -> _Programme:
    """The quadratic programme of a criterion, for torques in units of `unit` (N,) [N m]."""
    criterion, (n, count) = asked.criterion, asked.min_norm.shape
    right = np.linalg.solve(r.T, asked.wrench) / unit
    lower, upper = (np.clip(b / unit, -FAR, FAR) for b in (asked.ranges.lower, asked.ranges.upper))
    one, zero, none = np.eye(n), np.zeros((n, n)), np.full((n, count), np.inf)
    boxed = (
        np.vstack([right, np.broadcast_to(lower, (n, count))]),
        np.vstack([right, np.broadcast_to(upper, (n, count))]),
    )
    if isinstance(criterion, WeightedNorm):
        weight = 2 * criterion.of(n)[:, 0]
        return _Programme(weight, np.vstack([q.T, one]), np.zeros((n, count)), *boxed, unit**2)
    if isinstance(criterion, LargestTorque):
        # z = (M, t): M_i - t <= 0 <= M_i + t.
        columns = np.vstack([np.zeros((3 + n, 1)), -np.ones((n, 1)), np.ones((n, 1))])
        rows = np.hstack([np.vstack([q.T, one, one, one]), columns])
        linear = np.vstack([np.zeros((n, count)), np.ones((1, count))])
        flat = np.zeros((n, count))
        return _Programme(
            np.zeros(n + 1),
            rows,
            linear,
            np.vstack([boxed[0], -none, flat]),
            np.vstack([boxed[1], flat, none]),
            unit,
        )
    if isinstance(criterion, ElectricPower):
        # z = (M, d): d_i >= 0, M_i - d_i <= idle_high, M_i + d_i >= idle_low; f = sum k d_i^2 + |phi_i'| d_i.
        rates = np.broadcast_to(asked.rates, (n, count))
        idle = np.sort([np.zeros((n, count)), -rates / (criterion.loss * unit)], axis=0)
        rows = np.block([[q.T, np.zeros((3, n))], [one, zero], [one, -one], [one, one], [zero, one]])
        linear = np.vstack([np.zeros((n, count)), np.abs(rates) / (criterion.loss * unit)])
        return _Programme(
            np.concatenate([np.zeros(n), np.full(n, 2.0)]),
            rows,
            linear,
            np.vstack([boxed[0], -none, idle[0], np.zeros((n, count))]),
            np.vstack([boxed[1], idle[1], none, none]),
            criterion.loss * unit**2,
        )
    raise InputError(f"no quadratic programme of {type(criterion).__name__}")


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
