"""Where a search starts (the servo law, constant offsets, other windings), and the distinct minima that it finds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from occ.errors import Status
from occ.laws.base import yaw_motion
from occ.laws.servo import ServoLaw
from occ.optimal.attempt import Attempt
from occ.optimal.formulation import Formulation, Rotation
from occ.task import Task

SAME_COST = 1e-4
"""Costs on the first mesh that are this close, relative to max(1, size), may belong to the same minimum."""
SAME_HEADING = 1e-2
"""[rad] Headings that are this close at all edges, up to full turns, do, too."""


OPPOSITE = 3
"""Starts before those with other windings: the law's, along the program and against it."""


@dataclass(frozen=True)
class NamedStart:
    """A guess and what it is called."""

    name: str
    rotation: Rotation


def law_rotation(task: Task) -> Rotation:
    """The servo law's rotation, or the one at constant rate where the law is unstable."""
    motion, _ = yaw_motion(ServoLaw(), task, tolerance=1e-7)
    return motion or uniform_rotation(task.start.heading, task.start.heading_rate)


def uniform_rotation(heading: float, rate: float) -> Rotation:
    """psi = psi_0 + rate t."""
    return lambda t: np.vstack([heading + rate * t, np.full_like(t, rate), np.zeros_like(t)])


def turned_further(rotation: Rotation, rate: float) -> Rotation:
    """A rotation and a uniform one on top of it."""
    return lambda t: rotation(t) + np.vstack([rate * t, np.full_like(t, rate), np.zeros_like(t)])


def starts_of(task: Task, count: int, turn: float | None, *, free: bool = False) -> list[NamedStart]:
    """The law; constant offsets to the program's direction around the circle; the law with one turn more and less.

    A longer list begins with the shorter one, so that more starts never miss what fewer have found.

    Args:
        task: what to do.
        count: of the starts.
        turn: [rad] net turn of the heading that the end asks for; None where it is free.
        free: the start is chosen, too; the law, which knows it as given, is not asked then.

    Returns:
        As many guesses, the law's first.
    """
    if free and turn is not None:
        law = uniform_rotation(task.start.heading, turn / task.duration)
    else:
        law = law_rotation(task)
    if turn is not None:
        heading = law(np.array([0.0, task.duration]))[0]
        law = turned_further(law, (turn - (heading[1] - heading[0])) / task.duration)
    found = [NamedStart("constant rate" if free else "law", law)]
    rate = mean_turning_rate(task) if turn is None else turn / task.duration
    for j in range(count):
        offset = 2 * np.pi * _spread(j)
        name = f"constant rate {rate:.4g} rad/s from {offset:.4g} rad on"
        found.append(NamedStart(name, uniform_rotation(task.start.heading + offset, rate)))
    if turn is None:
        further = [turned_further(law, 2 * np.pi * turns / task.duration) for turns in (1, -1)]
        names = ("law with +1 turn", "law with -1 turn")
        found[OPPOSITE:OPPOSITE] = [NamedStart(*each) for each in zip(names, further, strict=True)]
    return found[:count]


def _spread(j: int) -> float:
    """0, 1/2, 1/4, 3/4, 1/8, ..: each halves one of the widest gaps of the circle (van der Corput's sequence)."""
    return sum(((j >> bit) & 1) / 2 ** (bit + 1) for bit in range(j.bit_length()))


def mean_turning_rate(task: Task) -> float:
    """[rad/s] Mean rate at which the velocity of B's program turns; 0 where it stands still."""
    if task.motion.turning_rate is not None:
        return task.motion.turning_rate
    _, velocity, _ = task.motion.at(np.linspace(0.0, task.duration, 400))
    moving = np.hypot(*velocity) > 1e-3 * np.hypot(*velocity).max(initial=1e-12)
    direction = np.unwrap(np.arctan2(velocity[1, moving], velocity[0, moving]))
    return float((direction[-1] - direction[0]) / task.duration) if direction.size else 0.0


@dataclass(frozen=True)
class Minimum:
    """A local minimum on the first mesh.

    Args:
        attempt: the best that reached it.
        names: of the starts that reached it.
    """

    attempt: Attempt
    names: tuple[str, ...]

    @property
    def cost(self) -> float:
        """Claimed on the first mesh."""
        return self.attempt.outcome.cost


def distinct(formulation: Formulation, attempts: Mapping[str, Attempt]) -> list[Minimum]:
    """The different minima among attempts from several starts, the least first.

    Args:
        formulation: for headings.
        attempts: on one mesh, by names; those that failed are left out.

    Returns:
        Minima that differ in cost or heading.
    """
    found: list[Minimum] = []
    solved = [item for item in attempts.items() if item[1].outcome.status is Status.OK]
    for name, attempt in sorted(solved, key=lambda item: item[1].outcome.cost):
        for j, minimum in enumerate(found):
            if same_minimum(formulation, minimum.attempt, attempt):
                found[j] = Minimum(minimum.attempt, (*minimum.names, name))
                break
        else:
            found.append(Minimum(attempt, (name,)))
    return found


def same_minimum(formulation: Formulation, one: Attempt, other: Attempt) -> bool:
    """Whether two solutions on one mesh agree in cost and heading.

    Args:
        formulation: for headings.
        one: a solution.
        other: another one.

    Returns:
        True where both are closer than `SAME_COST` and `SAME_HEADING`.
    """
    cost = one.outcome.cost
    if abs(cost - other.outcome.cost) > SAME_COST * max(1.0, abs(cost)):
        return False
    # The start state is the same or one of those that differ by full turns.
    difference = formulation.headings(one.outcome.nodes) - formulation.headings(other.outcome.nodes)
    difference -= 2 * np.pi * np.round(difference[0] / (2 * np.pi))
    return bool(np.abs(difference).max() < SAME_HEADING)


def found_in_words(minima: Sequence[Minimum], starts: int) -> str:
    """How many minima there are, and how bad the worst is.

    Args:
        minima: the least first.
        starts: how many there were.

    Returns:
        Text.
    """
    if not minima:
        return "found from a motion that holds the limits, as no start leads to a minimum"
    found = f"{len(minima)} distinct local minima from {starts} starts" if starts > 1 else "from one start"
    if len(minima) < 2 or minima[0].cost <= 0:
        return found
    more = 100 * (max(minimum.cost for minimum in minima) / minima[0].cost - 1)
    return f"{found}, the worst {more:.3g} % above the least"
