"""Floors of the work from Z u^2 + U >= 2 sqrt(Z (U + h)) |u| - h, which holds for every h >= -min U.

A motion whose psi~ goes over a stretch of the circle pays at least the integral of the root over the stretch, less h T.
So everything far from a candidate is shown to cost more than it: roughly, but rigorously, cell by cell.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from flint import acb, arb

from occ.certify.balls import Ball, EnclosedTask, Refused, integral

CELLS = 240
"""Cells of a turn."""
ROUNDING = 2.0**-44
"""Relative margin for a handful of operations in floating point: many times their rounding."""


@dataclass(frozen=True)
class Floors:
    """Lower bounds of lengths, cell by cell, for several h; floats that are lower ends of balls.

    Args:
        task: enclosed.
        levels: [W] h, each at least -min U for certain.
        cells: for each h the least length of each cell of [psi~(0), psi~(0) + 2 pi).
        roots: for each h the least 2 sqrt(Z (U + h)) on each cell [J/rad].
        edges: for each cell the value of 2 G + T_min at its lower edge [J].
        forces: for each cell the least and the largest slope of the cost of the end [J/rad].
    """

    task: EnclosedTask
    levels: tuple[float, ...]
    cells: tuple[tuple[float, ...], ...]
    roots: tuple[tuple[float, ...], ...]
    edges: tuple[float, ...]
    forces: tuple[tuple[float, float], ...]

    @classmethod
    def create(cls, task: EnclosedTask, above: Sequence[float]) -> Floors:
        """For the levels h = -min U + above [W].

        Args:
            task: enclosed.
            above: not negative.
        """
        width = 2 * arb.pi() / CELLS
        edges = [task.start + k * width for k in range(CELLS + 1)]
        boxes = [a.union(b) for a, b in pairwise(edges)]
        powers = [task.power.on(box).lower() for box in boxes]
        lowest = _lowest(task, boxes, powers)
        levels, cells, roots = [], [], []
        for rise in above:
            h = float((rise - lowest + abs(lowest) * arb(2) ** -40).upper())
            levels.append(h)
            cells.append(
                tuple(_length(task, h, power, ends, width) for power, ends in zip(powers, pairwise(edges), strict=True))
            )
            roots.append(tuple(_low(2 * (task.friction * arb.max(power + h, arb(0))).sqrt()) for power in powers))
        slopes = [2 * task.friction * task.rate + task.of_end.derivative().on(box) for box in boxes]
        return cls(
            task,
            tuple(levels),
            tuple(cells),
            tuple(roots),
            tuple(_low(task.of_end(edge)) for edge in edges[:-1]),
            tuple((_low(slope), -_low(-slope)) for slope in slopes),
        )

    @cached_property
    def _sums(self) -> tuple[np.ndarray, ...]:
        return tuple(np.concatenate([[0.0], np.cumsum(cells)]) for cells in self.cells)

    def way(self, level: int, first: int, last: int) -> float:
        """The least length from the edge of cell `first` to the edge of cell `last`, whole numbers on the real line."""
        sums = self._sums[level]
        low, high = (divmod(edge, CELLS) for edge in (min(first, last), max(first, last)))
        total = (high[0] - low[0]) * sums[-1] + sums[high[1]] - sums[low[1]]
        # A few hundred additions: this covers their rounding many times.
        margin = 2.0**-40 * (1 + abs(high[0]) + abs(low[0])) * sums[-1]
        return max(float(total - margin), 0.0)

    def work(self, via: int, hole: tuple[int, int] | None = None) -> float:
        """A floor of work plus kinetic energy at the start, over all motions that reach `via`, wherever they end.

        Args:
            via: edge of a cell that the motion reaches on its way; 0 for all motions.
            hole: edges between which ends are left out.

        Returns:
            [J]

        Raises:
            Refused: full turns may pay at every level, so that ends further away are not excluded.
        """
        steep = self._steep()
        reach = CELLS * (2 + max(abs(edge) // CELLS for edge in (via, *(hole or ()))))
        floor = float("inf")
        for first, last, levels in (
            (-reach, reach, range(len(self.levels))),
            # Beyond, a further turn costs more than it gives: the first turn beyond stands for all of them.
            (-reach - CELLS, -reach, steep),
            (reach, reach + CELLS, steep),
        ):
            for cell in range(first, last):
                if hole and hole[0] <= cell < hole[1]:
                    continue
                floor = min(floor, self._of_end(via, cell, levels))
        return floor

    def _of_end(self, via: int, cell: int, levels: Iterable[int]) -> float:
        """From the nearer edge of the cell the cost changes with its slope at least."""
        place, rightwards = cell % CELLS, cell >= via
        near = cell if rightwards else cell + 1
        slope = self.forces[place][0] if rightwards else -self.forces[place][1]
        best = -float("inf")
        for i in levels:
            rest = self._duration * self.levels[i]
            length = self.way(i, 0, via) + self.way(i, via, near)
            inside = min(0.0, slope + self.roots[i][place]) * self._width
            best = max(best, length - rest + inside - ROUNDING * (length + abs(rest) - inside))
        force, edge = self._force * near, self.edges[near % CELLS]
        return best + force + edge - self._offset - ROUNDING * (abs(force) + abs(edge) + abs(self._offset))

    def _steep(self) -> list[int]:
        force = 4 * arb.pi() * self.task.friction * abs(self.task.rate)
        found = [i for i in range(len(self.levels)) if arb(self.way(i, 0, CELLS)) > force]
        if not found:
            raise Refused("ends further away are not excluded: full turns may pay")
        return found[:1]

    @cached_property
    def _width(self) -> float:
        return float((2 * arb.pi() / CELLS).upper())

    @cached_property
    def _force(self) -> float:
        return float(2 * self.task.friction * self.task.rate * 2 * arb.pi() / CELLS)

    @cached_property
    def _offset(self) -> float:
        return float(self.task.swing(self.task.start))

    @cached_property
    def _duration(self) -> float:
        return float(self.task.duration)


def _lowest(task: EnclosedTask, boxes: list[Ball], powers: list[Ball]) -> Ball:
    """A lower bound of min U: the cells that may hold it are looked at again in parts."""
    middle = min((task.power(arb(box.mid())).upper() for box in boxes), key=float)
    lowest = middle
    for box, power in zip(boxes, powers, strict=True):
        if power < middle:
            low, step = box.lower(), (box.upper() - box.lower()) / 64
            parts = [(low + k * step).union(low + (k + 1) * step) for k in range(64)]
            lowest = min([lowest, *(task.power.on(part).lower() for part in parts)], key=float)
    return lowest


def _length(task: EnclosedTask, h: float, power: Ball, ends: tuple[Ball, Ball], width: Ball) -> float:
    """The least length of one cell: its integral, or where U + h may vanish the least value."""
    if not power + h > 0:
        return 0.0

    def root(z: acb, analytic: bool) -> acb:
        return (task.friction * (task.power(z) + h)).sqrt(analytic=analytic)

    exact = 2 * integral(root, *ends, digits=7)
    return _low(exact if exact.is_finite() else 2 * width * (task.friction * (power + h)).sqrt())


def _low(ball: Ball) -> float:
    """A float that is certainly not above the ball."""
    lower = float(ball.lower())
    return lower - abs(lower) * 2.0**-50 - 1e-300
