"""The reduced formulation: V_X, V_Y eliminated by eq. (3.6); state (heading, yaw rate), control the yaw acceleration.

The program's velocity and acceleration enter as numbers at the nodes, so one nonlinear program serves every motion.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from occ.control import SymbolicControl
from occ.laws.base import open_loop_function, path_trajectory
from occ.model.coefficients import Coefficients, unpack
from occ.model.constraint import PathSymbols, on_program
from occ.motion import ProgramMotion, kinematics_function
from occ.numeric import evaluate_many
from occ.optimal.cost import Cost, cost_of
from occ.optimal.formulation import Formulation, Rotation
from occ.optimal.limits import LimitedMoment, limit_expressions
from occ.optimal.mesh import gauss_legendre
from occ.optimal.problem import Bounds, Names, Nodes, Problem, Row
from occ.optimal.shape import Shape
from occ.optimal.transcription import Transcription
from occ.task import Task
from occ.trajectory import PiecewisePolynomial, Trajectory

INSIDE = 1e-9
"""A quantity that jumps at a knot is taken this part of the interval inside of it."""


class _Torques(NamedTuple):
    """Torques with B on its program, and the symbols that give them."""

    symbols: PathSymbols
    matrices: Coefficients
    chosen: ca.SX  # (1 + n - 3 or 1,) yaw acceleration and null torques
    torque: ca.SX  # (n,)
    velocity: ca.SX  # (3,) pi'


def _torques(shape: Shape) -> _Torques:
    """pi' = C Omega + V*, M = minimum norm + null torque, eqs. (3.6), (3.7), (2.16)."""
    n = shape.wheel_count
    symbols = PathSymbols.create(n)
    k = unpack(symbols.coefficients, n)
    motion = symbols.on_program()
    chosen = ca.SX.sym("chosen", 1 + (n - 3 if shape.wants_null_torque else 0))
    torque = k.min_norm @ k.wrench(motion.velocity, motion.direction * chosen[0] + motion.rest)
    if chosen.numel() > 1:
        torque += k.null_torque @ chosen[1:]
    return _Torques(symbols, k, chosen, torque, motion.velocity)


@cache
def reduced_problem(shape: Shape) -> Problem:
    """psi' = Omega, Omega' = u_1; pi' = C Omega + V*, M = minimum norm + null torque, eqs. (3.6), (3.7), (2.16).

    Args:
        shape: keep ``path``.

    Returns:
        Problem with node data (r_B*', r_B*'') (4,) and parameters: packed matrices, point B, weights, torque-speed
        line, r_B*' at start and end, and the factor of u_1^2 in the integrand (see `Formulation.damping`); boundary
        conditions: x(T) - x(0).  Null torques are controls u_2.. where a limit or the cost sees them.  Under
        a limit of the torque rate u is a state, its derivative the control, and r_B*''' (2,) is data, too.
    """
    symbols, k, chosen, torque, velocity = _torques(shape)
    weights, line = ca.SX.sym("weights", len(shape.terms)), ca.SX.sym("line", 2)
    ends, damping = ca.SX.sym("end_velocities", 4), ca.SX.sym("damping")
    rates = k.wheel_rates @ velocity
    dissipation = ca.bilin(k.friction, velocity, velocity)
    cost = cost_of(shape.terms, weights, torque, rates, dissipation)
    state, rate = [symbols.heading, symbols.yaw_rate], [symbols.yaw_rate, chosen[0]]
    data = [symbols.program_velocity, symbols.program_acceleration]
    control, torque_rate = chosen, ca.SX.zeros(shape.wheel_count)
    if shape.has_torque_states:
        control, jerk = ca.SX.sym("chosen_rate", chosen.numel()), ca.SX.sym("jerk", 2)
        torque_rate = ca.jtimes(
            torque,
            ca.vertcat(symbols.heading, symbols.yaw_rate, chosen, *data),
            ca.vertcat(symbols.yaw_rate, chosen[0], control, symbols.program_acceleration, jerk),
        )
        state.append(chosen)
        rate.append(control)
        data.append(jerk)
    x = ca.vertcat(*state, cost.peak)
    start, end = ca.SX.sym("start", x.numel()), ca.SX.sym("end", x.numel())
    moment = LimitedMoment(torque, rates, velocity, torque_rate, line)
    return Problem(
        state=x,
        control=ca.vertcat(control, cost.slacks),
        data=ca.vertcat(*data),
        parameters=ca.vertcat(symbols.coefficients, symbols.point, weights, line, ends, damping),
        start=start,
        end=end,
        rate=ca.vertcat(*rate, ca.SX.zeros(cost.peak.numel())),
        integrand=cost.integrand + damping * chosen[0] ** 2,
        terminal=_terminal(symbols, k, cost, ends, (start, end)),
        path=ca.vertcat(limit_expressions(shape.limits, moment), cost.slack_rows, cost.peak_rows),
        boundary=end[:2] - start[:2],
        names=_names(shape),
    )


