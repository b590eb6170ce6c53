"""Time and action of an extremal from its first integral: no differential equation is integrated.

Along an extremal of the integral of Z u^2 + U(psi~) the energy constant h = Z u^2 - U does not change, so that

    time = integral of sqrt(Z / (U + h)) |dpsi~|,    action = integral of 2 sqrt(Z (U + h)) |dpsi~| - h time.

U + h vanishes at turning points and nearly vanishes where an extremal passes a minimum of U slowly.  Legs are therefore
cut at the minima and maxima of U, and on each piece psi~ = a + (b - a) / (1 + e^-y): in y the integrands decay at both
ends, their nearest singularities stay pi/2 away from the real axis however slow the passage is, and the trapezoidal
rule converges geometrically.  Near an end U + h is expanded about that end, so that it keeps all its digits.

Source: Trefethen, Weideman, The exponentially convergent trapezoidal rule, SIAM Review 56 (2014), section 14.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from occ.theory.trigonometric import TURN, derivative, recentred, value, value_and_slope, zeros

TINY = 1e-290


class Rule(NamedTuple):
    """Trapezoidal rule in y, folded: `share` of the way from the nearer end, and the weight of one end's half."""

    share: np.ndarray  # (n,)
    weight: np.ndarray  # (n,)

    @classmethod
    def create(cls, step: float, reach: float) -> Rule:
        """Nodes half a step off the middle, out to `reach`."""
        y = np.arange(step / 2, reach, step)
        small = 1 / (1 + np.exp(y))
        return cls(small, small * (1 - small) * step)


FINE = Rule.create(0.28, 66.0)
"""Rounding level also at turning points."""
COARSE = Rule.create(0.8, 34.0)
"""Five digits, for the search."""


class Well:
    """Z and U of one circle, with the minima and maxima of U.

    Args:
        friction: [N m s] Z, positive.
        power: (5,) [W] U.
    """

    def __init__(self, friction: float, power: np.ndarray) -> None:
        self.friction, self.power = friction, power
        slope = derivative(power)
        places = zeros(slope)
        bend = value(derivative(slope), places)
        # A constant U has no minima: any place will do to cut at.
        self.minima = places[bend > 0] if places.size else np.zeros(1)
        self.maxima = places[bend <= 0] if places.size else np.full(1, np.pi)
        self.bottoms = value(power, self.minima)
        self.bottom = float(self.bottoms.min())
        self._cuts = np.concatenate([self.minima, self.maxima])
        self._falls = self._ways_down()

    def is_critical(self, x: float) -> bool:
        """Whether an extremal may rest at the angle x [rad]: U' = 0 up to rounding."""
        return bool(np.abs(value(derivative(self.power), x)) <= 1e-12 * np.abs(self.power).sum())

    def turning_point(self, h: np.ndarray, start: np.ndarray, side: np.ndarray) -> np.ndarray:
        """The first zero of U + h on the way from `start`, where U + h is positive, to one side.

        Args:
            h: (N,) [W] energy constants.
            start: (N,) [rad].
            side: (N,) +1 or -1.

        Returns:
            (N,) [rad], infinite where U + h stays positive.
        """
        distance = np.full(h.shape, np.inf)
        for way, top, place, level in self._falls:
            k = np.flatnonzero((side == way) & (level[-1] + h < 0) & (top + h >= 0))
            if not k.size:
                continue
            ahead = np.mod(way * (self._on_the_way_down(place, level, h[k]) - start[k]), TURN)
            ahead = np.where(ahead > TURN - 1e-9, 0.0, ahead)
            distance[k] = np.minimum(distance[k], ahead)
        return start + side * distance

    def _ways_down(self) -> list[tuple[float, float, np.ndarray, np.ndarray]]:
        """Direction, highest level, and a table of places and levels from each maximum of U to a minimum beside it."""
        tables = []
        share = (1 - np.cos(np.linspace(0, np.pi, 400))) / 2
        for bottom in self.minima:
            for way in (1.0, -1.0):
                drop = np.mod(way * (bottom - self.maxima), TURN).min()
                place = bottom - way * drop * share[::-1]
                level = np.minimum.accumulate(value(self.power, place))
                tables.append((way, float(level[0]), place, level))
        return tables

    def _on_the_way_down(self, place: np.ndarray, level: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Where U = -h on one table: a cell of the table, and Newton's method that may not leave it."""
        cell = np.clip(np.searchsorted(-level, h) - 1, 0, len(level) - 2)
        first, last = place[cell], place[cell + 1]
        low, high = np.minimum(first, last), np.maximum(first, last)
        x = (low + high) / 2
        for _ in range(6):
            value_here, slope = value_and_slope(self.power, x)
            # A slope of zero is where the table ends; TINY keeps the step defined, the cell keeps it inside.
            x = np.clip(x - (value_here + h) / (slope + np.copysign(TINY, slope)), low, high)
        return x

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
        turns = np.floor((high - low) / TURN)
        rest = low + TURN * turns
        index, pieces = [], []
        groups = [(rest, high, low_level, high_level, np.ones_like(turns))]
        if turns.any():
            groups.append((low, low + TURN, low_level, low_level, turns))
        for start, end, start_level, end_level, count in groups:
            order = np.sort(start + np.mod(self._cuts[:, None] - start, TURN), axis=0)
            cuts = [start, *order, end]
            for k, (a, b) in enumerate(pairwise(cuts)):
                stop = np.minimum(b, end)
                keep = np.flatnonzero((stop > a) & (count > 0))
                first = start_level if k == 0 else value(self.power, a) + h
                last = np.where(b >= end, end_level, value(self.power, b) + h)
                index.append(keep)
                pieces.append(np.stack([a, stop, first, last, count])[:, keep])
        where, table = np.concatenate(index), np.concatenate(pieces, axis=1)
        time, length = self._pieces(table[0], table[1], table[2], table[3], rule)
        size = len(h)
        return np.bincount(where, time * table[4], size), np.bincount(where, length * table[4], size)

    def _pieces(
        self, a: np.ndarray, b: np.ndarray, level_a: np.ndarray, level_b: np.ndarray, rule: Rule
    ) -> tuple[np.ndarray, np.ndarray]:
        width = b - a
        s = width[:, None] * rule.share
        half_sine, half_cosine = np.sin(s / 2), np.cos(s / 2)
        sine, square = 2 * half_sine * half_cosine, half_sine * half_sine
        time, length = np.zeros(len(a)), np.zeros(len(a))
        weight = width[:, None] * rule.weight
        for place, level, way in ((a, level_a, 1.0), (b, level_b, -1.0)):
            _, c_1, s_1, c_2, s_2 = recentred(self.power, place)[:, :, None]
            slope = s_1 + 2 * s_2
            # U(a + s) - U(a) without cancellation.
            rise = slope * (way * sine) - 2 * square * (c_1 + 4 * c_2 * (1 - square) + 2 * s_2 * way * sine)
            # Rounding of the end points of a very short piece may make its levels negative.
            root = np.sqrt(self.friction * (np.abs(level[:, None] + rise) + TINY))
            time += self.friction * np.sum(weight / root, axis=1)
            length += 2 * np.sum(weight * root, axis=1)
        return time, length
