"""Limits proven between the nodes, for the motion that the handed-over torques make.

With B on its program the heading is exactly the double integral of the yaw acceleration that is handed over, a
polynomial in each interval; null torques are polynomials, too, and the program is an analytic function of time between
its knots: so is each limited quantity.  Where B may leave its path the torques and their rates are the polynomials;
speeds and positions are known within proven distances of polynomials (`occ.optimal.enclosed_motion`), which the bounds
of what depends on them contain.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np

from occ.control import SymbolicControl
from occ.errors import Status
from occ.motion import ProgramMotion, kinematics_function
from occ.optimal.attempt import Attempt
from occ.optimal.cost import Aim
from occ.optimal.driven import DrivenMotion
from occ.optimal.enclosed_motion import EnclosedVelocity, Matrices, enclosed_pose, enclosed_velocity, panel_counts
from occ.optimal.formulation import Formulation
from occ.optimal.full import Full, full_problem
from occ.optimal.limits import LimitedArcs, line_numbers, rows_of
from occ.optimal.powers import UNIT, Panels, derivative, integral, integral_slack, size_of, stacked
from occ.optimal.problem import Problem
from occ.optimal.proof import Proven, Quantities, proven
from occ.optimal.reduced import Reduced, reduced_problem
from occ.optimal.shape import Shape
from occ.trajectory import PiecewisePolynomial

KNOT = 1e-9
"""A knot of the program this near to an edge, relative to the horizon, is that edge."""
SHARP = 1e-7
"""A bound that contains no more than this, relative to the limit, of what is not the polynomial's is a proof; others
are left to the estimate, which would not be passed for nothing then."""
AFFORDABLE = 0.01
"""The same in units of the tolerance of the cost: taking so little off a limit costs next to nothing of it."""
LARGEST = "largest_torque"
"""What is named where the largest torque is the cost and its rows are estimated."""
TORQUE_SQUARED = Aim.single("torque_squared")
"""A cost without slacks that lets all null torques in: the path conditions are the limits and nothing else."""


def with_proof(formulation: Formulation, attempt: Attempt) -> Attempt:
    """The attempt with proven bounds of its limited quantities in place of estimates, where there is a proof.

    Where the largest torque m is the cost, |M_i| <= m is a limit like the others.

    Args:
        formulation: of the task.
        attempt: a solution.

    Returns:
        The same where nothing is limited.
    """
    arcs, nodes = attempt.arcs, attempt.outcome.nodes
    if arcs is None or attempt.outcome.status is not Status.OK:
        return attempt
    claimed = float(nodes.edges[-1, -1]) if formulation.shape.peaks else np.nan
    if not (arcs.hard or claimed > 0.0):
        return attempt
    control = formulation.control(attempt.transcription, attempt.edges, nodes)
    assert isinstance(control, SymbolicControl)
    asked = _with_torque_limit(formulation, claimed) if claimed > 0.0 else formulation
    if formulation.settings.keep == "path":
        start = formulation.start_state(nodes)
        found = proven(on_path(asked, control, start[[2, 5]]))
        added = np.zeros((len(asked.hard_limits), 1))
    else:
        assert isinstance(formulation, Full)
        assert isinstance(asked, Full)
        found, added = beside_path(asked, control, formulation.driven(attempt.transcription, attempt.edges, nodes))
    return replace(attempt, arcs=_with_bounds(arcs, formulation, asked, (found, added), claimed))


def _with_torque_limit(formulation: Formulation, torque: float) -> Formulation:
    """The same with this limit [N m] of the torques."""
    task = formulation.task
    return replace(formulation, task=replace(task, limits=replace(task.limits, torque=torque)))


def _with_bounds(
    arcs: LimitedArcs, formulation: Formulation, asked: Formulation, bounds: tuple[Proven, np.ndarray], claimed: float
) -> LimitedArcs:
    """The arcs with the bounds that are sharp; those of torques are in units of the claimed one, if there is one."""
    found, added = bounds
    places, proven_places = (_places(each) for each in (formulation, asked))
    most = max(SHARP, AFFORDABLE * formulation.settings.tolerance)
    sharp = np.isfinite(found.largest).all(axis=1) & (added.max(axis=1) <= most)
    names = tuple(name for name in places if sharp[proven_places[name]].all())
    relative = found.largest + added
    largest, remainder = arcs.largest.copy(), found.remainder
    for name in names:
        of, rows = proven_places[name], places[name]
        unit = (asked.hard_limits[of] / formulation.hard_limits[rows])[:, None]
        largest[rows] = np.maximum(relative[of] * unit, arcs.load[rows].max(axis=2))
        remainder = max(remainder, float(added[of].max()))
    others = tuple(name for name in places if name not in names)
    if claimed > 0.0 and sharp[proven_places["torque"]].all():
        largest[arcs.hard :] = np.maximum(relative[proven_places["torque"]], arcs.load[arcs.hard :].max(axis=2))
    elif claimed > 0.0:
        claimed, others = np.nan, (*others, LARGEST)
    return replace(arcs, largest=largest, proven=names, estimated=others, remainder=remainder, claimed=claimed)


def _places(formulation: Formulation) -> dict[str, np.ndarray]:
    """Rows of the limits of each quantity, the tube included."""
    places = rows_of(formulation.limited, formulation.shape.wheel_count)
    if formulation.settings.keep == "tube":
        places["tube"] = np.array([len(formulation.hard_limits) - 1])
    return places


def on_path(formulation: Formulation, control: SymbolicControl, start: np.ndarray) -> Quantities:
    """The limited quantities of a motion with B on its program, as functions of time.

    Args:
        formulation: of the task, with keep ``path``.
        control: that is handed over: yaw acceleration and null torques in time.
        start: (2,) [rad, rad/s] heading and yaw rate at the start.

    Returns:
        In the order of the limits.
    """
    task, signal = formulation.task, control.signal
    assert signal is not None
    shape = Shape(wheel_count=task.platform.wheel_count, terms=TORQUE_SQUARED.terms, limits=formulation.limited)
    rate = integral(signal.powers[:1], signal.edges, start[1:])
    heading = integral(rate, signal.edges, start[:1])
    slack = integral_slack(rate, signal.edges, UNIT * signal.powers.shape[2] * size_of(signal.powers[:1]))
    slack = np.concatenate([integral_slack(heading, signal.edges, slack), slack])
    reduced = Reduced(task, replace(formulation.settings, aim=TORQUE_SQUARED))
    panels = Panels.of(signal.edges, _signals(reduced, signal), np.ones(len(signal.edges) - 1, dtype=int))
    return _quantities(reduced, reduced_problem(shape), panels, (stacked([*heading, *rate]), slack))


def beside_path(formulation: Full, control: SymbolicControl, motion: DrivenMotion) -> tuple[Proven, np.ndarray]:
    """Bounds of the limited quantities, the tube included, where B may leave its path.

    Args:
        formulation: of the task, with keep ``tube`` or ``ends``.
        control: torques in time.
        motion: that they make, integrated.

    Returns:
        Bounds for the polynomials near the motion, and (k, N) what the motion itself may add to them.
    """
    task, signal = formulation.task, control.signal
    assert signal is not None
    matrices = Matrices.of(task.dynamics.coefficients)
    full = Full(task, replace(formulation.settings, aim=TORQUE_SQUARED))
    panels = Panels.of(signal.edges, _signals(full, signal), panel_counts(matrices, motion, signal.edges))
    torque = panels.rows(len(signal.powers))
    # Where nothing is known distances grow beyond all numbers; infinite ones, or none, are no proof.
    with np.errstate(over="ignore", invalid="ignore"):
        velocity = enclosed_velocity(matrices, motion, torque)
        pose = enclosed_pose(velocity, motion.start[:3], task.point)
    states = stacked([*pose.powers, *velocity.powers])
    slack = UNIT * states.shape[2] * size_of(states)
    found = proven(_quantities(full, full_problem(full.shape), panels, (states, slack)))
    with np.errstate(over="ignore", invalid="ignore"):
        added = [_added(formulation, name, velocity, torque) for name in formulation.limited]
        if formulation.settings.radius is not None:
            distance = np.sqrt(found.largest[-1:]) * formulation.settings.radius
            added.append((2 * distance + pose.point) * pose.point / formulation.settings.radius**2)
    largest, more = (panels.largest(values) for values in (found.largest, np.concatenate(added)))
    return replace(found, largest=largest), more


def _added(formulation: Formulation, name: str, velocity: EnclosedVelocity, torque: Panels) -> np.ndarray:
    """(k, P) What the distance of the velocities can add to a limited quantity, relative to its limit."""
    limits = formulation.task.limits
    rates = velocity.within(np.array(formulation.task.dynamics.coefficients.wheel_rates))
    if name == "wheel_speed":
        assert limits.wheel_speed is not None
        return rates / limits.wheel_speed
    if name == "wheel_power":
        assert limits.wheel_power is not None
        return rates * size_of(torque.powers) / limits.wheel_power
    if name == "torque_speed_line":
        return rates * line_numbers(limits)[1]
    if name == "platform_speed":
        assert limits.platform_speed is not None
        slid = np.hypot(*velocity.within(np.eye(3)[:2]))
        speed = np.hypot(*size_of(velocity.powers[:2]))
        return np.asarray((2 * speed + slid) * slid / limits.platform_speed**2)[None]
    return np.zeros_like(rates)


def _signals(formulation: Reduced | Full, signal: PiecewisePolynomial) -> np.ndarray:
    """(m, N, d) The signal, and its rates where they are limited, too."""
    rates = derivative(signal.powers, signal.edges) if formulation.shape.has_torque_states else ()
    return stacked([*signal.powers, *rates])


def _quantities(
    formulation: Reduced | Full, problem: Problem, signals: Panels, states: tuple[np.ndarray, np.ndarray]
) -> Quantities:
    """The path conditions of a problem along mechanical states (m, P, d), with their slack (m, P), and signals."""
    task, edges = formulation.task, signals.edges
    powers = stacked([*states[0], *signals.powers])
    others = signals.slack + UNIT * powers.shape[2] * size_of(signals.powers)
    return Quantities(
        function=_path_function(problem, formulation.shape.full, *task.motion_structure),
        edges=edges,
        powers=powers,
        slack=np.concatenate([states[1], others]),
        numbers=np.concatenate([formulation.parameters(), task.motion.values()]),
        scales=formulation.hard_limits,
        smooth=_without_knots(edges, task.motion.knots(task.duration)),
    )


@cache
def _path_function(
    problem: Problem, full: bool, motion: type[ProgramMotion], structure: tuple[int, ...], size: int
) -> ca.Function:
    """CasADi function (t, (states, controls), (parameters, values of the motion)) -> path conditions."""
    t, values = ca.SX.sym("t"), ca.SX.sym("values", size)
    position, velocity, acceleration = kinematics_function(motion, structure, size)(t, values)
    # Node data of the full formulation, or of the reduced one, without and with a limit of the torque rate.
    data = [position, velocity] if full else [velocity, acceleration]
    if problem.data.numel() > 4:
        data.append(ca.jacobian(acceleration, t))
    path = problem.node_function(problem.state, problem.control, ca.vertcat(*data), problem.parameters)[2]
    z, numbers = ca.vertcat(problem.state, problem.control), ca.vertcat(problem.parameters, values)
    return ca.Function("limited_quantities", [t, z, numbers], [ca.densify(path)])


def _without_knots(edges: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(N,) of booleans: no knot is inside the interval."""
    near = KNOT * (edges[-1] - edges[0])
    inside = (knots > edges[:-1, None] + near) & (knots < edges[1:, None] - near)
    return np.asarray(~inside.any(axis=1))
