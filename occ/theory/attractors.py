"""Where the yaw motion ends: attractors of eq. (4.4) on the cylinder, and the share of starts that go to each.

What can be said without simulating (d is the damping, q the push, as in `occ.theory.orbits`):

* rho < 1: one rotational motion, and it attracts every start: without equilibria a closed orbit winds around the
  cylinder, p > 0 contradicts int (d + q/p) dtheta = 0, and p < 0 is unique.
* rho >= 1 and |epsilon| K < 1: the divergence -d is negative, so that no closed orbit surrounds an equilibrium
  (Bendixson); int (d p + q) dtheta = 0 excludes p > 0 and a second p < 0.  The one rotational motion exists exactly
  where the branch of the saddle's unstable manifold that the push takes along passes over the next saddle (Tricomi's
  problem of the pendulum with a constant torque).
* |epsilon| K >= 1: the damping changes its sign; what is there is found by simulating.
* No friction: nothing settles.

Shares are counted over a grid of starts where more than one attractor is possible.

Source: Andronov, Vitt, Khaikin, Theory of Oscillators, chapter VII (synchronous machine).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from occ.integration import IntegrationError
from occ.theory.asymptotics import slow_slope
from occ.theory.circle import circle_quantities, side_of_critical
from occ.theory.coefficients import YawCoefficients
from occ.theory.equation import ScaledEquation, scaled_equation, scaled_right_side, yaw_acceleration
from occ.theory.orbits import RotatingOrbit, rotating_orbit
from occ.theory.stability import eigenvalues

HEADINGS, YAW_RATES = 24, 21
"""Starts of the grid: headings over a full turn, yaw rates from -2 |omega_B| to 2 |omega_B|."""
MOST_STEPS = 10_000
STILL = 1e-3
"""[1] A motion whose psi~' stays below this part of omega_B at the end counts as steady."""
DECAY = 14.0
"""Simulations last until the slowest motion has decayed by exp(-DECAY)."""
TURNS = 6
CAUGHT = 1e-4
"""[1] A motion whose rate falls below this part of omega_B within half a turn before the saddle is caught there."""
LONGEST = 1e9
"""[rad] of |omega_B| t."""

Kind = Literal["steady", "critical", "rotating", "oscillating", "unsettled"]


class Attractor(NamedTuple):
    """Where starts go to.

    ``critical`` is the steady rotation at R_B = R~_B, which attracts from one side only and yet gets almost all
    starts; ``oscillating`` swings about a steady rotation; ``unsettled`` starts had not settled when the simulation
    ended.
    """

    kind: Kind
    share: float  # of the starts; 1 where a theorem and no count says so
    psi_tilde: float | None  # [rad] of a steady rotation
    orbit: RotatingOrbit | None  # of a rotating motion


class _Circle(NamedTuple):
    c: YawCoefficients
    radius: float
    rate: float
    eq: ScaledEquation
    stable: float  # [rad] steady rotation of positive stiffness
    slowest: float  # [1/s] decay rate at the stable one, zero or less where it is not stable


def find_attractors(c: YawCoefficients, radius: float, rate: float) -> tuple[Attractor, ...]:
    """All attractors of one circle with the share of starts of each, the largest share first.

    Args:
        c: of one platform and point.
        radius: [m] R_B.
        rate: [rad/s] omega_B, not zero.

    Returns:
        One or more; a share of starts that had not settled is listed, too.
    """
    eq = ScaledEquation(*(np.asarray(float(value)) for value in scaled_equation(c, radius, rate)))
    side = int(side_of_critical(eq.ratio))
    if side < 0:
        orbit = rotating_orbit(eq)
        return (Attractor("rotating" if orbit else "unsettled", 1.0, None, orbit),)
    if not np.isfinite(eq.epsilon):
        return (Attractor("unsettled", 1.0, None, None),)
    circle = _circle(c, radius, rate, eq)
    one_signed = bool(abs(rate) * eq.k < c.xi_3)
    first, known = None, True
    if not friction_forbids_rotation(eq):
        try:
            first = _over_the_saddle(eq)
        except IntegrationError:
            known = False
    orbit = rotating_orbit(eq, first) if first is not None else None
    if one_signed and known and first is None:
        return (Attractor("steady" if side else "critical", 1.0, circle.stable, None),)
    return _counted(circle, orbit)


