"""Time and action of an extremal from its first integral: no differential equation is integrated.

Along an extremal of the integral of Z u^2 + U(psi~) the energy constant h = Z u^2 - U does not change, so that

    time = integral of sqrt(Z / (U + h)) |dpsi~|,    action = integral of 2 sqrt(Z (U + h)) |dpsi~| - h time.

U + h vanishes at turning points and nearly vanishes where an extremal passes a minimum of U slowly.  Legs are therefore
cut at the minima and maxima of U, real and complex, and on each piece psi~ = a + (b - a) / (1 + e^-y): in y the
integrands decay at both ends, singularities beside a cut stay pi/2 away from the real axis however slow the passage is,
and the trapezoidal rule converges geometrically.  Near an end U + h is expanded about that end, so that it keeps all
its digits.

What U rises by on a piece between two fixed cuts does not depend on h: it is tabled once, and of each leg only the
pieces at its two ends need sines and cosines of their own.

Source: Trefethen, Weideman, The exponentially convergent trapezoidal rule, SIAM Review 56 (2014), section 14.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from occ.theory.trigonometric import TURN, derivative, recentred, shoulders, value, zeros

TINY = 1e-290
CELLS = 64
"""Cells of the table of a way down from a maximum of U to a minimum."""
WAYS = np.array([8.0, -8.0])[:, None]
"""Directions from both ends of a piece, times eight."""
NEWTON_STEPS = 3
"""From a cell of that table to rounding."""


@dataclass(frozen=True, eq=False)
class Rule:
    """Trapezoidal rule in y, folded: `share` of the way from the nearer end, and the weight of one end's half."""

    share: np.ndarray  # (n,)
    weight: np.ndarray  # (n,)

    @classmethod
    def create(cls, step: float, reach: float) -> Rule:
        """Nodes half a step off the middle, out to `reach`."""
        y = np.arange(step / 2, reach, step)
        small = 1 / (1 + np.exp(y))
        return cls(small, small * (1 - small) * step)


FINE = Rule.create(0.24, 66.0)
"""Rounding level also at turning points."""
COARSE = Rule.create(0.8, 34.0)
"""Five digits, for the search."""


class Legs(NamedTuple):
    """Ways from a lower to a higher angle on which U + h is positive inside."""

    low: np.ndarray  # (2, N) places
    high: np.ndarray  # (2, N) places
    energy: np.ndarray  # (N,) [W] h
    low_level: np.ndarray  # (N,) [W] U + h, as exactly as it is known (zero at a turning point)
    high_level: np.ndarray  # (N,) [W]


