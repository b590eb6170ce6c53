"""Laws that keep B on its program: each is one choice of the yaw acceleration.

To add a law: write a frozen dataclass with `kind` and `yaw_acceleration` in a file of this folder and put it into
`LAWS` of this package.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import ClassVar, Self

import casadi as ca
import numpy as np

from occ.allocation import AllocationOption, MinNorm
from occ.checks import NonNegative, check_fields
from occ.control import SymbolicControl
from occ.errors import InputError, Status
from occ.integration import OUT_OF_RANGE, CompiledStep, IntegrationError, Settings, integrate
from occ.model.coefficients import Coefficients, packed_size, unpack
from occ.model.constraint import OnProgram, PathSymbols, path_functions
from occ.motion import ProgramMotion, kinematics_function
from occ.numeric import evaluate_many
from occ.task import Claim, Solution, Start, StartClass, Task
from occ.trajectory import Trajectory

LARGEST_YAW_RATE = 1e4
"""[rad/s] A yaw rate beyond this is reported as unstable."""
LEAST_STEPS = 40
"""Of the yaw equation's integration in a horizon."""
SAMPLES_PER_SECOND = 40
LAWS_KEPT = 64
"""Laws, each with its parameters, whose functions are remembered."""
MIN_NORM = MinNorm()


@dataclass(frozen=True)
class Moment:
    """What a path-keeping law may look at, all CasADi expressions.

    Args:
        t: [s].
        heading: [rad] psi.
        yaw_rate: [rad/s] Omega.
        program_velocity: (2,) [m/s] of B on the floor.
        program_acceleration: (2,) [m/s^2] of B on the floor.
        point: (2,) [m] B in the body frame.
        matrices: of the platform, eq. (2.16).
        on_program: pseudo-velocity and its rate that keep B on its program: reconstructed by eqs. (3.6), (3.7), or
            measured, and then with the accelerations of a stabilisation.
    """

    t: ca.SX
    heading: ca.SX
    yaw_rate: ca.SX
    program_velocity: ca.SX
    program_acceleration: ca.SX
    point: ca.SX
    matrices: Coefficients
    on_program: OnProgram


@dataclass(frozen=True, kw_only=True)
class Stabilisation:
    """e'' + velocity e' + position e = 0 for the error e of B on the floor: desired dynamics of the constraint.

    Args:
        position: [1/s^2] of the distance of B from its program.
        velocity: [1/s] of the difference of B's velocity to its program.

    Source: Baumgarte, Stabilization of constraints and integrals of motion in dynamical systems, Comput. Methods Appl.
    Mech. Eng. 1 (1972).
    """

    position: NonNegative
    velocity: NonNegative

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class PathKeepingLaw(ABC):
    """pi' = C Omega + V*, eq. (3.7), with Omega' chosen by the law; the wrench follows, and its share of each wheel.

    V_X and V_Y are reconstructed from heading and yaw rate by eq. (3.6); they are measured, like the position, where
    there is a stabilisation or the class says so.  On the program all of these are one law.

    Args:
        allocation: how the wrench is shared among the wheels; the motion is the same for every choice within limits.
        stabilisation: of B on its program; without it an error of its position never heals.
    """

    kind: ClassVar[str]
    start_class: ClassVar[StartClass] = "given"
    measures_velocity: ClassVar[bool] = False
    allocation: AllocationOption = MIN_NORM
    stabilisation: Stabilisation | None = None

    def __post_init__(self) -> None:
        check_fields(self)

    @abstractmethod
    def yaw_acceleration(self, moment: Moment) -> ca.SX:
        """Omega' [rad/s^2], a CasADi expression of the moment (a plain number is one, too)."""

    def start(self, task: Task) -> Start:
        """Heading and yaw rate with which the law starts; the task's unless the law has its own."""
        return task.start

    def check(self, task: Task) -> None:
        """Refuse a task on which the law has no start.

        Raises:
            InputError: what is wrong and what would be right.
        """
        self.start(task)
        self.allocation.check(task)

    def solve(self, task: Task) -> Solution:
        """Integrate the law's yaw equation and return its torques as feedback of (t, heading, yaw rate).

        Args:
            task: what to do.

        Returns:
            Solution of keep class ``path`` and free end; ``INFEASIBLE`` where the allocation holds the task's limits
            and cannot on the law's own motion; keep class ``none`` where it changes the wrench instead.
        """
        self.check(task)
        _, torque = _law_functions(self, task.platform.wheel_count, *task.motion_structure)
        begin = self.start(task)
        claim = Claim(start=self.start_class)
        first = task.state_on_program(0.0, begin.heading, begin.heading_rate)
        control = SymbolicControl(torque, task.path_data, knots=task.motion.knots(task.duration))
        t = np.linspace(0.0, task.duration, max(201, 1 + int(SAMPLES_PER_SECOND * min(task.duration, 1e3))))
        motion, reason = yaw_motion(self, task, tolerance=1e-11)
        if motion is None:
            return Solution(control=control, start_state=first, claim=claim, status=Status.UNSTABLE, message=reason)
        realised = self.allocation.realise(
            task, control, lambda times: task.states_on_program(times, *motion(times)[:2]), t
        )
        kept = realised.as_demanded
        return Solution(
            control=realised.control,
            start_state=first,
            claim=claim if kept else replace(claim, keep="none"),
            claimed=path_trajectory(task, t, *motion(t)) if kept else None,
            status=realised.status,
            message=realised.message,
            statistics=realised.statistics,
        )


