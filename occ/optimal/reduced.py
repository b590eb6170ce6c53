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
from occ.objectives import OBJECTIVES
from occ.optimal.mesh import SchemeName
from occ.optimal.transcription import Bounds, Nodes, Numbers, Problem, SolverOptions, Transcription
from occ.task import Task


@cache
def reduced_problem(wheel_count: int, objective: str) -> Problem:
    """psi' = Omega, Omega' = u; pi' = C Omega + V*, M = minimum norm, eqs. (3.6), (3.7), (2.16).

    Signed work is taken as change of kinetic energy plus dissipation, which holds exactly along every motion and leaves
    no quadrature error of the torque for the optimiser to exploit.

    Args:
        wheel_count: n.
        objective: name of an objective.

    Returns:
        Problem with node data (r_B*', r_B*'') (4,) and parameters: packed matrices, point B, r_B*' at start and end.
    """
    symbols = PathSymbols.create(wheel_count)
    k = unpack(symbols.coefficients, wheel_count)
    motion = symbols.on_program()
    u = ca.SX.sym("yaw_acceleration")
    torque = k.min_norm @ k.wrench(motion.velocity, motion.direction * u + motion.rest)
    chosen = OBJECTIVES[objective]
    integrand = chosen.work_share * ca.bilin(k.friction, motion.velocity, motion.velocity)
    if chosen.rest:
        integrand += chosen.rest(torque, k.wheel_rates @ motion.velocity)
    start, end = ca.SX.sym("start", 2), ca.SX.sym("end", 2)
    velocities = ca.SX.sym("end_velocities", 4)
    still = ca.SX.zeros(2)
    energies = [
        k.kinetic_energy(on_program(symbols.point, state[0], state[1], velocity, still).velocity)
        for state, velocity in ((start, velocities[:2]), (end, velocities[2:]))
    ]
    return Problem(
        state=ca.vertcat(symbols.heading, symbols.yaw_rate),
        control=u,
        data=ca.vertcat(symbols.program_velocity, symbols.program_acceleration),
        parameters=ca.vertcat(symbols.coefficients, symbols.point, velocities),
        start=start,
        end=end,
        rate=ca.vertcat(symbols.yaw_rate, u),
        integrand=integrand,
        terminal=chosen.work_share * (energies[1] - energies[0]),
    )


@dataclass(frozen=True)
class Structure:
    """What has to be the same for a nonlinear program to be used again."""

    wheel_count: int
    objective: str
    intervals: int
    degree: int
    scheme: SchemeName


@cache
def reduced_transcription(structure: Structure, options: SolverOptions) -> Transcription:
    """The nonlinear program of a structure, built once in a process.

    Args:
        structure: wheels, objective and mesh sizes.
        options: of the solver.

    Returns:
        A transcription of `reduced_problem`.
    """
    problem = reduced_problem(structure.wheel_count, structure.objective)
    return Transcription(problem, structure.intervals, structure.degree, structure.scheme, options)


def program_data(task: Task, t: np.ndarray) -> np.ndarray:
    """r_B*' and r_B*'' at times t of any shape; result (4, *t.shape) [m/s, m/s^2]."""
    _, velocity, acceleration = task.motion.at(t.ravel())
    return np.vstack([velocity, acceleration]).reshape(4, *t.shape)


def numbers_of(task: Task, transcription: Transcription, edges: np.ndarray, end: Bounds) -> Numbers:
    """The numbers of a task for a transcription.

    Args:
        task: platform, point, motion and start.
        transcription: of the reduced problem.
        edges: (N + 1,) [s].
        end: bounds of (heading, yaw rate) at the end.

    Returns:
        Numbers with the task's start.
    """
    velocities = task.motion.at(np.array([0.0, task.duration]))[1]
    return Numbers(
        edges=edges,
        data=program_data(task, transcription.node_times(edges)),
        parameters=np.concatenate([coefficients(task.platform), task.point, velocities.ravel(order="F")]),
        start=Bounds.fixed(np.array([task.start.heading, task.start.heading_rate])),
        end=end,
    )


def guess_from_law(task: Task, transcription: Transcription, edges: np.ndarray) -> Nodes:
    """The servo law's rotation on a mesh, or a rotation at constant rate where the law is unstable.

    Args:
        task: what to do.
        transcription: for its nodes.
        edges: (N + 1,) [s].

    Returns:
        States and controls to start from.
    """
    points = transcription.node_times(edges)
    t, index = np.unique(np.concatenate([edges, points.ravel()]), return_inverse=True)
    motion, _ = law_motion(ServoLaw(), task, t, tolerance=1e-7)
    if motion is None:
        heading = task.start.heading + task.start.heading_rate * t
        motion = np.vstack([heading, np.full_like(t, task.start.heading_rate), np.zeros_like(t)])
    values = motion[:, index]
    count = len(edges)
    inner = values[:, count:].reshape(3, *points.shape)
    return Nodes(values[:2, :count], inner[:2], inner[2:])
