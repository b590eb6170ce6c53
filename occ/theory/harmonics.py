"""Rotational motions by harmonic balance: many circles at once, without a matrix.

On the rotational motion of eq. (4.9) p(theta) = theta' is close to -1 + rho cos theta where epsilon is small, and close
to -1 where it is large: in p = sum_k P_k e^(ik theta) the harmonics beyond the first are small.  With e p p' + d p + q
written as e (p^2)'/2 + d p + q, the k-th harmonic of its change with p,

    (1 + i k e P_0) P'_k + (i k e P_1 + d_1) P'_(k-1) + (i k e P_-1 + d_-1) P'_(k+1) + O(e P_2),

is tridiagonal but for these.  Newton's method with this matrix takes one elimination along k for all circles at once;
its steps shrink by a factor of the size of e P_2, a thousand on the paper's platform.  Where they do not, the dense
matrices of `occ.theory.periodic` are there.

Source: Boyd, Chebyshev and Fourier Spectral Methods, chapter 15 (preconditioned Richardson iteration).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from occ.theory.asymptotics import slow_slope
from occ.theory.equation import ScaledEquation

GRIDS = (16, 32, 64, 128, 256)
"""Numbers of angles that are tried one after the other."""
STEPS = 14
CHUNK = 2048
"""Circles that are worked on together: their harmonics stay in a core's cache."""
SHRINKS = 0.5
"""A step that is not shorter than this part of the one before is given up."""
LIGHT = 0.5
"""|epsilon| beyond which the first guess is that of weak friction."""


class _Matrix(NamedTuple):
    """The tridiagonal matrix of a batch, eliminated from the highest harmonic down: P'_k = ratio_k P'_(k-1) + .."""

    inverse: np.ndarray  # (n + 1, B) of the diagonal after elimination
    upper: np.ndarray  # (n + 1, B) the next harmonic's part, times `inverse`
    ratio: np.ndarray  # (n + 1, B)
    mean: np.ndarray  # (B,) 1/diagonal of the mean, which is real