@dataclass(frozen=True)
class _PathArguments:
    """Symbols of a path-keeping control: (t, state, data) and what follows from them."""

    t: ca.SX
    state: ca.SX
    data: ca.SX
    symbols: PathSymbols
    program_position: ca.SX

    @classmethod
    def create(cls, wheel_count: int, motion: type[ProgramMotion], structure: tuple[int, ...], size: int) -> Self:
        """From the structure of the task; ``data`` is laid out as `Task.path_data`."""
        t, state = ca.SX.sym("t"), ca.SX.sym("state", 6)
        packed = packed_size(wheel_count)
        data = ca.SX.sym("data", packed + 2 + size)
        position, velocity, acceleration = kinematics_function(motion, structure, size)(t, data[packed + 2 :])
        symbols = PathSymbols(data[:packed], data[packed : packed + 2], state[2], state[5], velocity, acceleration)
        return cls(t, state, data, symbols, position)

    def moment(self, wheel_count: int, on_program: OnProgram) -> Moment:
        """What a law sees if this is its motion."""
        symbols = self.symbols
        return Moment(
            t=self.t,
            heading=symbols.heading,
            yaw_rate=symbols.yaw_rate,
            program_velocity=symbols.program_velocity,
            program_acceleration=symbols.program_acceleration,
            point=symbols.point,
            matrices=unpack(symbols.coefficients, wheel_count),
            on_program=on_program,
        )

    def measured(self, stabilisation: Stabilisation | None) -> OnProgram:
        """The measured pi', and the rest of pi'' that makes B accelerate as its program, or as its error asks for.

        Without stabilisation this is the derivative of program (3.1); with it V_B' + Omega x V_B = R^T (r_B*'' -
        velocity e' - position e) for the body components V_B of B's velocity and the error e on the floor.
        """
        reconstructed, velocity = self.symbols.on_program(), self.state[3:]
        if stabilisation is None:
            return OnProgram(reconstructed.direction, velocity, reconstructed.rest)
        c, s = ca.cos(self.state[2]), ca.sin(self.state[2])
        to_floor = ca.blockcat([[c, -s], [s, c]])
        b_x, b_y = ca.vertsplit(self.symbols.point)
        body = ca.vertcat(velocity[0] - velocity[2] * b_y, velocity[1] + velocity[2] * b_x)
        error = self.state[:2] + to_floor @ self.symbols.point - self.program_position
        error_rate = to_floor @ body - self.symbols.program_velocity
        wanted = self.symbols.program_acceleration - stabilisation.velocity * error_rate
        wanted = to_floor.T @ (wanted - stabilisation.position * error)
        turning = ca.vertcat(velocity[2] * body[1], -velocity[2] * body[0])
        return OnProgram(reconstructed.direction, velocity, ca.vertcat(wanted + turning, 0))


