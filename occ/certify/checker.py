"""The checker: whether data prove a lower bound.  Nothing else in this package may call a bound certified.

Each function below that examines a part of a proof raises `Refused` where a step of it fails.

What is checked is always the same.  If a function V satisfies along every motion of a family

    L + dV/dt >= 0    (Bellman's inequality, L the cost per second),

then the cost is at least V(start) - V(end).  A proof divides all motions into families and has a V for each; the bound
is the least of theirs.  Every number below is a ball that holds the true value, or a float that is certainly on the
safe side of it; the data are taken as the exact numbers that their floats are.  Three kinds of V:

*Level.*  V = h t -+ integral of 2 sqrt(Z (U + h)), where U + h >= 0 on all places that the family may reach: then
Z u^2 + U + h >= 2 sqrt(Z (U + h)) |u|.  A motion that goes at least as far as l <= 0 to the left and r >= 0 to the
right and ends at y passes 0, l, r, y or 0, r, l, y in this order, so that it costs at least the length of the shorter
of both ways, less h T, and its end cost.  Along a cell of ends that sum changes with a slope that is enclosed.  Where a
turn pays no less than it may gain, ends that are further away by full turns cost no less.

*Curve.*  For motions that stay in a window, V = a + b e + c e^2 / 2 with e = psi~ - psi~*(t), a' = -(Z psi~*'^2 + U),
b = -2 Z psi~*'.  Completing the squares in e' and e gives, wherever sigma = c' - c^2 / (2 Z) + m is positive,

    Z u^2 + U(psi~) + dV/dt >= eps e + sigma e^2 / 2 >= -eps^2 / (2 sigma),    eps = U'(psi~*) - 2 Z psi~*'',

where m <= 2 [U(psi~* + e) - U(psi~*) - U'(psi~*) e] / e^2 in the window.  At the end phi takes the place of U:
sigma_T = m_T - c(T) > 0 and tau = phi' + 2 Z psi~*'.  The cost is at least J[psi~*] + phi - integral of
eps^2 / (2 sigma) - tau^2 / (2 sigma_T).

*Squares.*  V is a polynomial, and the left side of the inequality is projected exactly on sums of squares: what a Gram
matrix leaves of it is moved into the matrix term by term, in balls, and Cholesky's method on balls shows that every
matrix inside is positive definite.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

from flint import arb

from occ.certify.angle import Family, OneAngle
from occ.certify.balls import Ball, EnclosedTask, Polynomial, Refused, integral, positive_definite, square
from occ.certify.bellman import Inequality
from occ.certify.lengths import Place, above, below
from occ.certify.proofs import CurveProof, Gram, Level, Proof, Split, SquaresProof, Tree, TurnsProof
from occ.certify.series import Key, Number, Series, entries

BOXES = 24
"""Boxes over the curve, and a quarter of those over the window, on which the curvature m is enclosed."""


def examine(problem: Inequality | OneAngle, proof: Proof) -> float:
    """The lower bound that a proof proves.

    Args:
        problem: what is to be bounded, in balls.
        proof: data, none of which is trusted.

    Returns:
        A float that is certainly not above the cost of any motion of the class.

    Raises:
        Refused: a step of the proof fails.
    """
    if isinstance(proof, SquaresProof) and isinstance(problem, Inequality):
        bound = by_squares(problem, proof)
    elif isinstance(proof, TurnsProof) and isinstance(problem, Inequality) and not problem.side:
        if not isinstance(proof.turns, int):
            raise Refused(f"{proof.turns!r} is no number of turns")
        sides = replace(problem, side=-1, turns=proof.turns), replace(problem, side=1, turns=proof.turns + 1)
        return min(examine(sides[0], proof.upto), examine(sides[1], proof.above))
    elif isinstance(proof, Tree) and isinstance(problem, OneAngle):
        bound = arb(of_family(problem, Family(), proof)) + problem.paid
    else:
        raise Refused("such a proof says nothing about this problem")
    return below(bound)


# Families of motions in one angle.


def of_family(problem: OneAngle, family: Family, proof: Tree) -> float:
    """A lower bound over the motions of one family, without what is paid in any case."""
    if isinstance(proof, Split):
        if problem.free_start and proof.axis != "end":
            raise Refused("a place where motions begin is needed to say how far they go")
        parts = family.split(proof.axis, proof.place)
        return min(of_family(problem, part, of) for part, of in zip(parts, (proof.below, proof.above), strict=True))
    if isinstance(proof, CurveProof):
        return below(along_curve(problem, family, proof))
    return at_level(problem, family, proof)


def at_level(problem: OneAngle, family: Family, proof: Level) -> float:
    """The bound by a potential at one level."""
    if not proof.level < math.inf:
        raise Refused(f"the level {proof.level!r} is not finite")
    if family.first > family.right or family.last < family.left:
        # Nothing ends where it does not go.
        return math.inf
    level = max(proof.level, -problem.lengths.least_between(family.left, family.right))
    first, last = max(family.first, family.left), min(family.last, family.right)
    far = (math.isinf(first) or math.isinf(last)) and (problem.end is None or problem.repeat > 0)
    if far or problem.for_ever:
        _turn_pays(problem, level)
    if problem.for_ever:
        return -level
    if problem.end is None:
        return below(_beyond(problem, first, last, level) if far else _over_cell(problem, family, (first, last), level))
    if far:
        # What the nearest end costs does not depend on how far motions go before.
        family = Family()
    return min((below(_at_end(problem, family, *at, level)) for at in _ends(problem, first, last)), default=math.inf)


def _turn_pays(problem: OneAngle, level: float) -> None:
    """A full turn costs no less at this level than its end may gain."""
    paid, gain = arb(problem.lengths.way(level, 0.0, float(problem.lengths.count))), abs(problem.turn_cost)
    if not paid >= gain:
        raise Refused(f"at {level!r} W a turn pays {paid.str(12)} J and may gain {gain.str(12)} J")


def _action(problem: OneAngle, level: float, way: Ball) -> Ball:
    return way - arb(level) * problem.task.duration


def _ways(problem: OneAngle, family: Family, level: float) -> list[tuple[Ball, Place]]:
    """Lengths from the start over both places that are reached, and which of them comes last."""
    left, right, way = family.near_left, family.near_right, problem.lengths.way
    between = arb(way(level, left, right))
    found = [(arb(way(level, 0.0, left)) + between, right), (arb(way(level, 0.0, right)) + between, left)]
    # Where the motion need not go to one side it goes to the other one at once.
    return found[:1] if left == 0 else found[1:] if right == 0 else found


def _ends(problem: OneAngle, first: Place, last: Place) -> list[tuple[Place, int]]:
    """The ends between two places with their turns; the one next to the start stands for all where they have no end."""
    assert problem.end is not None
    if not problem.repeat:
        return [(problem.end, 0)] if first <= problem.end <= last else []
    low, high = first / problem.repeat, last / problem.repeat
    if math.isinf(low) or math.isinf(high):
        low = high = max(low, min(0.0, high))
        low, high = (low, math.ceil(low)) if low >= 0 else (math.floor(high), high)
    return [(problem.end + problem.repeat * n, n) for n in range(math.ceil(low), math.floor(high) + 1)]


def _at_end(problem: OneAngle, family: Family, end: Place, turns: int, level: float) -> Ball:
    """With one end."""
    ways = [way + problem.lengths.way(level, last, end) for way, last in _ways(problem, family, level)]
    return _action(problem, level, min(ways, key=below)) + problem.turn_cost * turns


def _beyond(problem: OneAngle, first: Place, last: Place, level: float) -> Ball:
    """All ends beyond a place that is not the start."""
    task, near = problem.task, first if math.isinf(last) else last
    if math.isinf(near) or not (near > 0) == math.isinf(last):
        raise Refused("ends on both sides of the start are not bounded")
    # In the first turn phi is no less than this; each further one costs no less than it gains.
    force = 2 * task.friction * task.rate * (problem.lengths.place(near) - task.start) - abs(problem.turn_cost)
    periodic = task.of_end.c_0 - sum((abs(c) for c in task.of_end.coefficients[1:]), arb(0)) - task.swing(task.start)
    return _action(problem, level, arb(problem.lengths.way(level, 0.0, near))) + force + periodic


def _over_cell(problem: OneAngle, family: Family, cell: tuple[Place, Place], level: float) -> Ball:
    """All ends in a cell: from both edges the cost changes with its slope at least."""
    task, lengths = problem.task, problem.lengths
    box, edges = lengths.box(*cell), [lengths.place(p) for p in cell]
    force = 2 * task.friction * task.rate + task.of_end.derivative().on(box)
    power = task.power.on(box) + level
    roots = [2 * (task.friction * arb(max(0.0, x))).sqrt() for x in (below(power), above(power))]
    width, costs = edges[1] - edges[0], [task.end_cost(x) for x in edges]
    bounds = []
    for way, last in _ways(problem, family, level):
        a, b = (
            _action(problem, level, way + lengths.way(level, last, p)) + c for p, c in zip(cell, costs, strict=True)
        )
        # The length rises to the right of the place that comes last, and falls to the left of it.
        least = force + (roots[0] if last <= cell[0] else -roots[1])
        largest = force + (-roots[0] if last >= cell[1] else roots[1])
        bounds.append(_tent(a, b, width, arb(least.lower()), arb(largest.upper())))
    return min(bounds, key=below)


def _tent(a: Ball, b: Ball, width: Ball, least: Ball, largest: Ball) -> Ball:
    """The least of max(a + least s, b - largest (width - s))."""
    if least >= 0:
        return a
    if largest <= 0:
        return b
    return (largest * a - least * b + least * largest * width) / (largest - least)


# Along a curve.


def along_curve(problem: OneAngle, family: Family, proof: CurveProof) -> Ball:
    """The bound by a quadratic V about a curve."""
    task, times = problem.task, [arb(t) for t in proof.times]
    if problem.end is not None or problem.for_ever or math.isinf(family.left) or math.isinf(family.right):
        raise Refused("V about a curve says nothing about such an end, or outside of a window")
    if len({len(times), len(proof.acceleration), len(proof.curvature)}) != 1 or len(times) < 2:
        raise Refused("times, accelerations and curvatures should be as many")
    if not (times[0] == 0 and times[-1] == task.duration):
        raise Refused(f"the proof covers 0 to {proof.times[-1]!r} s, the horizon is {task.duration.str(12)} s")
    pieces, end, speed = follow(task.start, proof)
    edges = problem.lengths.place(family.left), problem.lengths.place(family.right)
    bends = Bends.create(task.power, pieces, edges)
    action, loss = arb(0), arb(0)
    for k, piece in enumerate(pieces):
        c = arb(proof.curvature[k]), arb(proof.curvature[k + 1])
        largest = max(abs(c[0]), abs(c[1]), key=above)
        sigma = (c[1] - c[0]) / piece.width - square(largest) / (2 * task.friction) + bends.least(piece.range())
        if not sigma > 0:
            raise Refused(f"the curvature is not positive between {proof.times[k]:.6g} and {proof.times[k + 1]:.6g} s")
        action += piece.integral(lambda s, p=piece: task.friction * square(p.speed(s)) + task.power(p.place(s)))
        loss += piece.integral(lambda s, p=piece: square(p.defect(task, s))) / (2 * sigma)
    tau = 2 * task.friction * (task.rate + speed) + task.of_end.derivative()(end)
    sigma = least_bend(task.of_end, end, edges) - arb(proof.curvature[-1])
    if not sigma > 0:
        raise Refused("the curvature at the end is not positive")
    return action + task.end_cost(end) - loss - square(tau) / (2 * sigma)


class Piece(NamedTuple):
    """psi~* = x + v s + a s^2 / 2 + j s^3 / 6 on one interval."""

    x: Ball
    v: Ball
    a: Ball
    j: Ball
    width: Ball

    def place(self, s: Ball) -> Ball:
        """psi~*."""
        return self.x + s * (self.v + s * (self.a / 2 + s * self.j / 6))

    def speed(self, s: Ball) -> Ball:
        """psi~*'."""
        return self.v + s * (self.a + s * self.j / 2)

    def defect(self, task: EnclosedTask, s: Ball) -> Ball:
        """eps."""
        return task.power.derivative()(self.place(s)) - 2 * task.friction * (self.a + s * self.j)

    def range(self) -> Ball:
        """All places."""
        return self.place(arb(0).union(self.width))

    def integral(self, function: Any) -> Ball:
        """Over the interval."""
        return integral(lambda s, _: function(s), arb(0), self.width)


