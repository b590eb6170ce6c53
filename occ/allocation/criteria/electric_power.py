"""Electric power without regeneration: convex, and not smooth where a wheel begins to take power."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.allocation.active_set import Powers, least_powers
from occ.allocation.criteria.base import SAME, Programme, Separable
from occ.allocation.criteria.slopes import NO_EFFECT
from occ.allocation.input_map import InputMap
from occ.allocation.least_norm import least_norms
from occ.allocation.reach import tolerance
from occ.allocation.residuals import certified
from occ.objectives import COPPER_LOSS

if TYPE_CHECKING:
    from occ.allocation.result import Question


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

    def slopes(self, torque: np.ndarray, rates: np.ndarray, near: float = SAME) -> tuple[np.ndarray, np.ndarray]:
        place = self._place(torque, rates, near)
        steep = 2 * self.loss * torque + rates
        size = np.abs(rates)
        low = np.where(np.abs(place) == 2, steep, np.where(place == -1, -size, 0.0))
        high = np.where(np.abs(place) == 2, steep, np.where(place == 1, size, 0.0))
        # A wheel that stands is idle at one torque only, and smooth there.
        return low, high

    def form(self, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
        return self._place(torque, rates, SAME)

    def _place(self, torque: np.ndarray, rates: np.ndarray, near: float) -> np.ndarray:
        """-2 below the idle interval, -1 at its lower end, 0 inside, 1 at its upper end, 2 above."""
        low, high = self._idle(rates)
        near = near * np.maximum(np.abs(torque).max(axis=0), 1e-3)
        inside = np.where(torque >= high - near, 1, np.where(torque <= low + near, -1, 0))
        return np.where(torque > high + near, 2, np.where(torque < low - near, -2, inside))

    def best_null(self, wheels: InputMap, torque: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Every nu at which no wheel takes power, or the one nu at which the slope of f changes its sign.

        Wheel i is idle between two nu, and elsewhere the slope of f_i is 2 k n_i^2 (nu - m_i), m_i in the middle of
        these two.  Where all wheels take power, as on most of a motion, the best nu is the mean of the m_i by n_i^2.
        """
        null = wheels.null_torque[:, 0]
        moved = np.abs(null) > NO_EFFECT
        column, weight = null[moved, None], null[moved] ** 2
        one = torque[moved] / -column
        two = one - rates[moved] / (self.loss * column)
        begin, end, middle = np.minimum(one, two), np.maximum(one, two), (one + two) / 2
        best = weight @ middle / weight.sum()
        rest = np.flatnonzero(~((best < begin) | (best > end)).all(axis=0))
        if not rest.size:
            return best, best
        begin, end, middle = begin[:, rest], end[:, rest], middle[:, rest]
        idle, left = begin.max(axis=0), end.min(axis=0)
        steep = idle > left
        idle[steep] = left[steep] = _sign_change(begin[:, steep], end[:, steep], middle[:, steep], weight)
        first, last = best, best.copy()
        first[rest], last[rest] = idle, left
        return first, last

    def of_many(self, asked: Question) -> np.ndarray:
        """In closed form where all wheels take power and no limit is met, by an active set elsewhere."""
        null, (lower, upper) = asked.wheels.null_torque, asked.bounds
        rates = np.broadcast_to(asked.rates, lower.shape)
        torque = asked.min_norm - null @ (null.T @ rates) / (2 * self.loss)
        easy = (torque * rates + self.loss * torque**2 > 0) & (torque <= upper) & (torque >= lower)
        hard = np.flatnonzero(~easy.all(axis=0))
        start = least_norms(asked.wheels, asked.min_norm[:, hard], lower[:, hard], upper[:, hard])
        for k, begin in zip(hard, start.T, strict=True):
            torque[:, k] = self._proven(asked.of(np.array([k])), begin) if np.isfinite(begin).all() else np.nan
        return torque

    def _proven(self, asked: Question, start: np.ndarray) -> np.ndarray:
        """(n,) The best torques of one sample from torques within its limits; NaN where none is proven to be so."""
        lower, upper = asked.bounds
        powers = Powers(asked.rates[:, 0], self.loss, np.hstack([lower, *self._idle(asked.rates), upper]))
        slack = float(tolerance(asked.min_norm)[0])
        for torque in least_powers(powers, asked.wheels.null_torque, start, slack):
            if certified(asked, torque[:, None]).prove[0]:
                return torque
        return np.full(len(start), np.nan)

    def programme(self, rates: np.ndarray, unit: np.ndarray) -> Programme:
        """z = (M, d): d_i >= 0, M_i - d_i <= idle_high, M_i + d_i >= idle_low; f = sum k d_i^2 + |phi_i'| d_i."""
        n, count = len(rates), len(unit)
        rates = np.broadcast_to(rates, (n, count)) / unit
        low, high = self._idle(rates)
        one, zero, none = np.eye(n), np.zeros((n, n)), np.full((n, count), np.inf)
        return Programme(
            np.concatenate([np.zeros(n), np.full(n, 2.0)]),
            np.vstack([np.zeros((n, count)), np.abs(rates) / self.loss]),
            np.block([[one, -one], [one, one], [zero, one]]),
            np.vstack([-none, low, np.zeros((n, count))]),
            np.vstack([high, none, none]),
            self.loss * unit**2,
        )

    def written(self, torque: Any, rates: Any) -> Any:
        import cvxpy as cp

        return cp.sum(cp.pos(cp.multiply(rates, torque) + self.loss * cp.square(torque)))


def _sign_change(begin: np.ndarray, end: np.ndarray, middle: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(N,) Where sum_i w_i (nu - m_i) over the wheels i with nu outside of [begin_i, end_i] changes its sign.

    It rises, in straight pieces and by jumps at the ends; no nu is inside of all intervals.

    Args:
        begin: (p, N).
        end: (p, N).
        middle: m (p, N).
        weight: w (p,).
    """
    ends = np.concatenate([begin, end])
    after = np.zeros_like(ends)
    for i, share in enumerate(weight):
        part = ends - middle[i]
        part *= (ends >= end[i]) | (ends < begin[i])
        part *= share
        after += part
    high = np.where(after >= 0, ends, np.inf).min(axis=0)
    low = np.where(after < 0, ends, -np.inf).max(axis=0)
    between = (low + high) / 2
    takes = weight[:, None] * ((between > end) | (between < begin))
    straight = (takes * middle).sum(axis=0) / takes.sum(axis=0)
    return np.minimum(np.maximum(straight, low), high)
