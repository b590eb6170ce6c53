"""Trigonometric polynomials of degree two: what the energies of a platform on a circle are made of.

p(x) = c_0 + c_1 cos x + s_1 sin x + c_2 cos 2x + s_2 sin 2x, held as an array (5, ...) in this order.
"""

from __future__ import annotations

import numpy as np

TURN = 2 * np.pi
_GRID = np.arange(64) * (TURN / 64)
_FINE = np.arange(512) * (TURN / 512)


def basis(x: np.ndarray) -> np.ndarray:
    """(5, ...) 1, cos x, sin x, cos 2x, sin 2x at the angles x [rad]."""
    c, s = np.cos(x), np.sin(x)
    return np.stack([np.ones_like(c), c, s, c * c - s * s, 2 * s * c])


def value(p: np.ndarray, x: np.ndarray | float) -> np.ndarray:
    """p(x): coefficients (5,) or (5, ...) that broadcast with the angles x [rad]."""
    c, s = np.cos(x), np.sin(x)
    # In the order of Clenshaw's sum for degree two: half of the time is spent here.
    return p[0] - p[3] + c * (p[1] + 2 * (p[3] * c + p[4] * s)) + p[2] * s


def value_and_slope(p: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """p(x) and p'(x) of one polynomial (5,) at the angles x [rad]."""
    c, s = np.cos(x), np.sin(x)
    first, second = p[3] * c + p[4] * s, p[4] * c - p[3] * s
    level = p[0] - p[3] + c * (p[1] + 2 * first) + p[2] * s
    slope = c * (p[2] + 4 * second) - p[1] * s - 2 * p[4]
    return level, slope


def derivative(p: np.ndarray) -> np.ndarray:
    """The coefficients (5, ...) of dp/dx."""
    return np.stack([np.zeros_like(p[0]), p[2], -p[1], 2 * p[4], -2 * p[3]])


def recentred(p: np.ndarray, a: np.ndarray) -> np.ndarray:
    """The coefficients (5, ...) of s -> p(a + s); a [rad] broadcasts with the coefficients."""
    _, c, s, c2, s2 = basis(a)
    return np.stack(
        np.broadcast_arrays(
            p[0], p[1] * c + p[2] * s, p[2] * c - p[1] * s, p[3] * c2 + p[4] * s2, p[4] * c2 - p[3] * s2
        )
    )


def zeros(p: np.ndarray) -> np.ndarray:
    """The angles in [0, 2 pi) at which p changes its sign, by bisection down to rounding.

    Args:
        p: (5,) one polynomial.

    Returns:
        (0 to 4,) [rad], increasing.
    """
    values = value(p, _FINE) >= 0
    before = np.flatnonzero(values != np.roll(values, -1))
    low, high = _FINE[before], _FINE[before] + TURN / len(_FINE)
    rising = ~values[before]
    for _ in range(52):
        middle = (low + high) / 2
        right = (value(p, middle) >= 0) == rising
        low, high = np.where(right, low, middle), np.where(right, middle, high)
    return np.sort(np.mod((low + high) / 2, TURN))


def least(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and value of the least value of each of many polynomials.

    A grid finds the valleys (there are at most two), Newton's method their bottoms.

    Args:
        p: (5, N).

    Returns:
        Angle (N,) [rad] and least value (N,).
    """
    best_x, best = np.zeros(p.shape[1:]), np.full(p.shape[1:], np.inf)
    values = basis(_GRID).T @ p
    bottom = (values <= np.roll(values, 1, axis=0)) & (values <= np.roll(values, -1, axis=0))
    ranked = np.where(bottom, values, np.inf)
    for _ in range(2):
        k = np.argmin(ranked, axis=0)
        x = _bottom(p, _GRID[k])
        reached = value(p, x)
        better = (reached < best) & np.isfinite(np.take_along_axis(ranked, k[None], axis=0)[0])
        best_x, best = np.where(better, x, best_x), np.where(better, reached, best)
        np.put_along_axis(ranked, k[None], np.inf, axis=0)
    return best_x, best


def _bottom(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Newton's method from grid points at the bottom of a valley; it may not leave the neighbouring points."""
    low, high = x - TURN / 64, x + TURN / 64
    for _ in range(6):
        _, c, s, c2, s2 = basis(x)
        slope = p[2] * c - p[1] * s + 2 * (p[4] * c2 - p[3] * s2)
        bend = -p[1] * c - p[2] * s - 4 * (p[3] * c2 + p[4] * s2)
        step = np.divide(slope, bend, out=np.zeros_like(slope), where=bend > 0)
        x = np.clip(x - step, low, high)
    return x