def follow(start: Ball, proof: CurveProof) -> tuple[list[Piece], Ball, Ball]:
    """The pieces of a curve, the place and the speed at its end."""
    pieces: list[Piece] = []
    x, v, times = start, arb(proof.speed), [arb(t) for t in proof.times]
    for k in range(len(times) - 1):
        width, a = times[k + 1] - times[k], arb(proof.acceleration[k])
        if not width > 0:
            raise Refused("the times should increase")
        pieces.append(Piece(x, v, a, (arb(proof.acceleration[k + 1]) - a) / width, width))
        x, v = pieces[-1].place(width), pieces[-1].speed(width)
    return pieces, x, v


def least_bend(p: Polynomial, x: Ball, edges: tuple[Ball, Ball]) -> Ball:
    """m for all x in a box, and all psi~ between the edges."""
    low, high = (edges[0] - x).lower(), (edges[1] - x).upper()
    step = (high - low) / (4 * BOXES)
    shifts = ((low + k * step).union(low + (k + 1) * step) for k in range(4 * BOXES))
    return min((p.remainder_on(x, e).lower() for e in shifts), key=float)


class Bends(NamedTuple):
    """m for places of a curve, box by box."""

    boxes: list[Ball]
    bends: list[Ball]

    @classmethod
    def create(cls, p: Polynomial, pieces: list[Piece], edges: tuple[Ball, Ball]) -> Bends:
        """Of all places of a curve, which should not leave the window."""
        ranges = [piece.range() for piece in pieces]
        low, high = min((r.lower() for r in ranges), key=float), max((r.upper() for r in ranges), key=float)
        if not (edges[0] < low and high < edges[1]):
            raise Refused("the curve leaves the window")
        step = (high - low) / BOXES
        boxes = [(low + k * step).union(low + (k + 1) * step) for k in range(BOXES)]
        return cls(boxes, [least_bend(p, box, edges) for box in boxes])

    def least(self, x: Ball) -> Ball:
        """m for all x in a box on the curve."""
        return min((m for box, m in zip(self.boxes, self.bends, strict=True) if box.overlaps(x)), key=float)


