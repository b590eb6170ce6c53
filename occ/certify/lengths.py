"""Lower bounds of the length of ways, the integral of 2 sqrt(Z (U + h)) |dpsi~| where U + h is positive.

Every proof about the work on a circle needs such lengths for many h between the same places.  So U is enclosed once, in
balls, at the nodes of Gauss's rule on each cell of a grid; for each h what is left is a sum of roots.  The rule's error
follows from a bound of U in an ellipse of the complex plane about the cell,

    |error| <= (64 / 15) M rho^(-2n) / (1 - rho^-2)        (n + 1 nodes on [-1, 1], |f| <= M in the ellipse of rho).

Cells in which U + h may vanish are halved, and what is left at the deepest level counts nothing.  The sums are made of
positive floats: each operation is rounded correctly, and one margin covers them all.

Source: Trefethen, Approximation Theory and Approximation Practice, theorem 19.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from flint import arb

from occ.certify.balls import Ball, EnclosedTask, Refused, square

NODES = 8
ELLIPSES = (3.0, 8.0, 24.0)
"""rho."""
DEEPEST = 18
"""Halvings of a cell."""
UNITS = 2**DEEPEST
"""Places between the edges of a cell that a proof may name."""
SHRINK = 1 - 2.0**-44
"""Covers the rounding of the few hundred operations of a sum of positive numbers many times."""
Place = float
"""Whole and dyadic parts of cells, counted from the start on the real line."""


def below(ball: Ball) -> float:
    """A float that is certainly not above the ball.

    Raises:
        Refused: the ball is not finite.
    """
    if not ball.is_finite():
        raise Refused("the enclosure of a bound is not finite")
    lower = float(ball.lower())
    return lower - abs(lower) * 2.0**-50 - 1e-300


def above(ball: Ball) -> float:
    """A float that is certainly not below the ball."""
    return -below(-ball)


class _Rule(NamedTuple):
    """Gauss's rule on [-1, 1]: nodes as balls, weights rounded down; reach and error of each ellipse."""

    nodes: tuple[Ball, ...]
    weights: np.ndarray
    reach: tuple[Ball, ...]
    error: np.ndarray


@lru_cache(maxsize=1)
def _rule() -> _Rule:
    pairs = [arb.legendre_p_root(NODES, k, weight=True) for k in range(NODES)]
    rho = [arb(r) for r in ELLIPSES]
    error = [arb(64) / 15 * r ** (-2 * (NODES - 1)) / (1 - r**-2) for r in rho]
    return _Rule(
        tuple(node for node, _ in pairs),
        np.array([below(weight) for _, weight in pairs]),
        tuple((r + 1 / r) / 2 for r in rho),
        np.array([above(e) for e in error]),
    )


@dataclass(frozen=True)
class _Cells:
    """What is known of U on a row of cells; all floats are lower ends of balls, or upper ends where it says so."""

    half: np.ndarray  # (N,) half the width
    values: np.ndarray  # (N, NODES) U at the nodes
    least: np.ndarray  # (N, ELLIPSES) of the real part of U in the ellipse
    largest: np.ndarray  # (N, ELLIPSES) upper end of |U + h| - h in the ellipse

    @classmethod
    def create(cls, task: EnclosedTask, cells: list[tuple[Ball, Ball]]) -> _Cells:
        rule, slope = _rule(), task.power.derivative()
        columns: tuple[list[Any], ...] = ([], [], [], [])
        for low, high in cells:
            middle, half = (low + high) / 2, (high - low) / 2
            level, rise = task.power(middle), abs(slope(middle))
            # U along a ray from the middle, by Taylor: cos and sin grow like cosh off the real axis.
            swings = [half * r * (rise + half * r * _bend(task, half * r) / 2) for r in rule.reach]
            row = (
                below(half),
                [below(task.power(middle + half * node)) for node in rule.nodes],
                [below(level - swing) for swing in swings],
                [above(level + swing) for swing in swings],
            )
            for column, item in zip(columns, row, strict=True):
                column.append(item)
        return cls(*(np.array(column) for column in columns))

    def lengths(self, method: Roots, h: float) -> np.ndarray:
        """(N,) [J] Lower bounds; -1 where the rule does not apply because U + h may vanish near the cell."""
        rule = _rule()
        root = np.sqrt(method.least * np.maximum(self.values + h, 0.0)) @ rule.weights
        applies = self.least + h > 0
        size = np.sqrt(method.largest * np.maximum(self.largest + h, 0.0))
        error = np.where(applies, rule.error * size, np.inf).min(axis=1) / SHRINK
        found = 2 * self.half * (root * SHRINK - error) * SHRINK
        return np.where(np.isfinite(error), np.maximum(found, 0.0), -1.0)


