"""The motion that wheel torques in time really make, integrated apart from the collocation.

The torques are handed over, not the polynomials of the states: a tube or an end is held by the motion that the torques
make, from which the polynomials differ by the error between the nodes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from occ.control import Control
from occ.model.coefficients import coefficients
from occ.model.dynamics import forward_function
from occ.numeric import BufferedFunction
from occ.task import Task

TOLERANCE = 1e-10
"""Of the integrator: well below what the referee lets pass, and cheaper than its own."""


class DrivenMotion:
    """x(t) with pi'' = A^-1 (C_phi^T M(t) - f - Z pi'), eqs. (2.1), (2.16).

    Args:
        task: platform and horizon.
        control: the wheel torques; smooth between its knots.
        start: (6,) x(0).

    Attributes:
        edges: (K + 1,) [s] knots, start and end.
        edge_states: (6, K + 1) x there.
        end_state: (6,) the last of them.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5 and II.6 (DOP853, dense output).
    """

    def __init__(self, task: Task, control: Control, start: np.ndarray) -> None:
        from scipy.integrate import solve_ivp

        self.task = task
        forward = BufferedFunction(forward_function(task.platform.wheel_count))
        forward.inputs[0][:] = coefficients(task.platform)
        self.edges = np.concatenate([[0.0], control.knots, [task.duration]])
        self._pieces: list[Callable[[np.ndarray], np.ndarray]] = []
        self.start = state = start
        states = [start]
        for begin, end in zip(self.edges[:-1], self.edges[1:], strict=True):
            rate = _rate(forward, control.segment(begin, end))
            method = {"method": "DOP853", "dense_output": True, "rtol": TOLERANCE, "atol": TOLERANCE}
            result = solve_ivp(rate, (begin, end), state, **method)
            self._pieces.append(result.sol)
            state = result.y[:, -1]
            states.append(state)
        self.end_state, self.edge_states = state, np.stack(states, axis=1)

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """x (6, N) at the times t (N,) [s]."""
        piece = np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, len(self._pieces) - 1)
        state = np.empty((6, len(t)))
        for k in np.unique(piece):
            state[:, piece == k] = self._pieces[k](t[piece == k])
        return state


def _rate(
    forward: BufferedFunction, torque: Callable[[float, np.ndarray], np.ndarray]
) -> Callable[[float, np.ndarray], np.ndarray]:
    """x' as a fast function of t and x."""
    _, states, torques = forward.inputs
    (result,) = forward.outputs

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        torques[:] = torque(t, state)
        states[:] = state
        forward()
        return result.copy()

    return rate
