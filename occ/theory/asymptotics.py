"""Slow manifold, boundary layer and period of the yaw motion for small epsilon, eqs. (4.9)-(4.19), one order further.

In the notation of `occ.theory.equation` (signed time u = omega_B t, signed epsilon e) the motions are attracted to an
invariant curve theta' = H(theta) with e H H_theta + (1 + e K S) H + 1 - rho cos theta = 0, S = sin(theta + delta).  Put
H = H_0 + e H_1 + e^2 H_2 + ... and compare powers of e:

    H_0 = rho cos theta - 1                                   the degenerate system (4.11), (4.14)
    H_1 = -H_0 (H_0' + K S) = H_0 G,  G = rho sin theta - K S
    H_2 = -(H_0 H_1)' - K S H_1

*Time along it.*  du = dtheta/H = (1 - e G + ...) dtheta/H_0: the corrected motion is the degenerate one with its clock
put forward by e times the integral of G along it, theta_1(u) = theta_0(u + e int G du), and both integrals in it are
closed forms.  The error is O(e^2) on any finite interval of time.

*Layer.*  y = theta' - H obeys e y' = -(1 + e (K S + H_theta)) y exactly.  With sigma = u/e = xi_3 t and y_0 = theta'(0)
- H(theta(0)) it decays like y = y_0 exp(-sigma) (1 + e sigma G(theta(0))) + O(e^2); what it adds to theta, e y_0 (1 -
exp(-sigma)), shifts the start of the slow motion by e y_0.

*Period.*  1/H = 1/H_0 - e H_1/H_0^2 + e^2 H_1'/H_0 + O(e^3), because (H_1/H_0)^2 - H_2/H_0 = H_1' (insert H_2).  Over
a turn only even parts are left: int dtheta/(1 - rho cos) = 2 pi/f with f = sqrt(1 - rho^2), int cos/(1 - rho cos) = 2
pi b/f with b = rho/(1 + f), int sin^2/(1 - rho cos) = 2 pi b/rho; hence

    |omega_B| T = (2 pi/f) {1 + e b K sin delta - e^2 f b (rho - K cos delta)} + O(e^3).
"""

from __future__ import annotations

import numpy as np

from occ.theory.degenerate import degenerate_flow
from occ.theory.equation import Array, ScaledEquation

HIGHEST_ORDER = 2


def slow_manifold(eq: ScaledEquation, psi_tilde: Array, order: int = 1) -> np.ndarray:
    """Omega = omega_B (1 + H_0 + e H_1 + e^2 H_2) on the slow manifold.

    Args:
        eq: of the circle.
        psi_tilde: [rad]; broadcasts with the numbers of the equation.
        order: 0 for the degenerate system (4.11), at most 2.

    Returns:
        [rad/s].
    """
    return np.asarray(eq.rate * (1 + slow_slope(eq, psi_tilde + eq.alpha, order)))


def slow_slope(eq: ScaledEquation, angle: Array, order: int) -> np.ndarray:
    """H_0 + .. + e^order H_order at theta, dimensionless; arguments as in `slow_manifold`, theta = psi~ + alpha."""
    slope = eq.ratio * np.cos(angle) - 1
    if order == 0:
        return np.asarray(slope)
    lead = eq.ratio * np.sin(angle)
    spin, spin_slope = eq.k * np.sin(angle + eq.delta), eq.k * np.cos(angle + eq.delta)
    gain = lead - spin
    if order == 1:
        return np.asarray(slope * (1 + eq.epsilon * gain))
    # H_2 = -(H_0^2 G)' - K S H_0 G, and every term of it has the factor H_0.
    second = 2 * lead * gain - slope * (eq.ratio * np.cos(angle) - spin_slope) - spin * gain
    return np.asarray(slope * (1 + eq.epsilon * (gain + eq.epsilon * second)))


def degenerate_motion(eq: ScaledEquation, psi_tilde: Array, t: Array) -> tuple[np.ndarray, np.ndarray]:
    """psi~(t), Omega(t) of the degenerate problem, eqs. (4.15)-(4.19), for every start and any number of turns.

    Args:
        eq: of the circle.
        psi_tilde: [rad] psi~(0).
        t: [s], of either sign.

    Returns:
        psi~ [rad], not wrapped, and Omega [rad/s].
    """
    flow = degenerate_flow(eq.ratio, psi_tilde + eq.alpha, eq.rate * t)
    return flow.angle - eq.alpha, np.asarray(eq.rate * (1 + flow.slope))


