"""Rotational motion as a boundary value problem on the return angle, many circles at once.

psi~ turns in one direction, so that theta is the independent variable and p(theta) = theta' (in signed time) the
unknown:

    e p p' + d p + q = 0,  d = 1 + e K sin(theta + delta),  q = 1 - rho cos theta,  p(theta + 2 pi) = p(theta).

p is smooth where the motion in time is not (just below the critical radius the platform makes its turn in a small part
of the period), and collocation at equispaced angles with a trigonometric polynomial converges faster than any power.
Newton's method takes the batch together; circles that need more harmonics go on to a finer grid, and the few for which
the finest one is too coarse to `occ.theory.shooting`.

There is no more than one such motion for rho < 1: the difference of two, p_1 < p_2 < 0, obeys e (p_1 - p_2)' = q (p_1
- p_2)/(p_1 p_2) with q > 0 and cannot be periodic.  In the same way int d du = int q/p^2 |dtheta| > 0 on it: it is
stable.

Period and mean damping are integrals of 1/p.  For rho < 1 the equation itself says 1/p = -(d + e p')/q, and integrals
of cos(m theta)/(1 - rho cos theta) are 2 pi b^m/sqrt(1 - rho^2), b = rho/(1 + sqrt(1 - rho^2)): they stay exact where
the period goes to infinity.

Source: Boyd, Chebyshev and Fourier Spectral Methods, chapters 3 and 14 (collocation); Floquet's multiplier of a
periodic orbit of a plane system is the exponential of the integral of its divergence (Andronov, Vitt, Khaikin, chapter
V).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from occ.theory.asymptotics import slow_slope
from occ.theory.equation import ScaledEquation
from occ.theory.shooting import Shot, shoot

GRIDS = (16, 32, 64, 128, 256, 512)
"""Numbers of angles that are tried one after the other."""
NEWTON_STEPS = 25
SLACK = 0.02
"""Newton's steps end before p is this part of its largest value beyond zero."""
FEWEST_SAMPLES, MOST_SAMPLES = 2048, 1 << 15
"""Of one period."""
CHUNK_NUMBERS = 1 << 18
"""Numbers in the matrices of one chunk: they stay in a core's cache."""
AGREEMENT = 1e-11
"""Two trapezoidal sums that agree so well are taken for their integral."""
TOLERANCE = 1e-11
"""Of p, relative to its largest value."""


class Orbits(NamedTuple):
    """Rotational motions, each entry an array; NaN where no such motion was found."""

    period: np.ndarray  # [s] time in which psi~ makes one turn; infinite at the critical radius
    mean_yaw_rate: np.ndarray  # [rad/s] mean of Omega over the period
    amplitude: np.ndarray  # [rad/s] half of max - min of Omega
    mean_damping: np.ndarray  # [1/s] mean of xi_3 {1 + R_B omega_B/V~_B sin(psi~ + beta)} over the period
    multiplier: np.ndarray  # [1] Floquet's: below 1 is stable
    harmonics: np.ndarray  # [1] of the trigonometric polynomial p; 0 where the motion was found by shooting
    converged: np.ndarray  # whether the motion was found to the tolerance


class RotatingOrbit(NamedTuple):
    """One rotational motion on a grid of equispaced psi~, fine enough to interpolate trigonometrically."""

    psi_tilde: np.ndarray  # (N,) [rad]
    yaw_rate: np.ndarray  # (N,) [rad/s] Omega
    orbit: Orbits  # with entries of shape ()


class Turn(NamedTuple):
    """Samples of one period, dense where time passes and where psi~ turns fast alike."""

    share: np.ndarray  # (N,) of the period that each sample stands for
    psi_tilde: np.ndarray  # (N,) [rad]
    yaw_rate: np.ndarray  # (N,) [rad/s]


def rotating_orbits(eq: ScaledEquation, tolerance: float = TOLERANCE) -> Orbits:
    """The rotational motions of eq. (4.4), one for each circle; rho < 1 has exactly one.

    Args:
        eq: of the circles; numbers and arrays broadcast.
        tolerance: of p, relative to its largest value.

    Returns:
        Arrays of the common shape; the motion at rho = 1 is the limit with an infinite period.
    """
    arrays = np.broadcast_arrays(*eq)
    shape = arrays[0].shape
    flat = ScaledEquation(*(np.array(array, dtype=float).ravel() for array in arrays))
    table = np.full((5, flat.rate.size), np.nan)
    harmonics = np.zeros(flat.rate.size, dtype=int)
    # Without friction there is no isolated motion to look for.
    looked_for = np.flatnonzero(np.isfinite(flat.epsilon) & np.isfinite(flat.ratio))
    some = _rows(flat, looked_for)
    for rows, slope in resolved(some, guess(some), tolerance):
        table[:, looked_for[rows]] = _measures(_rows(some, rows), slope)
        harmonics[looked_for[rows]] = slope.shape[1] // 2
    for row in map(int, np.flatnonzero((harmonics == 0) & (flat.ratio < 1) & np.isfinite(flat.epsilon))):
        shot = shoot(_rows(flat, row))
        if shot is not None:
            table[:, row] = _shot_measures(_rows(flat, row), shot)
    converged = np.isfinite(table[1])
    period, mean, amplitude, damping, multiplier = table.reshape(5, *shape)
    return Orbits(period, mean, amplitude, damping, multiplier, harmonics.reshape(shape), converged.reshape(shape))


