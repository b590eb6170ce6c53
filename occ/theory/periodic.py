"""The rotational motion as a periodic solution on the return angle, by collocation, many circles at once.

    e p p' + d p + q = 0,  d = 1 + e K sin(theta + delta),  q = 1 - rho cos theta,  p(theta + 2 pi) = p(theta).

p is smooth where the motion in time is not (just below the critical radius the platform makes its turn in a small part
of the period), and collocation at equispaced angles with a trigonometric polynomial converges faster than any power.
What `occ.theory.harmonics` leaves over is solved by Newton's method on finer and finer grids, a batch together.

Source: Boyd, Chebyshev and Fourier Spectral Methods, chapters 3 and 14.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from occ.theory.asymptotics import slow_slope
from occ.theory.equation import ScaledEquation
from occ.theory.harmonics import balanced

GRIDS = (16, 32, 64, 128, 256, 512)
"""Numbers of angles that are tried one after the other."""
NEWTON_STEPS = 25
SLACK = 0.02
"""Newton's steps end before p is this part of its largest value beyond zero."""
CHUNK_NUMBERS = 1 << 18
"""Numbers in the matrices of one chunk: they stay in a core's cache."""
TOLERANCE = 1e-11
"""Of p, relative to its largest value."""


def grid(count: int) -> np.ndarray:
    """Equispaced angles (N,) [rad] from 0."""
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


def _guess(eq: ScaledEquation) -> np.ndarray:
    """First guess of p: the slow manifold to second order, or the response of p = -1 to first order in rho and K.

    Args:
        eq: of the circles, entries (B,).

    Returns:
        (B, N) with the smaller residual of the two that stay negative, on the coarsest grid.
    """
    count = GRIDS[0]
    angle = grid(count)
    column = ScaledEquation(*(values[:, None] for values in eq))
    slow = slow_slope(column, angle, 2)
    force = (column.ratio - 1j * column.epsilon * column.k * np.exp(1j * column.delta)) / (1 - 1j * column.epsilon)
    light = np.minimum(-1 + (force * np.exp(1j * angle)).real, -0.05)
    turns = eq.ratio < 1
    error_slow, error_light = (np.abs(_residual(eq, p, p @ _derivative(count).T)).max(axis=1) for p in (slow, light))
    chosen = turns & (slow.max(axis=1) < 0) & (error_slow < error_light)
    return np.where(chosen[:, None], slow, light)


def _residual(eq: ScaledEquation, p: np.ndarray, slope: np.ndarray) -> np.ndarray:
    angle = grid(p.shape[1])
    return (eq.epsilon[:, None] * slope + _damping(eq, angle)) * p + _push(eq, angle)


def resolved(eq: ScaledEquation, first: np.ndarray | None, tolerance: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The rotational motions that are found, in batches.

    Args:
        eq: of the circles, entries (B,), finite.
        first: (B, N) first guess of p; None for the usual ones.
        tolerance: of p, relative to its largest value.

    Yields:
        Rows (b,) and their p (b, N) at N equispaced angles theta, of a grid whose last quarter of harmonics is below
        the tolerance.
    """
    left = np.ones(eq.rate.size, dtype=bool)
    if first is None:
        for rows, p in balanced(eq, tolerance):
            left[rows] = False
            yield rows, p
    rest = np.flatnonzero(left)
    some = eq.of(rest)
    for rows, p in _collocated(some, _guess(some) if first is None else first, tolerance):
        yield rest[rows], p


def _collocated(eq: ScaledEquation, first: np.ndarray, tolerance: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The same by Newton's method on finer and finer grids."""
    rows, p = np.arange(len(first)), first
    for count in GRIDS:
        if not len(rows):
            return
        if count < first.shape[1]:
            continue
        p = resampled(p, count)
        chunk = max(1, CHUNK_NUMBERS // count**2)
        solved = np.zeros(len(rows), dtype=bool)
        for start in range(0, len(rows), chunk):
            part = slice(start, start + chunk)
            p[part], solved[part] = _newton(eq.of(rows[part]), p[part], tolerance)
        spectrum = np.abs(np.fft.rfft(p, axis=1)) / count
        tail = spectrum[:, 3 * count // 8 :].max(axis=1)
        done = solved & (tail <= tolerance * np.abs(p).max(axis=1)) & _turning(eq.ratio[rows], p)
        if done.any():
            yield rows[done], p[done]
        rows, p = rows[~done], p[~done]


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
    damping, push = _damping(eq, grid(count)), _push(eq, grid(count))
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
