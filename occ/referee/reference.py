"""End states that a claim may refer to, computed by the referee itself."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from occ.integration import IntegrationError
from occ.model.constraint import path_functions
from occ.motion import kinematics_function
from occ.numeric import BufferedFunction
from occ.task import Task


@lru_cache(maxsize=64)
def servo_end_state(task: Task) -> np.ndarray:
    """x(T) of the servo law: psi' = Omega, Omega' from eq. (3.8), by Adams and BDF formulas.

    Another integrator and another way through the code than the law's own, so that the two check each other.

    Args:
        task: platform, motion, start and horizon.

    Returns:
        (6,) state.

    Raises:
        IntegrationError: the motion cannot be followed to the end.

    Source: Petzold, SIAM J. Sci. Stat. Comput. 4 (1983), 136 (LSODA).
    """
    from scipy.integrate import solve_ivp

    servo = BufferedFunction(path_functions(task.platform.wheel_count)["servo"])
    values = task.motion.values()
    program = BufferedFunction(kinematics_function(type(task.motion), task.motion.structure(), len(values)))
    program.inputs[1][:] = values
    servo.inputs[0][:] = task.path_data[: len(servo.inputs[0])]
    servo.inputs[1][:] = task.point

    def rate(t: float, y: np.ndarray) -> tuple[float, float]:
        program.inputs[0][0] = t
        program()
        servo.inputs[2][0], servo.inputs[3][0] = y
        servo.inputs[4][:], servo.inputs[5][:] = program.outputs[1], program.outputs[2]
        servo()
        return y[1], servo.outputs[0][0]

    start = [task.start.heading, task.start.heading_rate]
    outcome = solve_ivp(rate, (0.0, task.duration), start, method="LSODA", rtol=1e-11, atol=1e-12)
    # LSODA takes what is not a number for a success.
    if not (outcome.success and np.isfinite(outcome.y[:, -1]).all()):
        raise IntegrationError(float(outcome.t[-1]), "the servo law's own motion cannot be followed any further")
    return task.state_on_program(task.duration, *outcome.y[:, -1])
