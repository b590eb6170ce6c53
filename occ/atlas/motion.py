"""The law's motions at many points at once, by one integration, and where they end up."""

from __future__ import annotations

import numpy as np

from occ.atlas.points import Points
from occ.theory.attractors import friction_forbids_rotation
from occ.theory.coefficients import YawCoefficients
from occ.theory.dissipation import circle_energy
from occ.theory.equation import ScaledEquation, yaw_acceleration

LARGEST_YAW_RATE = 1e4
"""[rad/s] A motion whose yaw rate passes this is not followed any further."""
SETTLED = 60.0
"""[rad] |omega_B| t after which a motion has settled, for each unit of |epsilon| beyond 1."""


def law_motion(
    c: YawCoefficients, points: Points, duration: np.ndarray, at: tuple[float, ...], tolerance: float
) -> np.ndarray:
    """psi~, Omega and int D dt along the law's motion, eq. (4.3), from the start of each point.

    Args:
        c: of the points.
        points: any number of circles.
        duration: (N,) [s].
        at: parts of the duration, increasing, the last one 1.
        tolerance: relative and absolute, in the mean over the points.

    Returns:
        (K, 3, N) at each of the times [rad, rad/s, J]; NaN where a motion leaves every physical range.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5 (DOP853).
    """
    from scipy.integrate import solve_ivp

    energy = circle_energy(c, points.radius, points.rate)
    count = len(points)

    def right_side(_: float, y: np.ndarray) -> np.ndarray:
        angle, omega, _dissipated = y.reshape(3, count)
        acceleration = yaw_acceleration(c, points.radius, points.rate, angle, omega)
        rate = np.array([omega - points.rate, acceleration, energy.dissipation(angle, omega)])
        # A motion that has left must not stop the others.
        return (np.where(np.abs(omega) < LARGEST_YAW_RATE, rate, 0.0) * duration).ravel()

    start = np.concatenate([points.psi_tilde, points.heading_rate, np.zeros(count)])
    result = solve_ivp(right_side, (0.0, 1.0), start, method="DOP853", t_eval=at, rtol=tolerance, atol=tolerance)
    if result.status != 0:
        return np.full((len(at), 3, count), np.nan)
    states = result.y.T.reshape(len(at), 3, count)
    return np.where(np.abs(states[:, 1:2]) < LARGEST_YAW_RATE, states, np.nan)


def keeps_rotating(c: YawCoefficients, eq: ScaledEquation, points: Points) -> np.ndarray:
    """Whether the law, from the given start, rotates for ever beside a stable steady rotation.

    With weak friction both exist.  Where friction does not forbid it the motion is integrated until it has settled.

    Args:
        c: of the points.
        eq: of the points, all beyond the critical radius.
        points: any number of circles.

    Returns:
        (N,) booleans.
    """
    # Without friction there is no orbit that attracts.
    rows = np.flatnonzero(~friction_forbids_rotation(eq) & np.isfinite(eq.epsilon))
    rotates = np.zeros(len(points), dtype=bool)
    if rows.size:
        some = points.of(rows)
        duration = SETTLED * np.maximum(1.0, np.abs(eq.epsilon[rows])) / np.abs(some.rate)
        half, whole = law_motion(c.of(rows), some, duration, (0.5, 1.0), 1e-8)[:, 0]
        rotates[rows] = np.abs(whole - half) > 2 * np.pi
    return rotates
