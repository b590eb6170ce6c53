"""The yaw equation on the circle, eqs. (4.3) and (4.9), and its motions by integration.

With signed time u = omega_B t and signed epsilon = omega_B/xi_3 the sign of omega_B leaves the equation altogether:

    epsilon theta'' + {1 + epsilon K sin(theta + delta)} theta' + 1 - rho cos theta = 0,

theta = psi~ + alpha, delta = beta - alpha, ' = d/du, theta' = (Omega - omega_B)/omega_B.  With tau = |omega_B| t it is
eq. (4.9) with the sign of omega_B in the braces, too (errata 7).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from occ.integration import IntegrationError
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import YawCoefficients

Array = np.ndarray | float


class ScaledEquation(NamedTuple):
    """The numbers of eq. (4.9), each a number or an array; they broadcast with each other."""

    rate: np.ndarray  # [rad/s] omega_B
    epsilon: np.ndarray  # [1] omega_B/xi_3, with the sign of omega_B; infinite without friction
    ratio: np.ndarray  # [1] rho = R_B/R~_B; zero at the singular point (4.20), infinite without friction
    k: np.ndarray  # [1] K
    alpha: np.ndarray  # [rad]
    delta: np.ndarray  # [rad] beta - alpha

    def of(self, rows: np.ndarray | slice | int) -> ScaledEquation:
        """The equations of some circles."""
        return ScaledEquation(*(values[rows] for values in self))


def scaled_equation(c: YawCoefficients, radius: Array, rate: Array) -> ScaledEquation:
    """Eq. (4.9) of any number of platforms, points and circles.

    Args:
        c: numbers or arrays that broadcast with the others.
        radius: [m] R_B.
        rate: [rad/s] omega_B, not zero.

    Returns:
        Arrays of the common shape.
    """
    q = circle_quantities(c, radius, rate)
    rates = np.broadcast_to(np.asarray(rate, dtype=float), q.k.shape)
    return ScaledEquation(rates, np.sign(rates) * q.epsilon, q.radius_ratio, q.k, q.alpha, q.beta - q.alpha)


def yaw_acceleration(c: YawCoefficients, radius: Array, rate: Array, psi_tilde: Array, yaw_rate: Array) -> np.ndarray:
    """Omega' = psi~'' of eq. (4.3), with psi~' = Omega - omega_B.

    Args:
        c: numbers or arrays that broadcast with the others.
        radius: [m] R_B.
        rate: [rad/s] omega_B.
        psi_tilde: [rad] psi~ = psi - omega_B t - phi_B.
        yaw_rate: [rad/s] Omega.

    Returns:
        [rad/s^2].
    """
    deviation = yaw_rate - rate
    cosine = c.kappa_12 * deviation - c.xi_1 - c.kappa_22 * yaw_rate
    sine = c.kappa_11 * deviation + c.xi_2 - c.kappa_21 * yaw_rate
    return np.asarray(
        -c.xi_3 * yaw_rate - radius * rate * (cosine * np.cos(psi_tilde) + sine * np.sin(psi_tilde)), dtype=float
    )


def scaled_right_side(eq: ScaledEquation) -> Callable[[float, np.ndarray], tuple[float, float]]:
    """(theta, theta')' in |u| = |omega_B| t of one circle, in plain numbers: theta' stays a derivative in signed time.

    Args:
        eq: of one circle, each entry of size one; epsilon finite.

    Returns:
        The right-hand side of an integrator.
    """
    _, e, rho, k, _, delta = (float(np.asarray(value).reshape(())) for value in eq)
    sign, size, spin = math.copysign(1.0, e), abs(e), e * k

    def right_side(_: float, y: np.ndarray) -> tuple[float, float]:
        angle, slope = float(y[0]), float(y[1])
        damping = 1 + spin * math.sin(angle + delta)
        return sign * slope, -(damping * slope + 1 - rho * math.cos(angle)) / size

    return right_side


def reduced_motion(
    c: YawCoefficients, radius: float, rate: float, start: tuple[float, float], t: np.ndarray, tolerance: float = 1e-12
) -> tuple[np.ndarray, np.ndarray]:
    """psi~(t), Omega(t) by integration of eq. (4.3).

    Args:
        c: of one platform and point.
        radius: [m] R_B.
        rate: [rad/s] omega_B.
        start: psi~ [rad] and Omega [rad/s] at t = 0.
        t: (N,) [s], increasing from 0 or later.
        tolerance: relative and absolute, of the integrator.

    Returns:
        psi~ [rad] (not wrapped) and Omega [rad/s], each (N,).

    Raises:
        IntegrationError: the motion cannot be followed to the end.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5 (DOP853).
    """
    from scipy.integrate import solve_ivp

    numbers = YawCoefficients(*(float(value) for value in c))  # type: ignore[arg-type]  # numbers for arrays

    def right_side(_: float, y: np.ndarray) -> tuple[float, float]:
        return y[1] - rate, float(yaw_acceleration(numbers, radius, rate, y[0], y[1]))

    result = solve_ivp(
        right_side, (0.0, float(t[-1])), start, method="DOP853", t_eval=t, rtol=tolerance, atol=tolerance
    )
    if not result.success:
        reached = float(result.t[-1]) if len(result.t) else 0.0
        raise IntegrationError(reached, "the yaw motion on the circle cannot be followed any further")
    return result.y[0], result.y[1]