def _circle(c: YawCoefficients, radius: float, rate: float, eq: ScaledEquation) -> _Circle:
    # At the critical radius rounding must not take the roots away.
    q = circle_quantities(c, radius, rate)
    radius = max(radius, float(q.critical_radius))
    q = circle_quantities(c, radius, rate)
    decay = -eigenvalues(q.stable_damping, q.stiffness).real.max()
    numbers = YawCoefficients(*(np.asarray(float(value)) for value in c))
    return _Circle(numbers, radius, rate, eq, float(q.stable_heading), float(decay))


def friction_forbids_rotation(eq: ScaledEquation) -> np.ndarray:
    """Whether friction alone forbids a rotational motion beside the steady rotations, rho >= 1.

    With v = |theta'|, in the direction s of the motion, |e| v dv/ds = q - d v; m = 1 - |e| K <= d.  v <= (1 + rho)/m on
    such a motion, and

    * |e| (1 + rho) <= 2 m^2 arccos(1/rho): where q < 0, v falls by more than that;
    * 2 |e| rho <= m^2: v stays below A sin(|s|/2), m A = sqrt(4 rho^2 + e^2 A^4/4), s from -pi to 0, because q <=
      2 rho sin^2(s/2), and that has no room left at s = 0.

    Args:
        eq: of the circles; rho below 1 is taken for 1.

    Returns:
        Booleans; False says nothing.
    """
    rho, size = np.maximum(eq.ratio, 1.0), np.abs(eq.epsilon)
    least = 1 - size * eq.k
    with np.errstate(invalid="ignore"):
        falls = size * (1 + rho) <= 2 * np.arccos(1 / rho) * least**2
        below = 2 * size * rho <= least**2
    return np.asarray((least > 0) & (falls | below))


def _over_the_saddle(eq: ScaledEquation) -> np.ndarray | None:
    """theta' on a grid of angles along the unstable manifold of the saddle, some turns on; None where it is caught.

    In time the push takes the manifold along from theta = -s arccos(1/rho) to the side of -s, s = sign(omega_B).  While
    q > 0 nothing stops it; it is caught where theta' dies away in the half turn before the next saddle.

    Raises:
        IntegrationError: the manifold cannot be followed so far.
    """
    sign, rho = float(np.sign(eq.epsilon)), max(float(eq.ratio), 1.0)
    half = float(np.arccos(1 / rho))
    if half < 1e-4:
        # The critical case: the repelling side of the double equilibrium, on its slow manifold.
        first = -sign * 5e-2
        return _profile(eq, first, float(slow_slope(eq, first, 2)), TURNS)
    # |e| lambda^2 + d lambda - rho sin(arccos(1/rho)) = 0: the positive root.
    damping = 1 + float(eq.epsilon * eq.k) * np.sin(-sign * half + float(eq.delta))
    stiffness = rho * np.sin(half)
    growth = 2 * stiffness / (damping + np.sqrt(damping**2 + 4 * abs(float(eq.epsilon)) * stiffness))
    offset = 1e-3 * half
    return _profile(eq, -sign * (half + offset), -growth * offset, TURNS)


def _profile(eq: ScaledEquation, first: float, slope: float, turns: int) -> np.ndarray | None:
    """theta' at theta = 2 pi i/128 in the last of some turns; None where theta' dies away.

    Raises:
        IntegrationError: neither happens.
    """
    from scipy.integrate import solve_ivp

    side = float(np.sign(slope))

    def caught(_: float, y: np.ndarray) -> float:
        left = abs(y[0] - first) > np.pi
        return float(side * y[1] - CAUGHT) if left else 1.0

    def turned(_: float, y: np.ndarray) -> float:
        return float(turns * 2 * np.pi - abs(y[0] - first))

    caught.terminal = turned.terminal = True  # type: ignore[attr-defined]  # as SciPy wants it
    result = solve_ivp(
        scaled_right_side(eq),
        (0.0, LONGEST),
        (first, slope),
        method="LSODA",
        events=(caught, turned),
        dense_output=True,
        rtol=1e-9,
        atol=1e-12,
    )
    if len(result.t_events[0]):
        return None
    # LSODA may go on with what is no number, and call that a success.
    if not len(result.t_events[1]):
        raise IntegrationError(float(result.t[-1]) / abs(float(eq.rate)), "the yaw motion can be followed no further")
    angles, slopes = result.sol(np.linspace(0.0, result.t[-1], 400 * turns))
    last = np.abs(angles - angles[-1]) <= 2 * np.pi
    theta = angles[last] % (2 * np.pi)
    order = np.argsort(theta)
    return np.asarray(np.interp(2 * np.pi * np.arange(128) / 128, theta[order], slopes[last][order], period=2 * np.pi))


