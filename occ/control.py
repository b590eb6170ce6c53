"""What a player hands to the referee: wheel torques as a function of time and state.

The referee integrates the platform's own dynamics under a `Control`; it never takes the player's word for the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import casadi as ca
import numpy as np

from occ.numeric import BufferedFunction, evaluate_many
from occ.trajectory import PiecewisePolynomial


class Control(Protocol):
    """M(t, x): wheel torques [N m] from time [s] and state (6,)."""

    @property
    def knots(self) -> np.ndarray:
        """(K,) [s] Times inside the horizon at which the torques are not smooth."""
        ...

    def torque(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        """M (n, N) [N m] at the times t (N,) [s] and states (6, N)."""
        ...

    def segment(self, start: float, end: float) -> Callable[[float, np.ndarray], np.ndarray]:
        """The same at single times of one smooth piece [start, end]: a fast function (t, state (6,)) -> M (n,).

        What it returns may be overwritten by its next call.
        """
        ...


class SymbolicControl:
    """M = law(t, x, u(t), data) with a CasADi function and, where it has one, an open-loop signal u(t).

    Args:
        law: CasADi function (t, state (6,), signal (m,), data (d,)) -> torque (n,).
        data: (d,) the numbers of the task.
        signal: u(t), m signals; None where the law is a pure feedback (m = 0).
        knots: (K,) [s] times at which the law itself is not smooth, those of its program motion for example.
    """

    def __init__(
        self,
        law: ca.Function,
        data: np.ndarray,
        signal: PiecewisePolynomial | None = None,
        knots: np.ndarray | None = None,
    ) -> None:
        self.law, self.data, self.signal = law, data, signal
        self._knots = np.array([]) if knots is None else knots

    @property
    def knots(self) -> np.ndarray:
        return self._knots if self.signal is None else np.union1d(self.signal.edges[1:-1], self._knots)

    def torque(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        signal = np.zeros((0, len(t))) if self.signal is None else self.signal(t)
        return evaluate_many(self.law, t[None, :], state, signal, self.data, shared=(3,))[0]

    def segment(self, start: float, end: float) -> Callable[[float, np.ndarray], np.ndarray]:
        call = BufferedFunction(self.law)
        call.inputs[3][:] = self.data
        time, states, signals, _ = call.inputs
        (result,) = call.outputs
        signal = self.signal
        interval = 0 if signal is None else signal.interval((start + end) / 2)

        def torque(t: float, state: np.ndarray) -> np.ndarray:
            time[0] = t
            states[:] = state
            if signal is not None:
                signals[:] = signal.within(interval, t)
            call()
            return result

        return torque


class PythonControl:
    """M = function(t, x), any Python function of one time and one state.

    Args:
        function: (t [s], state (6,)) -> torque (n,) [N m].
        knots: (K,) [s] times at which it is not smooth.
    """

    def __init__(self, function: Callable[[float, np.ndarray], np.ndarray], knots: np.ndarray | None = None) -> None:
        self.function = function
        self._knots = np.array([]) if knots is None else np.asarray(knots, dtype=float)

    @property
    def knots(self) -> np.ndarray:
        return self._knots

    def torque(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        return np.column_stack([self.function(float(time), state[:, i]) for i, time in enumerate(t)])

    def segment(self, start: float, end: float) -> Callable[[float, np.ndarray], np.ndarray]:
        return self.function


class HeldControl:
    """M = M_k on [t_k, t_k+1): what a sampled controller has given at each sample, held until the next one.

    Args:
        edges: (K + 1,) [s] samples, and the end of the horizon.
        values: (n, K) [N m].
    """

    def __init__(self, edges: np.ndarray, values: np.ndarray) -> None:
        self.edges, self.values = edges, values

    @property
    def knots(self) -> np.ndarray:
        return self.edges[1:-1]

    def torque(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        place = np.searchsorted(self.edges, t, side="right") - 1
        return self.values[:, np.clip(place, 0, self.values.shape[1] - 1)]

    def segment(self, start: float, end: float) -> Callable[[float, np.ndarray], np.ndarray]:
        held = self.torque(np.array([(start + end) / 2]), np.empty((6, 1)))[:, 0]
        return lambda t, state: held
