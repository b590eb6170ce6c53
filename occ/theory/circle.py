"""The platform on a circle, section 4.1: critical radius and speed, steady rotations, their linear stability.

One CasADi function holds the formulas: NumPy does its operations for any number of points at once, and derivatives of
every quantity with respect to every parameter come from CasADi.  Where a denominator vanishes, infinity is the answer:
no critical speed without spin inertia of the wheels, no critical radius at the singular point (4.20).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from occ.numeric import on_arrays
from occ.theory.coefficients import YawCoefficients

CANCELLED = 1e-14
"""A sum that is smaller than this part of its terms is taken for zero."""
CRITICAL = 1e-9
"""A radius is the critical one within this relative distance."""


class CircleQuantities(NamedTuple):
    """What eqs. (4.4)-(4.9) are made of, each an array; angles in (-pi, pi]."""

    critical_radius: np.ndarray  # [m] R~_B, infinite at the singular point (4.20), zero without friction
    critical_speed: np.ndarray  # [m/s] V~_B, infinite where the wheels have no spin inertia
    alpha: np.ndarray  # [rad]
    beta: np.ndarray  # [rad]
    epsilon: np.ndarray  # [1] |omega_B|/xi_3
    k: np.ndarray  # [1] K of eq. (4.9)
    radius_ratio: np.ndarray  # [1] rho = R_B/R~_B, infinite without friction
    stable_heading: np.ndarray  # [rad] psi~_s of positive stiffness, NaN where there is no steady rotation
    unstable_heading: np.ndarray  # [rad] psi~_s of negative stiffness, NaN likewise
    stable_damping: np.ndarray  # [1/s] coefficient of the rate in eq. (4.7), NaN likewise
    unstable_damping: np.ndarray  # [1/s]
    stiffness: np.ndarray  # [1/s^2] coefficient of the deviation in eq. (4.7) at the stable root


@cache
def circle_function() -> ca.Function:
    """CasADi function (coefficients, radius, rate) -> the `CircleQuantities` as a column, eqs. (4.4)-(4.9).

    Returns:
        The function ``circle`` of `YawCoefficients` (14,), R_B [m] and omega_B [rad/s].
    """
    coefficients = ca.SX.sym("coefficients", len(YawCoefficients._fields))
    radius, rate = ca.SX.sym("radius"), ca.SX.sym("rate")
    c = YawCoefficients(*ca.vertsplit(coefficients))
    cosine, sine = _sum(c.xi_1, c.kappa_22 * rate), _sum(c.xi_2, -c.kappa_21 * rate)
    spin_cosine, spin_sine = _sum(c.kappa_11, -c.kappa_21), _sum(c.kappa_12, -c.kappa_22)
    drive, spin = ca.hypot(cosine, sine), ca.hypot(spin_cosine, spin_sine)
    # Without friction steady rotations exist at every radius, also where nothing drives the rotation (0/0).
    critical_radius = ca.if_else(c.xi_3 == 0, 0, c.xi_3 / drive)
    critical_speed = ca.if_else(spin == 0, ca.inf, c.xi_3 / spin)
    alpha, beta = ca.atan2(sine, cosine), ca.atan2(spin_sine, spin_cosine)
    turn = ca.sign(rate) * ca.acos(critical_radius / radius)
    headings = [_wrapped(-alpha + turn), _wrapped(-alpha - turn)]
    dampings = [c.xi_3 + radius * rate * spin * ca.sin(heading + beta) for heading in headings]
    # The root with sin(psi~ + alpha) of the sign of omega_B, eq. (4.7); errata 6.
    stiffness = radius * rate * drive * ca.sin(turn)
    column = ca.vertcat(
        critical_radius,
        critical_speed,
        alpha,
        beta,
        ca.fabs(rate) / c.xi_3,
        radius * spin,
        radius / critical_radius,
        *headings,
        *dampings,
        stiffness,
    )
    return ca.Function(
        "circle", [coefficients, radius, rate], [column], ["coefficients", "radius", "rate"], ["quantities"]
    )


def _sum(one: ca.SX, other: ca.SX) -> ca.SX:
    """One + other, exactly zero where the two cancel to the last digits: there a quotient is to be infinite."""
    value = one + other
    return ca.if_else(ca.fabs(value) <= CANCELLED * (ca.fabs(one) + ca.fabs(other)), 0, value)


def _wrapped(angle: ca.SX) -> ca.SX:
    return ca.atan2(ca.sin(angle), ca.cos(angle))


def circle_quantities(c: YawCoefficients, radius: np.ndarray | float, rate: np.ndarray | float) -> CircleQuantities:
    """Eqs. (4.4)-(4.9) for any number of platforms, points and circles at once.

    Args:
        c: numbers or arrays that broadcast with the others.
        radius: [m] R_B.
        rate: [rad/s] omega_B.

    Returns:
        Arrays of the common shape.
    """
    (values,) = on_arrays(circle_function(), c, (radius,), (rate,))
    return CircleQuantities(*values)


def side_of_critical(radius_ratio: np.ndarray | float) -> np.ndarray:
    """Which side of the critical radius a circle is on, eq. (4.6).

    Args:
        radius_ratio: rho = R_B/R~_B.

    Returns:
        1 with two steady rotations, 0 with one (rho = 1 within `CRITICAL`), -1 with none.
    """
    above = np.asarray(radius_ratio, dtype=float) - 1
    return np.where(np.abs(above) <= CRITICAL, 0, np.sign(above)).astype(int)