class Well:
    """Z and U of one circle, with the minima and maxima of U.

    A place is an angle as whole turns from the first cut, and what is left of it [rad]: (2, N).

    Args:
        friction: [N m s] Z, positive.
        power: (5,) [W] U.
        cuts: [rad] angles at which many legs begin or end: tables are made for them.
    """

    def __init__(self, friction: float, power: np.ndarray, cuts: tuple[float, ...] = ()) -> None:
        self.friction, self.power = friction, power
        slope = derivative(power)
        places = zeros(slope)
        bend = value(derivative(slope), places)
        # A constant U has no minima: any place will do to cut at.
        self.minima = places[bend > 0] if places.size else np.zeros(1)
        self.maxima = places[bend <= 0] if places.size else np.full(1, np.pi)
        self.bottoms = value(power, self.minima)
        self.bottom = float(self.bottoms.min())
        self._origin = cuts[0] if cuts else float(self.minima[0])
        cut = self.places(np.concatenate([cuts, self.minima, self.maxima, shoulders(power)]))[1]
        self._cuts = np.append(np.unique(cut), TURN)
        self._levels = value(power, self._origin + np.append(self._cuts[:-1], 0.0))
        self._valleys = self.places(self.minima)[1][:, None]
        self._rises: dict[Rule, np.ndarray] = {}
        self._falls = _Falls.create(power, self.minima, self.maxima, self.bottoms)

    def places(self, angle: np.ndarray) -> np.ndarray:
        """Places (2, N) of angles (N,) [rad]."""
        offset = angle - self._origin
        return self.moved(np.array([np.zeros_like(offset), offset]))

    def moved(self, places: np.ndarray, by: np.ndarray | float = 0.0) -> np.ndarray:
        """Places (2, N) that are further by so many radians."""
        offset = places[1] + by
        turns = np.floor(offset / TURN)
        return np.array([places[0] + turns, offset - TURN * turns])

    def angles(self, places: np.ndarray) -> np.ndarray:
        """Angles (N,) [rad] of places (2, N)."""
        return np.asarray(self._origin + (TURN * places[0] + places[1]))

    def is_critical(self, x: float) -> bool:
        """Whether an extremal may rest at the angle x [rad]: U' = 0 up to rounding."""
        return bool(np.abs(value(derivative(self.power), x)) <= 1e-12 * np.abs(self.power).sum())

    def lowest_between(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """(N,) [W] The lowest minimum of U strictly between two places (2, N); infinite where there is none."""
        before = low[0] + (low[1] >= self._valleys)
        inside = high[0] + (high[1] > self._valleys) > before
        return np.asarray(np.where(inside, self.bottoms[:, None], np.inf).min(axis=0))

    def way_to_turning_point(self, h: np.ndarray, start: np.ndarray, side: np.ndarray) -> np.ndarray:
        """How far it is from `start`, where U + h is positive, to the first zero of U + h on one side.

        Args:
            h: (N,) [W] energy constants.
            start: (2, N) places.
            side: (N,) +1 or -1.

        Returns:
            (N,) [rad], infinite where U + h stays positive.
        """
        falls = self._falls
        drop = falls.level[:, 0] - falls.level[:, 1]
        left = -h - falls.level[:, 1, None]
        row, k = np.nonzero((falls.way[:, None] == side) & (left > 0) & (left <= drop[:, None]))
        ahead = falls.way[row] * (falls.places_at(row, h[k]) - (self._origin + start[1, k]))
        ahead = np.mod(ahead, TURN)
        distance = np.full(h.shape, np.inf)
        np.minimum.at(distance, k, np.where(ahead > TURN - 1e-9, 0.0, ahead))
        return distance

    def integrals(
        self, ends: tuple[np.ndarray, np.ndarray], h: np.ndarray, levels: tuple[np.ndarray, np.ndarray], rule: Rule
    ) -> tuple[np.ndarray, np.ndarray]:
        """Time and the integral of 2 sqrt(Z (U + h)) |dpsi~| of legs on which U + h is positive inside.

        Args:
            ends: (N,) [rad] two end points, in any order.
            h: (N,) [W] energy constants.
            levels: (N,) [W] U + h at the two end points, as exactly as it is known (zero at a turning point).
            rule: of quadrature.

        Returns:
            (N,) [s] and (N,) [J].
        """
        swap = ends[1] < ends[0]
        low, high = np.where(swap, ends[1], ends[0]), np.where(swap, ends[0], ends[1])
        low_level, high_level = np.where(swap, levels[1], levels[0]), np.where(swap, levels[0], levels[1])
        return self.measured(Legs(self.places(low), self.places(high), h, low_level, high_level), rule)

    def measured(self, legs: Legs, rule: Rule) -> tuple[np.ndarray, np.ndarray]:
        """The same of legs whose ends are places.

        Args:
            legs: N.
            rule: of quadrature.

        Returns:
            (N,) [s] and (N,) [J].
        """
        low, high, h, low_level, high_level = legs
        cuts, count = self._cuts, len(self._cuts) - 1
        turns, offset = np.array([low, high]).swapaxes(0, 1)
        piece = np.searchsorted(cuts[:-1], offset, side="right") - 1
        first, last = count * turns.astype(np.int64) + piece
        inside = first == last
        begins = offset[0] == cuts[piece[0]]
        # Pieces that are covered from cut to cut, by their number on the circle, and how often.
        first += ~begins
        number = np.arange(count)[:, None]
        times = (last - 1 - number) // count - (first - 1 - number) // count
        which, whole = np.nonzero(times > 0)
        # What is left at the high ends, and at the low ends that are at no cut.
        left = np.where(inside, offset[0], cuts[piece[1]])
        (end,) = np.nonzero(offset[1] > left)
        (begin,) = np.nonzero(~inside & ~begins)
        level = np.where(inside, low_level, self._levels[piece[1]] + h)
        following = piece[0, begin] + 1
        a = np.concatenate([left[end], offset[0, begin]])
        b = np.concatenate([offset[1, end], cuts[following]])
        edges = np.empty((len(which) + len(a), 2, 1))
        edges[:, 0, 0] = np.concatenate([self._levels[which] + h[whole], level[end], low_level[begin]])
        edges[:, 1, 0] = np.concatenate(
            [self._levels[which + 1] + h[whole], high_level[end], self._levels[following] + h[begin]]
        )
        rises = np.concatenate([self._table(rule)[which], self._rise(a, b, rule)])
        width = np.concatenate([cuts[which + 1] - cuts[which], b - a])
        # Rounding of the end points of a very short piece may make its levels negative.
        weight = np.concatenate([rule.weight, rule.weight])
        root = np.sqrt(np.abs(edges + rises) + TINY).reshape(len(width), len(weight))
        width *= np.sqrt(self.friction)
        length = 2 * width * (root @ weight)
        time = width * (np.reciprocal(root, out=root) @ weight)
        leg = np.concatenate([whole, end, begin])
        often = np.concatenate([times[which, whole], np.ones(len(a))])
        return np.bincount(leg, time * often, len(h)), np.bincount(leg, length * often, len(h))

    def _table(self, rule: Rule) -> np.ndarray:
        """(P, 2, n) [W] rises on the pieces between neighbouring cuts."""
        if rule not in self._rises:
            self._rises[rule] = self._rise(self._cuts[:-1], self._cuts[1:], rule)
        return self._rises[rule]

    def _rise(self, a: np.ndarray, b: np.ndarray, rule: Rule) -> np.ndarray:
        """(P, 2, n) [W] U - U(a) and U - U(b) at the nodes of pieces, without cancellation; a, b (P,) offsets."""
        half = np.multiply.outer(b - a, rule.share / 2)[:, None]
        half_sine = np.sin(half)
        square = half_sine * half_sine
        half_sine *= np.cos(half)
        # A whole turn is no turn, so that a minimum there is where it has been found.
        place = self._origin + np.array([a, np.where(b < TURN, b, 0.0)]).T[:, :, None]
        c, s = np.cos(place), np.sin(place)
        second_c, second_s = c * c - s * s, 2 * s * c
        _, p_1, q_1, p_2, q_2 = self.power
        even, odd = 8 * (p_2 * second_c + q_2 * second_s), WAYS * (q_2 * second_c - p_2 * second_s)
        # The same formula from both ends, with the sine of the other sign.
        rises = half_sine * ((WAYS / 4) * (q_1 * c - p_1 * s) + odd / 2 - odd * square)
        rises += square * (even * square - (even + 2 * (p_1 * c + q_1 * s)))
        return np.asarray(rises)


class _Falls(NamedTuple):
    """Ways down from a maximum of U to a minimum beside it, as tables of U = bottom + drop sin^2(phase)."""

    way: np.ndarray  # (F,) +1 or -1
    ends: np.ndarray  # (F, 2) [rad] maximum and minimum
    level: np.ndarray  # (F, 2) [W] U there
    shape: np.ndarray  # (3, F, 2) coefficients of cos s, cos 2s, sin 2s there
    phase: np.ndarray  # (F, CELLS + 1) [rad] from pi/2 to 0, nearly in proportion to the way

    @classmethod
    def create(cls, power: np.ndarray, minima: np.ndarray, maxima: np.ndarray, bottoms: np.ndarray) -> _Falls:
        """All ways down of one U."""
        way = np.repeat([1.0, -1.0], len(minima))
        bottom = np.tile(minima, 2)
        top = bottom - way * np.mod(way[:, None] * (bottom[:, None] - maxima), TURN).min(axis=1)
        ends = np.stack([top, bottom], axis=1)
        place = top[:, None] + (bottom - top)[:, None] * _SHARES
        level = value(power, place)
        share = (level - level[:, -1:]) / (level[:, :1] - level[:, -1:] + TINY)
        phase = np.arcsin(np.sqrt(np.minimum(np.maximum(share, 0.0), 1.0)))
        # Of the minima the same numbers that say which ways are barred.
        levels = np.array([level[:, 0], np.tile(bottoms, 2)]).T
        return cls(way, ends, levels, recentred(power, ends)[[1, 3, 4]], phase)

    def places_at(self, row: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Where U = -h on some of the ways [rad]: a cell of the table, and Newton's method."""
        left = -h[:, None] - self.level[row]
        phase = np.arcsin(np.sqrt(np.minimum(left[:, 1] / (left[:, 1] - left[:, 0]), 1.0)))
        cell = np.count_nonzero(self.phase[row, 1:-1] > phase[:, None], axis=1)
        above, below = self.phase[row, cell], self.phase[row, cell + 1]
        share = (cell + (above - phase) / (above - below + TINY)) / CELLS
        # U is flat at both ends: it is expanded about the nearer one, so that nothing cancels.
        near = (phase < np.pi / 4).astype(np.int64)
        c_1, c_2, s_2 = self.shape[:, row, near]
        rise, place = left[np.arange(len(h)), near], self.ends[row, near]
        s = (self.ends[row, 1] - self.ends[row, 0]) * (share - near)
        for _ in range(NEWTON_STEPS):
            sine, square = np.sin(s), np.sin(s / 2) ** 2
            bend, skew = c_1 + 4 * c_2 * (1 - square), 4 * s_2 * square
            excess = 2 * square * bend + skew * sine + rise
            slope = sine * (bend - 4 * c_2 * square) + skew * (1 - 2 * square) + 2 * s_2 * sine * sine
            s -= excess / (slope + np.copysign(TINY, slope))
        return np.asarray(place + s)


_SHARES = np.linspace(0, 1, CELLS + 1)
