"""What every criterion of an allocation knows: its value, its bounds by duality, and itself as each solver wants it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from occ.allocation.criteria.slopes import balanced, nearest_to_zero, normal_slope
from occ.allocation.input_map import InputMap
from occ.allocation.ranges import TorqueRange

if TYPE_CHECKING:
    from occ.allocation.result import Question

SAME = 1e-9
"""Torques closer than this, relative to the largest one, are one where a kink is looked for."""


class Programme(NamedTuple):
    """f as a quadratic programme: min z P z / 2 + q z, low <= A z <= high; z begins with the torques in some unit.

    Args:
        quadratic: diagonal of P (m,).
        linear: q (m, N).
        rows: A (h, m), without the rows of wrench and limits.
        low: (h, N).
        high: (h, N).
        value_unit: (N,) f is the programme's value times this, up to a constant.
    """

    quadratic: np.ndarray
    linear: np.ndarray
    rows: np.ndarray
    low: np.ndarray
    high: np.ndarray
    value_unit: np.ndarray


class Criterion(ABC):
    """f(M, phi'), convex in the torques M (n, N) [N m]; phi' (n, N) [rad/s] is given."""

    needs_rates = False

    def check(self, wheel_count: int) -> None:
        """Refuse a platform with another number of wheels than this is meant for.

        Raises:
            InputError: what is wrong and what would be right.
        """
        return

    @abstractmethod
    def value(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """f (N,)."""

    def size(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """(N,) The size of the terms that f adds up, which is f itself where none of them cancel."""
        return self.value(torque, rates)

    @abstractmethod
    def best_null(self, wheels: InputMap, torque: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends (N,) and (N,) of the set of nu that make f(M + nu n) least without any limit; M (n, N), four wheels."""

    @abstractmethod
    def lower_bound(
        self, wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, rates: np.ndarray, force: np.ndarray
    ) -> np.ndarray:
        """(N,) The dual function at the multipliers lambda = force (3, N): no torque of the wrench has a smaller f."""

    @abstractmethod
    def multipliers(
        self, wheels: InputMap, torque: np.ndarray, ranges: TorqueRange, rates: np.ndarray, near: float = SAME
    ) -> np.ndarray:
        """(3, N) lambda at which the dual function meets f, if the torques (n, N) are best; any numbers if not.

        Torques this near to a limit or a kink, relative to their size, are on it.
        """

    @abstractmethod
    def form(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """(n, N) Whole numbers that change where the best torque is not smooth, apart from limits."""

    @abstractmethod
    def of_many(self, asked: Question) -> np.ndarray:
        """(n, N) The best torques of any number of wheels, of several ones those of least norm; NaN where none."""

    @abstractmethod
    def programme(self, rates: np.ndarray, unit: np.ndarray) -> Programme:
        """f as a quadratic programme in the torques M / unit and what else it needs; rates (n, N), unit (N,) [N m]."""

    @abstractmethod
    def written(self, torque: Any, rates: Any) -> Any:
        """f as one would write it on paper, summed over samples: CVXPY's expressions of torques and rates (n, N)."""


class Separable(Criterion):
    """f = sum of f_i(M_i, phi_i')."""

    @abstractmethod
    def terms(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """(n, N) f_i."""

    @abstractmethod
    def tilted(self, pull: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """(n, N) the M_i that makes f_i(M_i) + pull_i M_i least; pull (n, N)."""

    @abstractmethod
    def slopes(self, torque: np.ndarray, rates: np.ndarray, near: float = SAME) -> tuple[np.ndarray, np.ndarray]:
        """(n, N) and (n, N): ends of the interval of f_i's slopes at M_i, a point where f_i is smooth."""

    def value(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return np.asarray(self.terms(torque, rates).sum(axis=0))

    def lower_bound(
        self, wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, rates: np.ndarray, force: np.ndarray
    ) -> np.ndarray:
        """sum_i min over the range of (f_i + (C_phi lambda)_i M_i) - lambda Pi; valid for every lambda."""
        pull = wheels.wheel_rates @ force
        torque = np.clip(self.tilted(pull, rates), ranges.lower, ranges.upper)
        return self.value(torque, rates) + np.asarray((pull * torque).sum(axis=0) - (force * wrench).sum(axis=0))

    def multipliers(
        self, wheels: InputMap, torque: np.ndarray, ranges: TorqueRange, rates: np.ndarray, near: float = SAME
    ) -> np.ndarray:
        """lambda with C_phi lambda = -g, g a slope of f and its limits at M that is normal to all null torques."""
        low, high = self.slopes(torque, rates, near)
        side = ranges.side(torque, near)
        low, high = np.where(side < 0, -np.inf, low), np.where(side > 0, np.inf, high)
        # A wheel whose range is a point is at both ends of it.
        point = ranges.upper - ranges.lower <= 0
        low, high = np.where(point, -np.inf, low), np.where(point, np.inf, high)
        count = wheels.wheel_count
        if count == 4:
            slope = balanced(low, high, wheels.null_torque[:, 0])
        elif count == 3:
            slope = nearest_to_zero(low, high)
        else:
            basis, slope = np.linalg.qr(wheels.wheel_rates)[0], np.zeros_like(low)
            for k in range(slope.shape[1]):
                slope[:, k] = normal_slope(low[:, k], high[:, k], basis)
        return -wheels.min_norm.T @ slope