def _bend(task: EnclosedTask, reach: Ball) -> Ball:
    """An upper bound of |U''| within `reach` of the real axis."""
    p = task.power
    first, second = abs(p.c_1) + abs(p.s_1), abs(p.c_2) + abs(p.s_2)
    return first * reach.cosh() + 4 * second * (2 * reach).cosh()


class _Node:
    """A cell that is halved where it needs to be."""

    def __init__(self, task: EnclosedTask, low: Ball, high: Ball, depth: int) -> None:
        self.task, self.low, self.high, self.depth = task, low, high, depth

    @cached_property
    def _row(self) -> tuple[float, list[float], list[tuple[float, float, float]]]:
        """Half the width, U at the nodes, and of each ellipse the least and the largest U and the error."""
        cells, rule = _Cells.create(self.task, [(self.low, self.high)]), _rule()
        ellipses = zip(cells.least[0].tolist(), cells.largest[0].tolist(), rule.error.tolist(), strict=True)
        return float(cells.half[0]), cells.values[0].tolist(), list(ellipses)

    @cached_property
    def _highest(self) -> tuple[float, float]:
        """U and the width, from above."""
        return above(self.task.power.on(self.low.union(self.high))), above(self.high - self.low)

    @cached_property
    def halves(self) -> tuple[_Node, _Node]:
        middle = (self.low + self.high) / 2
        return (
            _Node(self.task, self.low, middle, self.depth + 1),
            _Node(self.task, middle, self.high, self.depth + 1),
        )

    def length(self, method: Roots, h: float, first: float = 0.0, last: float = 1.0) -> float:
        """Of the part between two dyadic shares of the cell."""
        if first >= last or self.depth >= DEEPEST:
            return 0.0
        if self.depth:
            highest, width = self._highest
            if highest + h <= 0 or 4 * method.largest * (highest + h) * width * width < method.grain * method.grain:
                return 0.0
        if first == 0.0 and last == 1.0:
            found = self._whole(method, h)
            if found >= 0:
                return found
        left, right = self.halves
        lower = left.length(method, h, min(2 * first, 1.0), min(2 * last, 1.0))
        return lower + right.length(method, h, max(2 * first - 1, 0.0), max(2 * last - 1, 0.0))

    def _whole(self, method: Roots, h: float) -> float:
        """The same as `_Cells.lengths` for one cell."""
        half, values, ellipses = self._row
        errors = [
            error * math.sqrt(method.largest * (largest + h)) for least, largest, error in ellipses if least + h > 0
        ]
        if not errors:
            return -1.0
        root = sum(w * math.sqrt(method.least * (u + h)) for w, u in zip(method.weights, values, strict=True))
        return max(2 * half * (root * SHRINK - min(errors) / SHRINK) * SHRINK, 0.0)


class Roots(NamedTuple):
    """How roots are summed.

    Args:
        least: [N m s] Z from below.
        largest: [N m s] Z from above.
        grain: [J] lengths that need not be found.
        weights: of Gauss's rule.
    """

    least: float
    largest: float
    grain: float
    weights: list[float]


