"""Linear stability of the steady rotations, eqs. (4.7), (4.8), and its exact domain in closed form (Fig. 3).

At the root with positive stiffness psi~_s + alpha = s theta, s = sign(omega_B), cos theta = R~_B/R_B, so that with
q = sqrt(R_B^2 - R~_B^2) the damping in eq. (4.7) is linear in q:

    xi_3 {1 + (|omega_B|/V~_B) [s R~_B sin(beta - alpha) + cos(beta - alpha) q]}.

At one rate the radii with a stable family are therefore one interval.  The other root is a saddle, whatever the
damping.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from occ.checks import Vector2
from occ.model.platform import Platform
from occ.theory.circle import CircleQuantities, circle_quantities
from occ.theory.coefficients import YawCoefficients, yaw_function
from occ.theory.equation import Array


class StableRadii(NamedTuple):
    """lower < R_B < upper: where a family of steady rotations is asymptotically stable; both infinite where none is."""

    lower: np.ndarray  # [m]
    upper: np.ndarray  # [m]


def eigenvalues(damping: Array, stiffness: Array) -> np.ndarray:
    """Roots of lambda^2 + damping lambda + stiffness = 0, eq. (4.7), without cancellation.

    Args:
        damping: [1/s].
        stiffness: [1/s^2]; both broadcast.

    Returns:
        (2, ...) complex [1/s]; where real, the one of larger magnitude first.
    """
    half, product = np.broadcast_arrays(-0.5 * np.asarray(damping, dtype=complex), np.asarray(stiffness))
    root = np.sqrt(half**2 - product)
    large = np.where(half.real < 0, half - root, half + root)
    # The product of the roots is the stiffness; a pair of zeros has no quotient.
    small = np.divide(product, large, out=np.zeros_like(large), where=large != 0)
    return np.array([large, np.where(root.real == 0, half - (large - half), small)])


def stable_radii(c: YawCoefficients, rate: Array) -> StableRadii:
    """The exact stability domain of steady rotations at each rate, in closed form.

    With a = xi_3 {1 + (omega_B/V~_B) R~_B sin(beta - alpha)} and b = xi_3 (|omega_B|/V~_B) cos(beta - alpha) the
    damping a + b q is positive for q > -a/b (b > 0), for q < -a/b (b < 0) or for all q (b = 0 < a); q = 0 is R_B =
    R~_B.

    Args:
        c: numbers or arrays that broadcast with the rate.
        rate: [rad/s] omega_B, not zero.

    Returns:
        The interval of radii [m].

    Source: paper, eq. (4.7) and Fig. 3; for the printed parameters lower = R~_B and upper = R_c of the errata.
    """
    unit = circle_quantities(c, 1.0, rate)  # K at R_B = 1 m is xi_3/V~_B
    delta, critical = unit.beta - unit.alpha, unit.critical_radius
    exists = np.isfinite(critical)
    inner = np.where(exists, critical, 0.0)
    at_critical = c.xi_3 + rate * unit.k * inner * np.sin(delta)
    slope = np.abs(rate) * unit.k * np.cos(delta)
    crossing = np.divide(-at_critical, slope, out=np.zeros_like(slope), where=slope != 0)
    boundary = np.hypot(inner, crossing)
    lower = np.where(at_critical >= 0, inner, np.where(slope > 0, boundary, np.inf))
    upper = np.where((slope < 0) & (at_critical > 0), boundary, np.inf)
    # Neither damping nor a slope: no radius is asymptotically stable.
    none = ~exists | ((at_critical <= 0) & (slope <= 0))
    return StableRadii(np.where(none, np.inf, lower), upper)


def sufficient(q: CircleQuantities, radius: Array, rate: Array) -> np.ndarray:
    """R_B > R~_B and R_B |omega_B| < V~_B: eq. (4.8), enough for a stable steady rotation but not needed for one.

    Args:
        q: of the same circles.
        radius: [m] R_B.
        rate: [rad/s] omega_B.

    Returns:
        Booleans.
    """
    return np.asarray((radius > q.critical_radius) & (radius * np.abs(rate) < q.critical_speed))


def damping_rate(c: YawCoefficients) -> np.ndarray:
    """omega_c: the only rate at which cos(beta - alpha) changes its sign; infinite where there is none.

    (xi_1 + kappa_22 omega_c) (kappa_11 - kappa_21) + (xi_2 - kappa_21 omega_c) (kappa_12 - kappa_22) = 0; for the
    paper's platform omega_c = -(zeta_Y b_X^2 + zeta_X b_Y^2)/[m (a_X b_Y - a_Y b_X)].  Beyond it the damping falls
    with the radius.

    Args:
        c: numbers or arrays.

    Returns:
        [rad/s].

    Source: errata, Fig. 3.
    """
    cosine, sine = c.kappa_11 - c.kappa_21, c.kappa_12 - c.kappa_22
    constant = np.asarray(c.xi_1 * cosine + c.xi_2 * sine, dtype=float)
    growth = np.asarray(c.kappa_22 * cosine - c.kappa_21 * sine, dtype=float)
    return np.divide(-constant, growth, out=np.full(constant.shape, np.inf), where=growth != 0)


@cache
def _drive_function(wheel_count: int) -> ca.Function:
    """J_a (xi_1 + kappa_22 omega_B, xi_2 - kappa_21 omega_B) of point, parameters and rate, and its Jacobian."""
    function = yaw_function(wheel_count)
    point, rate = ca.SX.sym("point", 2), ca.SX.sym("rate")
    parameters = ca.SX.sym("parameters", function.size1_in(0))
    c = YawCoefficients(*ca.vertsplit(function(parameters, point)))
    drive = c.inertia * ca.vertcat(c.xi_1 + c.kappa_22 * rate, c.xi_2 - c.kappa_21 * rate)
    return ca.Function("drive", [point, parameters, rate], [drive, ca.jacobian(drive, point)])


def singular_point(platform: Platform, rate: float) -> Vector2:
    """The point B with xi_1 + kappa_22 omega_B = xi_2 - kappa_21 omega_B = 0, eq. (4.20): R~_B is infinite there.

    Both are affine in b, whatever the wheels: the first step of Newton's method solves them, the second one rounds off.

    Args:
        platform: any platform.
        rate: [rad/s] omega_B, not zero.

    Returns:
        (2,) [m] (b_X, b_Y).
    """
    function = _drive_function(platform.wheel_count)
    point = np.array([1.0, 1.0])  # [m] away from the points where a coupling is cleared of rounding
    for _ in range(2):
        drive, jacobian = (np.array(value) for value in function(point, platform.parameters(), rate))
        point = point - np.linalg.solve(jacobian, drive)[:, 0]
    return float(point[0]), float(point[1])
