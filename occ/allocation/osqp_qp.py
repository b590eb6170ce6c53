"""The box-limited allocation of least norm by OSQP for any number of wheels; nothing that OSQP says is believed.

A torque is taken if its residuals, recomputed from the problem alone, prove it; a wrench is out of reach if a
certificate proves it; everything else has failed, whatever the solver's status.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from occ.allocation.input_map import InputMap
from occ.allocation.residuals import proven_peak, residuals
from occ.allocation.result import REACH, Allocation, allocation_of, checked, checked_limit

NEAR_LIMIT = 1e-5
"""A wheel this near to its limit, relative to it, is tried on it where the solver's own polishing has failed."""
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


class BoxLimitedQp:
    """min |M|^2 subject to C_phi^T M = Pi, |M_i| <= limit; one OSQP workspace, updated and warm-started.

    It is solved for x = M / limit and with orthonormal equations (C_phi = Q R, Q^T x = R^-T Pi / limit): all numbers
    are about 1, and the solver's tolerances mean parts of the limit.

    Args:
        wheels: the input map, any number of wheels.
        limit: [N m], of every wheel.

    Raises:
        InputError: a limit that is not positive.

    Source: Stellato et al., OSQP: an operator splitting solver for quadratic programs, Math. Prog. Comp. 12 (2020).
    """

    def __init__(self, wheels: InputMap, limit: float) -> None:
        import osqp
        from scipy.sparse import csc_matrix, identity

        self.wheels, self.limit = wheels, checked_limit(limit)
        self.worst = 0.0
        """Largest residual of the torques proven so far, relative to the limit."""
        n = wheels.wheel_count
        self._q, self._r = np.linalg.qr(wheels.wheel_rates)
        self._low, self._high = -np.ones(3 + n), np.ones(3 + n)
        self._solver = osqp.OSQP()
        rows = csc_matrix(np.vstack([self._q.T, np.eye(n)]))
        self._solver.setup(identity(n, format="csc"), np.zeros(n), rows, self._low, self._high, **SETTINGS)

    def allocate(self, wrench: np.ndarray) -> Allocation:
        """Solve for many wrenches one after the other.

        Args:
            wrench: (3, N) [N, N, N m].

        Returns:
            The allocation; ``failed`` where neither the torque nor its impossibility is proven.

        Raises:
            InputError: wrenches that are not finite or not (3, N).
        """
        wrench, _ = checked(self.wheels, wrench, self.limit)
        torque = np.full((self.wheels.wheel_count, wrench.shape[1]), np.nan)
        unproven = np.zeros(wrench.shape[1], dtype=bool)
        for k in range(wrench.shape[1]):
            found, shown_impossible = self._solve(wrench[:, k])
            if found is not None:
                torque[:, k] = found
            unproven[k] = found is None and not shown_impossible
        result = allocation_of(self.wheels, self.wheels.min_norm @ wrench, self.limit, torque.copy(), unproven)
        # A proof of the one against the facets' word for the other is a contradiction: neither is believed.
        contradiction = ~unproven & (result.reachable != np.isfinite(torque[0]))
        result.torque[:, contradiction] = np.nan
        result.failed[contradiction], result.reachable[contradiction] = True, False
        return result

    def _solve(self, wrench: np.ndarray) -> tuple[np.ndarray | None, bool]:
        """A proven torque (n,) or None, and whether it is proven that there is none."""
        n, limit = self.wheels.wheel_count, self.limit
        right = np.linalg.solve(self._r.T, wrench) / limit
        self._low[:3], self._high[:3] = right, right
        self._solver.update(l=self._low, u=self._high)
        answer = self._solver.solve(raise_error=False)
        x, y = np.asarray(answer.x, dtype=float), np.asarray(answer.y, dtype=float)
        if x.shape == (n,) and y.shape == (3 + n,) and np.isfinite(x).all() and np.isfinite(y).all():
            # The wrench is restored exactly, so that no rounding of the solver moves the platform.
            null, min_norm = self.wheels.null_torque, self.wheels.min_norm @ wrench
            torque = min_norm + null @ (null.T @ x) * limit
            if self._prove(wrench, torque, y[3:] * limit):
                return torque, False
            torque, bound = self._polished(min_norm, x)
            if self._prove(wrench, torque, bound):
                return torque, False
        certificate = answer.prim_inf_cert
        if certificate is not None and np.shape(certificate) == (3 + n,):
            force = np.linalg.solve(self._r, np.asarray(certificate[:3], dtype=float))
            return None, proven_peak(self.wheels, wrench, force) > limit * (1 + REACH)
        return None, False

    def _prove(self, wrench: np.ndarray, torque: np.ndarray, bound: np.ndarray) -> bool:
        """Whether torques (n,) and multipliers of the limits (n,) prove each other."""
        # The best multipliers of the wrench follow from those of the limits.
        force = -self.wheels.min_norm.T @ (torque + bound)
        found = residuals(self.wheels, wrench, self.limit, torque, force, bound)
        proven = found.prove(self.limit)
        if proven:
            self.worst = max(self.worst, found.largest(self.limit))
        return proven

    def _polished(self, min_norm: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The torques (n,) with the wheels that x (n,) has near their limits exactly there, and multipliers (n,)."""
        from scipy.optimize import nnls

        null, side = self.wheels.null_torque, np.sign(x)
        held = np.abs(x) > 1 - NEAR_LIMIT
        nu = np.linalg.lstsq(null[held], side[held] * self.limit - min_norm[held], rcond=None)[0]
        bound = np.zeros(len(x))
        if held.any() and nu.size:
            bound[held] = side[held] * nnls((side[held, None] * null[held]).T, -nu)[0]
        return min_norm + null @ nu, bound
