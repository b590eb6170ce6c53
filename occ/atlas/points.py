"""Parameter points as arrays: plain data for any number of circles at once."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields, replace

import numpy as np

from occ.theory.coefficients import YawCoefficients, yaw_coefficients_many


@dataclass(frozen=True)
class Points:
    """N tasks on circles.

    Args:
        wheel_count: n.
        parameters: (P, 4 + 10 n) numbers of the platforms that occur.
        platform: (N,) which of them.
        point: (2, N) [m] B in the body frame.
        radius: (N,) [m] R_B.
        rate: (N,) [rad/s] omega_B.
        phase: (N,) [rad] phi_B.
        heading: (N,) [rad] psi(0).
        heading_rate: (N,) [rad/s] Omega(0).
        duration: (N,) [s].
    """

    wheel_count: int
    parameters: np.ndarray
    platform: np.ndarray
    point: np.ndarray
    radius: np.ndarray
    rate: np.ndarray
    phase: np.ndarray
    heading: np.ndarray
    heading_rate: np.ndarray
    duration: np.ndarray

    def __len__(self) -> int:
        return len(self.radius)

    def of(self, rows: np.ndarray) -> Points:
        """Some of the points.

        Args:
            rows: (K,) their numbers.

        Returns:
            K points.
        """
        names = ("platform", "radius", "rate", "phase", "heading", "heading_rate", "duration")
        chosen = {name: getattr(self, name)[rows] for name in names}
        return replace(self, point=self.point[:, rows], **chosen)

    @property
    def digest(self) -> str:
        """sha256 of all numbers."""
        found = hashlib.sha256()
        for field in fields(self):
            found.update(np.ascontiguousarray(getattr(self, field.name)).tobytes())
        return found.hexdigest()

    @property
    def coefficients(self) -> YawCoefficients:
        """Eq. (3.10) at each point."""
        if len(self.parameters) == 1 and np.all(self.point == self.point[:, :1]):
            one = yaw_coefficients_many(self.wheel_count, self.parameters[0], self.point[:, :1])
            return YawCoefficients(*(np.broadcast_to(value, len(self)) for value in one))
        if len(self.parameters) == 1:
            return yaw_coefficients_many(self.wheel_count, self.parameters[0], self.point)
        return yaw_coefficients_many(self.wheel_count, self.parameters[self.platform].T, self.point)

    @property
    def psi_tilde(self) -> np.ndarray:
        """(N,) [rad] psi~(0) = psi(0) - phi_B."""
        return self.heading - self.phase
