"""Errors of the asymptotics of section 4.2 against the full equation, and their orders in epsilon.

The limit is taken in eq. (4.9) as it stands: epsilon is halved while rho, K, alpha, beta and the scaled start are held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ.theory.asymptotics import (
    HIGHEST_ORDER,
    asymptotic_amplitude,
    asymptotic_mean_yaw_rate,
    asymptotic_period,
    corrected_motion,
    degenerate_motion,
)
from occ.theory.coefficients import YawCoefficients
from occ.theory.equation import ScaledEquation, scaled_equation, scaled_right_side
from occ.theory.orbits import rotating_orbits


class MotionErrors(NamedTuple):
    """Largest errors over the time grid, one for each epsilon; orders by `observed_orders`."""

    epsilon: np.ndarray  # (H,) [1] signed
    degenerate: np.ndarray  # (H,) [rad] of psi~, eqs. (4.16)-(4.19)
    corrected: np.ndarray  # (H,) [rad] of psi~, with the layer
    corrected_rate: np.ndarray  # (H,) [rad/s] of Omega, with the layer
    outside_layer: np.ndarray  # (H,) [rad/s] of Omega without the layer's part, in the second half of the times


def rotation_table(c: YawCoefficients, rate: float, radii: np.ndarray) -> dict[str, np.ndarray]:
    """Period, mean yaw rate and amplitude of rotational motions beside their asymptotic values.

    Args:
        c: of one platform and point.
        rate: [rad/s] omega_B.
        radii: (N,) [m] below the critical one.

    Returns:
        Columns (N,) by name; ``_error`` is relative to the full equation's value, for mean yaw rates to |omega_B|.
    """
    eq = scaled_equation(c, radii, rate)
    full = rotating_orbits(eq)
    table: dict[str, np.ndarray] = {"radius_m": np.asarray(radii), "radius_ratio": eq.ratio, "period_s": full.period}
    for name, order in (("asymptotic", 0), ("first_order", 1), ("second_order", HIGHEST_ORDER)):
        value = asymptotic_period(eq, order)
        table |= {f"period_{name}_s": value, f"period_{name}_error": value / full.period - 1}
    mean, amplitude = asymptotic_mean_yaw_rate(eq), asymptotic_amplitude(eq)
    return table | {
        "mean_yaw_rate_rad_s": full.mean_yaw_rate,
        "mean_yaw_rate_asymptotic_rad_s": mean,
        "mean_yaw_rate_asymptotic_error": (mean - full.mean_yaw_rate) / abs(rate),
        "amplitude_rad_s": full.amplitude,
        "amplitude_asymptotic_rad_s": amplitude,
        "amplitude_asymptotic_error": amplitude / full.amplitude - 1,
    }


def halved(eq: ScaledEquation, halvings: int) -> ScaledEquation:
    """The equation at epsilon, epsilon/2, .., each entry (halvings + 1,); everything else is held."""
    factors = 0.5 ** np.arange(halvings + 1)
    numbers = [np.full(halvings + 1, float(value)) for value in eq]
    return ScaledEquation(*numbers)._replace(epsilon=float(eq.epsilon) * factors)


def observed_orders(errors: np.ndarray) -> np.ndarray:
    """log2(error at epsilon/error at epsilon/2): (H,) -> (H - 1,)."""
    return np.asarray(np.log2(np.abs(errors[:-1] / errors[1:])))


def motion_errors(eq: ScaledEquation, start: tuple[float, float], t: np.ndarray, halvings: int = 4) -> MotionErrors:
    """Errors of the degenerate and of the corrected motion at epsilon, epsilon/2, ...

    Args:
        eq: of one circle.
        start: psi~(0) [rad] and Omega(0) [rad/s], on or off the slow manifold.
        t: (N,) [s], increasing from 0.
        halvings: of epsilon.

    Returns:
        Errors against eq. (4.9), integrated.
    """
    family = halved(eq, halvings)
    psi, yaw_rate = start
    late = len(t) // 2
    rows = []
    for k in range(halvings + 1):
        one = ScaledEquation(*(values[k] for values in family))
        full_psi, full_rate = _integrated(one, start, t)
        degenerate, _ = degenerate_motion(one, psi, t)
        corrected, rate = corrected_motion(one, psi, yaw_rate, t)
        _, outside = corrected_motion(one, psi, yaw_rate, t, layer=False)
        errors = (degenerate - full_psi, corrected - full_psi, rate - full_rate, (outside - full_rate)[late:])
        rows.append([float(np.abs(error).max()) for error in errors])
    return MotionErrors(family.epsilon, *np.array(rows).T)


def _integrated(eq: ScaledEquation, start: tuple[float, float], t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """psi~(t) and Omega(t) of eq. (4.9), by an explicit Runge-Kutta method of order 8."""
    from scipy.integrate import solve_ivp

    psi, yaw_rate = start
    scale, alpha = float(eq.rate), float(eq.alpha)
    times = abs(scale) * t
    result = solve_ivp(
        scaled_right_side(eq),
        (0.0, float(times[-1])),
        (psi + alpha, (yaw_rate - scale) / scale),
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-12,
    )
    assert result.success, result.message
    return result.y[0] - alpha, scale * (1 + result.y[1])
