"""The largest torque of all wheels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.allocation.criteria.base import SAME, Criterion, Programme
from occ.allocation.criteria.slopes import NO_EFFECT
from occ.allocation.input_map import InputMap
from occ.allocation.least_distance import ROUNDING
from occ.allocation.least_norm import least_norms
from occ.allocation.ranges import TorqueRange

if TYPE_CHECKING:
    from occ.allocation.result import Question


@dataclass(frozen=True)
class LargestTorque(Criterion):
    """f = max |M_i|; of several best torques the one of least norm is meant."""

    def value(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(torque).max(axis=0))

    def best_null(self, wheels: InputMap, torque: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        null = wheels.null_torque[:, 0]
        moved = np.abs(null) > NO_EFFECT
        middle, half = -torque[moved] / null[moved, None], wheels.least_peak(torque) / np.abs(null[moved, None])
        low, high = (middle - half).max(axis=0), (middle + half).min(axis=0)
        # Most often the set is a point, whose two ends rounding may exchange.
        mean = (low + high) / 2
        return np.minimum(low, mean), np.maximum(high, mean)

    def lower_bound(
        self, wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, rates: np.ndarray, force: np.ndarray
    ) -> np.ndarray:
        """max |M_i| >= t where sum |y_i| min(t, b_i) = -lambda Pi, y = -C_phi lambda, b_i the limit of y_i."""
        return peak_bound(ranges, -wheels.wheel_rates @ force, -(force * wrench).sum(axis=0))

    def multipliers(
        self, wheels: InputMap, torque: np.ndarray, ranges: TorqueRange, rates: np.ndarray, near: float = SAME
    ) -> np.ndarray:
        return -wheels.min_norm.T @ least_peak_rows(wheels, torque, ranges.holding(torque))[1]

    def form(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        size = np.abs(torque)
        return np.sign(torque).astype(int) * (size >= size.max(axis=0) * (1 - SAME))

    def of_many(self, asked: Question) -> np.ndarray:
        """A least norm within a smaller box: |M_i| <= t with the least possible t."""
        peak, _ = least_peak_rows(asked.wheels, asked.min_norm, asked.ranges)
        lower, upper = asked.bounds
        return least_norms(asked.wheels, asked.min_norm, np.maximum(lower, -peak), np.minimum(upper, peak))

    def programme(self, rates: np.ndarray, unit: np.ndarray) -> Programme:
        """z = (M, t): M_i - t <= 0 <= M_i + t, and t is least."""
        n, count = len(rates), len(unit)
        one, column = np.eye(n), np.ones((n, 1))
        none, zero = np.full((n, count), np.inf), np.zeros((n, count))
        return Programme(
            np.zeros(n + 1),
            np.vstack([np.zeros((n, count)), np.ones((1, count))]),
            np.block([[one, -column], [one, column]]),
            np.vstack([-none, zero]),
            np.vstack([zero, none]),
            unit,
        )

    def written(self, torque: Any, rates: Any) -> Any:
        import cvxpy as cp

        return cp.sum(cp.max(cp.abs(torque), axis=0))


def least_peak_rows(wheels: InputMap, torque: np.ndarray, ranges: TorqueRange) -> tuple[np.ndarray, np.ndarray]:
    """The least possible largest torque within the ranges, by the facets of all boxes |M_i| <= t within them.

    Args:
        wheels: the input map.
        torque: (n, N) [N m] any torques of the wrenches.
        ranges: of the wheels.

    Returns:
        (N,) [N m], and the facets (n, N) that prove it.
    """
    best, chosen = np.full(torque.shape[1], -np.inf), np.zeros_like(torque)
    for facet in (*wheels.facets, *-wheels.facets):
        rows = np.broadcast_to(facet[:, None], torque.shape)
        bound = peak_bound(ranges, rows, facet @ torque)
        chosen = np.where(bound > best, rows, chosen)
        best = np.maximum(best, bound)
    return best, chosen


def peak_bound(ranges: TorqueRange, rows: np.ndarray, value: np.ndarray) -> np.ndarray:
    """The least t with sum |y_i| min(t, b_i) >= value; no torque with y M = value has a smaller largest entry.

    Args:
        ranges: b_i is the upper limit where y_i > 0 and minus the lower one elsewhere.
        rows: (n, N) y.
        value: (N,) [N m].

    Returns:
        (N,) [N m].
    """
    size = np.abs(rows)
    b = np.where(rows > 0, ranges.upper, -ranges.lower)
    # Wheels that the row does not load come last and change nothing.
    order = np.argsort(np.where(size > 0, b, np.inf), axis=0)
    size, b = np.take_along_axis(size, order, axis=0), np.take_along_axis(np.broadcast_to(b, size.shape), order, axis=0)
    # With the first k wheels at their limits the others share what is left.
    used = np.concatenate([np.zeros((1, size.shape[1])), np.cumsum(np.where(size > 0, size * b, 0.0), axis=0)[:-1]])
    left = np.cumsum(size[::-1], axis=0)[::-1]
    # Wheels that the row hardly loads would make much of what rounding leaves to them.
    lacking = value - used - ROUNDING * (np.abs(value) + np.abs(used))
    needs = np.divide(lacking, left, out=np.zeros_like(left), where=left > 0)
    least = np.maximum(ranges.lower, -ranges.upper).max(axis=0)
    return np.asarray(np.maximum(needs.max(axis=0), least.clip(0.0)))
