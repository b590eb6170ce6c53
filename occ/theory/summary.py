"""What the platform will do on one circle, as plain numbers under the names that `occ circle` prints.

Each section is a function of the setting; to add quantities, write a section and put it into `SECTIONS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from occ.task import Task
from occ.theory.asymptotics import HIGHEST_ORDER, asymptotic_period
from occ.theory.attractors import Attractor, find_attractors
from occ.theory.circle import CircleQuantities, circle_quantities, side_of_critical
from occ.theory.coefficients import YawCoefficients, yaw_coefficients
from occ.theory.dissipation import circle_of
from occ.theory.equation import ScaledEquation, scaled_equation, yaw_acceleration
from occ.theory.law_power import long_run_section
from occ.theory.orbits import Orbits, one_turn, rotating_orbit
from occ.theory.stability import eigenvalues, stable_radii, sufficient
from occ.theory.wheels import WheelDemand, wheel_demand

SETTLED = 0.02
"""A motion has settled when its deviation is this part of what it was."""


class Setting(NamedTuple):
    """A task on a circle and what follows from its coefficients."""

    task: Task
    radius: float  # [m] R_B
    rate: float  # [rad/s] omega_B
    c: YawCoefficients
    q: CircleQuantities
    eq: ScaledEquation

    @property
    def regime(self) -> str:
        """Existence of steady rotations: ``steady``, ``critical`` or ``rotational``, eq. (4.6)."""
        return ("rotational", "critical", "steady")[int(side_of_critical(self.q.radius_ratio)) + 1]


def circle_setting(task: Task) -> Setting:
    """The setting of a task.

    Args:
        task: whose motion is a circle.

    Returns:
        Coefficients and quantities of eqs. (3.10), (4.5).

    Raises:
        InputError: another motion.
    """
    motion = circle_of(task)
    c = yaw_coefficients(task.platform, task.point)
    q = circle_quantities(c, motion.radius, motion.rate)
    eq = scaled_equation(c, motion.radius, motion.rate)
    return Setting(task, motion.radius, motion.rate, c, q, eq)


def circle_summary(task: Task) -> dict[str, Any]:
    """Regime, steady rotations, attractors, periods, wheel demands and long-run power of a task on a circle.

    Args:
        task: whose motion is a circle.

    Returns:
        Plain data: numbers (some of them infinite), text, lists and dictionaries.

    Raises:
        InputError: another motion.
    """
    setting = circle_setting(task)
    summary: dict[str, Any] = {}
    for section in SECTIONS:
        summary |= section(setting)
    return summary


def _quantities(s: Setting) -> dict[str, Any]:
    return {
        "radius_m": s.radius,
        "rate_rad_s": s.rate,
        "critical_radius_m": float(s.q.critical_radius),
        "critical_speed_m_s": float(s.q.critical_speed),
        "alpha_rad": float(s.q.alpha),
        "beta_rad": float(s.q.beta),
        "epsilon": float(s.q.epsilon),
        "k": float(s.q.k),
        "radius_ratio": float(s.q.radius_ratio),
        "regime": s.regime,
    }


def _stability(s: Setting) -> dict[str, Any]:
    radii = stable_radii(s.c, s.rate)
    return {
        "steady": _steady(s),
        "sufficient_conditions": bool(sufficient(s.q, s.radius, s.rate)),
        "stable_radii_m": [float(radii.lower), float(radii.upper)] if radii.lower < radii.upper else None,
    }


def _steady(s: Setting) -> list[dict[str, Any]]:
    """Steady rotations, the one of positive stiffness first; at the critical radius there is one, stable-unstable."""
    if s.regime == "rotational":
        return []
    if s.regime == "critical":
        at = circle_quantities(s.c, s.q.critical_radius, s.rate)
        return [_root(float(at.stable_heading), float(at.stable_damping), 0.0)]
    stiffness = float(s.q.stiffness)
    return [
        _root(float(s.q.stable_heading), float(s.q.stable_damping), stiffness),
        _root(float(s.q.unstable_heading), float(s.q.unstable_damping), -stiffness),
    ]


def _root(heading: float, damping: float, stiffness: float) -> dict[str, Any]:
    values = [complex(value) for value in eigenvalues(damping, stiffness)]
    return {
        "psi_tilde_rad": heading,
        "stable": damping > 0 and stiffness > 0,
        "eigenvalues": [value.real + 0.0 if value.imag == 0 else [value.real, value.imag] for value in values],
    }


def _attractors(s: Setting) -> dict[str, Any]:
    """All attractors, and for the first one the time in which deviations from it fall to `SETTLED`."""
    found = find_attractors(s.c, s.radius, s.rate)
    return {
        "attractors": [_attractor(s, item) for item in found],
        "settling_time_s": _settling_time(s, found[0]),
    }


def _settling_time(s: Setting, attractor: Attractor) -> float:
    decay = 0.0
    if attractor.kind == "steady":
        decay = -float(eigenvalues(s.q.stable_damping, s.q.stiffness).real.max())
    elif attractor.orbit is not None:
        decay = float(attractor.orbit.orbit.mean_damping)
    return -math.log(SETTLED) / decay if decay > 0 else math.inf


def _attractor(s: Setting, item: Attractor) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": item.kind, "share": item.share}
    if item.psi_tilde is not None:
        still = np.array([item.psi_tilde])
        entry["psi_tilde_rad"] = item.psi_tilde
        entry["mean_yaw_rate_rad_s"] = s.rate
        return entry | _wheels(s, (still, np.array([s.rate])), np.ones(1))
    if item.orbit is not None:
        turn = one_turn(s.eq, item.orbit)
        entry |= _rotation(item.orbit.orbit)
        return entry | _wheels(s, (turn.psi_tilde, turn.yaw_rate), turn.share)
    return entry


def _rotation(orbit: Orbits) -> dict[str, Any]:
    return {
        "period_s": float(orbit.period),
        "mean_yaw_rate_rad_s": float(orbit.mean_yaw_rate),
        "yaw_rate_amplitude_rad_s": float(orbit.amplitude),
        "floquet_multiplier": float(orbit.multiplier),
    }


def _wheels(s: Setting, rotation: tuple[np.ndarray, np.ndarray], share: np.ndarray) -> dict[str, Any]:
    """Torques, speeds and powers of the wheels in a steady rotation or over an exact period."""
    acceleration = yaw_acceleration(s.c, s.radius, s.rate, *rotation)
    demand: WheelDemand = wheel_demand(s.task.platform, s.task.point, (s.radius, s.rate), (*rotation, acceleration))
    constant = {"wheel_torque_Nm": [float(value) for value in demand.torque[:, 0]]} if len(share) == 1 else {}
    return constant | {
        "peak_torque_Nm": [float(value) for value in np.abs(demand.torque).max(axis=1)],
        "peak_wheel_speed_rad_s": [float(value) for value in np.abs(demand.speed).max(axis=1)],
        "peak_power_W": [float(value) for value in np.abs(demand.power).max(axis=1)],
        "mean_power_W": float((demand.power.sum(axis=0) * share).sum()),
    }


def _rotational(s: Setting) -> dict[str, Any]:
    """Period and means of the rotational regime, where there is no steady rotation."""
    if s.regime != "rotational":
        return {}
    found = rotating_orbit(s.eq)
    periods = {
        "period_asymptotic_s": float(asymptotic_period(s.eq)),
        "period_corrected_s": float(asymptotic_period(s.eq, HIGHEST_ORDER)),
    }
    return (_rotation(found.orbit) if found else {"period_s": None, "mean_yaw_rate_rad_s": None}) | periods


SECTIONS: tuple[Callable[[Setting], dict[str, Any]], ...] = (
    _quantities,
    _stability,
    _rotational,
    _attractors,
    long_run_section,
)