# By sums of squares.


def by_squares(problem: Inequality, proof: SquaresProof) -> Ball:
    """The bound by a polynomial V."""
    if any(j or i > 2 * problem.regular for i, j, *_ in proof.value):
        raise Refused("V has a power of the yaw rate or of the yaw acceleration that it may not have")
    if problem.duration is None and any(k for _, _, k, _ in proof.value):
        raise Refused("V depends on time")
    if proof.slope and not (problem.end and proof.slope * problem.side < 0):
        raise Refused("V is linear in the angle, but its value at the ends is not bounded")
    v, level, slope = Series({key: arb(c) for key, c in proof.value.items()}), arb(proof.level), arb(proof.slope)
    prove_sum_of_squares(problem.flow(v, level, slope), proof.flow)
    boundary = problem.boundary(v, level)
    if boundary is not None:
        if proof.end is None:
            raise Refused("the condition at the ends is missing")
        prove_sum_of_squares(boundary, (proof.end,))
    return problem.bound(v, level, slope)


def prove_sum_of_squares(series: Series, grams: tuple[Gram, ...]) -> None:
    """H = z_1^T Q_1 z_1 + (1 - tau^2) z_2^T Q_2 z_2 with Q_1 and Q_2 positive definite, after an exact projection.

    Args:
        series: H, with balls for coefficients.
        grams: near Q_1 and, where there is time, Q_2.

    Raises:
        Refused: this is not proven.
    """
    if not grams or grams[0].inside:
        raise Refused("there is no Gram matrix without weight")
    rows = [[[arb(float(c)) for c in row[: a + 1]] for a, row in enumerate(gram.matrix)] for gram in grams]
    rest = dict(series.terms)
    for gram, matrix in zip(grams, rows, strict=True):
        for a, b, key, factor in entries(gram.basis, gram.inside):
            rest[key] = rest.get(key, arb(0)) - matrix[a][b] * factor
    for (a, b), c in absorbed(rest, grams[0].basis).items():
        rows[0][a][b] += c
    if not all(map(positive_definite, rows)):
        raise Refused("a Gram matrix is not positive definite, or not by more than the rounding radius")


