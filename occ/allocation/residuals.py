"""What proves that a torque is the best allocation, or that there is none: no word of a solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from occ.allocation.input_map import PARALLEL, InputMap
from occ.allocation.least_distance import ROUNDING
from occ.allocation.ranges import TorqueRange

if TYPE_CHECKING:
    from occ.allocation.result import Question

PROOF = 1e-9
"""Largest residual of a proven torque, relative to the sizes of what is compared."""
NEAR = (1e-9, 1e-7, 1e-5, 1e-3)
"""Torques so near to a limit or a kink are tried on it: all multipliers give bounds, and the best of them counts."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """How far torques are from being the solutions of min f(M), C_phi^T M = Pi, lower <= M <= upper; each (N,).

    Args:
        wrench: [N m] largest torque whose wrench is C_phi^T M - Pi.
        limits: [N m] largest excess over a limit.
        value: f of the torques.
        size: of the terms of f, which measures rounding.
        bound: the dual function at the multipliers alone: no torque has a smaller f within the limits, where these
            are widened by the excess.
        torque_size: [N m] largest torque, which measures rounding.
        rounding: of the bound, which adds up terms as large as the multipliers.
    """

    wrench: np.ndarray
    limits: np.ndarray
    value: np.ndarray
    size: np.ndarray
    bound: np.ndarray
    torque_size: np.ndarray
    rounding: np.ndarray

    @property
    def gap(self) -> np.ndarray:
        """(N,) Value minus bound as far as it is more than rounding, relative to the size of the value's terms."""
        gap = self.value - self.bound
        return np.sign(gap) * np.maximum(np.abs(gap) - self.rounding, 0.0) / np.maximum(self.size, 1e-6)

    @property
    def largest(self) -> np.ndarray:
        """(N,) The largest residual, relative; NaN where one is not a number."""
        size = np.maximum(self.torque_size, 1e-6)
        return np.asarray(np.max([self.wrench / size, self.limits / size, np.abs(self.gap)], axis=0))

    @property
    def prove(self) -> np.ndarray:
        """(N,) Whether the torques are the solutions; False, too, where a residual is not a number."""
        return self.largest <= PROOF


def residuals(asked: Question, torque: np.ndarray, force: np.ndarray) -> Residuals:
    """Residuals of the primal and the dual problem, from the problem and its supposed solution alone.

    Args:
        asked: the problem.
        torque: (n, N) [N m] M.
        force: (3, N) lambda, multipliers of the wrench; any numbers give a bound, the right ones a tight one.

    Returns:
        The residuals.

    Source: Boyd and Vandenberghe, Convex Optimization, 5.5 (weak duality, gap).
    """
    wheels, held = asked.wheels, asked.ranges.holding(torque)
    terms = (np.abs(wheels.wheel_rates @ force) * np.abs(torque)).sum(axis=0) + np.abs(force * asked.wrench).sum(axis=0)
    return Residuals(
        wrench=np.abs(wheels.min_norm @ (wheels.wrench(torque) - asked.wrench)).max(axis=0),
        limits=asked.ranges.excess(torque),
        value=asked.criterion.value(torque, asked.rates),
        size=asked.criterion.size(torque, asked.rates),
        bound=asked.criterion.lower_bound(wheels, asked.wrench, held, asked.rates, force),
        torque_size=np.abs(torque).max(axis=0),
        rounding=ROUNDING * terms,
    )


def certified(asked: Question, torque: np.ndarray) -> Residuals:
    """Residuals of torques (n, N) with the multipliers that follow from them.

    Args:
        asked: the problem.
        torque: (n, N) [N m].

    Returns:
        The residuals; they prove the torques or show that these are not the solutions.
    """
    found = _with_own_multipliers(asked, torque, NEAR[0])
    for near in NEAR[1:]:
        doubtful = np.flatnonzero(np.abs(found.gap) > PROOF)
        if not doubtful.size:
            break
        other = _with_own_multipliers(asked.of(doubtful), torque[:, doubtful], near)
        better = np.abs(other.gap) < np.abs(found.gap[doubtful])
        for name in ("bound", "rounding"):
            getattr(found, name)[doubtful[better]] = getattr(other, name)[better]
    return found


def _with_own_multipliers(asked: Question, torque: np.ndarray, near: float) -> Residuals:
    force = asked.criterion.multipliers(asked.wheels, torque, asked.ranges, asked.rates, near)
    return residuals(asked, torque, force)


def proven_excess(wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, force: np.ndarray) -> np.ndarray:
    """sum |y_i| e >= w Pi - max of y M within the ranges, y = C_phi w: what the limits lack, for every w.

    Args:
        wheels: the input map.
        wrench: (3, N) Pi.
        ranges: of the wheels.
        force: (3, N) w, any vectors: the certificates.

    Returns:
        (N,) [N m] by which every limit would have to be wider at least; negative where nothing is proven.
    """
    rows = wheels.wheel_rates @ force
    # A wheel without a limit is not loaded by rounding.
    rows = np.where(np.abs(rows) > PARALLEL * np.abs(rows).sum(axis=0), rows, 0.0)
    size = np.abs(rows).sum(axis=0)
    most = np.where(rows > 0, ranges.upper, ranges.lower) * rows
    lacking = (force * wrench).sum(axis=0) - most.sum(axis=0)
    good = np.isfinite(lacking) & (size > 0)
    return np.where(good, lacking / np.where(good, size, 1.0), -np.inf)
