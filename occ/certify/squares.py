"""Certified lower bounds by sums of squares: work, squares of the torques and electric energy on a circle.

The degree of V escalates within an effort that is counted by the sizes of the programs, the same on every machine, and
so does the strict margin that is asked of the solver where the check refuses; the largest bound that the check has
passed counts.  What is left between it and the best motion known is *unresolved*.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import zip_longest

import flint
import numpy as np

from occ.certify.balls import Refused
from occ.certify.bellman import Inequality, end_force
from occ.certify.checker import examine
from occ.certify.ends import FREE, Ends
from occ.certify.proofs import SquaresProof, TurnsProof
from occ.certify.running import Cost, inequality
from occ.certify.sos import Degree, propose
from occ.task import Task

BITS = 256
"""Products of a few doubles are exact: what cancels in the platform cancels in the balls."""
DEGREES = tuple(Degree(*item) for item in ((4, 2), (6, 2), (8, 2), (4, 4), (6, 4), (8, 4), (10, 4), (8, 6)))
"""Degrees of V that are tried, in time and in the angle."""
MARGINS = (1e-9, 1e-8, 1e-7, 1e-6)
"""Strict margins that are asked of the solver, relative to the size of the cost."""

CLOSED = 1e-6
"""A bound this close (relative) to the best motion known closes the question."""
SMALL = 2e-7
"""A step of the degree that changes the bound by less than this (relative) is the last one."""
LOOSE = 1e-4
"""A gap above this (relative) is worth to tell motions apart by the full turns of a given end."""
CUTS = (-1, 0, -2, 1)
"""Numbers of turns between which they are told apart."""
GROWTH = 4
"""The effort of a program is this power of the size of its Gram matrix; its time grows with the third to the fifth."""
EFFORT = 600_000
"""Of all programs of a class together: some 10 to 20 s on a processor of 2025."""


@dataclass(frozen=True)
class SquaresCertificate:
    """A lower bound by sums of squares.

    Args:
        lower: a float that is certainly not above the least value; -inf where nothing is proven.
        upper: value of the best motion known; inf where none is.
        proof: its numbers.
        degree: of V.
        reason: why no better bound is known.
        seconds: [s] of processor time spent.
        step: what the last degree added to the bound; inf where there was only one.
        end_force: how much V changes with a given end state, per rad and per rad/s.
        effort: that was spent.
    """

    lower: float
    upper: float
    proof: SquaresProof | TurnsProof | None
    degree: Degree | None
    reason: str
    seconds: float
    step: float = np.inf
    end_force: float = 0.0
    effort: int = 0

    @property
    def gap(self) -> float:
        """[1] (upper - lower) / |upper|."""
        return (self.upper - self.lower) / max(abs(self.upper), 1e-12) if np.isfinite(self.upper) else np.inf

    @property
    def word(self) -> str:
        """``certified``, or ``unresolved`` where the best motion known is far above the bound."""
        return "certified" if self.gap <= CLOSED else "unresolved"

    def __str__(self) -> str:
        if self.word == "certified":
            return f"certified: at least {self.lower:.10g}"
        return f"unresolved: between {self.lower:.8g} and {self.upper:.8g} ({self.reason})"


def check_squares(problem: Inequality, proof: SquaresProof | TurnsProof, claim: float | None = None) -> float:
    """The lower bound that a proof proves.

    Args:
        problem: in balls.
        proof: its numbers, which are not trusted.
        claim: a bound that somebody prints.

    Returns:
        A float that is certainly not above the cost of any motion of the class.

    Raises:
        Refused: the proof fails, or it proves less than the claim.
    """
    with flint.ctx.workprec(BITS):
        lower = examine(problem, proof)
    if claim is not None and claim > lower:
        raise Refused(f"the claim {claim!r} is above what is proven, {lower!r}")
    return lower


def certify_squares(
    task: Task, cost: Cost, ends: Ends = FREE, *, upper: float = np.inf, effort: int = EFFORT
) -> SquaresCertificate:
    """Find and check a lower bound over a class of starts and ends.

    Args:
        task: on a circle.
        cost: what is bounded.
        ends: class of starts and ends.
        upper: value of the best motion known.
        effort: beyond which no further degree is begun.

    Returns:
        The best bound that has passed the check.

    Raises:
        InputError: the motion is not a circle.
    """
    with flint.ctx.workprec(BITS):
        problem = inequality(task, cost, ends)
        if not (problem.start and problem.end):
            return escalate(problem, DEGREES, upper, effort)
        whole = escalate(problem, DEGREES, upper, effort // 2)
        if whole.gap <= LOOSE:
            return whole
        # Ends that differ by full turns are reached by ways of their own.
        parts = escalate(problem, DEGREES, upper, effort - whole.effort, _best_cut(problem))
        better = parts if parts.lower > whole.lower else whole
        return replace(better, seconds=whole.seconds + parts.seconds, effort=whole.effort + parts.effort)


@dataclass
class _Effort:
    """How much is left; it may fall below zero within a degree."""

    amount: int


def _best_cut(problem: Inequality) -> int:
    """The number of turns up to which a proof of the lowest degree should reach."""

    def bound(cut: int) -> float:
        try:
            return _attempt(problem, DEGREES[0], _Effort(0), cut)[0]
        except Refused:
            return -np.inf

    return max(CUTS, key=bound)


def escalate(
    problem: Inequality, degrees: tuple[Degree, ...], upper: float, effort: int, cut: int | None = None
) -> SquaresCertificate:
    """Try one degree after the other.

    Args:
        problem: in balls.
        degrees: in the order in which they are tried.
        upper: value of the best motion known.
        effort: beyond which no further degree is begun.
        cut: full turns of a given end up to which one proof reaches, and above which another; None for one proof.

    Returns:
        The best bound that has passed the check.
    """
    # Loading it takes as long as a small program, and says nothing of the larger ones.
    import_module("cvxpy")
    begin, left = time.process_time(), _Effort(effort)
    best = SquaresCertificate(-np.inf, upper, None, None, "nothing was tried", 0.0)
    for degree, following in zip_longest(degrees, degrees[1:]):
        before = best.lower
        try:
            lower, proof = _attempt(problem, degree, left, cut)
        except Refused as refusal:
            best = replace(best, reason=f"degree {degree.time}, {degree.angle}: {refusal}")
        else:
            if lower > before:
                force, reason = end_force(problem, proof), "the degree of V is too low"
                best = SquaresCertificate(lower, upper, proof, degree, reason, 0.0, lower - before, force)
            if best.gap <= CLOSED:
                best = replace(best, reason="")
                break
            if abs(lower - before) <= SMALL * abs(lower):
                reason = "a higher degree of V gives no more: a better motion may exist"
                best = replace(best, reason=reason, step=abs(lower - before))
                break
        if following and _effort(following) * (1 if cut is None else 2) > left.amount:
            best = replace(best, reason=f"{best.reason}; the effort allowed is spent")
            break
    return replace(best, seconds=time.process_time() - begin, effort=effort - left.amount)


def _attempt(
    problem: Inequality, degree: Degree, left: _Effort, cut: int | None
) -> tuple[float, SquaresProof | TurnsProof]:
    """A bound and its proof with the smallest margin that the check accepts."""
    if cut is not None:
        low, upto = _attempt(replace(problem, side=-1, turns=cut), degree, left, None)
        high, above = _attempt(replace(problem, side=1, turns=cut + 1), degree, left, None)
        assert isinstance(upto, SquaresProof)
        assert isinstance(above, SquaresProof)
        return min(low, high), TurnsProof(cut, upto, above)
    last = Refused("no margin was tried")
    for margin in MARGINS:
        left.amount -= _effort(degree)
        try:
            proof = propose(problem, degree, margin)
            return check_squares(problem, proof), proof
        except Refused as refusal:
            last = refusal
        if left.amount <= 0:
            break
    raise last


def _effort(degree: Degree) -> int:
    """Of one program."""
    return int(((degree.time // 2 + 1) * (degree.angle + 1)) ** GROWTH)