def balanced(eq: ScaledEquation, tolerance: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """p of the circles inside the critical radius for which the iteration converges fast.

    There q > 0, so that a p which solves the equation between the angles of the grid, too, has no zero: its harmonics
    fall below the tolerance before the grid's last quarter, and it is negative on the grid.

    Args:
        eq: of the circles, entries (B,), finite.
        tolerance: of p, relative to its mean.

    Yields:
        Rows (b,) and their p (b, N) at N equispaced angles theta.
    """
    inside = np.flatnonzero(eq.ratio < 1)
    for first in range(0, inside.size, CHUNK):
        rows = inside[first : first + CHUNK]
        harmonics = _guess(eq.of(rows))
        for count in GRIDS:
            left, harmonics, exact = _solved(eq.of(rows), _padded(harmonics, count // 2), tolerance)
            p = np.fft.irfft(harmonics[:, exact], count, axis=0) * count
            negative = p.max(axis=0) < 0
            if negative.any():
                yield rows[left[exact][negative]], p.T[negative]
            go_on = ~exact
            rows, harmonics = rows[left[go_on]], harmonics[:, go_on]
            if not rows.size:
                break


def _padded(harmonics: np.ndarray, count: int) -> np.ndarray:
    return np.concatenate([harmonics, np.zeros((count - len(harmonics), harmonics.shape[1]))])


def _guess(eq: ScaledEquation) -> np.ndarray:
    """(4, B) harmonics of the slow manifold to second order, or of the response of p = -1 to rho and K."""
    angle = (2 * np.pi / 8) * np.arange(8)[:, None]
    slow = np.fft.rfft(slow_slope(eq, angle, 2), axis=0)[:4] / 8
    force = (eq.ratio - 1j * eq.epsilon * eq.k * np.exp(1j * eq.delta)) / (1 - 1j * eq.epsilon)
    light = np.zeros_like(slow)
    light[0], light[1] = -1, force / 2
    return np.where(np.abs(eq.epsilon) > LIGHT, light, slow)


def _solved(eq: ScaledEquation, harmonics: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Iterate on one grid until what is left is far below the tolerance, or below the harmonics that are missing.

    Args:
        eq: entries (B,).
        harmonics: (n + 1, B) first guess of P_0 to P_n.
        tolerance: relative to the mean of p.

    Returns:
        Places (b,) of those that have converged, their P (n + 1, b), and whether the grid is fine enough for them.
    """
    places, eq_now = np.arange(harmonics.shape[1]), eq
    matrix = _eliminated(eq, harmonics)
    last = np.full(harmonics.shape[1], np.inf)
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for _ in range(STEPS):
        step = _step(eq_now, matrix, harmonics)
        harmonics = harmonics + step
        size = np.abs(step).max(axis=0) / np.abs(harmonics[0])
        tail = np.abs(harmonics[3 * len(harmonics) // 4 :]).max(axis=0) / np.abs(harmonics[0])
        with np.errstate(invalid="ignore"):
            shrinks = size < SHRINKS * last
            left = np.where(shrinks & np.isfinite(last), size * size / last, size)
        exact = (tail <= tolerance) & (left <= 0.01 * tolerance)
        ready = exact | ((tail > tolerance) & (left <= 0.1 * tail))
        found.append((places[ready], harmonics[:, ready], exact[ready]))
        go_on = np.flatnonzero(~ready & shrinks)
        if not go_on.size:
            break
        places, harmonics, last, eq_now = places[go_on], harmonics[:, go_on], size[go_on], eq_now.of(go_on)
        matrix = _Matrix(*(values[..., go_on] for values in matrix))
    return (
        np.concatenate([item[0] for item in found]),
        np.concatenate([item[1] for item in found], axis=1),
        np.concatenate([item[2] for item in found]),
    )


def _eliminated(eq: ScaledEquation, harmonics: np.ndarray) -> _Matrix:
    """The matrix at a first guess, from its mean and first harmonic."""
    frequency = 1j * eq.epsilon * np.arange(len(harmonics))[:, None]
    spin = _spin(eq)
    diagonal = 1 + frequency * harmonics[0]
    lower, upper = frequency * harmonics[1] + spin, frequency * harmonics[1].conj() + spin.conj()
    inverse, ratio = np.zeros_like(diagonal), np.zeros_like(diagonal)
    above = np.zeros_like(spin)
    for k in range(len(harmonics) - 1, 0, -1):
        inverse[k] = 1 / (diagonal[k] + upper[k] * above)
        above = ratio[k] = -lower[k] * inverse[k]
    mean = 1 / (1 + 2 * (spin.conj() * ratio[1]).real)
    return _Matrix(inverse, upper * inverse, ratio, mean)


def _spin(eq: ScaledEquation) -> np.ndarray:
    """First harmonic of d = 1 + e K sin(theta + delta)."""
    return np.asarray(-0.5j * eq.epsilon * eq.k * np.exp(1j * eq.delta))


def _step(eq: ScaledEquation, matrix: _Matrix, harmonics: np.ndarray) -> np.ndarray:
    """The change of P for which the matrix takes the residual away."""
    residual = _residual(eq, harmonics)
    change = -residual * matrix.inverse
    for k in range(len(change) - 2, 0, -1):
        change[k] -= matrix.upper[k] * change[k + 1]
    change[0] = -(residual[0].real + 2 * (_spin(eq).conj() * change[1]).real) * matrix.mean
    for k in range(1, len(change)):
        change[k] += matrix.ratio[k] * change[k - 1]
    return change


def _residual(eq: ScaledEquation, harmonics: np.ndarray) -> np.ndarray:
    """Harmonics of e (p^2)'/2 + d p + q, q = 1 - rho cos theta."""
    count, spin = 2 * len(harmonics), _spin(eq)
    p = np.fft.irfft(harmonics, count, axis=0) * count
    square = np.fft.rfft(p * p, axis=0)[:-1] / count
    residual = (0.5j * eq.epsilon) * np.arange(len(harmonics))[:, None] * square + harmonics
    residual[0] += 1 + 2 * (spin * harmonics[1].conj()).real
    residual[1:] += spin * harmonics[:-1]
    residual[1:-1] += spin.conj() * harmonics[2:]
    residual[1] -= eq.ratio / 2
    return residual
