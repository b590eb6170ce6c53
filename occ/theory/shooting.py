"""Rotational motion by shooting: where the trigonometric polynomials of `occ.theory.orbits` would need too many terms.

Just below the critical radius and with moderate friction p(theta) has a corner at theta = 0.  Integration in time
passes it with small steps; Newton's method on the return map p(pi) -> p(pi - 2 pi) closes the orbit.  Its derivative
on the orbit is the multiplier, exp(-int d |du|/|e|).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from occ.theory.equation import ScaledEquation, scaled_right_side

RETURNS = 30
TOLERANCE = 1e-10
LONGEST = 1e7
"""[rad] of |omega_B| t in one turn; what is longer is as good as critical."""
SAMPLES = 1024


class Moments(NamedTuple):
    """Rotational motions in means over a turn, each an array."""

    duration: np.ndarray  # (B,) [rad] |omega_B| T
    waves: np.ndarray  # (5, B) means over time of 1, cos theta, sin theta, cos 2 theta, sin 2 theta
    slope: np.ndarray  # (B,) mean of theta' over theta

    def put(self, rows: np.ndarray | int, other: Moments) -> None:
        """Write others into some rows."""
        self.duration[rows], self.waves[:, rows], self.slope[rows] = other

    def damping(self, eq: ScaledEquation) -> np.ndarray:
        """Mean over time of d = 1 + e K sin(theta + delta) (B,)."""
        mixed = self.waves[2] * np.cos(eq.delta) + self.waves[1] * np.sin(eq.delta)
        return np.asarray(1 + eq.epsilon * eq.k * mixed)


class Shot(NamedTuple):
    """One turn of a rotational motion."""

    moments: Moments  # with entries of shape () and (5,)
    extremes: tuple[np.ndarray, np.ndarray]  # least and largest theta'
    slope: np.ndarray  # (N,) theta' at theta = 2 pi i/N


def shoot(eq: ScaledEquation) -> Shot | None:
    """Solve p(pi - 2 pi) = p(pi) for the rotational motion of one circle.

    Args:
        eq: of one circle, each entry of size one; rho < 1.

    Returns:
        The turn, or None where the return map was not closed.
    """
    size, start = abs(float(np.asarray(eq.epsilon).reshape(()))), -(1 + float(np.asarray(eq.ratio).reshape(())))
    for _ in range(RETURNS):
        turn = _turn(eq, start)
        if turn is None:
            return None
        end, shot = turn
        if abs(end - start) <= TOLERANCE * abs(start):
            return shot
        damped = (shot.moments.damping(eq) * shot.moments.duration).item()
        start += (end - start) / (1 - np.exp(-max(damped / size, 1e-3)))
        start = min(start, -1e-3)
    return None


def _turn(eq: ScaledEquation, start: float) -> tuple[float, Shot] | None:
    """Integrate from theta = pi until |theta - pi| = 2 pi."""
    from scipy.integrate import solve_ivp

    _, e, rho, k, _, delta = (float(np.asarray(value).reshape(())) for value in eq)
    motion = scaled_right_side(eq)

    def right_side(time: float, y: np.ndarray) -> tuple[float, ...]:
        angle, slope = float(y[0]), float(y[1])
        return *motion(time, y), *(f(m * angle) for m in (1, 2) for f in (math.cos, math.sin)), slope * slope

    def turned(_: float, y: np.ndarray) -> float:
        return 2 * np.pi - abs(float(y[0]) - np.pi)

    def level(_: float, y: np.ndarray) -> float:
        return float((1 + e * k * math.sin(y[0] + delta)) * y[1] + 1 - rho * math.cos(y[0]))

    turned.terminal = True  # type: ignore[attr-defined]  # as SciPy wants it
    result = solve_ivp(
        right_side,
        (0.0, LONGEST),
        (np.pi, start, 0.0, 0.0, 0.0, 0.0, 0.0),
        method="LSODA",
        events=(turned, level),
        dense_output=True,
        rtol=1e-11,
        atol=1e-13,
    )
    if result.status != 1:
        return None
    # theta is monotonic in time; between the steps the dense output has about the accuracy of the steps.
    times = np.unique(np.concatenate([np.linspace(a, b, 8) for a, b in zip(result.t[:-1], result.t[1:], strict=True)]))
    angle, slope = result.sol(times)[:2]
    wanted = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    order = np.argsort(angle % (2 * np.pi))
    values = np.interp(wanted, (angle % (2 * np.pi))[order], slope[order], period=2 * np.pi)
    _, end, *integrals, square = result.y_events[0][0]
    duration = float(result.t_events[0][0])
    # int p^2 |du| = int |p| |dtheta|, and p is negative.
    means = Moments(
        np.asarray(duration), np.array([1.0, *(np.array(integrals) / duration)]), np.asarray(-square / (2 * np.pi))
    )
    slopes = np.append(result.y_events[1][:, 1] if len(result.y_events[1]) else [], slope[[0, -1]])
    return float(end), Shot(means, (slopes.min(), slopes.max()), values)