def corrected_motion(
    eq: ScaledEquation, psi_tilde: Array, yaw_rate: Array, t: Array, layer: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """psi~(t), Omega(t) to first order in epsilon: slow motion from the shifted start, and its boundary layer.

    Args:
        eq: of the circle; epsilon finite.
        psi_tilde: [rad] psi~(0).
        yaw_rate: [rad/s] Omega(0).
        t: [s] >= 0.
        layer: False leaves the layer's decaying part out, and keeps the shift of the start.

    Returns:
        psi~ [rad], not wrapped, and Omega [rad/s]; O(epsilon^2) off the motion of eq. (4.9), without the layer only
        some multiples of 1/xi_3 after the start.
    """
    e, start = eq.epsilon, psi_tilde + eq.alpha
    off = (yaw_rate - eq.rate) / eq.rate - slow_slope(eq, start, 1)
    first, u = start + e * off, eq.rate * t
    angle = degenerate_flow(eq.ratio, first, u + e * _clock(eq, first, u)).angle
    if layer:
        sigma = np.abs(u / e)
        decayed = off * np.exp(-sigma)
        angle = angle - e * decayed
        gain = eq.ratio * np.sin(start) - eq.k * np.sin(start + eq.delta)
        decayed = decayed * (1 + e * sigma * gain)
    else:
        decayed = np.zeros(())
    slope = slow_slope(eq, angle, 1) + decayed
    return angle - eq.alpha, np.asarray(eq.rate * (1 + slope))


def _clock(eq: ScaledEquation, start: Array, u: Array) -> np.ndarray:
    """Integral of G = rho sin theta - K sin(theta + delta) over u along the degenerate motion."""
    flow = degenerate_flow(eq.ratio, start, u)
    return np.asarray(
        (eq.ratio - eq.k * np.cos(eq.delta)) * flow.sine - eq.k * np.sin(eq.delta) * flow.cosine, dtype=float
    )


def asymptotic_period(eq: ScaledEquation, order: int = 0) -> np.ndarray:
    """T = (2 pi/(|omega_B| f)) {1 + e b K sin delta - e^2 f b (rho - K cos delta)}.

    f = sqrt(1 - rho^2), b = rho/(1 + f).

    Args:
        eq: of the circle.
        order: 0 for the period of eq. (4.18), at most 2.

    Returns:
        [s] time between two equal values of Omega in rotational motion; infinite for rho >= 1.
    """
    rho = np.minimum(eq.ratio, 1.0)
    f = np.sqrt((1 - rho) * (1 + rho))
    b = rho / (1 + f)
    factor = np.ones_like(f)
    if order >= 1:
        factor = factor + eq.epsilon * b * eq.k * np.sin(eq.delta)
    if order >= HIGHEST_ORDER:
        factor = factor - eq.epsilon**2 * f * b * (rho - eq.k * np.cos(eq.delta))
    turn = np.broadcast_to(2 * np.pi / np.abs(eq.rate), factor.shape)
    return np.divide(turn * factor, f, out=np.full(factor.shape, np.inf), where=f > 0)


def asymptotic_mean_yaw_rate(eq: ScaledEquation, order: int = 0) -> np.ndarray:
    """omega_B - sign(omega_B) 2 pi/T with the period of that order: one turn against omega_B in each period.

    Args:
        eq: of the circle.
        order: of the period, at most 2.

    Returns:
        [rad/s]; omega_B (1 - sqrt(1 - rho^2)) to leading order.
    """
    return np.asarray(eq.rate - np.sign(eq.rate) * 2 * np.pi / asymptotic_period(eq, order))


def asymptotic_amplitude(eq: ScaledEquation, order: int = 0) -> np.ndarray:
    """Half of max - min of Omega in rotational motion: |omega_B| (rho + e K sin delta), from H at theta = 0 and pi.

    Args:
        eq: of the circle.
        order: 0 for |omega_B| rho, eq. (4.18); at most 1.

    Returns:
        [rad/s]; NaN where there is no rotational motion.
    """
    amplitude = eq.ratio + (eq.epsilon * eq.k * np.sin(eq.delta) if order else 0.0)
    return np.asarray(np.where(eq.ratio < 1, np.abs(eq.rate) * np.abs(amplitude), np.nan))
