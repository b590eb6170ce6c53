"""Trigonometric polynomials of degree two: what the energies of a platform on a circle are made of.

p(x) = c_0 + c_1 cos x + s_1 sin x + c_2 cos 2x + s_2 sin 2x, held as an array (5, ...) in this order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

TURN = 2 * np.pi
_GRID = np.arange(64) * (TURN / 64)
_FINE = np.arange(512) * (TURN / 512)
NEWTON_STEPS = 20
SMALL_STEP = 1e-8
"""[rad] After a step of Newton's method as short as this one the angle is exact to rounding."""
MOST_STEPS = 60
ROUNDING = 4e-16
ON_AXIS, FAR = 1e-9, 3.0
"""[rad] Distances from the real axis between which complex zeros matter to a quadrature along it."""
QUADRATIC = 1e-3
STALLED = 0.7
"""Newton's steps towards a threefold root shrink faster than this."""


def basis(x: np.ndarray) -> np.ndarray:
    """(5, ...) 1, cos x, sin x, cos 2x, sin 2x at the angles x [rad]."""
    c, s = np.cos(x), np.sin(x)
    return np.stack([np.ones_like(c), c, s, c * c - s * s, 2 * s * c])


_GRID_BASIS = basis(_GRID)
_FINE_BASIS = basis(_FINE)


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
    """The angles in [0, 2 pi) at which p changes its sign, down to rounding.

    Args:
        p: (5,) one polynomial.

    Returns:
        (0 to 4,) [rad], increasing.
    """
    values = p @ _FINE_BASIS >= 0
    before = np.flatnonzero(values != np.roll(values, -1))
    low = _FINE[before]
    bracket = low, low + TURN / len(_FINE)
    return np.sort(np.mod(crossing(lambda x: value_and_slope(p, x), bracket, ~values[before]), TURN))


def shoulders(p: np.ndarray) -> np.ndarray:
    """The angles (0 to 2,) [rad] of the complex zeros of p' beside the real axis, where p is nearly level.

    p' is z^-2 times a polynomial of degree four in z = e^ix, and its zeros beside |z| = 1 come in pairs z, 1/conj z.
    """
    _, c_1, s_1, c_2, s_2 = derivative(p)
    first, second = (c_1 - 1j * s_1) / 2, (c_2 - 1j * s_2) / 2
    z = np.roots([second, first, 0.0, np.conj(first), np.conj(second)])
    height = np.log(np.maximum(np.abs(z), 1.0))
    return np.angle(z[(height > ON_AXIS) & (height < FAR)])


def crossing(
    level: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    bracket: tuple[np.ndarray, np.ndarray],
    rising: np.ndarray,
) -> np.ndarray:
    """Where functions change their sign, by Newton's method, and bisection where it would leave the bracket.

    Args:
        level: value and slope at the angles (N,) [rad].
        bracket: lower and upper ends (N,) [rad].
        rising: (N,) whether a function is negative at the lower end, and not at the upper one.

    Returns:
        (N,) [rad], exact to rounding.
    """
    low, high = bracket
    x, before = (low + high) / 2, high - low
    for _ in range(MOST_STEPS):
        here, slope = level(x)
        early = (here < 0) == rising
        low, high = np.where(early, x, low), np.where(early, high, x)
        step = x - np.divide(here, slope, out=np.full_like(x, np.inf), where=slope != 0)
        following = np.where((step >= low) & (step <= high), step, (low + high) / 2)
        moved = np.abs(following - x)
        x = following
        # Quadratic convergence has just ended, or rounding is all that is left and steps no longer become shorter.
        ended = (moved <= QUADRATIC * before) | (moved > STALLED * before) | (moved <= ROUNDING)
        if (ended & (moved <= SMALL_STEP)).all():
            break
        before = moved
    return x


def least(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and value of the least value of each of many polynomials.

    A grid finds the valleys (there are at most two), Newton's method their bottoms.

    Args:
        p: (5, N).

    Returns:
        Angle (N,) [rad] and least value (N,).
    """
    values = p.T @ _GRID_BASIS
    rise = np.diff(values, axis=1, append=values[:, :1])
    bottom = (rise >= 0) & np.roll(rise <= 0, 1, axis=1)
    k = np.argmin(values, axis=1)
    best_x = _bottom(p, values, k)
    best = value(p, best_x)
    # The other valley, where there is one, may be the deeper one between the points of the grid.
    other = np.flatnonzero(np.count_nonzero(bottom, axis=1) > 1)
    ranked = np.where(bottom[other], values[other], np.inf)
    np.put_along_axis(ranked, k[other, None], np.inf, axis=1)
    x = _bottom(p[:, other], values[other], np.argmin(ranked, axis=1))
    reached = value(p[:, other], x)
    better = reached < best[other]
    best_x[other[better]], best[other[better]] = x[better], reached[better]
    return best_x, best


def _bottom(p: np.ndarray, values: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Bottoms of valleys by Newton's method, from the vertex of a parabola through three points of the grid.

    Args:
        p: (5, N).
        values: (N, 64) on the grid.
        k: (N,) lowest points of the valleys; the method may not leave the neighbouring points.

    Returns:
        (N,) [rad].
    """
    rows = np.arange(len(k))
    before, here, after = values[rows, k - 1], values[rows, k], values[rows, (k + 1) % len(_GRID)]
    bend = before - 2 * here + after
    shift = np.divide(before - after, 2 * bend, out=np.zeros_like(bend), where=bend > 0)
    low, high = _GRID[k] - _GRID[1], _GRID[k] + _GRID[1]
    x = _GRID[k] + _GRID[1] * shift
    active = slice(None)
    for _ in range(NEWTON_STEPS):
        part, angle = p[:, active], x[active]
        c, s = np.cos(angle), np.sin(angle)
        first, second = part[3] * c + part[4] * s, part[4] * c - part[3] * s
        slope = c * (part[2] + 4 * second) - part[1] * s - 2 * part[4]
        bend = 4 * part[3] - c * (part[1] + 8 * first) - part[2] * s
        step = np.divide(slope, bend, out=np.zeros_like(slope), where=bend > 0)
        x[active] = np.clip(angle - step, low[active], high[active])
        # Convergence is quadratic.
        active = rows[active][np.abs(step) > SMALL_STEP]
        if not active.size:
            break
    return x
