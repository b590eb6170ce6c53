"""The reduced formulation: V_X, V_Y eliminated by eq. (3.6); state (heading, yaw rate), control the yaw acceleration.

The program's velocity and acceleration enter as numbers at the nodes, so one nonlinear program serves every motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from occ.laws.base import law_motion
from occ.laws.servo import ServoLaw
from occ.model.coefficients import coefficients, unpack
from occ.model.constraint import PathSymbols, on_program
from occ.model.dynamics import friction_time
from occ.objectives import OBJECTIVES
from occ.optimal.limits import NEEDS_NULL_TORQUE, limit_values
from occ.optimal.mesh import SchemeName
from occ.optimal.transcription import Bounds, Nodes, Numbers, Problem, SolverOptions, Transcription
from occ.task import Task


@cache
def reduced_problem(wheel_count: int, objective: str, limits: tuple[str, ...] = ()) -> Problem:
    """psi' = Omega, Omega' = u_1; pi' = C Omega + V*, M = minimum norm + null torque, eqs. (3.6), (3.7), (2.16).

    Signed work is taken as change of kinetic energy plus dissipation, which holds exactly along every motion and leaves
    no quadrature error of the torque for the optimiser to exploit.

    Args:
        wheel_count: n.
        objective: name of an objective.
        limits: names of the limited quantities; the null torques (n - 3,) are controls u_2.. where a limit sees them.

    Returns:
        Problem with node data (r_B*', r_B*'') (4,) and parameters: packed matrices, point B, r_B*' at start and end,
        and the factor of u_1^2 that is added to the integrand (see `damping`);
        path conditions: the limited quantities of every wheel; boundary conditions: x(T) - x(0).
    """
    symbols = PathSymbols.create(wheel_count)
    k = unpack(symbols.coefficients, wheel_count)
    motion = symbols.on_program()
    u = ca.SX.sym("yaw_acceleration")
    null = ca.SX.sym("null_torque", wheel_count - 3 if set(limits) & set(NEEDS_NULL_TORQUE) else 0)
    torque = k.min_norm @ k.wrench(motion.velocity, motion.direction * u + motion.rest)
    if null.numel():
        torque += k.null_torque @ null
    rates = k.wheel_rates @ motion.velocity
    quantities = {"torque": torque, "wheel_speed": rates, "wheel_power": torque * rates}
    chosen = OBJECTIVES[objective]
    integrand = chosen.work_share * ca.bilin(k.friction, motion.velocity, motion.velocity)
    if chosen.rest:
        integrand += chosen.rest(torque, rates)
    start, end = ca.SX.sym("start", 2), ca.SX.sym("end", 2)
    velocities = ca.SX.sym("end_velocities", 4)
    damping = ca.SX.sym("damping")
    still = ca.SX.zeros(2)
    energies = [
        k.kinetic_energy(on_program(symbols.point, state[0], state[1], velocity, still).velocity)
        for state, velocity in ((start, velocities[:2]), (end, velocities[2:]))
    ]
    return Problem(
        state=ca.vertcat(symbols.heading, symbols.yaw_rate),
        control=ca.vertcat(u, null),
        data=ca.vertcat(symbols.program_velocity, symbols.program_acceleration),
        parameters=ca.vertcat(symbols.coefficients, symbols.point, velocities, damping),
        start=start,
        end=end,
        rate=ca.vertcat(symbols.yaw_rate, u),
        integrand=integrand + damping * u**2,
        terminal=chosen.work_share * (energies[1] - energies[0]),
        path=ca.vertcat(*(quantities[name] for name in limits)) if limits else ca.SX(0, 1),
        boundary=end - start,
    )


DAMPING = 1e-6


@dataclass(frozen=True)
class Structure:
    """What has to be the same for a nonlinear program to be used again."""

    wheel_count: int
    objective: str
    intervals: int
    degree: int
    scheme: SchemeName
    limits: tuple[str, ...] = ()


@cache
def reduced_transcription(structure: Structure, options: SolverOptions) -> Transcription:
    """The nonlinear program of a structure, built once in a process.

    Args:
        structure: wheels, objective and mesh sizes.
        options: of the solver.

    Returns:
        A transcription of `reduced_problem`.
    """
    problem = reduced_problem(structure.wheel_count, structure.objective, structure.limits)
    return Transcription(problem, structure.intervals, structure.degree, structure.scheme, options)


def program_data(task: Task, t: np.ndarray) -> np.ndarray:
    """r_B*' and r_B*'' at times t of any shape; result (4, *t.shape) [m/s, m/s^2]."""
    _, velocity, acceleration = task.motion.at(t.ravel())
    return np.vstack([velocity, acceleration]).reshape(4, *t.shape)


@dataclass(frozen=True, kw_only=True)
class Ends:
    """Bounds of (heading, yaw rate) at both ends, and of their difference; each of two entries."""

    start: Bounds
    end: Bounds
    difference: Bounds


def damping(task: Task, structure: Structure) -> float:
    """c J_a tau [J s^3], the factor of u^2, where nothing else determines the control; 0 elsewhere.

    A cost without curvature in the torque sees the yaw rate at the collocation points only.  With Radau points every
    yaw rate is one; with Legendre points those at the edges are not, and the smallest cost of u^2 settles them.

    Args:
        task: for the scale.
        structure: objective and scheme.

    Returns:
        The factor; c is so small that the cost changes by less than 1e-7 of its value.
    """
    if structure.scheme == "radau" or OBJECTIVES[structure.objective].rest is not None:
        return 0.0
    k = task.dynamics.coefficients
    direction = np.array([task.point[1], -task.point[0], 1.0])
    inertia = float(direction @ np.array(k.inertia) @ direction)
    return DAMPING * inertia * min(friction_time(task.platform), task.duration)


def numbers_of(
    task: Task, transcription: Transcription, edges: np.ndarray, ends: Ends, damping: float = 0.0
) -> Numbers:
    """The numbers of a task for a transcription, with the task's limits at the nodes.

    Args:
        task: platform, point, motion and limits.
        transcription: of the reduced problem.
        edges: (N + 1,) [s].
        ends: bounds at both ends.
        damping: factor of the yaw acceleration squared in the integrand.

    Returns:
        Numbers.
    """
    velocities = task.motion.at(np.array([0.0, task.duration]))[1]
    limits = limit_values(task.limits, task.platform.wheel_count)
    return Numbers(
        edges=edges,
        data=program_data(task, transcription.node_times(edges)),
        parameters=np.concatenate([coefficients(task.platform), task.point, velocities.ravel(order="F"), [damping]]),
        start=ends.start,
        end=ends.end,
        path=Bounds(lower=-limits, upper=limits),
        boundary=ends.difference,
    )


def guess_from_law(task: Task, transcription: Transcription, edges: np.ndarray, turn: float | None = None) -> Nodes:
    """The servo law's rotation on a mesh, or a rotation at constant rate where the law is unstable.

    Args:
        task: what to do.
        transcription: for its nodes.
        edges: (N + 1,) [s].
        turn: [rad] net turn of the heading; a uniform rotation is added to the law's to reach it; None adds none.

    Returns:
        States and controls to start from; null torques are zero.
    """
    points = transcription.node_times(edges)
    t, index = np.unique(np.concatenate([edges, points.ravel()]), return_inverse=True)
    motion, _ = law_motion(ServoLaw(), task, t, tolerance=1e-7)
    if motion is None:
        heading = task.start.heading + task.start.heading_rate * t
        motion = np.vstack([heading, np.full_like(t, task.start.heading_rate), np.zeros_like(t)])
    if turn is not None:
        rate = (turn - (motion[0, -1] - motion[0, 0])) / task.duration
        motion = motion + np.vstack([rate * t, np.full_like(t, rate), np.zeros_like(t)])
    values = motion[:, index]
    count = len(edges)
    inner = values[:, count:].reshape(3, *points.shape)
    null = np.zeros((transcription.problem.control.numel() - 1, *points.shape))
    return Nodes(values[:2, :count], inner[:2], np.concatenate([inner[2:], null]))
