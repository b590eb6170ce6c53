"""Which families of motions to tell apart, and at which level: proofs in floating point for `occ.certify.checker`.

A family whose bound is too low is cut where that gains most: at its cell of ends, or at a place to one side of all that
its motions are known to pass.  There U may be so low that a motion could wait there for less than the level says; the
motions that go that far pay for the way, and for the others the level may rise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from occ.certify.angle import Family, OneAngle
from occ.certify.balls import Refused
from occ.certify.checker import at_level
from occ.certify.lengths import Place
from occ.certify.proofs import Axis, CurveProof, Level, Split, Tree
from occ.theory.quadrature import COARSE, Well
from occ.theory.trigonometric import TURN, value

FINEST = 2.0**-14
"""Cells are not divided below this part of a cell of the grid."""
HALVINGS = 26
RISES = (0.0, *(10.0 ** (k / 4) for k in range(-12, 9)))
"""Levels that are tried for ends far away, relative to the size of U and above the least one."""
MOST_TURNS = 1024


@dataclass
class _Node:
    """A family, the level that bounds it best, and how it is divided."""

    family: Family
    level: float = -np.inf
    cut: tuple[Axis, Place] | None = None
    parts: tuple[_Node, _Node] | None = None
    curve: CurveProof | None = None

    def divide(self, axis: Axis, place: Place) -> tuple[_Node, _Node]:
        below, above = self.family.split(axis, place)
        self.cut, self.parts = (axis, place), (_Node(below), _Node(above))
        return self.parts

    def tree(self) -> Tree:
        if self.cut and self.parts:
            return Split(*self.cut, self.parts[0].tree(), self.parts[1].tree())
        return self.curve or Level(self.level)


def search(
    problem: OneAngle,
    target: float,
    most: int,
    curve: tuple[CurveProof, tuple[Place, Place]] | None = None,
) -> Tree:
    """Divide families until all bounds reach the target, or so many have been looked at.

    Args:
        problem: to be bounded.
        target: [J] without what is paid in any case.
        most: families of motions, the same on every machine.
        curve: V for the motions that stay in a window, and its edges.

    Returns:
        To be checked by `occ.certify.checker.examine`.

    Raises:
        Refused: nothing is paid for ways, or not enough for ends that are far away, or for leaving the window.
    """
    root = _Node(Family())
    roots = [root]
    if curve:
        inside, beyond = root.divide("right", curve[1][1])
        outside, within = inside.divide("left", curve[1][0])
        within.curve = curve[0]
        roots = [beyond, outside]
    hints = _Hints(problem)
    active = [node for one in roots for node in _by_ends(problem, one, target, hints)]
    left = most
    while active and left > 0:
        following: list[_Node] = []
        for node, hint in zip(active, hints.of([node.family for node in active]), strict=True):
            if curve and hint.free < target:
                raise Refused("a motion that leaves the window is as good")
            node.level = hint.level
            left -= 1
            bound = at_level(problem, node.family, Level(node.level)) if left >= 0 else target
            if bound < target:
                cut = hints.cut(node.family, hint, bound)
                following += node.divide(*cut) if cut else ()
        active = [node for node in following if _is_possible(node.family)]
    return root.tree()


def _is_possible(family: Family) -> bool:
    return family.first <= family.right and family.last >= family.left


def _by_ends(problem: OneAngle, node: _Node, target: float, hints: _Hints) -> list[_Node]:
    """Leave ends far away to one level each; the families that are left."""
    turn = float(problem.lengths.count)
    if problem.end is not None and not problem.repeat:
        return [node]
    shift = 0.5 if problem.repeat else 0.0
    n = 1
    while n < MOST_TURNS:
        sides = Family(first=(n + shift) * turn), Family(last=-(n + shift) * turn)
        far = [hints.level_far(side) for side in sides]
        if min(bound for bound, _ in far) >= target:
            break
        n *= 2
    if not all(np.isfinite(level) for _, level in far):
        raise Refused("ends further away are not excluded: full turns may pay")
    cuts = [(k + shift) * turn for k in range(-n, n + 1)] + ([-(n + 1 - shift) * turn] if problem.repeat else [])
    found = _divided(node, sorted(set(cuts)))
    found[-1].level, found[0].level = far[0][1], far[1][1]
    return found[1:-1]


def _divided(node: _Node, cuts: list[Place]) -> list[_Node]:
    """Cut at many ends, from left to right."""
    if not cuts:
        return [node]
    k = len(cuts) // 2
    left, right = node.divide("end", cuts[k])
    return _divided(left, cuts[:k]) + _divided(right, cuts[k + 1 :])


class _Hint(NamedTuple):
    """What is known of a family in floating point."""

    level: float
    bound: float  # [J] for the middle of its ends
    free: float  # [J] the same if the motions did not go further than they must
    reach: tuple[Place, Place]  # how far they must go


class _Hints:
    """The level at which a way takes the time given, in floating point."""

    def __init__(self, problem: OneAngle) -> None:
        self.problem, task = problem, problem.task
        self.count = problem.lengths.count
        self.duration = float(task.duration)
        self.power = np.array([float(c) for c in task.power.coefficients])
        self.scale = float(np.abs(self.power).sum())
        if not (task.friction > 0 and self.scale > 0):
            raise Refused("without friction nothing is paid for a way")
        self.well = Well(float(task.friction), self.power)
        self.edges = np.array([float(edge) for edge in problem.lengths.edges])
        self.heights = value(self.power, self.edges[:-1])
        self.bottoms = np.interp(
            (self.well.minima - self.edges[0]) % TURN, self.edges - self.edges[0], range(self.count + 1)
        )
        self.of_end = np.array([float(c) for c in task.of_end.coefficients])
        self.start, self.swing = float(task.start), float(task.swing(task.start))
        self.force = 2 * float(task.friction * task.rate)

    def level_far(self, family: Family) -> tuple[float, float]:
        """The best bound of ends far away, and its level."""
        best = -np.inf, np.inf
        for rise in RISES:
            level = rise * self.scale - self.problem.lengths.lowest
            try:
                best = max(best, (at_level(self.problem, family, Level(level)), level))
            except Refused:
                continue
        return best

    def of(self, families: list[Family]) -> list[_Hint]:
        """Of many families at once."""
        rows = []
        for family in families:
            first, last = max(family.first, family.left), min(family.last, family.right)
            end = (first + last) / 2 if self.problem.end is None else self._end(first)
            left, right = family.near_left, family.near_right
            reach = min(left, end), max(right, end)
            outer = self.low(family.left, family.right)[0], self.low(*reach)[0]
            rows.append((left, right, end, *outer, *reach))
        left, right, end, lowest, low, *reaches = np.array(rows).T
        # The shorter way over both places, by angle.
        swap = right + abs(end - left) < abs(end - right) - left
        first, then = np.where(swap, right, left), np.where(swap, left, right)
        legs = [self.angle(np.tile(x, 2)) for x in (np.zeros_like(end), first, then, end)]
        levels, actions = self._in_time(legs, -np.concatenate([lowest, low]))
        cost = np.zeros_like(end)
        if self.problem.end is None:
            x = self.angle(end)
            cost = self.force * (x - self.start) + value(self.of_end, x) - self.swing
        n = len(families)
        return [
            _Hint(float(levels[k]), float(actions[k] + cost[k]), float(actions[n + k] + cost[k]), reach)
            for k, reach in enumerate(zip(*reaches, strict=True))
        ]

    def _end(self, first: Place) -> Place:
        repeat = self.problem.repeat
        assert self.problem.end is not None
        return float(repeat * math.ceil(first / repeat)) if repeat else self.problem.end

    def cut(self, family: Family, hint: _Hint, bound: float) -> tuple[Axis, Place] | None:
        """Where to divide a family whose bound is too low."""
        free = self.problem.end is None
        if not self.problem.free_start and (hint.free - hint.bound > hint.bound - bound or not free):
            (low_left, left), (low_right, right) = (
                self.low(family.left, hint.reach[0]),
                self.low(hint.reach[1], family.right),
            )
            near, far = (hint.reach[0], left) if low_left < low_right else (hint.reach[1], right)
            place = round((near + far) / 2 / FINEST) * FINEST
            inner = (family.left, family.near_left) if low_left < low_right else (family.near_right, family.right)
            if abs(place - near) > FINEST and inner[0] < place < inner[1]:
                return ("left" if low_left < low_right else "right"), place
        if free and family.last - family.first > FINEST:
            return "end", (family.first + family.last) / 2
        return None

    def low(self, first: Place, last: Place) -> tuple[float, Place]:
        """The least of U between two places, and where that is, near to a finite one of them."""
        if last - first >= self.count:
            first = first if math.isfinite(first) else last - self.count if math.isfinite(last) else 0.0
            last = first + self.count
        inner = np.arange(math.ceil(first), math.floor(last) + 1)
        bottoms = self.bottoms + self.count * np.ceil((first - self.bottoms) / self.count)
        keep = bottoms <= last
        places = np.concatenate([[first, last], inner, bottoms[keep]])
        ends = value(self.power, self.angle(places[:2]))
        heights = np.concatenate([ends, self.heights[inner % self.count], self.well.bottoms[keep]])
        k = int(np.argmin(heights))
        return float(heights[k]), float(places[k])

    def angle(self, place: np.ndarray) -> np.ndarray:
        """[rad] psi~ at places."""
        turns, rest = np.divmod(place, self.count)
        return np.interp(rest, np.arange(len(self.edges)), self.edges) + TURN * turns

    def _in_time(self, legs: list[np.ndarray], least: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The level at which the legs take the time given, or the least one where that is fast enough; its action."""
        low, high = np.full(len(least), np.log(1e-14 * self.scale)), np.full(len(least), np.log(1e8 * self.scale))
        edges = np.stack([np.stack(pair) for pair in pairwise(legs)])
        leg, family = np.nonzero(edges[:, 0] != edges[:, 1])
        ends = edges[leg, 0, family], edges[leg, 1, family]
        heights = [value(self.power, x) for x in ends]

        def ways(rise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            if not family.size:
                return np.zeros_like(rise), np.zeros_like(rise)
            h = rise[family]
            levels = np.maximum(heights[0] + h, 0.0), np.maximum(heights[1] + h, 0.0)
            found = self.well.integrals(ends, h, levels, COARSE)
            seconds, lengths = (np.bincount(family, part, len(rise)) for part in found)
            return seconds, lengths

        never = ways(least + np.exp(low))[0] <= self.duration
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            later = ways(least + np.exp(middle))[0] > self.duration
            low, high = np.where(later, middle, low), np.where(later, high, middle)
        h = np.where(never, least, least + np.exp((low + high) / 2))
        return h, ways(h)[1] - h * self.duration
