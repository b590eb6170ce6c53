"""The weighted norm of the torques; the norm itself is the paper's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.allocation.criteria.base import SAME, Programme, Separable
from occ.allocation.input_map import InputMap
from occ.allocation.least_norm import least_norms
from occ.errors import InputError

if TYPE_CHECKING:
    from occ.allocation.result import Question


@dataclass(frozen=True)
class WeightedNorm(Separable):
    """f = sum w_i M_i^2.

    Args:
        weight: w (n,), positive; None is 1 for every wheel.
    """

    weight: tuple[float, ...] | None = None

    def check(self, wheel_count: int) -> None:
        if self.weight is not None and len(self.weight) != wheel_count:
            raise InputError(f"weights should be {wheel_count} numbers, one for each wheel, not {len(self.weight)}")

    def of(self, wheel_count: int) -> np.ndarray:
        """(n, 1) The weights."""
        return np.ones((wheel_count, 1)) if self.weight is None else np.array(self.weight)[:, None]

    def terms(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return self.of(len(torque)) * torque**2

    def tilted(self, pull: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return -pull / (2 * self.of(len(pull)))

    def slopes(self, torque: np.ndarray, rates: np.ndarray, near: float = SAME) -> tuple[np.ndarray, np.ndarray]:
        slope = 2 * self.of(len(torque)) * torque
        return slope, slope

    def best_null(self, wheels: InputMap, torque: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self.weight is None:
            # The minimum norm is normal to the null torque already.
            zero = np.zeros(1)
            return zero, zero
        weighted = np.array(self.weight) * wheels.null_torque[:, 0]
        best = -(weighted @ torque) / (weighted @ wheels.null_torque[:, 0])
        return best, best

    def form(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return np.zeros((1, torque.shape[1]), dtype=int)

    def of_many(self, asked: Question) -> np.ndarray:
        return least_norms(asked.wheels, asked.min_norm, *asked.bounds, self.of(len(asked.min_norm))[:, 0])

    def programme(self, rates: np.ndarray, unit: np.ndarray) -> Programme:
        n, count = len(rates), len(unit)
        nothing = np.zeros((0, count))
        return Programme(2 * self.of(n)[:, 0], np.zeros((n, count)), np.zeros((0, n)), nothing, nothing, unit**2)

    def written(self, torque: Any, rates: Any) -> Any:
        import cvxpy as cp

        return cp.sum(self.of(torque.shape[0]).T @ cp.square(torque))


LEAST_NORM = WeightedNorm()