class Lengths:
    """Lower bounds of lengths on one circle, which is cut into cells at the start and, if it is given, at the end.

    Args:
        task: enclosed.
        count: cells of a turn, about.
        end: [rad] another place that is an edge, on the real line.
        grain: [J] lengths that need not be found.
    """

    def __init__(self, task: EnclosedTask, count: int, end: Ball | None = None, grain: float = 0.0) -> None:
        self.task = task
        turn = 2 * arb.pi()
        self.turns = 0 if end is None else math.floor(float((end - task.start) / turn))
        ahead = arb(0) if end is None else end - task.start - turn * self.turns
        between = 0 if end is None else max(1, round(count * float(ahead) / math.tau))
        beyond = max(count - between, 1)
        self.edges = [task.start + ahead * k / between for k in range(between)]
        self.edges += [task.start + ahead + (turn - ahead) * k / beyond for k in range(beyond + 1)]
        self.count = between + beyond
        self.end: Place = float(self.turns * self.count + between)
        if not all(a < b for a, b in pairwise(self.edges)):
            raise Refused("the end is too close to the start, or a full turn from it, to tell them apart")
        self.boxes = [a.union(b) for a, b in pairwise(self.edges)]
        self._roots = Roots(max(below(task.friction), 0.0), above(task.friction), grain, _rule().weights.tolist())
        self._cells = _Cells.create(task, list(pairwise(self.edges)))
        self._nodes: dict[int, _Node] = {}
        self._sums: dict[float, np.ndarray] = {}
        self._between: dict[tuple[Place, Place], float] = {}

    def place(self, p: Place) -> Ball:
        """[rad] psi~ at a place."""
        turns, k, share = self._split(p)
        low, high = self.edges[k], self.edges[k + 1]
        return low + (high - low) * arb(share) + 2 * arb.pi() * turns

    def box(self, first: Place, last: Place) -> Ball:
        """All psi~ between two places."""
        return self.place(first).union(self.place(last))

    def _split(self, p: Place) -> tuple[int, int, float]:
        whole = math.floor(p)
        turns, k = divmod(whole, self.count)
        return turns, k, p - whole

    def sums(self, h: float) -> np.ndarray:
        """(count + 1,) [J] Lengths from the start to the edges of the cells of one turn."""
        if h not in self._sums:
            cells = self._cells.lengths(self._roots, h)
            for k in np.flatnonzero(cells < 0):
                cells[k] = self._node(int(k)).length(self._roots, h) * SHRINK
            self._sums[h] = np.concatenate([[0.0], np.cumsum(cells)])
        return self._sums[h]

    def _node(self, k: int) -> _Node:
        if k not in self._nodes:
            self._nodes[k] = _Node(self.task, self.edges[k], self.edges[k + 1], 0)
        return self._nodes[k]

    def way(self, h: float, first: Place, last: Place) -> float:
        """[J] The least length between two places, in any order."""
        (turns, k, share), (more, i, rest) = self._split(min(first, last)), self._split(max(first, last))
        if (turns, k) == (more, i):
            return self._node(k).length(self._roots, h, share, rest) * SHRINK
        sums = self.sums(h)
        total = 0.0
        if share:
            total += self._node(k).length(self._roots, h, share, 1.0)
            k += 1
        if rest:
            total += self._node(i).length(self._roots, h, 0.0, rest)
        # A difference of sums is a sum of positive numbers but for the rounding of both.
        whole = (more - turns) * sums[-1] + sums[i] - sums[k] - 2.0**-44 * (1 + abs(more - turns)) * sums[-1]
        return max((total + float(whole)) * SHRINK, 0.0)

    def clear(self, first: Place, side: int, h: float) -> Place | None:
        """How far from a place, to the right (+1) or to the left (-1), U + h is certainly positive.

        Returns:
            A place; None where it is positive all around.
        """
        k = math.floor(first) if side > 0 else math.ceil(first) - 1
        positive = self.lows[(k + side * np.arange(self.count + 1)) % self.count] + h > 0
        if positive.all():
            return None
        k += side * int(np.argmin(positive))
        near = float(max(first, k) if side > 0 else min(first, k + 1))
        step = 0.5
        while step * UNITS > 1:
            far = near + side * step
            if k <= far <= k + 1 and self.task.power.on(self.box(min(near, far), max(near, far))) + h > 0:
                near = far
            else:
                step /= 2
        return near

    @cached_property
    def lows(self) -> np.ndarray:
        """(count,) [W] Lower bounds of U on the cells, tight where U has its minima."""
        return np.array(
            [below(self._low(box, *ends)) for box, ends in zip(self.boxes, pairwise(self.edges), strict=True)]
        )

    @cached_property
    def lowest(self) -> float:
        """[W] A lower bound of U."""
        return float(self.lows.min())

    def least_between(self, first: Place, last: Place) -> float:
        """[W] A lower bound of U between two places, the one to the left first; either may be infinite."""
        if last - first >= self.count:
            return self.lowest
        if (first, last) not in self._between:
            inner, outer = math.ceil(first), math.floor(last)
            pairs = [(first, last)] if inner > outer else [(first, inner), (outer, last)]
            parts = (pair for pair in pairs if pair[0] < pair[1] or first == last)
            least = [below(self._low(self.box(*pair), *map(self.place, pair))) for pair in parts]
            self._between[first, last] = min([*least, *self.lows[np.arange(inner, outer) % self.count].tolist()])
        return self._between[first, last]

    def _low(self, box: Ball, low: Ball, high: Ball) -> Ball:
        """Of U on a cell: at an edge if U is monotone or concave there, by a parabola if it is convex."""
        power = self.task.power
        slope = power.derivative()
        bend = slope.derivative()
        edges = arb.min(power(low), power(high)).lower()
        if not slope.on(box).contains(0) or bend.on(box) < 0:
            return edges
        if bend.on(box) > 0:
            middle = box.mid()
            for _ in range(5):
                middle = arb((middle - slope(middle) / bend(middle)).mid())
            if box.contains(middle):
                return (power(middle) - square(slope(middle)) / (2 * bend.on(box))).lower()
        step = (high - low) / 64
        parts = [power.on((low + k * step).union(low + (k + 1) * step)).lower() for k in range(64)]
        return min([edges, *parts], key=float)
