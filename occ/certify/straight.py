"""A straight way that passes every minimum of U proves itself: S = -h t plus the length to an angle is smooth there.

Z u^2 + U >= 2 sqrt(Z (U + h)) |u| - h with equality along the extremal of energy h >= -min U, so that the work is at
least the length to its end, less h T, plus the cost of the end.  Ends near the optimal one are compared to it by a
parabola, all others by the floors of `occ.certify.floors`, which take the best h for each of them.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import acb, arb

from occ.certify.balls import Ball, EnclosedTask, Refused, integral, square
from occ.certify.floors import CELLS, Floors
from occ.theory.minimum_work import LeastWork


@dataclass(frozen=True)
class StraightProof:
    """The numbers of the construction.

    Args:
        energy: [W] h.
        end: [rad] from the start to the end of the way.
        hole: edges of the cells around the end in which the parabola speaks.
    """

    energy: float
    end: float
    hole: tuple[int, int]


def propose(least: LeastWork, margin: int) -> StraightProof:
    """Numbers for a proof about a straight optimum; nothing here needs to be right.

    Args:
        least: the optimum.
        margin: cells on both sides of the end in which the parabola speaks.

    Returns:
        To be checked by `lower_bound`.

    Raises:
        Refused: the optimum has a turning point.
    """
    if least.extremal is None or len(least.extremal.places) != 2:
        raise Refused("the optimal way is not straight")
    way = least.extremal.places[1] - least.extremal.places[0]
    cell = int(way // (6.283185307179586 / CELLS))
    return StraightProof(least.extremal.energy, way, (cell - margin, cell + 1 + margin))


def lower_bound(task: EnclosedTask, proof: StraightProof, floors: Floors) -> Ball:
    """A proven lower bound of the work with a free end, from numbers that need not be trusted.

    Args:
        task: enclosed.
        proof: the numbers.
        floors: of the same task.

    Returns:
        A ball; its lower end bounds the work [J] of every motion from the start.

    Raises:
        Refused: a step of the proof fails.
    """
    h, side = arb(proof.energy), 1 if proof.end > 0 else -1
    width = 2 * arb.pi() / CELLS
    for k in range(CELLS):
        if not task.power.on(task.start + width * (k + arb("0.5 +/- 0.5"))) + h > 0:
            raise Refused("U + h is not positive everywhere: the way does not pass every minimum of U")
    low, high = proof.hole
    if not (low > 0 if side > 0 else high < 0):
        raise Refused("the ends of the parabola lie on both sides of the start")
    edges = task.start + low * width, task.start + high * width
    end = task.start + arb(proof.end)
    if not edges[0] < end < edges[1]:
        raise Refused("the end is outside of its parabola")

    def root(z: acb, analytic: bool) -> acb:
        return (task.friction * (task.power(z) + h)).sqrt(analytic=analytic)

    length = abs(2 * integral(root, task.start, end))
    slope = 2 * side * (task.friction * (task.power(end) + h)).sqrt()
    slope += 2 * task.friction * task.rate + task.of_end.derivative()(end)
    bend = min((_bend(task, h, side, box) for box in _boxes(*edges)), key=float)
    if not bend > 0:
        raise Refused("the cost of the end is not convex near the end")
    inside = length - h * task.duration + task.end_cost(end) - square(slope) / (2 * bend)
    return arb.min(inside, arb(floors.work(0, proof.hole))) - task.start_energy


def _boxes(low: Ball, high: Ball) -> list[Ball]:
    step = (high - low) / 32
    return [(low + k * step).union(low + (k + 1) * step) for k in range(32)]


def _bend(task: EnclosedTask, h: Ball, side: int, x: Ball) -> Ball:
    """The second derivative of length plus cost of the end on a box."""
    root = (task.friction * (task.power.on(x) + h)).sqrt()
    first = task.power.derivative()
    return (side * task.friction * first.on(x) / root + task.of_end.derivative().derivative().on(x)).lower()
