"""Rotational motions: their period, their means over a turn and their stability, many circles at once.

psi~ turns in one direction, so that theta is the independent variable and p(theta) = theta' (in signed time) the
unknown, a periodic solution of e p p' + d p + q = 0 (`occ.theory.periodic`).  The few circles for which the finest grid
is too coarse go to `occ.theory.shooting`.

There is no more than one such motion for rho < 1: the difference of two, p_1 < p_2 < 0, obeys e (p_1 - p_2)' = q (p_1
- p_2)/(p_1 p_2) with q > 0 and cannot be periodic.  In the same way int d du = int q/p^2 |dtheta| > 0 on it: it is
stable.

Period and means over time are integrals of cos(m theta)/p and sin(m theta)/p.  For rho < 1 the equation itself says
1/p = -(d + e p')/q, and the harmonics of 1/q are b^|m|/sqrt(1 - rho^2), b = rho/(1 + sqrt(1 - rho^2)): means stay exact
where the period goes to infinity.

Source: Floquet's multiplier of a periodic orbit of a plane system is the exponential of the integral of its divergence
(Andronov, Vitt, Khaikin, Theory of Oscillators, chapter V).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ.theory.equation import ScaledEquation
from occ.theory.periodic import TOLERANCE, grid, resampled, resolved
from occ.theory.shooting import Moments, shoot
from occ.theory.trigonometric import basis

FEWEST_SAMPLES, MOST_SAMPLES = 2048, 1 << 15
"""Of one period."""
AGREEMENT = 1e-11
"""Two trapezoidal sums that agree so well are taken for their integral."""
NEAR = 0.9
"""rho beyond which q = 1 - rho cos theta may be so small that 1/p loses digits in -(d + e p')/q."""


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
    means: Moments  # with entries of shape () and (5,)


Extremes = tuple[np.ndarray, np.ndarray]
"""Least and largest theta'."""


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
    some = flat.of(looked_for)
    for rows, slope in resolved(some, None, tolerance):
        one = some.of(rows)
        table[:, looked_for[rows]] = _measures(one, moments(one, slope), _extremes(one, slope))
        harmonics[looked_for[rows]] = slope.shape[1] // 2
    for row in map(int, np.flatnonzero((harmonics == 0) & (flat.ratio < 1) & np.isfinite(flat.epsilon))):
        shot = shoot(flat.of(row))
        if shot is not None:
            table[:, row] = _measures(flat.of(row), shot.moments, shot.extremes)
    converged = np.isfinite(table[1])
    period, mean, amplitude, damping, multiplier = table.reshape(5, *shape)
    return Orbits(period, mean, amplitude, damping, multiplier, harmonics.reshape(shape), converged.reshape(shape))


def rotating_means(eq: ScaledEquation) -> Moments:
    """Period and means over time of the rotational motions, one for each circle.

    Args:
        eq: of the circles, entries (B,).

    Returns:
        Of the circles; NaN where no motion was found.
    """
    count = eq.rate.size
    found = Moments(np.full(count, np.nan), np.full((5, count), np.nan), np.full(count, np.nan))
    looked_for = np.flatnonzero(np.isfinite(eq.epsilon) & np.isfinite(eq.ratio))
    some = eq.of(looked_for)
    for rows, slope in resolved(some, None, TOLERANCE):
        found.put(looked_for[rows], moments(some.of(rows), slope))
    for row in map(int, np.flatnonzero(np.isnan(found.duration) & (eq.ratio < 1) & np.isfinite(eq.epsilon))):
        shot = shoot(eq.of(row))
        if shot is not None:
            found.put(row, shot.moments)
    return found


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
    for _, slope in resolved(one, None if first is None else first[None, :], TOLERANCE):
        return _one_orbit(one, slope[0], moments(one, slope), _extremes(one, slope), slope.shape[1] // 2)
    shot = shoot(one) if one.ratio[0] < 1 else None
    return None if shot is None else _one_orbit(one, shot.slope, shot.moments, shot.extremes, 0)


def _one_orbit(
    eq: ScaledEquation, slope: np.ndarray, means: Moments, extremes: Extremes, harmonics: int
) -> RotatingOrbit:
    period, mean, amplitude, damping, multiplier = _measures(eq, means, extremes).reshape(5)
    orbit = Orbits(period, mean, amplitude, damping, multiplier, np.asarray(harmonics), np.asarray(True))
    single = Moments(means.duration.reshape(()), means.waves.reshape(5), means.slope.reshape(()))
    return RotatingOrbit(grid(len(slope)) - eq.alpha, eq.rate * (1 + slope), orbit, single)


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
    phase = grid(int(np.clip(40 / f, FEWEST_SAMPLES, MOST_SAMPLES)))
    angle = phase - 2 * np.arctan2(b * np.sin(phase), 1 + b * np.cos(phase))
    spectrum = np.fft.rfft(found.yaw_rate) / len(found.yaw_rate)
    spectrum[1:-1] *= 2
    step, wave, yaw_rate = np.exp(1j * angle), np.ones(len(angle), dtype=complex), np.zeros(len(angle))
    for value in spectrum:
        yaw_rate += (value * wave).real
        wave *= step
    weight = f / (1 + rho * np.cos(phase)) / np.abs(yaw_rate - eq.rate)
    return Turn(weight / weight.sum(), angle - eq.alpha, yaw_rate)


def moments(eq: ScaledEquation, p: np.ndarray) -> Moments:
    """Duration of a turn and means over time, du = dtheta/p, of 1, cos theta, sin theta, cos 2 theta, sin 2 theta.

    Args:
        eq: of the circles, entries (B,).
        p: (B, N) at N equispaced angles theta.

    Returns:
        Of the circles.
    """
    means = _exact_moments(eq, p)
    near = np.flatnonzero(eq.ratio > NEAR)
    if near.size:
        sampled, agrees = _sampled_moments(p[near])
        apart = (eq.ratio[near] > 1) | agrees
        means.put(near[apart], Moments(*(values[..., apart] for values in sampled)))
    return means


def _exact_moments(eq: ScaledEquation, p: np.ndarray) -> Moments:
    """By 1/|p| = (d + e p')/q: products of the harmonics of d + e p' and of 1/q, (b^|m|)/f."""
    count = p.shape[1]
    terms = np.fft.rfft(p, axis=1)[:, : count // 2].T / count
    mean = terms[0].real.copy()
    terms *= 1j * eq.epsilon * np.arange(len(terms))[:, None]
    terms[0] = 1.0
    terms[1] -= 0.5j * eq.epsilon * eq.k * np.exp(1j * eq.delta)
    rho = np.minimum(eq.ratio, 1.0)
    f = np.sqrt((1 - rho) * (1 + rho))
    b = rho / (1 + f)
    # Of the terms from the m-th on, by Horner's rule, and of those before it and of negative order.
    tails = [np.zeros_like(terms[0])] * 3
    total = np.zeros_like(terms[0])
    for k in range(len(terms) - 1, -1, -1):
        total = total * b + terms[k]
        if k < len(tails):
            tails[k] = total
    negative = (tails[0] - terms[0]).conj()
    first = tails[1] + b * (terms[0] + negative)
    second = tails[2] + b * (terms[1] + b * (terms[0] + negative))
    whole = (tails[0] + negative).real
    with np.errstate(divide="ignore"):
        duration = 2 * np.pi * whole / f
    # The harmonic of e^(i m theta) is the mean of e^(-i m theta).
    waves = np.array([np.ones_like(b), *(part / whole for h in (first, second) for part in (h.real, -h.imag))])
    return Moments(duration, waves, mean)


def _sampled_moments(p: np.ndarray) -> tuple[Moments, np.ndarray]:
    """By the trapezoidal rule for 1/p, and whether half of the samples give the same."""
    fine = resampled(p, 8 * p.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.abs(1 / fine)
        whole, half = density.mean(axis=1), density[:, ::2].mean(axis=1)
        waves = (basis(grid(fine.shape[1])) @ density.T) / (fine.shape[1] * whole)
        agrees = np.abs(whole - half) <= AGREEMENT * whole
    return Moments(2 * np.pi * whole, waves, p.mean(axis=1)), agrees


def _measures(eq: ScaledEquation, means: Moments, extremes: Extremes) -> np.ndarray:
    """Period, mean yaw rate, amplitude, mean damping, multiplier: (5, B)."""
    amplitude = np.abs(eq.rate) * (extremes[1] - extremes[0]) / 2
    mean = eq.rate * (1 + np.sign(means.slope) * 2 * np.pi / means.duration)
    friction = means.damping(eq) / np.abs(eq.epsilon)
    multiplier = np.exp(-friction * means.duration)
    values = (means.duration / np.abs(eq.rate), mean, amplitude, friction * np.abs(eq.rate), multiplier)
    return np.array(np.broadcast_arrays(*values))


def _extremes(eq: ScaledEquation, p: np.ndarray) -> Extremes:
    """Least and largest p (B,)."""
    # Products of p, p' and d have up to twice as many harmonics, 1/p has more.
    fine = resampled(p, p.shape[1] * (2 if np.all(eq.ratio < 1) else 8))
    return _extreme(p, fine, -1.0), _extreme(p, fine, 1.0)


def _extreme(p: np.ndarray, fine: np.ndarray, sign: float) -> np.ndarray:
    """Largest value of sign p times sign, by Newton's method for p' = 0 from the largest one on the fine grid."""
    count = p.shape[1]
    spectrum = np.fft.rfft(p, axis=1) / count
    spectrum[:, 1:-1] *= 2
    order = np.arange(count // 2 + 1)
    angle = grid(fine.shape[1])[np.argmax(sign * fine, axis=1)]
    for _ in range(3):
        wave = spectrum * np.exp(1j * order * angle[:, None])
        slope, curvature = (1j * order * wave).real.sum(axis=1), -(order**2 * wave).real.sum(axis=1)
        move = np.divide(-slope, curvature, out=np.zeros_like(slope), where=sign * curvature < 0)
        angle = angle + np.clip(move, -np.pi / count, np.pi / count)
    wave = spectrum * np.exp(1j * order * angle[:, None])
    return np.maximum(sign * wave.real.sum(axis=1), (sign * fine).max(axis=1)) * sign
