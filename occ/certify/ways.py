"""All ways at once: bounds of every extremal, cell by cell, whatever the optimum looks like.

A least motion exists, is smooth, conserves h = Z u^2 - U and turns at most once (reports/proof.md).  So either psi~
goes straight from its start to its end, or it turns once, at a place y beyond both, where U = -h is the least value on
the way.  For every h' with U + h' >= 0 on the way,

    integral of (Z u^2 + U) dt >= length of the way for h' - h' T,    length = integral of 2 sqrt(Z (U + h')) |dpsi~|,

with equality for h' = h.  Where the end is free, 2 Z u_T + phi' = 0 gives h = phi'^2 / (4 Z) - U at the end, so that
each cell of ends has a range of h, a place before which psi~ does not turn, and a bound; where the end is given, each
cell of turning points has.  No h' is trusted: it is raised until the inequality holds.  Cells are halved until all
bounds are close.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from flint import arb

from occ.certify.balls import Ball, EnclosedTask, Refused, square
from occ.certify.floors import CELLS, ROUNDING, Floors
from occ.certify.lengths import Lengths, Place, above, below


class Item(NamedTuple):
    """One family of ways.

    Args:
        side: 0 for straight ways, +1 or -1 for ways that turn on this side of both ends.
        first: lower edge of the cell of ends, or where the end is given of turning points.
        last: upper edge.
        level: [W] h'.
    """

    side: int
    first: Place
    last: Place
    level: float = -np.inf


@dataclass(frozen=True)
class WaysProof:
    """Items that divide cells; a cell that has none counts with its floor.

    Args:
        items: in any order.
        reach: cells on both sides of the start beyond which the floors speak; 0 where the end is given.
    """

    items: tuple[Item, ...]
    reach: int = 0


class Ways:
    """What both problems share.

    Args:
        task: enclosed.
        lengths: on its circle.
    """

    def __init__(self, task: EnclosedTask, lengths: Lengths) -> None:
        self.task, self.lengths = task, lengths
        self.duration = float(task.duration)
        self._tops = np.array([above(task.power(edge)) for edge in lengths.edges[:-1]])

    def tops(self, first: Place, last: Place) -> float:
        """[W] The least of U at the edges of cells in a stretch, from above; infinite where it holds none."""
        edges = np.arange(np.ceil(first), np.floor(last) + 1).astype(int)
        return float(self._tops[edges[: self.lengths.count] % self.lengths.count].min(initial=np.inf))

    def lows(self, first: Place, last: Place) -> float:
        """[W] A lower bound of U between two places."""
        inner, outer = math.ceil(first), math.floor(last)
        if first == last or inner > outer:
            return below(self.task.power.on(self.lengths.box(first, last)))
        cells = np.arange(inner, min(outer, inner + self.lengths.count))
        least = float(self.lengths.lows[cells % self.lengths.count].min(initial=np.inf))
        parts = (pair for pair in ((first, inner), (outer, last)) if pair[0] < pair[1])
        return min([least, *(below(self.task.power.on(self.lengths.box(*pair))) for pair in parts)])

    def action(self, length: float, level: float) -> float:
        """[J] length - level T, rounded down."""
        rest = level * self.duration
        return length - rest - ROUNDING * (length + abs(rest))

    def bound(self, item: Item) -> float:
        """[J] A lower bound of the work plus the kinetic energy at the start over the ways of one item."""
        raise NotImplementedError

    def roots(self) -> Iterator[tuple[Item, float]]:
        """Cells that cover everything up to some distance, each with a bound that needs no proof."""
        raise NotImplementedError

    def beyond(self) -> float:
        """[J] A lower bound for everything further away."""
        return np.inf


class FreeEnds(Ways):
    """Items are cells of ends.

    Args:
        task: enclosed.
        floors: of the same task.
        reach: cells on both sides of the start.
    """

    def __init__(self, task: EnclosedTask, floors: Floors, reach: int) -> None:
        super().__init__(task, floors.lengths)
        self.floors, self.reach = floors, reach
        self._slope = task.of_end.derivative()

    def roots(self) -> Iterator[tuple[Item, float]]:
        cells = np.arange(-self.reach, self.reach)
        for k, floor in zip(cells, self.floors.of_cells(cells), strict=True):
            yield Item(0, float(k), float(k + 1)), float(floor)
            if -CELLS <= k < CELLS:
                # A turning point is less than a turn from both ends: it is not passed.
                yield Item(1, float(k), float(k + 1)), float(floor)
                yield Item(-1, float(k), float(k + 1)), float(floor)

    def beyond(self) -> float:
        return self.floors.beyond(self.reach)

    def bound(self, item: Item) -> float:
        side, first, last, _ = item
        task, box = self.task, self.lengths.box(first, last)
        force = 2 * task.friction * task.rate + self._slope.on(box)
        forward = 1 if first >= 0 else -1
        # u_T = -phi' / (2 Z) points away from the start on a straight way, and back from the turning point.
        if (forward if side == 0 else -side) * force > 0:
            return np.inf
        power = task.power.on(box)
        energy = square(force) / (4 * task.friction) - power
        low, high = below(energy), above(energy)
        if self.tops(min(0.0, last), max(0.0, first)) + high < 0:
            return np.inf
        if side == 0:
            lowest = -min(self.lows(min(0.0, last), max(0.0, first)), below(power))
            levels = {max(item.level, min(high, lowest)), max(item.level, high)}
            return max(self._straight(item, level, power, force) for level in levels)
        near = self.lengths.clear(max(0.0, first) if side > 0 else min(0.0, last), side, low)
        if near is None:
            return np.inf
        return self._turning(item, max(item.level, min(high, -self.lengths.lowest)), near, power, force)

    def _root(self, power: Ball, level: float) -> Ball:
        """[J/rad] The slope of a length where U is `power`."""
        least, largest = (max(0.0, x) for x in (below(power + level), above(power + level)))
        roots = [2 * (self.task.friction * arb(x)).sqrt() for x in (least, largest)]
        return roots[0].union(roots[1])

    def _straight(self, item: Item, level: float, power: Ball, force: Ball) -> float:
        _, first, last, _ = item
        start, end = (first, last) if first >= 0 else (last, first)
        near = self.lengths.way(level, 0.0, start)
        far = near + self.lengths.way(level, start, end)
        slope = force + (1 if first >= 0 else -1) * self._root(power, level)
        return self._over_cell(item, level, (near, far) if first >= 0 else (far, near), slope)

    def _turning(self, item: Item, level: float, near: Place, power: Ball, force: Ball) -> float:
        side, first, last, _ = item
        inner, outer = (first, last) if side > 0 else (last, first)
        way = self.lengths.way(level, 0.0, near)
        if (near - outer) * side < 0:
            # It may turn inside of the cell of ends, where phi hardly changes.
            cost = below(self.task.end_cost_on(self.lengths.box(first, last)))
            return self.action(way, level) + cost - ROUNDING * (way + abs(cost))
        short = way + self.lengths.way(level, outer, near)
        long = short + self.lengths.way(level, inner, outer)
        slope = force - side * self._root(power, level)
        return self._over_cell(item, level, (long, short) if side > 0 else (short, long), slope)

    def _over_cell(self, item: Item, level: float, lengths: tuple[float, float], slope: Ball) -> float:
        """From lower bounds at both edges of a cell and a bound of the slope between them."""
        edges = (self.lengths.place(p) for p in (item.first, item.last))
        a, b = (
            self.action(length, level) + below(self.task.end_cost(x)) for length, x in zip(lengths, edges, strict=True)
        )
        width = above(self.lengths.place(item.last) - self.lengths.place(item.first))
        least, largest = below(slope), above(slope)
        margin = ROUNDING * (abs(a) + abs(b) + (abs(least) + abs(largest)) * width)
        if least >= 0:
            return a - margin
        if largest <= 0:
            return b - margin
        s = min(max((a - b + largest * width) / (largest - least), 0.0), width)
        return max(a + least * s, b - largest * (width - s)) - margin


class GivenEnd(Ways):
    """Items are cells of turning points, and one for the straight way.

    Args:
        task: enclosed.
        lengths: with the end among its edges.
        end: edge at which motions end.
        cost: [J] what the end costs, kinetic energy included, as a ball.
    """

    def __init__(self, task: EnclosedTask, lengths: Lengths, end: Place, cost: Ball) -> None:
        super().__init__(task, lengths)
        self.end, self.cost = end, below(cost)

    def roots(self) -> Iterator[tuple[Item, float]]:
        low, high = min(0.0, self.end), max(0.0, self.end)
        # A turning point is less than a turn from both ends: it is not passed.
        right = range(int(high), int(low) + self.lengths.count)
        left = range(int(high) - self.lengths.count, int(low))
        items = [Item(0, low, high), *(Item(1, k, k + 1) for k in right), *(Item(-1, k, k + 1) for k in left)]
        return ((item, self.bound(item)) for item in items)

    def bound(self, item: Item) -> float:
        side, first, last, _ = item
        if side == 0:
            low, high = min(0.0, self.end), max(0.0, self.end)
            level = max(item.level, -self.lows(low, high))
            length = self.lengths.way(level, low, high)
        else:
            power = self.task.power.on(self.lengths.box(first, last))
            near = first if side > 0 else last
            if self.tops(min(0.0, self.end, near), max(0.0, self.end, near)) < below(power):
                # U would be less on the way than where it turns.
                return np.inf
            level = max(item.level, -below(power))
            length = self.lengths.way(level, 0.0, near) + self.lengths.way(level, self.end, near)
        return self.action(length, level) + self.cost - ROUNDING * (length + abs(self.cost))


def lower_bound(ways: Ways, proof: WaysProof) -> float:
    """A proven lower bound from items that need not be trusted.

    Args:
        ways: the problem.
        proof: the items.

    Returns:
        [J] Of the work plus the kinetic energy at the start.

    Raises:
        Refused: ends far away are not excluded.
    """
    if not all(item.level < math.inf for item in proof.items):
        raise Refused("a level is not finite")
    parts: dict[tuple[int, int], list[Item]] = {}
    for item in proof.items:
        parts.setdefault((item.side, math.floor(item.first)), []).append(item)
    bounds = [ways.beyond()]
    for root, floor in ways.roots():
        items = sorted(parts.get((root.side, math.floor(root.first)), ()), key=lambda item: item.first)
        places = [root.first, *(item.last for item in items)]
        tiled = places[-1] == root.last and all(p == item.first for p, item in zip(places, items, strict=False))
        bounds += map(ways.bound, items) if items and tiled else [floor]
    if any(math.isnan(bound) for bound in bounds):
        raise Refused("the enclosure of a bound is not finite")
    return float(min(bounds))
