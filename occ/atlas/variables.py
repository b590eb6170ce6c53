"""What an atlas may hold: names, units and meanings, the same names as in `occ circle --json`."""

from __future__ import annotations

from typing import NamedTuple

MISSING, STEADY, CRITICAL, ROTATIONAL, UNSTABLE = "", "steady", "critical", "rotational", "unstable"
REGIMES = (MISSING, STEADY, CRITICAL, ROTATIONAL, UNSTABLE)
"""Texts are kept as their places in this list."""


class Variable(NamedTuple):
    """A quantity at each point.

    Args:
        unit: ``1`` where there is none.
        meaning: one line.
        text: whether its values are places in `REGIMES`.
    """

    unit: str
    meaning: str
    text: bool = False


LONG_RUN: dict[str, Variable] = {
    "critical_radius_m": Variable("m", "R~_B of eq. (4.6): smaller circles have no steady rotation"),
    "critical_speed_m_s": Variable("m/s", "V~_B of eq. (4.8)"),
    "alpha_rad": Variable("rad", "alpha"),
    "beta_rad": Variable("rad", "beta"),
    "epsilon": Variable("1", "|omega_B|/xi_3 of eq. (4.9)"),
    "radius_ratio": Variable("1", "R_B/R~_B; above 1 there are steady rotations of the law"),
    "regime": Variable("1", "existence of steady rotations of the law", text=True),
    "stable_psi_tilde_rad": Variable("rad", "steady rotation of positive stiffness; missing where there is none"),
    "unstable_psi_tilde_rad": Variable("rad", "steady rotation of negative stiffness; missing where there is none"),
    "eigenvalue_real_1_s": Variable("1/s", "largest real part at the steady rotation of positive stiffness, eq. (4.7)"),
    "eigenvalue_imaginary_1_s": Variable("1/s", "imaginary part of the same"),
    "law_regime": Variable("1", "what becomes of the law from the given start", text=True),
    "period_s": Variable("s", "of the rotational motion; missing where the law does not rotate"),
    "period_asymptotic_s": Variable("s", "the same to leading order in epsilon, eq. (4.15)"),
    "mean_yaw_rate_rad_s": Variable("rad/s", "mean of Omega of the law in the long run"),
    "law_mean_power_W": Variable("W", "mean power of the law in the long run; missing where it is unstable"),
    "law_torque_Nm": Variable("N m", "largest wheel torque of the law's steady rotation"),
    "least_mean_power_W": Variable("W", "least mean power of any rotation strategy"),
    "least_mean_power_regime": Variable("1", "of the motion with the least mean power", text=True),
    "optimal_switch_radius_m": Variable("m", "on smaller circles a rotational motion is optimal"),
    "long_run_gap_percent": Variable("%", "law_mean_power_W above least_mean_power_W"),
    "platform_speed_m_s": Variable("m/s", "speed of B, R_B |omega_B|"),
}

LEAST_WORK: dict[str, Variable] = {
    "law_work_J": Variable("J", "work of the law over the horizon, from the given start"),
    "least_work_J": Variable("J", "infimum over all motions with B on its program from the given start, the end free"),
    "work_gap_percent": Variable("%", "law_work_J above least_work_J"),
}


def place(regime: str) -> int:
    """Where a regime is in the list."""
    return REGIMES.index(regime)
