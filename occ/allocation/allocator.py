"""Every allocation comes in here: of given wrenches, or along the motions of a platform with limits and a rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.allocation import closed_form
from occ.allocation.criteria import LEAST_NORM, Criterion
from occ.allocation.input_map import InputMap
from occ.allocation.out_of_reach import Rule, nearest_wrench
from occ.allocation.ranges import TorqueRange, torque_range
from occ.allocation.result import Allocation, Question, question
from occ.task import Limits


def solve(asked: Question) -> Allocation:
    """The best allocation of checked arguments: in closed form up to four wheels, and by the criterion for more."""
    if asked.wheels.wheel_count <= 4:
        return closed_form.solve(asked)
    answer = asked.answer(asked.criterion.of_many(asked))
    # What no torque was found for although the facets say that there is one has failed.
    lost = answer.reachable & np.isnan(answer.torque).any(axis=0)
    return asked.answer(answer.torque, lost) if lost.any() else answer


def allocate(
    wheels: InputMap,
    wrench: np.ndarray,
    limits: float | TorqueRange,
    criterion: Criterion = LEAST_NORM,
    rates: np.ndarray | None = None,
) -> Allocation:
    """min f(M) subject to C_phi^T M = Pi, lower_i <= M_i <= upper_i; of several best torques the one of least norm.

    Args:
        wheels: input map of any number of wheels.
        wrench: (3, N) [N, N, N m].
        limits: one limit [N m] of every wheel, or a range of each.
        criterion: f.
        rates: (n, N) [rad/s] phi', where f asks for them.

    Returns:
        The allocation; NaN torques where the wrench is out of reach, ``failed`` where nothing could be shown.

    Raises:
        InputError: arguments that cannot be meant; names what is wrong and what would be right.
    """
    return solve(question(wheels, wrench, limits, criterion, rates))


@dataclass(frozen=True, eq=False)
class Allocator:
    """Minimum-norm torques and wheel rates -> allocated torques.

    Args:
        wheels: the input map.
        limits: of the task.
        criterion: f.
        rule: for wrenches out of reach; None leaves these as they are.
        inertia: (3, 3) A of the platform.
    """

    wheels: InputMap
    limits: Limits
    criterion: Criterion
    rule: Rule | None
    inertia: np.ndarray

    def ask(self, min_norm: np.ndarray, rates: np.ndarray) -> Question:
        """The problem of minimum-norm torques (n, N) [N m] at wheel rates (n, N) [rad/s]."""
        ranges = torque_range(self.limits, rates)
        return Question(self.wheels, self.wheels.wrench(min_norm), min_norm, ranges, self.criterion, rates)

    def torque(self, min_norm: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Torques (n, N) [N m], within the limits wherever the wrench is in reach or a rule makes it so.

        Without a rule a wrench out of reach is kept and the limits are not, which every check of the limits sees.
        """
        asked = self.ask(min_norm, rates)
        if self.criterion is LEAST_NORM and not asked.ranges.excess(min_norm).any():
            return min_norm
        found = solve(asked)
        if found.reachable.all():
            return self._within(asked, found.torque)
        torque = np.where(found.reachable, self._within(asked, found.torque), min_norm)
        if self.rule is not None:
            out = np.flatnonzero(~found.reachable & ~found.failed)
            lost = asked.of(out)
            wrench = nearest_wrench(self.wheels, lost.wrench, lost.ranges, self.rule, self.inertia)
            moved = Question(
                self.wheels, wrench, self.wheels.min_norm @ wrench, lost.ranges, self.criterion, lost.rates
            )
            kept = self._within(moved, solve(moved).torque)
            torque[:, out] = np.where(np.isfinite(kept), kept, min_norm[:, out])
        return torque

    @staticmethod
    def _within(asked: Question, torque: np.ndarray) -> np.ndarray:
        """Torques that pass a limit by rounding are on it."""
        return np.clip(torque, asked.ranges.lower, asked.ranges.upper)
