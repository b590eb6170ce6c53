"""Allocated torques along a law's own motion: is each wrench in reach, and when does a wheel meet its limit?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from occ.allocation.allocator import Allocator, solve
from occ.allocation.ranges import limit_parts
from occ.allocation.reach import zonotope
from occ.allocation.residuals import PROOF, certified
from occ.allocation.result import Allocation, Question
from occ.control import Control
from occ.errors import Status

States = Callable[[np.ndarray], np.ndarray]
"""x (6, N) of a motion at any times t (N,)."""

NEAR = 0.95
"""Peaks between samples are looked for where a sample comes this near to the limit."""
SAME_TIME = 1e-9
"""Times closer than this part of the horizon are one."""


@dataclass(frozen=True)
class Realised:
    """What became of a law's torques under an allocation.

    Args:
        control: what is handed to the referee; None where there is none.
        status: ``OK``, ``INFEASIBLE`` (a wrench is out of reach) or ``FAILED`` (the allocation could not be shown).
        message: why, in words with numbers and units.
        as_demanded: whether every wrench is the law's own; False where a rule for wrenches out of reach changed some.
        statistics: of the allocation.
    """

    control: Control | None
    status: Status = Status.OK
    message: str = ""
    as_demanded: bool = True
    statistics: dict[str, Any] = field(default_factory=dict)


class AllocatedControl:
    """M(t, x) by an allocation, from a control with minimum-norm torques; the wheel rates are those of the state.

    Args:
        min_norm: the law's own control.
        allocator: limits, criterion and rule.
        knots: (K,) [s] times at which the torques are not smooth.
    """

    def __init__(self, min_norm: Control, allocator: Allocator, knots: np.ndarray) -> None:
        self.min_norm, self.allocator, self._knots = min_norm, allocator, knots

    @property
    def knots(self) -> np.ndarray:
        return np.union1d(self.min_norm.knots, self._knots)

    def torque(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        return self.allocator.torque(self.min_norm.torque(t, state), self.allocator.wheels.wheel_rates @ state[3:])

    def segment(self, start: float, end: float) -> Callable[[float, np.ndarray], np.ndarray]:
        inner, allocator = self.min_norm.segment(start, end), self.allocator
        rates = allocator.wheels.wheel_rates

        def torque(t: float, state: np.ndarray) -> np.ndarray:
            return allocator.torque(inner(t, state)[:, None], (rates @ state[3:])[:, None])[:, 0]

        return torque


def realise(allocator: Allocator, control: Control, states: States, t: np.ndarray) -> Realised:
    """Allocate a law's wrenches along its own motion, between the samples too.

    Args:
        allocator: limits, criterion and rule.
        control: of the law, with minimum-norm torques.
        states: the law's motion.
        t: (N,) [s] samples, the ends of the horizon among them.

    Returns:
        The control with allocated torques, or why there is none.
    """

    def ask(times: np.ndarray) -> Question:
        state = states(times)
        return allocator.ask(control.torque(times, state), allocator.wheels.wheel_rates @ state[3:])

    if not np.isfinite(ask(t).min_norm).all():
        return Realised(None, Status.FAILED, "the law's torques are not finite along its own motion")
    t = np.union1d(t, peak_times(lambda times: _loads(ask(times)), t))
    asked = ask(t)
    found = solve(asked)
    reachable = found.reachable
    if found.failed.any():
        when = t[found.failed.argmax()]
        return Realised(
            None, Status.FAILED, f"allocation: neither a torque nor its impossibility is shown at t = {when:.3f} s"
        )
    proof = certified(asked.of(reachable), found.torque[:, reachable])
    if not proof.prove.all():
        k = int(np.nan_to_num(proof.largest, nan=np.inf).argmax())
        return Realised(
            None,
            Status.FAILED,
            f"allocation: the torque at t = {t[reachable][k]:.3f} s fails its recomputed residuals "
            f"({proof.largest[k]:.3g}, relative; at most {PROOF:g} is a proof)",
        )
    moved = np.abs(found.torque - asked.min_norm).max(axis=0) > PROOF * np.abs(asked.min_norm).max()
    statistics = {
        "samples": len(t),
        "allocated_samples": int(moved[reachable].sum()),
        "allocation_residual": float(proof.largest.max(initial=0.0)),
    }
    if not reachable.all():
        message = _out_of_reach(allocator, asked, found, t)
        if allocator.rule is None:
            return Realised(None, Status.INFEASIBLE, message)
        # Where B leaves its program nobody knows beforehand when the torques meet their limits; the referee's steps
        # find it, and would be fewer by a tenth if they were told.
        return Realised(
            AllocatedControl(control, allocator, np.array([])),
            message=f"{message}; rule {allocator.rule}: B leaves its program",
            as_demanded=False,
            statistics=statistics | {"out_of_reach_samples": int((~reachable).sum())},
        )

    def form(times: np.ndarray) -> np.ndarray:
        here = ask(times)
        torque = allocator.torque(here.min_norm, here.rates)
        return np.vstack([here.ranges.side(torque), here.criterion.form(torque, here.rates)])

    return Realised(AllocatedControl(control, allocator, change_times(form, t)), statistics=statistics)


def _loads(asked: Question) -> np.ndarray:
    """(k, N) How far each facet of the reachable wrenches and each minimum-norm torque is loaded; 1 is the limit."""
    reach, m, ranges = zonotope(asked.wheels), asked.min_norm, asked.ranges
    along, against = reach.bounds(ranges)
    values = reach.rows @ m
    half = np.maximum((ranges.upper - ranges.lower).min(axis=0) / 2, 1e-12)
    over = np.vstack([values - along, -values - against, m - ranges.upper, ranges.lower - m])
    return 1.0 + over / half


def _out_of_reach(allocator: Allocator, asked: Question, found: Allocation, t: np.ndarray) -> str:
    k = int(found.excess.argmax())
    excess, wheel = float(found.excess[k]), int(found.wheel[k])
    one = asked.of(np.array([k]))
    upper = float(one.min_norm[wheel, 0]) > 0
    bound = float((one.ranges.upper if upper else -one.ranges.lower)[wheel, 0])
    amount = f"{excess:.4f}" if excess >= 5e-5 else f"{excess:.1g}"
    parts = limit_parts(allocator.limits, one.rates)
    name = min(parts, key=lambda part: float((parts[part].upper if upper else -parts[part].lower)[wheel, 0]))
    rate, limits = float(one.rates[wheel, 0]), allocator.limits
    source = {
        "torque": f"limit {bound:g} N m",
        "power": f"limit {bound:.4f} N m by {limits.wheel_power or 0:g} W at {rate:.3f} rad/s",
        "voltage": f"limit {bound:.4f} N m by the torque-speed line at {rate:.3f} rad/s",
    }[name]
    return (
        f"wheel {wheel + 1} torque needs {bound + excess:.4f} N m at t = {t[k]:.3f} s even with the best "
        f"allocation; {source} ({amount} N m too much)"
    )


def peak_times(loads: Callable[[np.ndarray], np.ndarray], t: np.ndarray, rounds: int = 10) -> np.ndarray:
    """Times of the local maxima of several functions between samples, all brackets refined at once.

    Args:
        loads: t (N,) -> (k, N), relative to the limits of the functions.
        t: (N,) [s] increasing samples.
        rounds: each narrows the brackets to a quarter.

    Returns:
        (K,) [s] of the maxima near 1 or above it.
    """
    values = loads(t)
    inner = values[:, 1:-1]
    row, column = np.nonzero((inner >= values[:, :-2]) & (inner > values[:, 2:]) & (inner > NEAR))
    low, high = t[column], t[column + 2]
    if not row.size:
        return np.array([])
    places = np.linspace(0.0, 1.0, 9)
    which = np.arange(len(row))
    for _ in range(rounds):
        times = low[:, None] + (high - low)[:, None] * places
        fine = loads(times.ravel())[np.repeat(row, len(places)), np.arange(times.size)].reshape(times.shape)
        best = np.clip(fine.argmax(axis=1), 1, len(places) - 2)
        low, high = times[which, best - 1], times[which, best + 1]
    return np.asarray((low + high) / 2)


def change_times(form: Callable[[np.ndarray], np.ndarray], t: np.ndarray, most: int = 8) -> np.ndarray:
    """Times at which a piecewise constant vector changes, by bisection of all brackets at once.

    Args:
        form: t (N,) -> (k, N).
        t: (N,) [s] increasing samples.
        most: changes that are looked for between two samples.

    Returns:
        (K,) [s], inside the horizon and apart from each other.
    """
    values = form(t)
    (changed,) = np.nonzero((values[:, 1:] != values[:, :-1]).any(axis=0))
    low, high, left, right = t[changed], t[changed + 1], values[:, changed], values[:, changed + 1]
    times: list[float] = []
    for _ in range(most):
        if not low.size:
            break
        first, last = low.copy(), high.copy()
        for _ in range(52):
            middle = (first + last) / 2
            same = (form(middle) == left).all(axis=0)
            first, last = np.where(same, middle, first), np.where(same, last, middle)
        times += last.tolist()
        # What stands right of the first change may still differ from what stands at the next sample.
        after = form(last)
        more = (after != right).any(axis=0) & (last < high)
        low, high, left, right = last[more], high[more], after[:, more], right[:, more]
    found = np.unique(times)
    span = t[-1] - t[0]
    found = found[(found > t[0] + SAME_TIME * span) & (found < t[-1] - SAME_TIME * span)]
    return found[np.diff(found, prepend=-np.inf) > SAME_TIME * span]
