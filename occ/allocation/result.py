"""What every allocation returns, and what every allocation asks of its arguments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from occ.allocation.criteria.base import Criterion
from occ.allocation.input_map import InputMap
from occ.allocation.ranges import TorqueRange, checked_range
from occ.allocation.reach import tolerance, zonotope
from occ.errors import InputError


@dataclass(frozen=True, eq=False)
class Allocation:
    """Wheel torques for N wrenches.

    Args:
        torque: (n, N) [N m]; NaN where no torque was found.
        reachable: (N,) whether some torque within the limits makes the wrench.
        excess: (N,) [N m] by how much every wheel's limits would have to be wider; 0 where reachable.
        wheel: (N,) wheel (from 0) that lacks it; -1 where reachable.
        failed: (N,) whether neither a torque nor its impossibility could be shown.
    """

    torque: np.ndarray
    reachable: np.ndarray
    excess: np.ndarray
    wheel: np.ndarray
    failed: np.ndarray

    @classmethod
    def of_all(cls, torque: np.ndarray) -> Allocation:
        """Torques (n, N) of wrenches that are all in reach."""
        count = torque.shape[1]
        nothing = np.zeros(count, dtype=bool)
        return cls(torque, ~nothing, np.zeros(count), np.full(count, -1), nothing)

    def put(self, which: np.ndarray, part: Allocation) -> None:
        """Replace the allocations of some samples."""
        for field in fields(self):
            getattr(self, field.name)[..., which] = getattr(part, field.name)

    @classmethod
    def joined(cls, parts: Sequence[Allocation]) -> Allocation:
        """The allocations of several batches of samples as one."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts], axis=-1) for field in fields(cls)))


@dataclass(frozen=True, eq=False)
class Question:
    """The checked arguments of an allocation.

    Args:
        wheels: the input map.
        wrench: (3, N) Pi.
        min_norm: (n, N) [N m] minimum-norm torques of the wrenches.
        ranges: of the wheels.
        criterion: what is least.
        rates: (n, N) [rad/s] phi', or zeros (n, 1) where the criterion asks for none.
    """

    wheels: InputMap
    wrench: np.ndarray
    min_norm: np.ndarray
    ranges: TorqueRange
    criterion: Criterion
    rates: np.ndarray

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, N) and (n, N) [N m] lower and upper limits of each sample, to be read only."""
        lower, upper = (np.broadcast_to(end, self.min_norm.shape) for end in (self.ranges.lower, self.ranges.upper))
        return lower, upper

    def answer(self, torque: np.ndarray, failed: np.ndarray | None = None) -> Allocation:
        """The result for given torques (n, N): reach, excess and wheel follow from the wrenches alone."""
        reach = zonotope(self.wheels)
        excess, row = reach.excess(self.min_norm, self.ranges)
        reachable = excess <= tolerance(self.min_norm)
        wheel = np.full(len(reachable), -1)
        failed = np.zeros(len(reachable), dtype=bool) if failed is None else failed
        out = ~reachable
        if out.any():
            wheel[out] = reach.binding(row[out], self.min_norm[:, out], self.ranges.of(out))
        torque = np.where(reachable & ~failed, torque, np.nan)
        return Allocation(torque, reachable & ~failed, np.where(reachable, 0.0, excess), wheel, failed)

    def of(self, which: np.ndarray | slice) -> Question:
        """The same about some of the samples."""
        rates = self.rates if self.rates.shape[1] == 1 else self.rates[:, which]
        return Question(
            self.wheels,
            self.wrench[:, which],
            self.min_norm[:, which],
            self.ranges.of(which),
            self.criterion,
            rates,
        )


def question(
    wheels: InputMap,
    wrench: np.ndarray,
    limits: float | TorqueRange,
    criterion: Criterion,
    rates: np.ndarray | None = None,
) -> Question:
    """The arguments of an allocation as numbers that can be meant.

    Args:
        wheels: the input map.
        wrench: (3, N) [N, N, N m].
        limits: one limit [N m] of every wheel, or a range of each.
        criterion: what is least.
        rates: (n, N) [rad/s] phi', where the criterion asks for them.

    Returns:
        The same, checked.

    Raises:
        InputError: names what is wrong and what would be right.
    """
    wrench = _numbers("wrench", wrench, (3, -1))
    count, samples = wheels.wheel_count, wrench.shape[1]
    criterion.check(count)
    ranges = checked_range(limits, count, samples)
    if rates is None:
        if criterion.needs_rates:
            raise InputError(
                f"rates should be given as an array (n, N) in rad/s: {type(criterion).__name__} asks for them"
            )
        rates = np.zeros((count, 1))
    else:
        rates = _numbers("rates", rates, (count, samples))
    return Question(wheels, wrench, wheels.min_norm @ wrench, ranges, criterion, rates)


def _numbers(name: str, value: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    wanted = f"({shape[0]}, {'N' if shape[1] < 0 else shape[1]})"
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} should be an array of numbers of the shape {wanted}, not {value!r}") from error
    if array.ndim != 2 or len(array) != shape[0] or shape[1] not in (-1, array.shape[1]):
        raise InputError(f"{name} should have the shape {wanted}, not {array.shape}")
    if not np.isfinite(array.sum()):
        bad = ~np.isfinite(array).all(axis=0)
        if bad.any():
            k = int(bad.argmax())
            raise InputError(f"{name} should be finite; sample {k} is {array[:, k].tolist()}")
    return array
