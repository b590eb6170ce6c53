"""Allocated torques along a law's own motion: is each wrench in reach, and when does a wheel meet its limit?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from occ.allocation import closed_form
from occ.allocation.input_map import InputMap
from occ.allocation.osqp_qp import BoxLimitedQp
from occ.allocation.result import Allocation
from occ.control import Control
from occ.errors import Status

States = Callable[[np.ndarray], np.ndarray]
"""x (6, N) of a motion at any times t (N,)."""

NEAR = 0.95
"""Peaks between samples are looked for where a sample comes this near to the limit."""
AGREEMENT = 1e-7
"""Largest difference between closed form and OSQP, relative to the limit."""
AT_LIMIT = 1e-9
"""A torque this near to its limit, relative to it, is on it."""
SAME_TIME = 1e-9
"""Times closer than this part of the horizon are one."""


@dataclass(frozen=True)
class Realised:
    """What became of a law's torques under an allocation.

    Args:
        control: what is handed to the referee; None where there is none.
        status: ``OK``, ``INFEASIBLE`` (a wrench is out of reach) or ``FAILED`` (the allocation could not be shown).
        message: why, in words with numbers and units.
        statistics: of the solver.
    """

    control: Control | None
    status: Status = Status.OK
    message: str = ""
    statistics: dict[str, Any] = field(default_factory=dict)


class BoxLimited:
    """The allocation of least norm within the box, by the closed form where there is one, else by OSQP.

    Args:
        wheels: the input map.
        limit: [N m].
    """

    def __init__(self, wheels: InputMap, limit: float) -> None:
        self.wheels, self.limit = wheels, limit
        self.by_qp = BoxLimitedQp(wheels, limit)
        self.has_closed_form = wheels.wheel_count <= 4

    def allocate(self, min_norm: np.ndarray) -> Allocation:
        """From minimum-norm torques (n, N) [N m]."""
        wrench = self.wheels.wrench(min_norm)
        if self.has_closed_form:
            return closed_form.allocate(self.wheels, wrench, self.limit)
        return self.by_qp.allocate(wrench)

    def torque(self, min_norm: np.ndarray) -> np.ndarray:
        """Torques (n, N) [N m]; the minimum norm itself where it holds the limit, and where nothing does.

        In the latter case the wrench is kept and the limit is not, which every check of the limit sees.
        """
        torque = min_norm.copy()
        over = np.abs(min_norm).max(axis=0) > self.limit
        if over.any():
            found = self.allocate(min_norm[:, over])
            torque[:, over] = np.where(found.reachable, found.torque, min_norm[:, over])
        return torque


class AllocatedControl:
    """M(t, x) of least norm within the box, from a control with minimum-norm torques.

    Args:
        min_norm: the law's own control.
        box: the allocation.
        knots: (K,) [s] times at which a wheel comes on to its limit or leaves it.
    """

    def __init__(self, min_norm: Control, box: BoxLimited, knots: np.ndarray) -> None:
        self.min_norm, self.box, self._knots = min_norm, box, knots

    @property
    def knots(self) -> np.ndarray:
        return np.union1d(self.min_norm.knots, self._knots)

    def torque(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        return self.box.torque(self.min_norm.torque(t, state))

    def segment(self, start: float, end: float) -> Callable[[float, np.ndarray], np.ndarray]:
        inner, box = self.min_norm.segment(start, end), self.box

        def torque(t: float, state: np.ndarray) -> np.ndarray:
            m = inner(t, state)
            # Most calls end here, where speed counts.
            return m if np.abs(m).max() <= box.limit else box.torque(m[:, None])[:, 0]

        return torque


def realise(wheels: InputMap, limit: float, control: Control, states: States, t: np.ndarray) -> Realised:
    """Allocate a law's wrenches along its own motion, between the samples too.

    Args:
        wheels: the input map.
        limit: [N m], of every wheel.
        control: of the law, with minimum-norm torques.
        states: the law's motion.
        t: (N,) [s] samples, the ends of the horizon among them.

    Returns:
        The control with allocated torques, or why there is none.
    """
    box = BoxLimited(wheels, limit)

    def min_norm(times: np.ndarray) -> np.ndarray:
        return control.torque(times, states(times))

    def loads(times: np.ndarray) -> np.ndarray:
        torque = min_norm(times)
        return np.vstack([np.abs(torque), np.abs(wheels.facets @ torque)]) / limit

    t = np.union1d(t, peak_times(loads, t))
    torque = min_norm(t)
    if not np.isfinite(torque).all():
        return Realised(None, Status.FAILED, "the law's torques are not finite along its own motion")
    over = np.abs(torque).max(axis=0) > limit
    if not over.any():
        return Realised(AllocatedControl(control, box, np.array([])))
    found = box.allocate(torque[:, over])
    if not (found.reachable | found.failed).all():
        return Realised(None, Status.INFEASIBLE, _out_of_reach(found, t[over], limit))
    wrench = wheels.wrench(torque[:, over])
    by_qp = box.by_qp.allocate(wrench) if box.has_closed_form else found
    # Where OSQP decides nothing, as at the very border of what is in reach, the closed form has to prove itself.
    undecided = by_qp.failed.copy()
    if box.has_closed_form and undecided.any():
        undecided[undecided] = ~closed_form.proven(wheels, wrench[:, undecided], found.torque[:, undecided], limit)
    if undecided.any():
        when = t[over][undecided.argmax()]
        return Realised(
            None, Status.FAILED, f"allocation: what OSQP returns at t = {when:.3f} s fails its recomputed residuals"
        )
    difference = np.where(by_qp.failed, 0.0, np.abs(found.torque - by_qp.torque).max(axis=0))
    if not difference.max() <= AGREEMENT * limit:
        k = int(difference.argmax())
        return Realised(
            None,
            Status.FAILED,
            f"allocation: closed form and OSQP differ by {difference[k]:.3g} N m at t = {t[over][k]:.3f} s",
        )
    statistics = {
        "allocated_samples": int(over.sum()),
        "undecided_by_osqp": int(by_qp.failed.sum()),
        "allocation_residual": box.by_qp.worst,
        "allocation_difference_Nm": float(difference.max()),
    }

    def on_limit(times: np.ndarray) -> np.ndarray:
        m = box.torque(min_norm(times))
        return np.sign(m) * (np.abs(m) >= limit * (1 - AT_LIMIT))

    return Realised(AllocatedControl(control, box, change_times(on_limit, t)), statistics=statistics)


def _out_of_reach(found: Allocation, t: np.ndarray, limit: float) -> str:
    k = int(found.excess.argmax())
    excess = float(found.excess[k])
    amount = f"{excess:.4f}" if excess >= 5e-5 else f"{excess:.1g}"
    return (
        f"wheel {found.wheel[k] + 1} torque needs {limit + excess:.4f} N m at t = {t[k]:.3f} s even with the best "
        f"allocation; limit {limit:g} N m ({amount} N m too much)"
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
