"""The law's motions at many points at once, by one integration, and where they end up."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ.atlas.points import Points
from occ.theory.attractors import friction_forbids_rotation
from occ.theory.coefficients import YawCoefficients
from occ.theory.dissipation import circle_energy
from occ.theory.equation import ScaledEquation, yaw_acceleration

LARGEST_YAW_RATE = 1e4
"""[rad/s] A motion whose yaw rate passes this is not followed any further."""
LEFT = f"the law's yaw rate leaves every physical range: it passes {LARGEST_YAW_RATE:g} rad/s"
STUCK = "the law's motion cannot be followed for {:.6g} s: no step of the integrator is short enough"
SETTLED = 60.0
"""[rad] |omega_B| t after which a motion has settled, for each unit of |epsilon| beyond 1."""


class LawMotions(NamedTuple):
    """Motions of N points at K times; NaN and a reason where one cannot be followed to its end."""

    states: np.ndarray  # (K, 3, N) psi~ [rad], Omega [rad/s] and int D dt [J]
    reasons: list[tuple[int, str]]  # by number of the point


def law_motion(
    c: YawCoefficients, points: Points, duration: np.ndarray, at: tuple[float, ...], tolerance: float
) -> LawMotions:
    """psi~, Omega and int D dt along the law's motion, eq. (4.3), from the start of each point.

    Args:
        c: of the points.
        points: any number of circles.
        duration: (N,) [s].
        at: parts of the duration, increasing, the last one 1.
        tolerance: relative and absolute, in the mean over the points.

    Returns:
        States at each of the times, and why some are missing.
    """
    states = np.full((len(at), 3, len(points)), np.nan)
    reasons: list[tuple[int, str]] = []
    waiting = [np.arange(len(points))]
    while waiting:
        rows = waiting.pop()
        found = _together(c.of(rows), points.of(rows), duration[rows], at, tolerance)
        if found is not None:
            states[..., rows] = found
            left = rows[np.isnan(found[-1, 1])]
            reasons += [(int(i), LEFT) for i in left]
        elif len(rows) > 1:
            # One motion stops all that are integrated with it: halves find out which.
            waiting += np.array_split(rows, 2)
        else:
            reasons.append((int(rows[0]), STUCK.format(float(duration[rows[0]]))))
    return LawMotions(states, sorted(reasons))


def _together(
    c: YawCoefficients, points: Points, duration: np.ndarray, at: tuple[float, ...], tolerance: float
) -> np.ndarray | None:
    """The states of all points by one integration, NaN after a motion has left; None where the integrator gives up.

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
        return None
    states = result.y.T.reshape(len(at), 3, count)
    return np.where(np.abs(states[:, 1:2]) < LARGEST_YAW_RATE, states, np.nan)


class Rotating(NamedTuple):
    """Which of N points rotate for ever, and of which this is not known."""

    rotates: np.ndarray  # (N,) booleans
    reasons: list[tuple[int, str]]  # number of each point that is not known, and why


def keeps_rotating(c: YawCoefficients, eq: ScaledEquation, points: Points) -> Rotating:
    """Whether the law, from the given start, rotates for ever beside a stable steady rotation.

    With weak friction both exist.  Where friction does not forbid it the motion is integrated until it has settled.

    Args:
        c: of the points.
        eq: of the points, all beyond the critical radius.
        points: any number of circles.

    Returns:
        Which ones do; False also where it is not known.
    """
    # Without friction there is no orbit that attracts.
    rows = np.flatnonzero(~friction_forbids_rotation(eq) & np.isfinite(eq.epsilon))
    rotates = np.zeros(len(points), dtype=bool)
    if not rows.size:
        return Rotating(rotates, [])
    some = points.of(rows)
    duration = SETTLED * np.maximum(1.0, np.abs(eq.epsilon[rows])) / np.abs(some.rate)
    found = law_motion(c.of(rows), some, duration, (0.5, 1.0), 1e-8)
    half, whole = found.states[:, 0]
    rotates[rows] = np.abs(whole - half) > 2 * np.pi
    return Rotating(rotates, [(int(rows[i]), f"what becomes of the law: {reason}") for i, reason in found.reasons])
