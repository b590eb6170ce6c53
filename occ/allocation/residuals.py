"""What proves that a torque is the box-limited allocation of least norm, or that there is none: no word of a solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.allocation.input_map import InputMap

PROOF = 1e-9
"""Largest residual of a proven torque, relative to the limit (the gap: to its square)."""


@dataclass(frozen=True)
class Residuals:
    """How far a point is from being the solution of min |M|^2/2, C_phi^T M = Pi, |M_i| <= limit.

    Args:
        wrench: [N m] largest torque whose wrench is C_phi^T M - Pi.
        box: [N m] largest excess over the limit.
        stationarity: [N m] largest entry of M + C_phi lambda + mu.
        gap: [N^2 m^2] primal objective minus dual objective of the multipliers alone.
    """

    wrench: float
    box: float
    stationarity: float
    gap: float

    def prove(self, limit: float) -> bool:
        """Whether the point solves the problem; False, too, where a residual is not a number."""
        return self.largest(limit) <= PROOF

    def largest(self, limit: float) -> float:
        """The largest residual, relative to the limit [N m] (the gap: to its square)."""
        parts = np.array([self.wrench, self.box, self.stationarity, abs(self.gap) / limit])
        return float(parts.max() / limit)


def residuals(
    wheels: InputMap, wrench: np.ndarray, limit: float, torque: np.ndarray, force: np.ndarray, bound: np.ndarray
) -> Residuals:
    """Residuals of the Karush-Kuhn-Tucker conditions from the problem alone.

    The dual objective -|C_phi lambda + mu|^2/2 - lambda Pi - limit sum |mu_i| holds for every lambda and mu, so that
    a gap of zero proves the torque optimal without any word of the solver.

    Args:
        wheels: the input map.
        wrench: (3,) Pi.
        limit: [N m].
        torque: (n,) M.
        force: (3,) lambda, multipliers of the wrench.
        bound: (n,) mu, multipliers of the limits, with the sign of the torque that they hold.

    Returns:
        The residuals.

    Source: Boyd and Vandenberghe, Convex Optimization, 5.5.
    """
    pull = wheels.wheel_rates @ force + bound
    dual = -pull @ pull / 2 - force @ wrench - limit * np.abs(bound).sum()
    return Residuals(
        wrench=float(np.abs(wheels.min_norm @ (wheels.wheel_rates.T @ torque - wrench)).max()),
        box=float(np.maximum(np.abs(torque).max() - limit, 0.0)),
        stationarity=float(np.abs(torque + pull).max()),
        gap=float(torque @ torque / 2 - dual),
    )


def proven_peak(wheels: InputMap, wrench: np.ndarray, force: np.ndarray) -> float:
    """max_i |M_i| >= |w Pi| / sum_i |(C_phi w)_i| for every M of the wrench and every w.

    Args:
        wheels: the input map.
        wrench: (3,) Pi.
        force: (3,) w, any vector: the certificate.

    Returns:
        [N m] what the certificate proves to be needed; 0 where it proves nothing.
    """
    size = float(np.abs(wheels.wheel_rates @ force).sum())
    return abs(float(force @ wrench)) / size if size > 0 and np.isfinite(size) else 0.0