@lru_cache(maxsize=LAWS_KEPT)
def _law_functions(
    law: PathKeepingLaw, wheel_count: int, motion: type[ProgramMotion], structure: tuple[int, ...], size: int
) -> tuple[ca.Function, ca.Function]:
    """CasADi functions yaw (t, heading, yaw_rate, data) -> Omega' and torque (t, state, signal, data) -> M."""
    path = _PathArguments.create(wheel_count, motion, structure, size)
    reconstructed = path.symbols.on_program()
    measuring = law.measures_velocity or law.stabilisation is not None
    felt = path.measured(law.stabilisation) if measuring else reconstructed
    matrices = unpack(path.symbols.coefficients, wheel_count)
    wrench = matrices.wrench(felt.velocity, felt.direction * _chosen(law, path.moment(wheel_count, felt)) + felt.rest)
    heading, yaw_rate = ca.SX.sym("heading"), ca.SX.sym("yaw_rate")
    chosen = _chosen(law, path.moment(wheel_count, reconstructed))
    reduced = ca.substitute(chosen, path.state, ca.vertcat(0, 0, heading, 0, 0, yaw_rate))
    return (
        ca.Function("yaw", [path.t, heading, yaw_rate, path.data], [ca.densify(reduced)]),
        ca.Function(
            "law", [path.t, path.state, ca.SX.sym("signal", 0), path.data], [ca.densify(matrices.min_norm @ wrench)]
        ),
    )


@lru_cache(maxsize=LAWS_KEPT)
def _yaw_equation(
    law: PathKeepingLaw, wheel_count: int, motion: type[ProgramMotion], structure: tuple[int, ...], size: int
) -> ca.Function:
    """CasADi function (t, (psi, Omega), data) -> (Omega, Omega')."""
    yaw, _ = _law_functions(law, wheel_count, motion, structure, size)
    t, x, data = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("data", yaw.numel_in(3))
    return ca.Function("yaw_equation", [t, x, data], [ca.vertcat(x[1], yaw(t, x[0], x[1], data))])


def _chosen(law: PathKeepingLaw, moment: Moment) -> ca.SX:
    """The law's yaw acceleration as one expression."""
    value = law.yaw_acceleration(moment)
    try:
        chosen = ca.SX(value)
    except NotImplementedError as error:
        raise InputError(f"yaw_acceleration gives {value!r}; should be a number or a CasADi expression") from error
    if chosen.shape != (1, 1):
        raise InputError(f"yaw_acceleration has the shape {chosen.shape}; should be one expression in rad/s^2")
    return chosen


@cache
def open_loop_function(
    wheel_count: int, motion: type[ProgramMotion], structure: tuple[int, ...], size: int
) -> ca.Function:
    """M(t, x, u, data) of a given yaw acceleration u_1 and null torques u_2.. with B on its program, eq. (3.7).

    Args:
        wheel_count: n.
        motion: class of the program motion.
        structure: of the motion.
        size: number of the motion's values.

    Returns:
        CasADi function (t, state (6,), signal (1 + n - 3,), data) -> torque (n,) [N m].
    """
    path = _PathArguments.create(wheel_count, motion, structure, size)
    signal = ca.SX.sym("signal", wheel_count - 2)
    torque = path_functions(wheel_count)["torque"](*path.symbols, signal[0], signal[1:])
    return ca.Function("open_loop", [path.t, path.state, signal, path.data], [ca.densify(torque)])


