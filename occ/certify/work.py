"""Certified lower bounds of the work on a circle: which construction, how fine, and what stays open.

Two kinds of proof, both checked in ball arithmetic by code that trusts none of the numbers it is given: along a curve
(`occ.certify.curve`) and by a straight way (`occ.certify.straight`).  Margins and fineness escalate within a budget of
time; where neither closes the gap, what is left is an interval, and the word for it is *unresolved*.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import flint
import numpy as np
from flint import arb

from occ.certify import curve, straight
from occ.certify.balls import Ball, EnclosedTask, Refused, enclose
from occ.certify.floors import Floors
from occ.task import Task
from occ.theory.minimum_work import LeastWork, minimum_work

BITS = 96
CLOSED = 1e-6
"""A bound this close (relative) to the value of the theory closes the question."""

LEVELS = (0.0, *np.logspace(-3.5, 0.5, 17))
"""Levels of the floors above -min U, relative to the swing of U."""

Proof = curve.CurveProof | straight.StraightProof


@dataclass(frozen=True)
class Certificate:
    """A lower bound of the work with a free end, and the numbers that prove it.

    Args:
        lower: [J] a float that is certainly not above the infimum.
        upper: [J] value of the best motion that the theory knows.
        proof: data of the construction; None where only the floors speak.
        reason: why it stays open; empty where it does not.
        seconds: [s] spent.
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


def check(task: Task, proof: Proof | None, claim: float | None = None) -> float:
    """The lower bound that a proof proves, in ball arithmetic.

    Args:
        task: on a circle, with a free end.
        proof: its data, which are not trusted; None for the floors alone.
        claim: [J] a bound that somebody prints.

    Returns:
        [J] A float that is certainly not above the work of any motion from the start.

    Raises:
        Refused: the proof fails, or it proves less than the claim.
    """
    with flint.ctx.workprec(BITS):
        enclosed, floors = _ground(task)
        return _checked(enclosed, floors, proof, claim)


@lru_cache(maxsize=2)
def _ground(task: Task) -> tuple[EnclosedTask, Floors]:
    """What all proofs about one task share."""
    enclosed = enclose(task)
    swing = float(sum(abs(c) for c in enclosed.power.coefficients[1:]))
    return enclosed, Floors.create(enclosed, [level * swing for level in LEVELS])


def _checked(enclosed: EnclosedTask, floors: Floors, proof: Proof | None, claim: float | None) -> float:
    ball: Ball
    if proof is None:
        ball = arb(floors.work(0)) - enclosed.start_energy
    elif isinstance(proof, curve.CurveProof):
        ball = curve.lower_bound(enclosed, proof, floors)
    else:
        ball = straight.lower_bound(enclosed, proof, floors)
    if not ball.is_finite():
        raise Refused("the enclosure is not finite")
    lower = float(np.nextafter(float(ball.lower()), -np.inf))
    if claim is not None and claim > lower:
        raise Refused(f"the claim {claim!r} J is above what is proven, {lower!r} J")
    return lower


def certify_work(task: Task, least: LeastWork | None = None, budget: float = 10.0) -> Certificate:
    """Find and check a proof of a lower bound of the work with a free end.

    Args:
        task: on a circle.
        least: the infimum by theory, if it is known already.
        budget: [s] after which no further proof is tried.

    Returns:
        The best certificate found; it may be unresolved.

    Raises:
        InputError: the motion is not a circle.
    """
    begin = time.perf_counter()
    least = least or minimum_work(task)
    best, proof, reason = -np.inf, None, "nothing was tried"
    try:
        best, reason = check(task, None), "only the floor far from the optimum is proven"
    except Refused as refusal:
        reason = str(refusal)
    for attempt in _attempts(task, least):
        try:
            if isinstance(attempt, Refused):
                raise attempt
            lower = check(task, attempt)
        except Refused as refusal:
            reason = str(refusal)
        else:
            if lower > best:
                best, proof = lower, attempt
        if (least.work - best) <= CLOSED * abs(least.work) or time.perf_counter() - begin > budget:
            break
    return Certificate(best, least.work, proof, reason, time.perf_counter() - begin)


def _attempts(task: Task, least: LeastWork) -> Iterator[Proof | Refused]:
    if least.extremal is None:
        return
    for margin in (6, 12, 9, 16, 3):
        try:
            yield straight.propose(least, margin)
        except Refused as refusal:
            yield refusal
    for pieces in (240, 720):
        for margin in (20, 32, 14, 9, 48):
            try:
                with flint.ctx.workprec(BITS):
                    yield curve.propose(task, enclose(task), least, margin, pieces)
            except Refused as refusal:
                yield refusal
