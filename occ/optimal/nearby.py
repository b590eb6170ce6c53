"""A solution of a task nearby as the start of a search: its mesh, its motion and its torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occ.control import Control
from occ.errors import InputError, Status
from occ.task import Solution, Task
from occ.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Nearby:
    """x(c t), M(c t): the motion of a solution on another horizon, c the old one over the new one.

    Called as a `Rotation` it gives heading, yaw rate and yaw acceleration only.

    Args:
        control: torques of the solution.
        claimed: its motion.
        duration: [s] of the new horizon.
    """

    control: Control
    claimed: Trajectory
    duration: float

    @classmethod
    def of(cls, solution: Solution, task: Task) -> Nearby:
        """From a solution that collocation has found.

        Args:
            solution: of a task nearby.
            task: the new one.

        Returns:
            The start of a search.

        Raises:
            InputError: there is no solution in it, no motion or no mesh, or another number of wheels.
        """
        control, claimed = solution.control, solution.claimed
        if solution.status is not Status.OK or control is None or claimed is None or not control.knots.size:
            raise InputError(
                f"Collocation: near should be a solution that collocation has found, with a mesh and status 'ok'; "
                f"its status is {solution.status.value!r}, its message {solution.message!r}"
            )
        wheels = len(control.torque(claimed.t[:1], claimed.state[:, :1]))
        if wheels != task.platform.wheel_count:
            raise InputError(
                f"Collocation: near should be a solution for {task.platform.wheel_count} wheels, not for {wheels}"
            )
        return cls(control, claimed, task.duration)

    @property
    def edges(self) -> np.ndarray:
        """(N + 1,) [s] The mesh of the solution, on the new horizon."""
        ends = self.claimed.t[[0, -1]]
        return np.asarray(np.concatenate([ends[:1], self.control.knots, ends[1:]]) / self._pace)

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """(3, N) Heading [rad], yaw rate and yaw acceleration at the times t (N,) [s]."""
        state = self._state(self._pace * t)
        acceleration = np.interp(self._pace * t, self.claimed.t, self.claimed.state_rate[5])
        return np.vstack([state[2], self._pace * state[5], self._pace**2 * acceleration])

    def motion(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States (6, N) and torques (n, N) [N m] at the times t (N,) [s]; torques as they are, whatever the pace."""
        state = self._state(self._pace * t)
        torque = self.control.torque(self._pace * t, state)
        state[3:] *= self._pace
        return state, torque

    @property
    def _pace(self) -> float:
        return float((self.claimed.t[-1] - self.claimed.t[0]) / self.duration)

    def _state(self, t: np.ndarray) -> np.ndarray:
        return np.asarray(self._spline(t)).T

    @cached_property
    def _spline(self) -> Callable[[np.ndarray], np.ndarray]:
        from scipy.interpolate import CubicHermiteSpline

        return CubicHermiteSpline(self.claimed.t, self.claimed.state.T, self.claimed.state_rate.T)
