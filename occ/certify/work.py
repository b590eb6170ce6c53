"""Certified lower bounds of the work on a circle: which construction, how fine, and what stays open.

Two constructions, both checked in ball arithmetic by code that trusts none of the numbers it is given.  All ways at
once (`occ.certify.ways`) covers each class of ends and closes nearly always; along a curve (`occ.certify.curve`) proves
the same for a free end without the theory of extremals.  Cells are halved, margins and fineness escalate within a
budget of time; where that does not close the gap, what is left is an interval, and the word for it is *unresolved*.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import islice
from typing import Literal

import flint
import numpy as np
from flint import arb

from occ.certify import curve
from occ.certify.balls import EnclosedTask, Refused, enclose
from occ.certify.floors import CELLS, Floors
from occ.certify.lengths import Lengths
from occ.certify.search import search
from occ.certify.ways import FreeEnds, GivenEnd, WaysProof, lower_bound
from occ.errors import InputError
from occ.task import EndClass, Task
from occ.theory.dissipation import circle_of
from occ.theory.minimum_work import LeastWork, minimum_work

BITS = 96
CLOSED = 1e-6
"""A bound this close (relative) to the value of the theory closes the question."""
AIM = 0.4
"""Share of it that the search asks for."""
GRAIN = 1e-9
"""Lengths that need not be found, relative to the work."""
MOST_TURNS = 1024
"""Ends further away are left to the floors."""

Construction = Literal["any", "ways", "curve"]


@dataclass(frozen=True)
class Ends:
    """A class of starts and ends of section 4.3.

    Args:
        end: ``free``; ``law`` with its state; ``periodic``, with any winding.
        state: (6,) at the end, where it is given; its numbers are exact.
        free_start: whether the start is chosen, too (``periodic`` only).
    """

    end: EndClass = "free"
    state: tuple[float, ...] | None = None
    free_start: bool = False

    def least(self, task: Task) -> LeastWork:
        """The infimum by theory."""
        state = None if self.state is None else np.array(self.state)
        return minimum_work(task, self.end, state, free_start=self.free_start)


FREE = Ends()


@dataclass(frozen=True)
class WindingsProof:
    """Proofs for the full turns of psi~ in a periodic motion.

    Args:
        proofs: for -n, ..., n turns.
    """

    proofs: tuple[WaysProof, ...]


Proof = WaysProof | WindingsProof | curve.CurveProof


@dataclass(frozen=True)
class Certificate:
    """A lower bound of the work of a class, and the numbers that prove it.

    Args:
        lower: [J] a float that is certainly not above the infimum.
        upper: [J] value of the best motion that the theory knows.
        proof: data of the construction; None where only the floors speak.
        reason: why it stays open; empty where it does not.
        seconds: [s] of the processor's time.
    """

    lower: float
    upper: float
    proof: Proof | None
    reason: str
    seconds: float

    @property
    def gap(self) -> float:
        """[1] (upper - lower) / |upper|."""
        return (self.upper - self.lower) / max(abs(self.upper), 1e-12)

    @property
    def word(self) -> str:
        """``certified``, or ``unresolved`` where the bracket is not closed."""
        return "certified" if self.gap <= CLOSED else "unresolved"

    def __str__(self) -> str:
        if self.word == "certified":
            return f"certified: at least {self.lower:.10g} J"
        return f"unresolved: between {self.lower:.8g} J and {self.upper:.8g} J ({self.reason})"


def check(task: Task, proof: Proof | None, claim: float | None = None, ends: Ends = FREE) -> float:
    """The lower bound that a proof proves, in ball arithmetic.

    Args:
        task: on a circle.
        proof: its data, which are not trusted; None for the floors alone.
        claim: [J] a bound that somebody prints.
        ends: class of starts and ends.

    Returns:
        [J] A float that is certainly not above the work of any motion of the class.

    Raises:
        Refused: the proof fails, or it proves less than the claim.
        InputError: not a circle, or ends that are not defined there.
    """
    with flint.ctx.workprec(BITS):
        lower = _ground(task, ends).lower(proof)
    if claim is not None and claim > lower:
        raise Refused(f"the claim {claim!r} J is above what is proven, {lower!r} J")
    return lower


def certify_work(
    task: Task, ends: Ends = FREE, construction: Construction = "any", budget: float = 30.0
) -> Certificate:
    """Find and check a proof of a lower bound of the work.

    Args:
        task: on a circle.
        ends: class of starts and ends.
        construction: ``ways``; ``curve`` for a free end only; ``any`` begins with the curve there, the closer one.
        budget: [s] of the processor's time after which no further proof is looked for.

    Returns:
        The best certificate found; it may be unresolved.

    Raises:
        InputError: not a circle, or ends that are not defined there.
    """
    begin = time.process_time()
    least = ends.least(task)
    best, proof, reason = -np.inf, None, "nothing was tried"
    with flint.ctx.workprec(BITS):
        ground = _ground(task, ends)
        for attempt in ground.attempts(least, construction, begin + budget):
            try:
                if isinstance(attempt, Refused):
                    raise attempt
                lower = ground.lower(attempt)
            except Refused as refusal:
                reason = str(refusal)
            else:
                if lower > best:
                    best, proof, reason = lower, attempt, f"no better proof in {budget:g} s"
            if (least.work - best) <= CLOSED * abs(least.work) or time.process_time() - begin > budget:
                break
    return Certificate(best, least.work, proof, reason, time.process_time() - begin)


class _Ground:
    """What all proofs about one task and one class share."""

    def __init__(self, task: Task, ends: Ends) -> None:
        self.task, self.ends = task, ends
        self.enclosed = enclose(task)
        self.start_energy = self.enclosed.start_energy
        # Only how finely lengths are found depends on the value of the theory.
        self.grain = GRAIN * abs(ends.least(task).work)

    @cached_property
    def floors(self) -> Floors:
        return Floors(self.enclosed, self.grain)

    def lower(self, proof: Proof | None) -> float:
        """[J] What a proof proves."""
        if isinstance(proof, WindingsProof) and self.ends.end == "periodic":
            return self._of_windings(proof)
        if isinstance(proof, WaysProof) and self.ends.end != "periodic":
            ways = self.free(proof.reach) if self.ends.end == "free" else self.given
            ball = arb(lower_bound(ways, proof))
        elif isinstance(proof, curve.CurveProof) and self.ends.end == "free":
            ball = curve.lower_bound(self.enclosed, proof, self.floors)
        elif proof is None and self.ends.end == "free":
            ball = arb(self.floors.work(0))
        else:
            raise Refused(f"such a proof says nothing about the end {self.ends.end!r}")
        return _float_below(ball - self.start_energy)

    def attempts(
        self, least: LeastWork, construction: Construction, deadline: float
    ) -> Iterator[Proof | Refused | None]:
        """Proofs to try, the coarsest first."""
        target = least.work - AIM * CLOSED * abs(least.work) + float(self.start_energy)
        if self.ends.end == "periodic":
            yield self._windings(target - float(self.start_energy), deadline)
        elif self.ends.end != "free":
            yield search(self.given, target, deadline)
        else:
            yield None
            curves = _curves(self.task, self.enclosed, least) if construction != "ways" else iter(())
            # Where the first curve fails the others mostly do, too.
            yield from islice(curves, 1)
            if construction != "curve":
                yield self._ways(target, deadline)
            yield from curves

    def _ways(self, target: float, deadline: float) -> WaysProof | Refused:
        try:
            turns = 2
            while turns < MOST_TURNS and self.floors.beyond(turns * CELLS) < target:
                turns *= 2
            return search(self.free(turns * CELLS), target, deadline)
        except Refused as refusal:
            return refusal

    def free(self, reach: int) -> FreeEnds:
        """The problem with a free end."""
        return FreeEnds(self.enclosed, self.floors, reach)

    @cached_property
    def given(self) -> GivenEnd:
        """The problem whose end is the state."""
        if self.ends.state is None:
            raise InputError("end: a state is needed where the end is given")
        circle, e = circle_of(self.task), self.enclosed
        end = arb(self.ends.state[2]) - arb(circle.phase) - e.rate * e.duration
        last = e.kinetic_energy(end, arb(self.ends.state[5]))
        cost = 2 * e.friction * e.rate * (end - e.start) + e.swing(end) - e.swing(e.start) + last
        lengths = Lengths(e, CELLS, end, self.grain)
        return GivenEnd(e, lengths, lengths.end, cost)

    def _turning(self, turns: int) -> GivenEnd:
        """A periodic motion in which psi~ makes so many full turns; kinetic energy cancels."""
        cost = 4 * arb.pi() * self.enclosed.friction * self.enclosed.rate * turns
        return GivenEnd(self.enclosed, self.floors.lengths, float(turns * CELLS), cost)

    def _windings(self, target: float, deadline: float) -> WindingsProof | Refused:
        try:
            n = 1
            while n < MOST_TURNS and min(self.floors.of_turns(side * (n + 1)) for side in (1, -1)) < target:
                n += 1
            return WindingsProof(tuple(search(self._turning(k), target, deadline) for k in range(-n, n + 1)))
        except Refused as refusal:
            return refusal

    def _of_windings(self, proof: WindingsProof) -> float:
        n, rest = divmod(len(proof.proofs), 2)
        if rest != 1:
            raise Refused("the windings are not as many to the right as to the left")
        bounds = [self.floors.of_turns(n + 1), self.floors.of_turns(-n - 1)]
        for turns, part in zip(range(-n, n + 1), proof.proofs, strict=True):
            if turns == 0 and self.ends.free_start:
                # Without a turn nothing is below U itself.
                bounds.append(_float_below(arb(self.floors.lengths.lowest) * self.enclosed.duration))
            else:
                bounds.append(lower_bound(self._turning(turns), part))
        return min(bounds)


@lru_cache(maxsize=2)
def _ground(task: Task, ends: Ends) -> _Ground:
    return _Ground(task, ends)


def _float_below(ball: arb) -> float:
    if not ball.is_finite():
        raise Refused("the enclosure is not finite")
    return float(np.nextafter(float(ball.lower()), -np.inf))


def _curves(task: Task, enclosed: EnclosedTask, least: LeastWork) -> Iterator[Proof | Refused]:
    if least.extremal is None:
        return
    for pieces in (240, 720):
        for margin in (20, 32, 14, 9, 48):
            try:
                yield curve.propose(task, enclosed, least, margin, pieces)
            except Refused as refusal:
                yield refusal