def _terminal(symbols: PathSymbols, k: Coefficients, cost: Cost, velocities: ca.SX, ends: tuple[ca.SX, ca.SX]) -> ca.SX:
    """T(T) - T(0), by its weight, and the largest torque."""
    still = ca.SX.zeros(2)
    energies = [
        k.kinetic_energy(on_program(symbols.point, state[0], state[1], velocity, still).velocity)
        for state, velocity in zip(ends, (velocities[:2], velocities[2:]), strict=True)
    ]
    kinetic = cost.work_weight * (energies[1] - energies[0])
    return kinetic + cost.peak_weight * ends[1][-1] if cost.peak.numel() else kinetic


def _names(shape: Shape) -> Names:
    null = shape.wheel_count - 3 if shape.wants_null_torque else 0
    chosen = (Row("yaw acceleration", "rad/s^2"), *[Row(f"null torque {j + 1}", "N m") for j in range(null)])
    heading: tuple[Row, ...] = (Row("heading", "rad"), Row("yaw rate", "rad/s"))
    peaks = (Row("largest torque", "N m"),) * shape.peaks
    slacks = tuple(Row(f"slack {j + 1}", "W") for j in range(shape.slacks))
    boundary = Row("turn of the heading", "rad"), Row("change of the yaw rate", "rad/s")
    control, state = chosen, heading
    if shape.has_torque_states:
        control = tuple(Row(f"rate of {row.quantity}", f"{row.unit}/s") for row in chosen)
        state = (*heading, *chosen)
    return Names(state=(*state, *peaks), control=(*control, *slacks), path=shape.path_names(), boundary=boundary)