def _counted(circle: _Circle, orbit: RotatingOrbit | None) -> tuple[Attractor, ...]:
    """Simulate the grid of starts and count where they end."""
    psi, speed, step = _start_grid(circle)
    decays = [circle.slowest] + ([float(orbit.orbit.mean_damping)] if orbit else [])
    slowest = min((rate for rate in decays if rate > 0), default=abs(circle.rate) / 50)
    count = int(min(MOST_STEPS, np.ceil(DECAY / slowest / step)))
    tail = max(1, int(min(count // 4, np.ceil(4 * np.pi / abs(circle.rate) / step))))
    psi, speed = _integrated(circle, psi, speed, step, count - tail)
    before, swing = psi.copy(), np.zeros_like(psi)
    for _ in range(tail):
        psi, speed = _integrated(circle, psi, speed, step, 1)
        swing = np.maximum(swing, np.abs(speed))
    still = swing <= STILL * abs(circle.rate)
    rotating = ~still & (np.abs(psi - before) >= np.pi)
    if orbit is None and rotating.any():
        one = int(np.flatnonzero(rotating)[0])
        orbit = _orbit_from(circle.eq, float(psi[one] + circle.eq.alpha), float(speed[one] / circle.rate))
    if orbit is None:
        rotating[:] = False
    rest = ~still & ~rotating
    found = [
        Attractor("steady", float(still.mean()), circle.stable, None),
        Attractor("rotating", float(rotating.mean()), None, orbit),
        Attractor("oscillating" if circle.slowest < 0 else "unsettled", float(rest.mean()), None, None),
    ]
    return tuple(sorted((item for item in found if item.share > 0), key=lambda item: -item.share))


def _orbit_from(eq: ScaledEquation, angle: float, slope: float) -> RotatingOrbit | None:
    """The rotating motion that a start is near to; None where it is not found."""
    try:
        first = _profile(eq, angle, slope, 2)
    except IntegrationError:
        return None
    return None if first is None else rotating_orbit(eq, first)


def _start_grid(circle: _Circle) -> tuple[np.ndarray, np.ndarray, float]:
    """psi~(0), psi~'(0) of the grid, and a time step that resolves them."""
    heading = 2 * np.pi * (np.arange(HEADINGS) + 0.5) / HEADINGS
    yaw_rate = np.linspace(-2.0, 2.0, YAW_RATES) * abs(circle.rate)
    psi, omega = (values.ravel() for values in np.meshgrid(heading, yaw_rate, indexing="ij"))
    deviation = omega - circle.rate
    turn = np.linspace(0.0, 2 * np.pi, 64)
    acceleration = np.abs(yaw_acceleration(circle.c, circle.radius, circle.rate, turn, circle.rate)).max()
    spin = (
        circle.radius
        * abs(circle.rate)
        * np.hypot(circle.c.kappa_11 - circle.c.kappa_21, circle.c.kappa_12 - circle.c.kappa_22)
    )
    fastest = max(np.abs(deviation).max(), np.sqrt(acceleration), float(circle.c.xi_3 + spin))
    return psi, deviation, 0.2 / float(fastest)


def _integrated(
    circle: _Circle, psi: np.ndarray, speed: np.ndarray, step: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Classical Runge-Kutta steps of psi~'' = Omega'(psi~, omega_B + psi~')."""

    def acceleration(angle: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return yaw_acceleration(circle.c, circle.radius, circle.rate, angle, circle.rate + rate)

    for _ in range(count):
        k1 = acceleration(psi, speed)
        k2 = acceleration(psi + step / 2 * speed, speed + step / 2 * k1)
        k3 = acceleration(psi + step / 2 * speed + step**2 / 4 * k1, speed + step / 2 * k2)
        k4 = acceleration(psi + step * speed + step**2 / 2 * k2, speed + step * k3)
        psi = psi + step * speed + step**2 / 6 * (k1 + k2 + k3)
        speed = speed + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return psi, speed
