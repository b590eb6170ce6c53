"""Floors of the work from Z u^2 + U >= 2 sqrt(Z (U + h)) |u| - h, which holds for every h >= -min U.

A motion whose psi~ goes over a stretch of the circle pays at least the integral of the root over the stretch, less h T.
So everything far from a candidate is shown to cost more than it: roughly, but rigorously, cell by cell.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from flint import arb

from occ.certify.balls import EnclosedTask, Refused
from occ.certify.lengths import Lengths, above, below

CELLS = 240
"""Cells of a turn."""
LEVELS = (0.0, *np.logspace(-3.5, 1.5, 21))
"""Levels h + min U, relative to the swing of U."""
ROUNDING = 2.0**-44
"""Relative margin for a handful of operations in floating point: many times their rounding."""


class Floors:
    """Lower bounds of the work over all motions that end in a cell of the circle, the end being free.

    Args:
        task: enclosed.
        grain: [J] lengths that need not be found.
    """

    def __init__(self, task: EnclosedTask, grain: float = 0.0) -> None:
        self.task, self.lengths = task, Lengths(task, CELLS, grain=grain)
        swing = float(sum(abs(c) for c in task.power.coefficients[1:]))
        # Without friction on the way U may be constant, so that its size sets the scale.
        scale = swing + 1e-3 * float(abs(task.power.c_0))
        self.levels = np.array([rise * scale - self.lengths.lowest for rise in LEVELS])
        self._sums = np.array([self.lengths.sums(float(h)) for h in self.levels])
        roots = 4 * below(task.friction) * np.maximum(self.lengths.lows + self.levels[:, None], 0.0)
        self._roots = np.sqrt(roots) * (1 - ROUNDING)
        slopes = [2 * task.friction * task.rate + task.of_end.derivative().on(box) for box in self.lengths.boxes]
        self._least, self._largest = np.array([below(s) for s in slopes]), np.array([above(s) for s in slopes])
        self._edges = np.array([below(task.of_end(edge)) for edge in self.lengths.edges[:-1]])

    def of_cells(self, cells: np.ndarray, via: int = 0, steep: bool = False) -> np.ndarray:
        """Floors of work plus kinetic energy at the start for motions that end in given cells.

        Args:
            cells: (K,) whole numbers on the real line, counted from the start.
            via: edge of a cell that the motion reaches on its way; 0 for all motions.
            steep: use only levels at which further turns cost more than they give.

        Returns:
            (K,) [J]
        """
        rows = self._steep() if steep else np.arange(len(self.levels))
        rightwards = cells >= via
        near, place = np.where(rightwards, cells, cells + 1), cells % CELLS
        lengths = self._way(rows, np.array([0]), np.array([via])) + self._way(rows, np.full_like(near, via), near)
        rest = (self._duration * self.levels[rows])[:, None]
        # From the nearer edge of the cell the cost changes with its slope at least.
        slope = np.where(rightwards, self._least[place], -self._largest[place])
        inside = np.minimum(0.0, slope + self._roots[rows][:, place]) * self._width
        each = lengths - rest + inside - ROUNDING * (lengths + np.abs(rest) - inside)
        force, edge = self._force * near, self._edges[near % CELLS]
        margin = ROUNDING * (np.abs(force) + np.abs(edge) + abs(self._offset))
        return np.asarray(each.max(axis=0) + force + edge - self._offset - margin)

    def _way(self, rows: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """(rows, K) [J] Lower bounds of the length between edges of cells."""
        low, high = np.minimum(first, last), np.maximum(first, last)
        sums = self._sums[rows]
        whole = sums[:, -1:] * (high // CELLS - low // CELLS) + sums[:, high % CELLS] - sums[:, low % CELLS]
        margin = 2.0**-40 * sums[:, -1:] * (1 + np.abs(high // CELLS) + np.abs(low // CELLS))
        return np.asarray(np.where(low == high, 0.0, np.maximum(whole - margin, 0.0)))

    def work(self, via: int) -> float:
        """A floor of work plus kinetic energy at the start, over all motions that reach `via`, wherever they end.

        Args:
            via: edge of a cell; 0 for all motions.

        Returns:
            [J]

        Raises:
            Refused: full turns may pay at every level, so that ends further away are not excluded.
        """
        reach = CELLS * (2 + abs(via) // CELLS)
        inner = self.of_cells(np.arange(-reach, reach), via)
        return min(float(inner.min()), self.beyond(reach, via))

    def beyond(self, reach: int, via: int = 0) -> float:
        """The same over ends in cells that are at least `reach` away from the start.

        Raises:
            Refused: they are not excluded.
        """
        # A further turn costs more than it gives: the first turn beyond stands for all of them.
        cells = np.arange(CELLS)
        return float(min(self.of_cells(cells + first, via, steep=True).min() for first in (-reach - CELLS, reach)))

    def of_turns(self, turns: int) -> float:
        """[J] A floor of the cost of motions that end so many full turns from their start, or more."""
        rows = self._steep()
        rest = self._duration * self.levels[rows]
        length, force = abs(turns) * self._sums[rows, -1], self._force * CELLS * turns
        return float(np.max(length - rest + force - ROUNDING * (length + np.abs(rest) + abs(force))))

    def _steep(self) -> np.ndarray:
        force = above(4 * arb.pi() * self.task.friction * abs(self.task.rate))
        found = np.flatnonzero(self._sums[:, -1] * (1 - ROUNDING) > force)
        if not found.size:
            raise Refused("ends further away are not excluded: full turns may pay")
        return found

    @cached_property
    def _width(self) -> float:
        return above(2 * arb.pi() / CELLS)

    @cached_property
    def _force(self) -> float:
        return float(2 * self.task.friction * self.task.rate * 2 * arb.pi() / CELLS)

    @cached_property
    def _offset(self) -> float:
        return float(self.task.swing(self.task.start))

    @cached_property
    def _duration(self) -> float:
        return float(self.task.duration)
