"""Certified lower bounds of the work on a circle: which construction, how fine, and what stays open.

Two constructions, both checked by `occ.certify.checker`, which trusts none of the numbers it is given.  Levels for all
families of motions (`occ.certify.search`) cover each class of ends; a quadratic V about the optimal heading
(`occ.certify.curve`) needs levels only for the motions that leave its window.  Families are divided, margins and
fineness escalate up to a number of families, the same on every machine; where that does not close the gap, what is left
is an interval, and the word for it is *unresolved*.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import flint
import numpy as np

from occ.certify import curve
from occ.certify.angle import OneAngle, one_angle
from occ.certify.balls import Refused
from occ.certify.checker import examine
from occ.certify.ends import FREE, Ends
from occ.certify.proofs import Tree
from occ.certify.search import search
from occ.task import Task
from occ.theory.minimum_work import LeastWork

BITS = 96
CLOSED = 1e-6
"""A bound this close (relative) to the value of the theory closes the question."""
AIM = 0.4
"""Share of it that the search asks for."""
ASIDE = 1e-9
"""Of motions that leave the window of a curve the same is asked: less than they should lack, relative to the work."""
FAMILIES = 15_000
"""Of motions that are told apart: some 30 s on a processor of 2025; nearly all tasks need less than a tenth."""
PATIENCE = 0.1
"""Share of them that is spent on motions that leave the window."""
GRAIN = 1e-9
"""Lengths that need not be found, relative to the work."""

Construction = Literal["any", "levels", "curve"]


@dataclass(frozen=True)
class Certificate:
    """A lower bound of the work of a class, and the numbers that prove it.

    Args:
        lower: [J] a float that is certainly not above the infimum.
        upper: [J] value of the best motion that the theory knows.
        proof: its numbers; None where nothing is proven.
        reason: why it stays open; empty where it does not.
        seconds: [s] of the processor's time.
    """

    lower: float
    upper: float
    proof: Tree | None
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


def check(task: Task, proof: Tree, claim: float | None = None, ends: Ends = FREE) -> float:
    """The lower bound that a proof proves, in ball arithmetic.

    Args:
        task: on a circle.
        proof: its data, which are not trusted.
        claim: [J] a bound that somebody prints.
        ends: class of starts and ends.

    Returns:
        [J] A float that is certainly not above the work of any motion of the class.

    Raises:
        Refused: the proof fails, or it proves less than the claim.
        InputError: not a circle, or ends that are not defined there.
    """
    with flint.ctx.workprec(BITS):
        lower = examine(_problem(task, ends), proof)
    if claim is not None and claim > lower:
        raise Refused(f"the claim {claim!r} J is above what is proven, {lower!r} J")
    return lower


def certify_work(
    task: Task, ends: Ends = FREE, construction: Construction = "any", families: int = FAMILIES
) -> Certificate:
    """Find and check a proof of a lower bound of the work.

    Args:
        task: on a circle.
        ends: class of starts and ends.
        construction: ``levels``; ``curve`` for a free end only; ``any`` begins with the curve there, the closer one.
        families: how many are told apart in each search before it stops.

    Returns:
        The best certificate found; it may be unresolved.

    Raises:
        InputError: not a circle, or ends that are not defined there.
        NoExtremal: the theory finds no motion to compare with.
    """
    begin = time.process_time()
    least = ends.least(task)
    best, proof, reason = -np.inf, None, "nothing was tried"
    with flint.ctx.workprec(BITS):
        problem = _problem(task, ends)
        for attempt in _attempts(task, problem, least, construction, families):
            try:
                if isinstance(attempt, Refused):
                    raise attempt
                lower = examine(problem, attempt)
            except Refused as refusal:
                reason = str(refusal)
            else:
                if lower > best:
                    best, proof, reason = lower, attempt, f"no better proof by {families} families of motions"
            if (least.work - best) <= CLOSED * abs(least.work):
                reason = ""
                break
    return Certificate(best, least.work, proof, reason, time.process_time() - begin)


@lru_cache(maxsize=4)
def _problem(task: Task, ends: Ends) -> OneAngle:
    # Only how finely lengths are found depends on the value of the theory.
    return one_angle(task, ends, GRAIN * abs(ends.least(task).work))


def _attempts(
    task: Task, problem: OneAngle, least: LeastWork, construction: Construction, families: int
) -> Iterator[Tree | Refused]:
    """Proofs to try."""
    target, unit = least.work - float(problem.paid), CLOSED * abs(least.work)
    curves = problem.end is None and least.extremal is not None and construction != "levels"
    tries = [(pieces, margin) for pieces in (240, 720) for margin in (20, 32, 14, 9, 48)] if curves else []
    # Where the first curve fails the others mostly do, too.
    for pieces, margin in tries if construction == "curve" else tries[:1]:
        try:
            found = curve.propose(task, problem, least, margin, pieces)
            yield search(problem, target - ASIDE * abs(least.work), round(PATIENCE * families), found)
        except Refused as refusal:
            yield refusal
    if construction != "curve":
        try:
            yield search(problem, target - AIM * unit, families)
        except Refused as refusal:
            yield refusal
