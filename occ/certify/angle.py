"""The work on a circle as a problem in one angle, and the families of motions that a proof tells apart.

With u = psi~' the work is the integral of Z u^2 + U, and what the end costs (`occ.certify.balls.EnclosedTask`).  Places
are counted in cells of the circle from the start on the real line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from flint import arb

from occ.certify.balls import Ball, EnclosedTask, Refused, enclose
from occ.certify.ends import FREE, Ends
from occ.certify.lengths import Lengths, Place
from occ.certify.proofs import Axis
from occ.errors import InputError
from occ.task import Task
from occ.theory.dissipation import circle_of

CELLS = 240
"""Cells of a turn."""


class Family(NamedTuple):
    """Motions by where they end, and by how far they go to both sides.

    Args:
        first: the end is not to the left of it.
        last: nor to the right of this.
        left: no motion goes beyond this place to the left,
        near_left: each goes as far to the left as this,
        near_right: and as far to the right as this,
        right: none beyond this.
    """

    first: Place = -math.inf
    last: Place = math.inf
    left: Place = -math.inf
    near_left: Place = 0.0
    near_right: Place = 0.0
    right: Place = math.inf

    def split(self, axis: Axis, place: Place) -> tuple[Family, Family]:
        """Both parts together hold every motion of the family.

        Raises:
            Refused: the place does not cut it.
        """
        low, high = {
            "end": (self.first, self.last),
            "left": (self.left, self.near_left),
            "right": (self.near_right, self.right),
        }[axis]
        if not low < place < high:
            raise Refused(f"{axis!r} is cut at {place!r}, which is not between {low!r} and {high!r}")
        if axis == "end":
            return self._replace(last=place), self._replace(first=place)
        if axis == "left":
            return self._replace(near_left=place), self._replace(left=place)
        return self._replace(right=place), self._replace(near_right=place)


@dataclass(frozen=True)
class OneAngle:
    """What is to be bounded.

    Args:
        task: its energies.
        lengths: on its circle, counted from the start.
        paid: [J] for start and end in any case.
        end: where a motion ends; None where it is free, and pays the end cost of the task.
        repeat: cells after which the end is the same one again; 0 where it is one place only.
        free_start: whether the start is any place (and the end so many turns from it).
        for_ever: the mean power of an endless motion is bounded instead.
    """

    task: EnclosedTask
    lengths: Lengths
    paid: Ball
    end: Place | None = None
    repeat: int = 0
    free_start: bool = False
    for_ever: bool = False

    @property
    def turn_cost(self) -> Ball:
        """[J] What a motion pays for each full turn of its end."""
        return 4 * arb.pi() * self.task.friction * self.task.rate


def one_angle(task: Task, ends: Ends = FREE, grain: float = 0.0, *, for_ever: bool = False) -> OneAngle:
    """The least work of a class of starts and ends, or the least mean power for ever.

    Args:
        task: on a circle.
        ends: class of starts and ends.
        grain: [J] lengths that need not be found.
        for_ever: whether the motion is endless; then start, end and horizon do not matter.

    Returns:
        Enclosed in balls.

    Raises:
        InputError: not a circle, or an end without its state.
    """
    e = enclose(task)
    if for_ever:
        return OneAngle(e, Lengths(e, CELLS, grain=grain), arb(0), free_start=True, for_ever=True)
    if ends.end == "periodic":
        # The kinetic energies of start and end are one.
        return OneAngle(e, Lengths(e, CELLS, grain=grain), arb(0), 0.0, CELLS, ends.free_start)
    if ends.end == "free":
        return OneAngle(e, Lengths(e, CELLS, grain=grain), -e.start_energy)
    if ends.state is None:
        raise InputError("end: a state is needed where the end is given")
    end = arb(ends.state[2]) - arb(circle_of(task).phase) - e.rate * e.duration
    paid = 2 * e.friction * e.rate * (end - e.start) + e.swing(end) - e.swing(e.start)
    paid += e.kinetic_energy(end, arb(ends.state[5])) - e.start_energy
    lengths = Lengths(e, CELLS, end, grain)
    return OneAngle(e, lengths, paid, lengths.end)
