"""The paper's symbols as numbers, by the formulas that the paper prints for them, and random motions to try them on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occ.model.presets import YouBot

SEED = 2026
TRIALS = 40


@dataclass(frozen=True)
class Symbols:
    """Eq. (2.17) and what follows from it, in the paper's letters; l is the half track, h the half wheelbase."""

    m: float
    m_1: float
    I_s: float
    J_1: float
    a_X: float
    a_Y: float
    mu_1: float
    mu_2: float
    l: float
    h: float
    R: float
    r: float

    @classmethod
    def of(cls, preset: YouBot) -> Symbols:
        """The symbols of a platform.

        Args:
            preset: with its parameters.

        Returns:
            Its numbers by the paper's letters [SI].
        """
        return cls(
            preset.platform_mass,
            preset.wheel_mass,
            preset.yaw_inertia,
            preset.wheel_spin_inertia,
            *preset.mass_center,
            preset.wheel_friction,
            preset.roller_friction,
            preset.half_track,
            preset.half_wheelbase,
            preset.wheel_radius,
            preset.roller_radius,
        )

    @property
    def m_s(self) -> float:
        """[kg] After eq. (2.15)."""
        return self.m + 4 * self.m_1

    @property
    def m_a(self) -> float:
        """[kg] After eq. (2.15)."""
        return self.m_s + 4 / self.R**2 * self.J_1

    @property
    def I_a(self) -> float:
        """[kg m^2] After eq. (2.15)."""
        return self.I_s + 4 * (self.l + self.h) ** 2 / self.R**2 * self.J_1

    @property
    def zeta_X(self) -> float:
        """[N s/m] After eq. (2.11)."""
        return 4 * self.mu_1 / self.R**2

    @property
    def zeta_Y(self) -> float:
        """[N s/m] After eq. (2.11)."""
        return 4 * self.mu_1 / self.R**2 + 8 * self.mu_2 / self.r**2

    @property
    def mu_Omega(self) -> float:
        """[N m s] After eq. (2.11)."""
        return 4 * self.mu_1 * (self.l + self.h) ** 2 / self.R**2 + 8 * self.mu_2 * self.h**2 / self.r**2

    def J_a(self, b_X: float, b_Y: float) -> float:
        """[kg m^2] After eq. (3.8), first line."""
        return self.I_a - 2 * self.m * (self.a_X * b_X + self.a_Y * b_Y) + self.m_a * (b_X**2 + b_Y**2)

    def yaw(self, b_X: float, b_Y: float) -> Mapping[str, float]:
        """Eq. (3.10): the coefficients by the paper's names.

        Args:
            b_X: [m].
            b_Y: [m].

        Returns:
            kappa [1/m], xi_1 and xi_2 [1/(m s)], xi_3 [1/s].
        """
        J_a = self.J_a(b_X, b_Y)
        return {
            "kappa_11": (self.m_a * b_X - self.m * self.a_X) / J_a,
            "kappa_12": (self.m_a * b_Y - self.m * self.a_Y) / J_a,
            "kappa_21": (self.m_s * b_X - self.m * self.a_X) / J_a,
            "kappa_22": (self.m_s * b_Y - self.m * self.a_Y) / J_a,
            "xi_1": self.zeta_Y * b_X / J_a,
            "xi_2": self.zeta_X * b_Y / J_a,
            "xi_3": (self.mu_Omega + self.zeta_X * b_Y**2 + self.zeta_Y * b_X**2) / J_a,
        }


@dataclass(frozen=True)
class OfPreset:
    """What can be said of a platform, and the paper's symbols for it.

    Args:
        preset: the platform's parameters.
    """

    preset: YouBot

    @cached_property
    def symbols(self) -> Symbols:
        """The paper's letters as numbers."""
        return Symbols.of(self.preset)


def random_motions() -> tuple[np.ndarray, np.ndarray]:
    """Velocities pi' (3, N) and accelerations pi'' (3, N) of every direction, the same at every call."""
    rng = np.random.default_rng(SEED)
    return rng.uniform(-1, 1, (3, TRIALS)), rng.uniform(-1, 1, (3, TRIALS))
