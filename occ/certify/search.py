"""Which ways to look at more closely, and at which level: proposals in floating point for `occ.certify.ways`."""

from __future__ import annotations

import time

import numpy as np

from occ.certify.ways import FreeEnds, GivenEnd, Item, Ways, WaysProof
from occ.theory.quadrature import COARSE, Well
from occ.theory.trigonometric import TURN, derivative, value

SMALLEST = 2.0**-16
"""Cells are not halved below this part of a cell of the grid."""
HALVINGS = 40


def search(ways: FreeEnds | GivenEnd, target: float, deadline: float) -> WaysProof:
    """Halve cells until all bounds reach the target, or the time is over.

    Args:
        ways: the problem.
        target: [J] of the work plus the kinetic energy at the start.
        deadline: [s] of `time.process_time`.

    Returns:
        To be checked by `occ.certify.ways.lower_bound`.
    """
    hints = _Hints(ways)
    reach = ways.reach if isinstance(ways, FreeEnds) else 0
    closed: list[Item] = []
    active = hints.levels([item for item, floor in ways.roots() if floor < target])
    while active:
        open_items: list[Item] = []
        finished: list[Item] = []
        for item in active:
            divisible = item.last - item.first > SMALLEST and (item.side != 0 or isinstance(ways, FreeEnds))
            if ways.bound(item) >= target or not divisible:
                finished.append(item)
            else:
                open_items.append(item)
            if time.process_time() > deadline:
                return WaysProof((*closed, *active), reach)
        closed += finished
        active = hints.levels([half for item in open_items for half in _halves(item)])
    return WaysProof(tuple(closed), reach)


def _halves(item: Item) -> tuple[Item, Item]:
    middle = (item.first + item.last) / 2
    return item._replace(last=middle), item._replace(first=middle)


class _Hints:
    """The level at which each way takes the time given, in floating point."""

    def __init__(self, ways: Ways) -> None:
        self.ways = ways
        task = ways.task
        self.power = np.array([float(c) for c in task.power.coefficients])
        self.well = Well(float(task.friction), self.power)
        self.edges = np.array([float(edge) for edge in ways.lengths.edges])
        self.slope = derivative(np.array([float(c) for c in task.of_end.coefficients]))
        self.slope[0] += 2 * float(task.friction * task.rate)

    def levels(self, items: list[Item]) -> list[Item]:
        """The items with the level that bounds them best, if that is above the least allowed."""
        if not items:
            return []
        side = np.array([item.side for item in items])
        first, last = (np.array([getattr(item, name) for item in items]) for name in ("first", "last"))
        given = self.ways.end if isinstance(self.ways, GivenEnd) else None
        end = self._angle((first + last) / 2 if given is None else np.full(len(items), given))
        start = self._angle(np.zeros(len(items)))
        turn, least = end.copy(), self._least(start, end)
        k = np.flatnonzero(side)
        if given is None:
            energy = value(self.slope, end[k]) ** 2 / (4 * self.well.friction) - value(self.power, end[k])
            outer = np.where(side[k] > 0, np.maximum(start[k], end[k]), np.minimum(start[k], end[k]))
            energy = np.maximum(energy, -value(self.power, outer))
            place = self.well.turning_point(energy, outer, side[k].astype(float))
            turn[k], least[k] = np.where(np.isfinite(place), place, outer), energy
        else:
            near, far = (self._angle(np.where(side[k] * s > 0, first[k], last[k])) for s in (1, -1))
            turn[k] = near
            least[k] = -np.minimum(value(self.power, near), value(self.power, far))
        found = self._in_time(np.stack([start, end]), turn, least)
        return [item._replace(level=float(level)) for item, level in zip(items, found, strict=True)]

    def _angle(self, place: np.ndarray) -> np.ndarray:
        turns, rest = np.divmod(place, self.ways.lengths.count)
        return np.interp(rest, np.arange(len(self.edges)), self.edges) + TURN * turns

    def _least(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """-min U between two angles."""
        low, high = np.minimum(start, end), np.maximum(start, end)
        least = -np.minimum(value(self.power, low), value(self.power, high))
        for place, bottom in zip(self.well.minima, self.well.bottoms, strict=True):
            least = np.where(np.mod(place - low, TURN) < high - low, np.maximum(least, -bottom), least)
        return least

    def _in_time(self, ends: np.ndarray, turn: np.ndarray, least: np.ndarray) -> np.ndarray:
        """The level at which both legs take the time given; -inf where the lowest one is fast enough."""
        duration = self.ways.duration
        scale = np.abs(self.power).sum()
        low, high = np.full(len(turn), np.log(1e-14 * scale)), np.full(len(turn), np.log(1e8 * scale))
        levels = value(self.power, ends), value(self.power, turn)

        def slow(rise: np.ndarray) -> np.ndarray:
            h = least + rise
            total = np.zeros_like(h)
            for k in (0, 1):
                edges = np.maximum(levels[0][k] + h, 0.0), np.maximum(levels[1] + h, 0.0)
                total += self.well.integrals((ends[k], turn), h, edges, COARSE)[0]
            return total > duration

        never = ~slow(np.exp(low))
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            later = slow(np.exp(middle))
            low, high = np.where(later, middle, low), np.where(later, high, middle)
        return np.where(never, -np.inf, least + np.exp((low + high) / 2))
