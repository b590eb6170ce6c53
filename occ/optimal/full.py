"""The full formulation: six states, n wheel torques, eq. (2.16); B on its program, in a tube, or at its ends.

With keep ``path`` B's velocity is on its program at every collocation point.  That leaves of the n torques the yaw
acceleration and the null torques; position follows from the start, so that no further condition is imposed, which would
only repeat it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np

from occ.control import SymbolicControl
from occ.laws.base import path_trajectory
from occ.model.coefficients import Coefficients, coefficients, packed_size, unpack
from occ.model.constraint import path_functions
from occ.model.dynamics import forward_function, state_rate
from occ.numeric import evaluate_many
from occ.optimal.cost import cost_of
from occ.optimal.driven import DrivenMotion
from occ.optimal.formulation import Formulation, Rotation
from occ.optimal.limits import LimitedMoment, limit_expressions
from occ.optimal.nearby import Nearby
from occ.optimal.problem import Bounds, Names, Nodes, Problem, Row, flat
from occ.optimal.reduced import claim_places, path_control
from occ.optimal.shape import Shape
from occ.optimal.transcription import Transcription
from occ.trajectory import PiecewisePolynomial, Trajectory

MISSED = 1e-6
"""[SI units] An end is hit by the torques if they miss it by at most this; the referee allows ten times as much."""
STEP = 1e-4
"""Part of an interval over which torques are differenced."""
STATES = (
    Row("x", "m"),
    Row("y", "m"),
    Row("heading", "rad"),
    Row("V_X", "m/s"),
    Row("V_Y", "m/s"),
    Row("yaw rate", "rad/s"),
)


@cache
def full_problem(shape: Shape) -> Problem:
    """pi'' = A^-1 (C_phi^T M - f - Z pi'), eqs. (2.1), (2.16), with M the control.

    Args:
        shape: of any keep.

    Returns:
        Problem with node data (r_B*, r_B*') (4,) and parameters: packed matrices, point B, weights, torque-speed line,
        1 / radius^2 of the tube, r_B* and r_B*' at start and end and r_B*'' at the start (10,), factors of M^2,
        of the squared null torque (see `Formulation.damping`) and of the squared torque rates (see
        `Formulation.rate_damping`) that are added to the integrand; boundary conditions:
        x(T) - x(0), position and velocity of B off its program at the start and at the end.  Under a limit of the
        torque rate M is a state and its derivative the control.  With B on its path its acceleration is then held as
        well, at the start, too, and two further controls w in V' = .. + w take up what velocity and acceleration
        together leave over, so that both can be imposed at every collocation point; r_B*'' (2,) is data, too.
    """
    n = shape.wheel_count
    state, torque = ca.SX.sym("state", 6), ca.SX.sym("torque", n)
    data = ca.SX.sym("program", 6 if shape.starts_on_path else 4)
    packed, point = ca.SX.sym("coefficients", packed_size(n)), ca.SX.sym("point", 2)
    weights, line, tube = ca.SX.sym("weights", len(shape.terms)), ca.SX.sym("line", 2), ca.SX.sym("tube")
    program_ends, damping = ca.SX.sym("program_ends", 10), ca.SX.sym("damping", 3)
    k, velocity = unpack(packed, n), state[3:]
    rates = k.wheel_rates @ velocity
    cost = cost_of(shape.terms, weights, torque, rates, ca.bilin(k.friction, velocity, velocity))
    null = k.null_torque.T @ torque
    rate = state_rate(state[2], velocity, k.acceleration(velocity, torque))
    states, rows, control, torque_rate = [state], [rate], torque, ca.SX.zeros(n)
    if shape.has_torque_states:
        control = torque_rate = ca.SX.sym("torque_rate", n)
        states.append(torque)
        rows.append(torque_rate)
    position_error, velocity_error = _off_program(point, state, data[:4])
    acceleration_error = ca.jtimes(velocity_error, state, rate) - data[4:] if shape.starts_on_path else ca.SX(0, 1)
    if shape.starts_on_path:
        correction = ca.SX.sym("correction", 2)
        control = ca.vertcat(control, correction)
        rows[0] = rate + ca.vertcat(0, 0, 0, correction, 0)
    x = ca.vertcat(*states, cost.peak)
    start, end = ca.SX.sym("start", x.numel()), ca.SX.sym("end", x.numel())
    keeping = {
        "path": ca.vertcat(velocity_error, acceleration_error),
        "tube": ca.sumsqr(position_error) * tube,
        "ends": ca.SX(0, 1),
    }[shape.keep]
    terminal = cost.work_weight * (k.kinetic_energy(end[3:6]) - k.kinetic_energy(start[3:6]))
    if cost.peak.numel():
        terminal += cost.peak_weight * end[-1]
    moment = LimitedMoment(torque, rates, velocity, torque_rate, line)
    boundary = [
        end[:6] - start[:6],
        *_off_program(point, start[:6], program_ends[:4]),
        *_off_program(point, end[:6], program_ends[4:8]),
    ]
    if shape.starts_on_path:
        moment_of_start = ca.vertcat(start[: 6 + n], program_ends[8:])
        boundary.append(ca.substitute(acceleration_error, ca.vertcat(state, torque, data[4:]), moment_of_start))
    return Problem(
        state=x,
        control=ca.vertcat(control, cost.slacks),
        data=data,
        parameters=ca.vertcat(packed, point, weights, line, tube, program_ends, damping),
        start=start,
        end=end,
        rate=ca.vertcat(*rows, ca.SX.zeros(cost.peak.numel())),
        integrand=cost.integrand
        + damping[0] * ca.sumsqr(torque)
        + damping[1] * ca.sumsqr(null)
        + damping[2] * ca.sumsqr(torque_rate),
        terminal=terminal,
        path=ca.vertcat(limit_expressions(shape.limits, moment), keeping, cost.slack_rows, cost.peak_rows),
        boundary=ca.vertcat(*boundary),
        names=_names(shape),
        held=n if shape.constant else 0,
    )


def _off_program(point: ca.SX, state: ca.SX, program: ca.SX) -> tuple[ca.SX, ca.SX]:
    """r_B - r_B* and its derivative in time, each (2,), from the state and (r_B*, r_B*') (4,)."""
    c, s = ca.cos(state[2]), ca.sin(state[2])
    turned = ca.vertcat(ca.horzcat(c, -s), ca.horzcat(s, c))
    body = ca.vertcat(state[3] - state[5] * point[1], state[4] + state[5] * point[0])
    return state[:2] + turned @ point - program[:2], turned @ body - program[2:]


def _names(shape: Shape) -> Names:
    torques = tuple(Row("torque", "N m", wheel) for wheel in range(1, shape.wheel_count + 1))
    rates = tuple(Row("torque rate", "N m/s", row.wheel) for row in torques)
    peaks = (Row("largest torque", "N m"),) * shape.peaks
    slacks = tuple(Row(f"slack {j + 1}", "W") for j in range(shape.slacks))
    off = [Row(f"{what} of B off its program", unit) for what, unit in (("position", "m"), ("velocity", "m/s"))]
    at_ends = [
        Row(f"{row.quantity} at the {where}, {axis}", row.unit)
        for where in ("start", "end")
        for row in off
        for axis in "xy"
    ]
    first = tuple(Row(f"acceleration of B off its program at the start, {axis}", "m/s^2") for axis in "xy")
    corrections = tuple(Row(f"correction of V_{axis}'", "m/s^2") for axis in "XY" if shape.starts_on_path)
    states = (*STATES, *torques) if shape.has_torque_states else STATES
    return Names(
        state=(*states, *peaks),
        control=(*(rates if shape.has_torque_states else torques), *corrections, *slacks),
        path=shape.path_names(),
        boundary=(
            *[Row(f"change of {row.quantity}", row.unit) for row in STATES],
            *at_ends,
            *(first if shape.starts_on_path else ()),
        ),
    )


class Full(Formulation):
    """Six states and n torques."""

    @property
    def shape(self) -> Shape:
        return Shape(
            wheel_count=self.task.platform.wheel_count,
            terms=self.settings.aim.terms,
            limits=self.limited,
            full=True,
            keep=self.settings.keep,
            constant=self.settings.constant,
        )

    def problem(self) -> Problem:
        return full_problem(self.shape)

    def data(self, edges: np.ndarray, s: np.ndarray) -> np.ndarray:
        t = edges[:-1, None] + np.diff(edges)[:, None] * s
        position, velocity, acceleration = self.task.motion.at(t.ravel())
        values = [position, velocity, acceleration] if self.shape.starts_on_path else [position, velocity]
        return np.vstack(values).reshape(-1, *t.shape)

    def parameters(self) -> np.ndarray:
        position, velocity, acceleration = self.task.motion.at(np.array([0.0, self.task.duration]))
        ends = np.append(np.concatenate([position, velocity]).ravel(order="F"), acceleration[:, 0])
        radius = self.settings.radius
        _, squared = self.damping()
        damping = [0.0 if self.settings.scheme == "radau" else squared, squared, self.rate_damping]
        return np.concatenate([self.common_parameters(), [0.0 if radius is None else radius**-2], ends, damping])

    def end_bounds(self) -> tuple[Bounds, Bounds, Bounds]:
        task, ends, keep = self.task, self.settings.ends, self.settings.keep
        start = task.state_on_program(0.0, task.start.heading, task.start.heading_rate)
        end_lower, end_upper = np.full(6, -np.inf), np.full(6, np.inf)
        boundary = np.full(16 if self.shape.starts_on_path else 14, np.nan)
        boundary[14:] = 0.0
        if ends.end == "law":
            assert ends.law_end is not None
            # With B on its path only the rotation is left to be asked for.
            chosen = [2, 5] if keep == "path" else list(range(6))
            end_lower[chosen] = end_upper[chosen] = ends.law_end[chosen]
        elif ends.end == "rest":
            chosen = [5] if keep == "path" else [3, 4, 5]
            end_lower[chosen] = end_upper[chosen] = 0.0
            if keep == "ends":
                boundary[10:12] = 0.0
        elif ends.turn is not None:
            boundary[[2, 5]] = ends.turn, 0.0
            if keep != "path":
                # The same heading and yaw rate: then B's velocity returns with V_X and V_Y.
                position = task.motion.at(np.array([0.0, task.duration]))[0]
                boundary[[0, 1]] = position[:, 1] - position[:, 0]
                boundary[[3, 4]] = 0.0
        elif keep == "ends":
            boundary[10:14] = 0.0
        if ends.start == "free":
            boundary[6:10] = 0.0
            turn = np.full(6, np.inf)
            turn[2] = 0.0 if self.phase_is_open else np.pi
            start_bounds = Bounds(lower=start - turn, upper=start + turn)
        else:
            start_bounds = Bounds.fixed(start)
        if self.settings.aside is not None:
            end_lower, end_upper = end_lower + self.settings.aside[:6], end_upper + self.settings.aside[:6]
            boundary[:6] += self.settings.aside[:6]
            boundary[10:14] += self.settings.aside[6:]
        asked = ~np.isnan(boundary)
        difference = Bounds(lower=np.where(asked, boundary, -np.inf), upper=np.where(asked, boundary, np.inf))
        return start_bounds, Bounds(lower=end_lower, upper=end_upper), difference

    def motion_guess(self, transcription: Transcription, edges: np.ndarray, rotation: Rotation) -> Nodes:
        nx, nu, *_ = transcription.sizes
        points = transcription.node_times(edges)
        nodes = Nodes(np.zeros((nx, len(edges))), np.zeros((nx, *points.shape)), np.zeros((nu, *points.shape)))
        for t, states in ((edges, nodes.edges), (points, nodes.points)):
            state, torque = self._guessed(t.ravel(), rotation)
            states[:6], n = state.reshape(6, *t.shape), len(torque)
            if self.shape.has_torque_states:
                states[6 : 6 + n] = torque.reshape(n, *t.shape)
            elif t is points:
                nodes.control[:n] = torque.reshape(n, *t.shape)
        if self.shape.constant:
            nodes.control[:] = nodes.control.mean(axis=2, keepdims=True)
        return nodes

    def _guessed(self, t: np.ndarray, rotation: Rotation) -> tuple[np.ndarray, np.ndarray]:
        """States (6, N) and torques (n, N) at times t (N,), with B on its program or where a solution nearby has it."""
        if isinstance(rotation, Nearby) and self.settings.keep != "path":
            return rotation.motion(t)
        heading, yaw_rate, acceleration = rotation(t)
        torque = self._torque_on_program(t, heading, yaw_rate, acceleration)
        return self.task.states_on_program(t, heading, yaw_rate), torque

    def _torque_on_program(
        self, t: np.ndarray, heading: np.ndarray, yaw_rate: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """(n, N) Torques of least norm with B on its program."""
        wheels = self.task.platform.wheel_count
        _, velocity, program = self.task.motion.at(t)
        arguments = [coefficients(self.task.platform), np.array(self.task.point), heading[None], yaw_rate[None]]
        null = np.zeros((wheels - 3, len(t)))
        return evaluate_many(
            path_functions(wheels)["torque"], *arguments, velocity, program, acceleration[None], null, shared=(0, 1)
        )[0]

    def control(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> SymbolicControl:
        n = self.task.platform.wheel_count
        if self.settings.keep == "path":
            return path_control(self.task, self._chosen(transcription, edges, nodes))
        scheme = transcription.scheme
        if self.shape.has_torque_states:
            values = np.concatenate([nodes.edges[:, :-1, None], nodes.points], axis=2)[6 : 6 + n]
            signal = PiecewisePolynomial(edges, scheme.nodes, values)
        elif self.shape.constant:
            signal = PiecewisePolynomial(edges, np.array([0.5]), nodes.control[:n, :, :1])
        else:
            signal = PiecewisePolynomial(edges, scheme.points, nodes.control[:n])
        return SymbolicControl(open_loop_torque(n), np.zeros(0), signal)

    def _chosen(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> PiecewisePolynomial:
        """Yaw acceleration and null torques, which with B on its program give the torques, eq. (3.7)."""
        k: Coefficients = self.task.dynamics.coefficients
        n = self.task.platform.wheel_count
        points = transcription.scheme.points
        if self.shape.has_torque_states:
            # Continuous from one interval to the next, as the torques are.
            points = transcription.scheme.nodes
            whole = np.concatenate([nodes.edges[:, :-1, None], nodes.points], axis=2)
            torque = whole[6 : 6 + n]
            acceleration = self._forward(flat(whole[:6]), flat(torque))[5].reshape(torque.shape[1:])
        else:
            _, derivative, control = transcription.interpolate(nodes, points)
            torque, acceleration = control[:n], derivative[5] / np.diff(edges)[:, None]
        null = np.einsum("nj,nkm->jkm", np.array(k.null_torque), torque)
        return PiecewisePolynomial(edges, points, np.concatenate([acceleration[None], null]))

    def between(
        self, transcription: Transcription, edges: np.ndarray, nodes: Nodes, s: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        state, control = super().between(transcription, edges, nodes, s)
        t = (edges[:-1, None] + np.diff(edges)[:, None] * s).ravel()
        if self.settings.keep != "path":
            state[:6] = self.driven(transcription, edges, nodes)(t).reshape(6, *state.shape[1:])
            return state, control
        # The torques that are handed over are those of the rotation with B exactly on its program.
        torque = self._torque_on_path(transcription, edges, nodes, (s, np.zeros_like(s)))
        state[:6] = self.task.states_on_program(t, state[2].ravel(), state[5].ravel()).reshape(6, *state.shape[1:])
        if not self.shape.has_torque_states:
            control[: len(torque)] = torque
            return state, control
        state[6 : 6 + len(torque)] = torque
        steps = np.clip([s - STEP, s + STEP], 0.0, 1.0) - s
        before, after = (self._torque_on_path(transcription, edges, nodes, (s, step)) for step in steps)
        control[: len(torque)] = (after - before) / (np.diff(edges)[:, None] * (steps[1] - steps[0]))
        return state, control

    def _torque_on_path(
        self, transcription: Transcription, edges: np.ndarray, nodes: Nodes, places: tuple[np.ndarray, np.ndarray]
    ) -> np.ndarray:
        """(n, N, m) Torques of a solution with B exactly on its program, steps away from places, (m,) each."""
        s, step = places
        widths = np.diff(edges)[:, None]
        state, *_ = transcription.interpolate(nodes, s)
        chosen = self._chosen(transcription, edges, nodes)
        here, there = (chosen.values @ chosen.basis(at) for at in (s, s + step))
        # The yaw acceleration that is handed over, not the derivative of the polynomials, goes on from there.
        ahead = widths * step
        heading = state[2] + ahead * (state[5] + ahead / 2 * here[0])
        yaw_rate = state[5] + ahead * here[0]
        t = edges[:-1, None] + widths * (s + step)
        torque = self._torque_on_program(t.ravel(), heading.ravel(), yaw_rate.ravel(), there[0].ravel())
        torque += np.array(self.task.dynamics.coefficients.null_torque) @ there[1:].reshape(
            len(there) - 1, there[0].size
        )
        return torque.reshape(-1, *state.shape[1:])

    def aimed(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> Formulation | None:
        if self.settings.keep == "path" or (self.settings.keep == "tube" and self.settings.ends.end == "free"):
            return None
        both = np.column_stack([nodes.edges[:6, -1], self.driven(transcription, edges, nodes).end_state])
        whole = np.concatenate([both, *self.task.point_motion(both)])
        aside = whole[:, 0] - whole[:, 1]
        before = np.zeros(10) if self.settings.aside is None else self.settings.aside
        if np.abs(aside - before).max() <= MISSED:
            return None
        return replace(self, settings=replace(self.settings, aside=aside))

    def _forward(self, state: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """d(state)/dt (6, N) at states (6, N) under torques (n, N)."""
        platform = self.task.platform
        numbers = coefficients(platform)
        return evaluate_many(forward_function(platform.wheel_count), numbers, state, torque, shared=(0,))[0]

    def driven(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> DrivenMotion:
        """The motion that the torques of a solution make; that of the last solution is kept."""
        if not self._last or self._last[0] is not nodes:
            motion = DrivenMotion(self.task, self.control(transcription, edges, nodes), self.start_state(nodes))
            self._last[:] = nodes, motion
        return self._last[1]

    @cached_property
    def _last(self) -> list[Any]:
        """The last nodes and their motion."""
        return []

    def claimed(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> Trajectory:
        s, t = claim_places(edges)
        if self.settings.keep != "path":
            state = self.driven(transcription, edges, nodes)(t)
            torque = self.control(transcription, edges, nodes).torque(t, state)
            return Trajectory(t, state, self._forward(state, torque))
        state, derivative, _ = transcription.interpolate(nodes, np.append(s, 1.0))
        rate = derivative / np.diff(edges)[:, None]
        heading, yaw_rate, acceleration = (
            np.append(row[:, :-1].ravel(), row[-1, -1]) for row in (state[2], state[5], rate[5])
        )
        return path_trajectory(self.task, t, heading, yaw_rate, acceleration)

    def start_state(self, nodes: Nodes) -> np.ndarray:
        if self.settings.keep == "path":
            return self.task.state_on_program(0.0, nodes.edges[2, 0], nodes.edges[5, 0])
        return nodes.edges[:6, 0]

    def yaw_rates(self, nodes: Nodes) -> np.ndarray:
        return nodes.edges[5]

    def headings(self, nodes: Nodes) -> np.ndarray:
        return nodes.edges[2]


@cache
def open_loop_torque(wheel_count: int) -> ca.Function:
    """M = u(t): CasADi function (t, state (6,), signal (n,), data (0,)) -> torque (n,)."""
    signal = ca.SX.sym("signal", wheel_count)
    arguments = [ca.SX.sym("t"), ca.SX.sym("state", 6), signal, ca.SX.sym("data", 0)]
    return ca.Function("open_loop_torque", arguments, [signal])
