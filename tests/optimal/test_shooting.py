"""An independent check of the optima: multiple shooting of Pontryagin's conditions with an adaptive integrator.

Nothing of the optimal room is used but the guess: the motion with B on its program is written down here again, the
torques come from the model's inverse dynamics, and the conditions of optimality from CasADi's derivatives of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from occ.errors import Status
from occ.model.presets import youbot
from occ.motion import Circle, Ellipse, RestToRestLine, kinematics_function
from occ.numeric import BufferedFunction
from occ.optimal.collocation import Collocation
from occ.referee import examine
from occ.task import Start, Task
from tests.tasks import POINT

TASKS = {
    "circle": Task(platform=youbot(), point=POINT, motion=Circle(radius=0.7, rate=-0.4, phase=np.pi / 2), duration=5.0),
    "ellipse": Task(
        platform=youbot(wheel_friction=0.2),
        point=(-0.1, 0.2),
        motion=Ellipse(semi_axes=(0.7, 0.4), rate=-0.6, tilt=0.4),
        duration=4.0,
        start=Start(heading=0.4, heading_rate=-0.3),
    ),
    "rest to rest": Task(
        platform=youbot(),
        point=POINT,
        motion=RestToRestLine(start=(0.0, 0.0), end=(0.6, 0.8), duration=4.0),
        duration=4.0,
    ),
}


@dataclass
class Shooting:
    """x' = f, lambda' = -H_x, H_u = 0, H = sum M_i^2 + lambda f, x = (psi, Omega); the cost is a fifth state."""

    task: Task
    edges: np.ndarray

    def __post_init__(self) -> None:
        task = self.task
        t, x, costate, u = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("costate", 2), ca.SX.sym("u")
        values = task.motion.values()
        program = kinematics_function(type(task.motion), task.motion.structure(), len(values))
        velocity = program(t, ca.DM(values))[1]
        c, s = ca.cos(x[0]), ca.sin(x[0])
        pseudo = ca.vertcat(
            c * velocity[0] + s * velocity[1] + x[1] * task.point[1],
            -s * velocity[0] + c * velocity[1] - x[1] * task.point[0],
            x[1],
        )
        rate = ca.vertcat(x[1], u)
        acceleration = ca.jtimes(pseudo, ca.vertcat(t, x), ca.vertcat(1, rate))
        state = ca.vertcat(0, 0, x[0], pseudo)
        torque = task.dynamics.min_norm_torque(task.dynamics.inverse(state, acceleration))
        cost = ca.sumsqr(torque)
        hamiltonian = cost + ca.dot(costate, rate)
        # Quadratic in u.
        slope = ca.gradient(hamiltonian, u)
        best = -ca.substitute(slope, u, 0) / ca.jacobian(slope, u)
        derivative = ca.vertcat(rate, -ca.gradient(hamiltonian, x), cost)
        y = ca.vertcat(x, costate, ca.SX.sym("cost"))
        self.rate = ca.Function("rate", [t, y], [ca.densify(ca.substitute(derivative, u, best))])
        self.guess_costate = ca.Function("costate", [t, x, u], [-ca.gradient(cost, u), ca.gradient(cost, x)])

    def through(self, k: int, y: np.ndarray) -> np.ndarray:
        """(5,) The end of interval k from its start (4,), the last entry being its cost."""
        call = BufferedFunction(self.rate)

        def rate(t: float, values: np.ndarray) -> np.ndarray:
            call.inputs[0][0], call.inputs[1][:] = t, values
            call()
            return call.outputs[0].copy()

        span = self.edges[k], self.edges[k + 1]
        return np.asarray(solve_ivp(rate, span, np.append(y, 0.0), method="DOP853", rtol=1e-10, atol=1e-11).y[:, -1])

    def solve(self, y: np.ndarray, end: list[int]) -> tuple[np.ndarray, float]:
        """Newton's method on the matching conditions.

        Args:
            y: (4, N + 1) guess of states and costates.
            end: entries of (x, costate) that vanish at the end.

        Returns:
            The solution (4, N + 1) and its cost.
        """
        count = len(self.edges) - 1
        start = y[:2, 0].copy()
        for _ in range(12):
            residual, jacobian = np.zeros(4 * (count + 1)), np.zeros((4 * (count + 1), 4 * (count + 1)))
            costs = np.zeros(count)
            for k in range(count):
                rows = slice(4 * k, 4 * k + 4)
                whole = self.through(k, y[:, k])
                costs[k] = whole[4]
                residual[rows] = whole[:4] - y[:, k + 1]
                jacobian[rows, 4 * k + 4 : 4 * k + 8] = -np.eye(4)
                for j in range(4):
                    step = 1e-6 * max(1.0, abs(y[j, k]))
                    moved = y[:, k] + step * np.eye(4)[j]
                    jacobian[rows, 4 * k + j] = (self.through(k, moved)[:4] - whole[:4]) / step
            residual[-4:-2], residual[-2:] = y[:2, 0] - start, y[end, -1]
            jacobian[-4, 0] = jacobian[-3, 1] = 1.0
            jacobian[-2, 4 * count + end[0]] = jacobian[-1, 4 * count + end[1]] = 1.0
            if np.abs(residual).max() < 1e-8:
                return y, float(costs.sum())
            y = y - np.linalg.solve(jacobian, residual).reshape(count + 1, 4).T
        raise AssertionError(f"no convergence: {np.abs(residual).max():.2g}")


@pytest.mark.parametrize("name", TASKS)
def test_the_optimum_satisfies_pontryagins_conditions(name: str) -> None:
    task = TASKS[name]
    end = "rest" if name == "rest to rest" else "free"
    verdict = examine(task, Collocation(objective="torque_squared", end=end, tolerance=1e-8).solve(task))
    assert verdict.record.status is Status.OK, verdict.record.message
    assert verdict.replay is not None
    shooting = Shooting(task, np.linspace(0.0, task.duration, 2 + int(task.duration / 0.3)))
    guess = np.zeros((4, len(shooting.edges)))
    motion = verdict.replay.at(shooting.edges)
    guess[:2] = motion[[2, 5]]
    for k, t in enumerate(shooting.edges):
        near = np.clip([t - 1e-4, t, t + 1e-4], 0.0, task.duration)
        states = verdict.replay.at(near)
        acceleration = (states[5, 2] - states[5, 0]) / (near[2] - near[0])
        moments = [shooting.guess_costate(at, states[[2, 5], j], acceleration) for j, at in enumerate(near)]
        guess[3, k] = float(moments[1][0])
        guess[2, k] = -float(moments[2][0] - moments[0][0]) / (near[2] - near[0]) - float(moments[1][1][1])
    # A free end has no costates; at rest only the heading is free.
    found, cost = shooting.solve(guess, [1, 2] if end == "rest" else [2, 3])
    assert verdict.record.measures["torque_squared_N2m2s"] == pytest.approx(cost, rel=1e-6)
    np.testing.assert_allclose(motion[[2, 5]], found[:2], atol=1e-5)
