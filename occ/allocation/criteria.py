"""What an allocation makes least: value, the best null torque of four wheels, and bounds from multipliers alone.

To add a criterion that is a sum over the wheels: a class with the four methods that `Separable` asks for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from occ.allocation.input_map import InputMap
from occ.allocation.ranges import TorqueRange
from occ.errors import InputError
from occ.objectives import COPPER_LOSS

NO_EFFECT = 1e-12
"""A wheel whose share in the unit null torque is below this is not moved by it."""
SAME = 1e-9
"""Torques closer than this, relative to the largest one, are one where a kink is looked for."""


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
    def multipliers(self, wheels: InputMap, torque: np.ndarray, ranges: TorqueRange, rates: np.ndarray) -> np.ndarray:
        """(3, N) lambda at which the dual function meets f, if the torques (n, N) are best; any numbers if not."""

    @abstractmethod
    def form(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """(n, N) Whole numbers that change where the best torque is not smooth, apart from limits."""


class Separable(Criterion):
    """f = sum of f_i(M_i, phi_i')."""

    @abstractmethod
    def terms(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """(n, N) f_i."""

    @abstractmethod
    def tilted(self, pull: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """(n, N) the M_i that makes f_i(M_i) + pull_i M_i least; pull (n, N)."""

    @abstractmethod
    def slopes(self, torque: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, N) and (n, N): ends of the interval of f_i's slopes at M_i, which is a point where f_i is smooth."""

    def value(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return np.asarray(self.terms(torque, rates).sum(axis=0))

    def lower_bound(
        self, wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, rates: np.ndarray, force: np.ndarray
    ) -> np.ndarray:
        """sum_i min over the range of (f_i + (C_phi lambda)_i M_i) - lambda Pi; valid for every lambda."""
        pull = wheels.wheel_rates @ force
        torque = np.clip(self.tilted(pull, rates), ranges.lower, ranges.upper)
        return self.value(torque, rates) + np.asarray((pull * torque).sum(axis=0) - (force * wrench).sum(axis=0))

    def multipliers(self, wheels: InputMap, torque: np.ndarray, ranges: TorqueRange, rates: np.ndarray) -> np.ndarray:
        """lambda with C_phi lambda = -g, g a slope of f and its limits at M that is normal to all null torques."""
        low, high = self.slopes(torque, rates)
        side = ranges.side(torque)
        low, high = np.where(side < 0, -np.inf, low), np.where(side > 0, np.inf, high)
        # A wheel whose range is a point is at both ends of it.
        point = ranges.upper - ranges.lower <= 0
        low, high = np.where(point, -np.inf, low), np.where(point, np.inf, high)
        count = wheels.wheel_count
        if count == 4:
            slope = _balanced(low, high, wheels.null_torque[:, 0])
        elif count == 3:
            slope = _nearest_to_zero(low, high)
        else:
            slope = np.column_stack(
                [_normal_slope(low[:, k], high[:, k], wheels.null_torque) for k in range(torque.shape[1])]
            )
        return -wheels.min_norm.T @ slope


def _nearest_to_zero(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.minimum(np.maximum(low, 0.0), high)


def _balanced(low: np.ndarray, high: np.ndarray, null: np.ndarray) -> np.ndarray:
    """g (n, N) between low and high with n g = 0 for the one null torque n (n,), where there is one."""
    slope = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high, 0.0))
    up, down = high - slope, slope - low
    column = null[:, None]
    lacking = -(null @ slope)
    # What a wheel can still add to n g in the direction in which it lacks.
    room = np.abs(column) * np.where(np.sign(column) * np.sign(lacking) > 0, up, down)
    room = np.where(np.abs(column) > NO_EFFECT, room, 0.0)
    free = np.isinf(room)
    total = np.where(np.isinf(room), 0.0, room).sum(axis=0)
    share = np.divide(np.abs(lacking), total, out=np.zeros_like(total), where=total > 0)
    finite = np.where(free, 0.0, room) * np.minimum(share, 1.0)
    # Of the wheels at a limit one takes all of it, as a limit pulls as hard as it must.
    first = (np.cumsum(free, axis=0) == 1) & free
    added = np.where(free.any(axis=0), np.where(first, np.abs(lacking), 0.0), finite)
    safe = np.where(np.abs(column) > NO_EFFECT, column, 1.0)
    return slope + np.sign(lacking) * added / safe


def _normal_slope(low: np.ndarray, high: np.ndarray, null: np.ndarray) -> np.ndarray:
    """g (n,) between low and high with null^T g as near to zero as possible, for several null torques (n, k)."""
    from scipy.optimize import lsq_linear

    slope = _nearest_to_zero(low, high)
    free = high > low
    if free.any():
        slope = np.where(free, 0.0, slope)
        right = -null.T @ slope
        slope[free] = lsq_linear(null[free].T, right, (low[free], high[free]), method="bvls", tol=1e-14).x
    return slope


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

    def slopes(self, torque: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


@dataclass(frozen=True)
class ElectricPower(Separable):
    """f = sum max(M_i phi_i' + k M_i^2, 0): electric power without regeneration, what a brake resistor burns is lost.

    With d_i the distance of M_i from the interval between 0 and -phi_i'/k, in which a wheel returns power,
    f_i = k d_i^2 + |phi_i'| d_i: convex, with a kink at both ends of the interval.

    Args:
        loss: k [W/(N m)^2] copper loss.
    """

    loss: float = COPPER_LOSS
    needs_rates = True

    def _idle(self, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends (n, N) of the interval of torques that take no power."""
        other = -rates / self.loss
        return np.minimum(other, 0.0), np.maximum(other, 0.0)

    def terms(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return np.maximum(torque * rates + self.loss * torque**2, 0.0)

    def size(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return np.asarray((np.abs(torque * rates) + self.loss * torque**2).sum(axis=0))

    def tilted(self, pull: np.ndarray, rates: np.ndarray) -> np.ndarray:
        low, high = self._idle(rates)
        beyond = np.maximum(np.abs(pull) - np.abs(rates), 0.0) / (2 * self.loss)
        return np.where(pull > 0, low - beyond, np.where(pull < 0, high + beyond, np.clip(0.0, low, high)))

    def slopes(self, torque: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        place = self.form(torque, rates)
        steep = 2 * self.loss * torque + rates
        size = np.abs(rates)
        low = np.where(np.abs(place) == 2, steep, np.where(place == -1, -size, 0.0))
        high = np.where(np.abs(place) == 2, steep, np.where(place == 1, size, 0.0))
        # A wheel that stands is idle at one torque only, and smooth there.
        return low, high

    def form(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """-2 below the idle interval, -1 at its lower end, 0 inside, 1 at its upper end, 2 above."""
        low, high = self._idle(rates)
        near = SAME * np.maximum(np.abs(torque).max(axis=0), 1e-9)
        inside = np.where(torque >= high - near, 1, np.where(torque <= low + near, -1, 0))
        return np.where(torque > high + near, 2, np.where(torque < low - near, -2, inside))

    def best_null(self, wheels: InputMap, torque: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The slope of f along nu rises between the ends of the idle intervals in straight pieces: where it is zero."""
        null = wheels.null_torque[:, 0]
        moved = np.abs(null) > NO_EFFECT
        size = np.abs(null[moved])[:, None]
        one, two = -torque[moved] / null[moved, None], (-rates[moved] / self.loss - torque[moved]) / null[moved, None]
        begin, end = np.minimum(one, two), np.maximum(one, two)
        rate = np.abs(rates[moved])
        corners = np.concatenate([begin, end])

        def slope(nu: np.ndarray, right: bool) -> np.ndarray:
            """(2 n, N) The slope of f on one side of the corners nu (2 n, N)."""
            total = np.zeros_like(nu)
            for i in range(len(begin)):
                over, under = nu - end[i], begin[i] - nu
                rises, falls = (over >= 0, under > 0) if right else (over > 0, under >= 0)
                total += np.where(rises, size[i] * (2 * self.loss * size[i] * over + rate[i]), 0.0)
                total -= np.where(falls, size[i] * (2 * self.loss * size[i] * under + rate[i]), 0.0)
            return total

        after, before = slope(corners, True), slope(corners, False)
        return (
            _first_zero(corners, before, after),
            -_first_zero(-corners, -after, -before),
        )


def _first_zero(corners: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(N,) Where a rising slope, straight between corners (k, N), is first not negative.

    Args:
        corners: in any order.
        before: slope on the left of each.
        after: slope on the right of each.
    """
    column = np.arange(corners.shape[1])
    place = np.where(after >= 0, corners, np.inf).argmin(axis=0)
    last = np.where(after < 0, corners, -np.inf).argmax(axis=0)
    corner, rise = corners[place, column], before[place, column]
    inside = (rise > 0) & (after[last, column] < 0)
    left, fall = corners[last, column], after[last, column]
    share = np.divide(-fall, rise - fall, out=np.zeros_like(rise), where=inside)
    return np.where(inside, left + (corner - left) * share, corner)


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

    def multipliers(self, wheels: InputMap, torque: np.ndarray, ranges: TorqueRange, rates: np.ndarray) -> np.ndarray:
        return -wheels.min_norm.T @ least_peak_rows(wheels, torque, ranges)[1]

    def form(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        size = np.abs(torque)
        return np.sign(torque).astype(int) * (size >= size.max(axis=0) * (1 - SAME))


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
    # Where no wheel is left but by rounding, the quotient is nothing but rounding.
    needs = np.divide(value - used, left, out=np.zeros_like(left), where=left > SAME * left[0])
    least = np.maximum(ranges.lower, -ranges.upper).max(axis=0)
    return np.asarray(np.maximum(needs.max(axis=0), least.clip(0.0)))


LEAST_NORM = WeightedNorm()