def absorbed(rest: dict[Key, Number], basis: tuple[Key, ...]) -> dict[tuple[int, int], Ball]:
    """What to add to a Gram matrix so that its polynomial becomes larger by a rest, exactly.

    A product of two terms has one term of highest degree in time and then in the angle: what is left of that goes
    into the place of the product, and its other terms, all lower, are left for later.

    Args:
        rest: coefficients by term; balls that hold what is to be added.
        basis: of the matrix.

    Returns:
        Balls by place in the lower triangle, such that for whatever numbers the balls of the rest hold there are
        numbers in these that add exactly them.

    Raises:
        Refused: a term is the highest one of no product.
    """
    rest, change, products = dict(rest), {}, _products(basis)
    while rest:
        key = max(rest, key=_degree)
        c = rest.pop(key)
        if c.is_zero():
            continue
        if key not in products:
            raise Refused(f"the term {key} is the highest one of no product of the Gram matrix")
        *place, terms = products[key]
        share = c / arb(terms[key])
        change[place[0], place[1]] = share
        for other, factor in terms.items():
            if other != key:
                rest[other] = rest.get(other, arb(0)) - share * factor
    return change


def _degree(key: Key) -> tuple[int, int]:
    return key[2], abs(key[3])


@lru_cache(maxsize=16)
def _products(basis: tuple[Key, ...]) -> dict[Key, tuple[int, int, dict[Key, float]]]:
    """Place and terms of the shortest product by its highest term."""
    whole: dict[tuple[int, int], dict[Key, float]] = {}
    for a, b, key, factor in entries(basis, False):
        terms = whole.setdefault((a, b), {})
        terms[key] = terms.get(key, 0.0) + factor
    found: dict[Key, tuple[int, int, dict[Key, float]]] = {}
    for (a, b), terms in whole.items():
        top = max(terms, key=_degree)
        if top not in found or len(terms) < len(found[top][2]):
            found[top] = a, b, terms
    return found