def law_motion(law: PathKeepingLaw, task: Task, t: np.ndarray, tolerance: float) -> tuple[np.ndarray | None, str]:
    """Heading, yaw rate and yaw acceleration of a law at the times t, or None with the reason.

    Args:
        law: whose yaw equation is integrated.
        task: platform, motion and start.
        t: (N,) [s].
        tolerance: of the integrator.

    Returns:
        (3, N) and an empty reason, or None and the reason.
    """
    motion, reason = yaw_motion(law, task, tolerance)
    return (None if motion is None else motion(t)), reason


def yaw_motion(
    law: PathKeepingLaw, task: Task, tolerance: float
) -> tuple[Callable[[np.ndarray], np.ndarray] | None, str]:
    """psi' = Omega, Omega' = yaw(t, psi, Omega), integrated by an explicit Runge-Kutta method of order 8.

    Args:
        law: whose yaw equation is integrated.
        task: platform, motion and start.
        tolerance: relative and absolute, of the integrator.

    Returns:
        The motion t (N,) [s] -> (3, N) heading, yaw rate, yaw acceleration and an empty reason, or None and the reason.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5 (DOP853).
    """
    structure = (law, task.platform.wheel_count, *task.motion_structure)
    yaw, _ = _law_functions(*structure)
    step = CompiledStep(_yaw_equation(*structure), tolerance)
    step.parameters(task.path_data)
    start = law.start(task)
    knots = task.motion.knots(task.duration)
    edges = np.concatenate([[0.0], knots[(knots > 0.0) & (knots < task.duration)], [task.duration]])
    bounds = Settings(longest=task.duration / LEAST_STEPS, largest=np.array([np.inf, LARGEST_YAW_RATE]))
    try:
        steps = integrate(step, edges, np.array([start.heading, start.heading_rate]), bounds, lambda k, x: None)
    except IntegrationError as error:
        left = f"the yaw rate passes {LARGEST_YAW_RATE:g} rad/s or is not a number"
        return None, f"{left if error.reason == OUT_OF_RANGE else error.reason} at t = {error.t:.4g} s"

    def motion(t: np.ndarray) -> np.ndarray:
        heading, omega = steps(t)
        (acceleration,) = evaluate_many(yaw, t[None, :], heading[None, :], omega[None, :], task.path_data, shared=(3,))
        return np.vstack([heading, omega, acceleration])

    return motion, ""


def path_trajectory(
    task: Task, t: np.ndarray, heading: np.ndarray, yaw_rate: np.ndarray, yaw_acceleration: np.ndarray
) -> Trajectory:
    """The full motion of the platform from its rotation while B is on its program, eqs. (2.1), (3.6), (3.7).

    Args:
        task: platform, point and motion.
        t: (N,) [s].
        heading: (N,) [rad].
        yaw_rate: (N,) [rad/s].
        yaw_acceleration: (N,) [rad/s^2].

    Returns:
        States and their rates.
    """
    state = task.states_on_program(t, heading, yaw_rate)
    _, velocity, acceleration = task.motion.at(t)
    c, s = np.cos(heading), np.sin(heading)
    b_x, b_y = task.point
    v_star = np.array([c * velocity[0] + s * velocity[1], -s * velocity[0] + c * velocity[1]])
    a_star = np.array([c * acceleration[0] + s * acceleration[1], -s * acceleration[0] + c * acceleration[1]])
    rate = np.vstack(
        [
            c * state[3] - s * state[4],
            s * state[3] + c * state[4],
            yaw_rate,
            a_star[0] + yaw_rate * v_star[1] + b_y * yaw_acceleration,
            a_star[1] - yaw_rate * v_star[0] - b_x * yaw_acceleration,
            yaw_acceleration,
        ]
    )
    return Trajectory(t, state, rate)