class Reduced(Formulation):
    """B on its program by construction."""

    @property
    def shape(self) -> Shape:
        return Shape(wheel_count=self.task.platform.wheel_count, terms=self.settings.aim.terms, limits=self.limited)

    def problem(self) -> Problem:
        return reduced_problem(self.shape)

    def data(self, edges: np.ndarray, s: np.ndarray) -> np.ndarray:
        t = edges[:-1, None] + np.diff(edges)[:, None] * s
        values = program_data(self.task, t)
        if not self.shape.has_torque_states:
            return values
        inside = edges[:-1, None] + np.diff(edges)[:, None] * np.clip(s, INSIDE, 1 - INSIDE)
        return np.concatenate([values, program_jerk(self.task, inside)])

    def parameters(self) -> np.ndarray:
        velocities = self.task.motion.at(np.array([0.0, self.task.duration]))[1]
        damping = 0.0 if self.settings.scheme == "radau" else self.damping()[0]
        return np.concatenate([self.common_parameters(), velocities.ravel(order="F"), [damping]])

    def end_bounds(self) -> tuple[Bounds, Bounds, Bounds]:
        task, ends = self.task, self.settings.ends
        given = np.array([task.start.heading, task.start.heading_rate])
        start, end, difference = Bounds.fixed(given), Bounds.free(2), Bounds.free(2)
        if ends.end == "law":
            assert ends.law_end is not None
            end = Bounds.fixed(ends.law_end[[2, 5]])
        elif ends.end == "rest":
            end = Bounds(lower=np.array([-np.inf, 0.0]), upper=np.array([np.inf, 0.0]))
        elif ends.turn is not None:
            difference = Bounds.fixed(np.array([ends.turn, 0.0]))
        if ends.start == "free":
            # Headings that differ by full turns are the same start.
            turn = np.array([0.0 if self.phase_is_open else np.pi, np.inf])
            start = Bounds(lower=given - turn, upper=given + turn)
        return start, end, difference

    def motion_guess(self, transcription: Transcription, edges: np.ndarray, rotation: Rotation) -> Nodes:
        nx, nu, *_ = transcription.sizes
        points = transcription.node_times(edges)
        at_edges, inner = rotation(edges), rotation(points.ravel()).reshape(3, *points.shape)
        nodes = Nodes(np.zeros((nx, len(edges))), np.zeros((nx, *points.shape)), np.zeros((nu, *points.shape)))
        nodes.edges[:2], nodes.points[:2] = at_edges[:2], inner[:2]
        if self.shape.has_torque_states:
            nodes.edges[2], nodes.points[2] = at_edges[2], inner[2]
        else:
            nodes.control[0] = inner[2]
        return nodes

    def control(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> SymbolicControl:
        return path_control(self.task, self._signal(transcription, edges, nodes))

    def _signal(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> PiecewisePolynomial:
        """Yaw acceleration and null torques in time."""
        count = 1 + (self.task.platform.wheel_count - 3) * self.shape.wants_null_torque
        if self.shape.has_torque_states:
            values = np.concatenate([nodes.edges[:, :-1, None], nodes.points], axis=2)[2 : 2 + count]
            return PiecewisePolynomial(edges, transcription.scheme.nodes, values)
        return PiecewisePolynomial(edges, transcription.scheme.points, nodes.control[:count])

    def between(
        self, transcription: Transcription, edges: np.ndarray, nodes: Nodes, s: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        state, control = super().between(transcription, edges, nodes, s)
        # The yaw acceleration that is handed over makes this rotation; the heading's polynomial is near it only.
        state[:2] = rotation_of(self._signal(transcription, edges, nodes), nodes.edges[:2, 0], s)
        return state, control

    def claimed(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> Trajectory:
        s, t = claim_places(edges)
        state, _, _ = transcription.interpolate(nodes, np.append(s, 1.0))
        acceleration = self._signal(transcription, edges, nodes)
        heading, yaw_rate = (np.append(row[:, :-1].ravel(), row[-1, -1]) for row in state[:2])
        return path_trajectory(self.task, t, heading, yaw_rate, acceleration(t)[0])

    def start_state(self, nodes: Nodes) -> np.ndarray:
        return self.task.state_on_program(0.0, *nodes.edges[:2, 0])

    def yaw_rates(self, nodes: Nodes) -> np.ndarray:
        return nodes.edges[1]

    def headings(self, nodes: Nodes) -> np.ndarray:
        return nodes.edges[0]


def path_control(task: Task, signal: PiecewisePolynomial) -> SymbolicControl:
    """The torques of a yaw acceleration and null torques with B on its program.

    Args:
        task: platform and motion.
        signal: u_1 and, where there are any, null torques; those that are missing are zero.

    Returns:
        Control of (t, heading, yaw rate).
    """
    missing = task.platform.wheel_count - 2 - len(signal.values)
    values = np.concatenate([signal.values, np.zeros((missing, *signal.values.shape[1:]))])
    law = open_loop_function(task.platform.wheel_count, *task.motion_structure)
    whole = PiecewisePolynomial(signal.edges, signal.nodes, values)
    return SymbolicControl(law, task.path_data, whole, task.motion.knots(task.duration))


def rotation_of(signal: PiecewisePolynomial, start: np.ndarray, s: np.ndarray) -> np.ndarray:
    """psi(t), Omega(t) with psi'' = u_1: the integrals of a signal, exact up to rounding.

    Args:
        signal: u_1 first.
        start: (2,) [rad, rad/s] at the first edge.
        s: (m,) places in each interval.

    Returns:
        (2, N, m).
    """
    x, weights = gauss_legendre(len(signal.nodes) + 1)
    places = np.append(s, 1.0)
    basis = signal.basis(np.outer(places, x).ravel()).reshape(len(signal.nodes), len(places), len(x))
    once, twice = basis @ weights * places, (basis * (1 - x)) @ weights * places**2
    widths, values = np.diff(signal.edges)[:, None], signal.values[0]
    change, turn = widths * (values @ once), widths**2 * (values @ twice)
    rates = start[1] + np.concatenate([[0.0], np.cumsum(change[:, -1])])[:-1, None]
    turn += widths * places * rates
    headings = start[0] + np.concatenate([[0.0], np.cumsum(turn[:, -1])])[:-1, None]
    return np.stack([headings + turn[:, :-1], rates + change[:, :-1]])


def claim_places(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places s (m,) in each interval, and times (N m + 1,) [s], at which a motion is claimed."""
    s = np.linspace(0.0, 1.0, 12, endpoint=False)
    return s, np.append((edges[:-1, None] + np.diff(edges)[:, None] * s).ravel(), edges[-1])


def program_data(task: Task, t: np.ndarray) -> np.ndarray:
    """r_B*' and r_B*'' at times t of any shape; result (4, *t.shape) [m/s, m/s^2]."""
    _, velocity, acceleration = task.motion.at(t.ravel())
    return np.vstack([velocity, acceleration]).reshape(4, *t.shape)


def program_jerk(task: Task, t: np.ndarray) -> np.ndarray:
    """r_B*''' at times t of any shape; result (2, *t.shape) [m/s^3]."""
    values = task.motion.values()
    (jerk,) = evaluate_many(_jerk_function(*task.motion_structure), t.reshape(1, -1), values, shared=(1,))
    return jerk.reshape(2, *t.shape)


@cache
def _jerk_function(motion: type[ProgramMotion], structure: tuple[int, ...], size: int) -> ca.Function:
    """CasADi function (t, values) -> r_B*''' (2,)."""
    kinematics = kinematics_function(motion, structure, size)
    t, values = ca.SX.sym("t"), ca.SX.sym("values", size)
    jerk = ca.jacobian(kinematics(t, values)[2], t)
    return ca.Function("jerk", [t, values], [ca.densify(jerk)])