def rotating_orbit(eq: ScaledEquation, first: np.ndarray | None = None) -> RotatingOrbit | None:
    """The rotational motion on one circle.

    Args:
        eq: of the circle.
        first: (N,) first guess of theta' at theta = 2 pi i/N, in case the usual one does not lead to the motion.

    Returns:
        The motion, or None where none was found.
    """
    one = ScaledEquation(*(np.array(value, dtype=float).reshape(1) for value in eq))
    if not np.isfinite(one.epsilon[0]):
        return None
    start = guess(one) if first is None else first[None, :]
    for _, slope in resolved(one, start, TOLERANCE):
        return _one_orbit(one, slope[0], _measures(one, slope)[:, 0], slope.shape[1] // 2)
    shot = shoot(one) if one.ratio[0] < 1 else None
    return None if shot is None else _one_orbit(one, shot.slope, _shot_measures(_rows(one, 0), shot), 0)


def _one_orbit(eq: ScaledEquation, slope: np.ndarray, measures: np.ndarray, harmonics: int) -> RotatingOrbit:
    period, mean, amplitude, damping, multiplier = (np.asarray(value) for value in measures)
    orbit = Orbits(period, mean, amplitude, damping, multiplier, np.asarray(harmonics), np.asarray(True))
    return RotatingOrbit(_grid(len(slope)) - eq.alpha, eq.rate * (1 + slope), orbit)


def one_turn(eq: ScaledEquation, found: RotatingOrbit) -> Turn:
    """Samples for means over the exact period, equispaced in the phase of the degenerate motion, which turns uniformly.

    Args:
        eq: of the circle.
        found: its rotational motion.

    Returns:
        The mean of any smooth function of the motion is its sum over the samples with their shares.
    """
    rho = float(eq.ratio) if eq.ratio < 1 else 0.0
    f = np.sqrt((1 - rho) * (1 + rho))
    b = rho / (1 + f)
    # The turn takes a part f of the phase.
    phase = _grid(int(np.clip(40 / f, FEWEST_SAMPLES, MOST_SAMPLES)))
    angle = phase - 2 * np.arctan2(b * np.sin(phase), 1 + b * np.cos(phase))
    spectrum = np.fft.rfft(found.yaw_rate) / len(found.yaw_rate)
    spectrum[1:-1] *= 2
    step, wave, yaw_rate = np.exp(1j * angle), np.ones(len(angle), dtype=complex), np.zeros(len(angle))
    for value in spectrum:
        yaw_rate += (value * wave).real
        wave *= step
    weight = f / (1 + rho * np.cos(phase)) / np.abs(yaw_rate - eq.rate)
    return Turn(weight / weight.sum(), angle - eq.alpha, yaw_rate)


def _rows(eq: ScaledEquation, rows: np.ndarray | int) -> ScaledEquation:
    return ScaledEquation(*(values[rows] for values in eq))


def _grid(count: int) -> np.ndarray:
    return 2 * np.pi * np.arange(count) / count


@cache
def _derivative(count: int) -> np.ndarray:
    """(N, N) d/dtheta of trigonometric interpolation at N (even) equispaced angles."""
    row = np.arange(count)
    with np.errstate(divide="ignore"):
        first = 0.5 * (-1.0) ** row / np.tan(row * np.pi / count)
    first[0] = 0.0
    return first[(row[:, None] - row) % count]


def _damping(eq: ScaledEquation, angle: np.ndarray) -> np.ndarray:
    """D = 1 + e K sin(theta + delta) (B, N)."""
    return 1 + (eq.epsilon * eq.k)[:, None] * np.sin(angle + eq.delta[:, None])


def _push(eq: ScaledEquation, angle: np.ndarray) -> np.ndarray:
    """Q = 1 - rho cos theta (B, N)."""
    return 1 - eq.ratio[:, None] * np.cos(angle)


def guess(eq: ScaledEquation) -> np.ndarray:
    """First guess of p: the slow manifold to second order, or the response of p = -1 to first order in rho and K.

    Args:
        eq: of the circles, entries (B,).

    Returns:
        (B, N) with the smaller residual of the two that stay negative, on the coarsest grid.
    """
    count = GRIDS[0]
    angle = _grid(count)
    column = ScaledEquation(*(values[:, None] for values in eq))
    slow = slow_slope(column, angle, 2)
    force = (column.ratio - 1j * column.epsilon * column.k * np.exp(1j * column.delta)) / (1 - 1j * column.epsilon)
    light = np.minimum(-1 + (force * np.exp(1j * angle)).real, -0.05)
    turns = eq.ratio < 1
    error_slow, error_light = (np.abs(_residual(eq, p, p @ _derivative(count).T)).max(axis=1) for p in (slow, light))
    chosen = turns & (slow.max(axis=1) < 0) & (error_slow < error_light)
    return np.where(chosen[:, None], slow, light)


def _residual(eq: ScaledEquation, p: np.ndarray, slope: np.ndarray) -> np.ndarray:
    angle = _grid(p.shape[1])
    return (eq.epsilon[:, None] * slope + _damping(eq, angle)) * p + _push(eq, angle)


def resolved(eq: ScaledEquation, first: np.ndarray, tolerance: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Solve on finer and finer grids and hand out what is resolved.

    Args:
        eq: of the circles, entries (B,), finite.
        first: (B, N) first guess of p.
        tolerance: of p, relative to its largest value.

    Yields:
        Rows (b,) and their p (b, N), of the coarsest grid whose last quarter of harmonics is below the tolerance.
    """
    rows, p = np.arange(len(first)), first
    for count in GRIDS:
        if count < first.shape[1]:
            continue
        p = resampled(p, count)
        chunk = max(1, CHUNK_NUMBERS // count**2)
        solved = np.zeros(len(rows), dtype=bool)
        for start in range(0, len(rows), chunk):
            part = slice(start, start + chunk)
            p[part], solved[part] = _newton(_rows(eq, rows[part]), p[part], tolerance)
        spectrum = np.abs(np.fft.rfft(p, axis=1)) / count
        tail = spectrum[:, 3 * count // 8 :].max(axis=1)
        done = solved & (tail <= tolerance * np.abs(p).max(axis=1)) & _turning(eq.ratio[rows], p)
        if done.any():
            yield rows[done], p[done]
        rows, p = rows[~done], p[~done]
        if not len(rows):
            return


def _turning(ratio: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Whether p keeps its sign (B,): other solutions of the equations of collocation are no motions."""
    fine = resampled(p, 4 * p.shape[1])
    nearest = (fine * np.sign(p.sum(axis=1))[:, None]).min(axis=1)
    # Up to the critical radius the sign is known, and rounding may hide it where p is nearly zero.
    return np.asarray(nearest > np.where(ratio <= 1, -1e-6, 0.0) * np.abs(p).max(axis=1))


def resampled(p: np.ndarray, count: int) -> np.ndarray:
    """Trigonometric interpolation of (B, N) values at equispaced angles to (B, count) ones, count >= N."""
    if p.shape[1] == count:
        return p.copy()
    spectrum = np.fft.rfft(p, axis=1)
    spectrum[:, -1] *= 0.5  # the highest harmonic stands for itself and its alias
    return np.fft.irfft(spectrum, count, axis=1) * (count / p.shape[1])


def _newton(eq: ScaledEquation, p: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method for e p p' + d p + q = 0 on one grid; steps are cut so that p keeps its sign.

    Args:
        eq: entries (B,).
        p: (B, N) first guess.
        tolerance: of the last step, relative to the largest p.

    Returns:
        p, and whether it has converged (B,).
    """
    count = p.shape[1]
    derivative, diagonal = _derivative(count), np.arange(count)
    damping, push = _damping(eq, _grid(count)), _push(eq, _grid(count))
    solved = np.zeros(len(p), dtype=bool)
    active = np.arange(len(p))
    direction = np.sign(p.sum(axis=1))
    for _ in range(NEWTON_STEPS):
        now, e = p[active], eq.epsilon[active, None]
        inertia = e * (now @ derivative.T) + damping[active]
        jacobian = (e * now)[:, :, None] * derivative
        jacobian[:, diagonal, diagonal] += inertia
        step = -_solve(jacobian, inertia * now + push[active])
        scale = np.abs(now).max(axis=1)
        # Cut steps that would take p well past zero; p itself may be as near to zero as it likes.
        reach = np.max(-step * direction[active, None] / (np.abs(now) + SLACK * scale[:, None]), axis=1)
        factor = 1 / np.maximum(reach, 1.0)
        p[active] = now + factor[:, None] * step
        size = np.abs(step).max(axis=1) / scale
        # The next step would be about the square of this one.
        close = (factor == 1.0) & (size <= max(tolerance, 1e-13) ** 0.5 * 0.03)
        solved[active[close]] = True
        active = active[~close & np.isfinite(size) & (size < 1e6)]
        if not len(active):
            break
    return p, solved


def _solve(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    try:
        return np.linalg.solve(matrices, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        # One of the batch is singular to the last digit: that one has no step.
        steps = np.full_like(right, np.nan)
        for i in range(len(right)):
            try:
                steps[i] = np.linalg.solve(matrices[i], right[i])
            except np.linalg.LinAlgError:
                continue
        return steps


def _measures(eq: ScaledEquation, p: np.ndarray) -> np.ndarray:
    """Period, mean yaw rate, amplitude, mean damping, multiplier: (5, B)."""
    # Products of p, p' and d have up to twice as many harmonics, 1/p has more.
    fine = resampled(p, p.shape[1] * (2 if np.all(eq.ratio < 1) else 8))
    duration, mean_damping = _integrals(eq, fine)
    return _physical(eq, duration, mean_damping, (_extreme(p, fine, -1.0), _extreme(p, fine, 1.0)))


def _shot_measures(eq: ScaledEquation, shot: Shot) -> np.ndarray:
    """The same of one turn found by shooting: (5,)."""
    low, high = (np.asarray(value) for value in shot.extremes)
    return _physical(eq, np.asarray(shot.duration), np.asarray(shot.damped / shot.duration), (low, high))


def _physical(
    eq: ScaledEquation, duration: np.ndarray, mean_damping: np.ndarray, extremes: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """From |omega_B| T, the mean of d over time and the extremes of p to the first five `Orbits`."""
    direction = np.sign(extremes[0] + extremes[1])
    amplitude = np.abs(eq.rate) * (extremes[1] - extremes[0]) / 2
    mean = eq.rate * (1 + direction * 2 * np.pi / duration)
    friction = mean_damping / np.abs(eq.epsilon)
    return np.array(
        [duration / np.abs(eq.rate), mean, amplitude, friction * np.abs(eq.rate), np.exp(-friction * duration)]
    )


def _integrals(eq: ScaledEquation, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """int |du| over a turn, du = dtheta/p, and the mean of d over this time."""
    count = p.shape[1]
    order = np.arange(count // 2 + 1)
    damping = _damping(eq, _grid(count))
    slope = np.fft.irfft(1j * order * np.fft.rfft(p, axis=1), count, axis=1)
    f = np.sqrt(np.maximum((1 - eq.ratio) * (1 + eq.ratio), 0.0))
    weight = np.where(order == 0, 1.0, 2.0) * (np.minimum(eq.ratio, 1.0) / (1 + f))[:, None] ** order
    # 1/p = -(d + e p')/q where p comes near to zero, and by itself where it does not and q would cancel.
    inverse = damping + eq.epsilon[:, None] * slope
    exact, exact_damped = (
        (np.fft.rfft(x, axis=1).real * weight).sum(axis=1) / count for x in (inverse, damping * inverse)
    )
    with np.errstate(divide="ignore"):
        sampled, coarse = np.abs((1 / p).mean(axis=1)), np.abs((1 / p[:, ::2]).mean(axis=1))
        sampled_damped = np.abs((damping / p).mean(axis=1))
    apart = (eq.ratio > 1) | (np.abs(sampled - coarse) <= AGREEMENT * sampled)
    duration = np.divide(exact, f, out=np.full_like(f, np.inf), where=f > 0)
    return (
        2 * np.pi * np.where(apart, sampled, duration),
        np.where(apart, sampled_damped, exact_damped) / np.where(apart, sampled, exact),
    )


def _extreme(p: np.ndarray, fine: np.ndarray, sign: float) -> np.ndarray:
    """Largest value of sign p times sign, by Newton's method for p' = 0 from the largest one on the fine grid."""
    count = p.shape[1]
    spectrum = np.fft.rfft(p, axis=1) / count
    spectrum[:, 1:-1] *= 2
    order = np.arange(count // 2 + 1)
    angle = _grid(fine.shape[1])[np.argmax(sign * fine, axis=1)]
    for _ in range(3):
        wave = spectrum * np.exp(1j * order * angle[:, None])
        slope, curvature = (1j * order * wave).real.sum(axis=1), -(order**2 * wave).real.sum(axis=1)
        move = np.divide(-slope, curvature, out=np.zeros_like(slope), where=sign * curvature < 0)
        angle = angle + np.clip(move, -np.pi / count, np.pi / count)
    wave = spectrum * np.exp(1j * order * angle[:, None])
    return np.maximum(sign * wave.real.sum(axis=1), (sign * fine).max(axis=1)) * sign
