"""Certified lower bounds by sums of squares: work, squares of the torques and electric energy on a circle.

The degree of V escalates within a budget of time, and the strict margin that is asked of the solver where the check
refuses; the largest bound that the check has passed counts.  What is left between it and the best motion known is
*unresolved*.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import zip_longest
from typing import Literal

import flint
import numpy as np
from flint import arb

from occ.certify.balls import Refused, enclose
from occ.certify.bellman import Inequality, SquaresProof, end_force, lower_bound, value_at
from occ.certify.running import running_costs, scales_of, state_of
from occ.certify.series import Series
from occ.certify.sos import Degree, propose
from occ.certify.work import FREE, Ends
from occ.errors import InputError
from occ.objectives import COPPER_LOSS
from occ.task import Task
from occ.theory.dissipation import circle_of

BITS = 256
"""Products of a few doubles are exact: what cancels in the platform cancels in the balls."""
Cost = Literal["work", "torque_squared", "electric"]
DEGREES = tuple(Degree(*item) for item in ((4, 2), (6, 2), (8, 2), (4, 4), (6, 4), (8, 4), (10, 4), (8, 6)))
"""Degrees of V that are tried, in time and in the angle."""
MARGINS = (1e-9, 1e-8, 1e-7, 1e-6)
"""Strict margins that are asked of the solver, relative to the size of the cost."""

CLOSED = 1e-6
"""A bound this close (relative) to the best motion known closes the question."""
SMALL = 2e-7
"""A step of the degree that changes the bound by less than this (relative) is the last one."""
GROWTH = 5
"""The time that a program takes grows with this power of the size of its Gram matrix."""


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
    """

    lower: float
    upper: float
    proof: SquaresProof | None
    degree: Degree | None
    reason: str
    seconds: float
    step: float = np.inf
    end_force: float = 0.0

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


def inequality(task: Task, cost: Cost, ends: Ends = FREE, *, for_ever: bool = False) -> Inequality:
    """Bellman's inequality of a task, in balls.

    Args:
        task: on a circle.
        cost: what is bounded.
        ends: class of starts and ends.
        for_ever: whether the mean over an endless motion is bounded instead.

    Returns:
        To be proven by `occ.certify.bellman.lower_bound`.

    Raises:
        InputError: the motion is not a circle, or ends without a bound.
    """
    running = running_costs(task)
    scales, regular = scales_of(task), cost != "work"
    costs = {
        "work": running.dissipation,
        "torque_squared": running.torque_squared,
        "electric": running.power + running.torque_squared * arb(COPPER_LOSS),
    }
    if for_ever:
        return Inequality(costs[cost], scales, regular)
    duration = arb(task.duration)
    start = state_of(task, task.start.heading, task.start.heading_rate)
    if ends.end == "periodic" and ends.free_start:
        return Inequality(costs[cost], scales, regular, duration, turn=arb(circle_of(task).rate) * duration)
    if ends.free_start or ends.end == "rest":
        raise InputError(
            f"end: {ends.end!r} with{' a free' if ends.free_start else ' the given'} start has no bound here"
        )
    end = None
    if ends.end == "periodic":
        end = state_of(task, task.start.heading, task.start.heading_rate, duration)
    elif ends.end == "law":
        assert ends.state is not None
        end = state_of(task, ends.state[2], ends.state[5], duration)
    end_cost, paid = Series({}), arb(0)
    if not regular:
        paid = -value_at(running.kinetic_energy, start)
        end_cost = Series.of(enclose(task).rest)
        if end:
            paid += value_at(running.kinetic_energy, end)
    return Inequality(costs[cost], scales, regular, duration, start, end, end_cost, paid)


def check_squares(problem: Inequality, proof: SquaresProof, claim: float | None = None) -> float:
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
        ball = lower_bound(problem, proof)
        if not ball.is_finite():
            raise Refused("the enclosure is not finite")
        lower = float(np.nextafter(float(ball.lower()), -np.inf))
    if claim is not None and claim > lower:
        raise Refused(f"the claim {claim!r} is above what is proven, {lower!r}")
    return lower


def certify_squares(
    task: Task, cost: Cost, ends: Ends = FREE, *, upper: float = np.inf, budget: float = 20.0
) -> SquaresCertificate:
    """Find and check a lower bound over a class of starts and ends.

    Args:
        task: on a circle.
        cost: what is bounded.
        ends: class of starts and ends.
        upper: value of the best motion known.
        budget: [s] of processor time after which no further degree is begun.

    Returns:
        The best bound that has passed the check.

    Raises:
        InputError: the motion is not a circle.
    """
    with flint.ctx.workprec(BITS):
        return escalate(inequality(task, cost, ends), DEGREES, upper, budget)


def escalate(problem: Inequality, degrees: tuple[Degree, ...], upper: float, budget: float) -> SquaresCertificate:
    """Try one degree after the other.

    Args:
        problem: in balls.
        degrees: in the order in which they are tried.
        upper: value of the best motion known.
        budget: [s] of processor time after which no further degree is begun.

    Returns:
        The best bound that has passed the check.
    """
    # Loading it takes as long as a small program, and says nothing of the larger ones.
    import_module("cvxpy")
    begin = time.process_time()
    best = SquaresCertificate(-np.inf, upper, None, None, "nothing was tried", 0.0)
    for degree, following in zip_longest(degrees, degrees[1:]):
        before, started = best.lower, time.process_time()
        try:
            lower, proof = _attempt(problem, degree, begin + budget)
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
        now = time.process_time()
        if following and now - begin + (now - started) * (_size(following) / _size(degree)) ** GROWTH > budget:
            best = replace(best, reason=f"{best.reason}; the time is up")
            break
    return replace(best, seconds=time.process_time() - begin)


def _attempt(problem: Inequality, degree: Degree, deadline: float) -> tuple[float, SquaresProof]:
    """A bound and its proof with the smallest margin that the check accepts."""
    last = Refused("no margin was tried")
    for margin in MARGINS:
        try:
            proof = propose(problem, degree, margin)
            return check_squares(problem, proof), proof
        except Refused as refusal:
            last = refusal
        if time.process_time() > deadline:
            break
    raise last


def _size(degree: Degree) -> int:
    return (degree.time // 2 + 1) * (degree.angle + 1)
