"""The referee: every number of a row is recomputed from the control, the true dynamics and the exact cost.

It sees no player: a `Solution` is a control, a start and a claim, and each claim is checked.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, get_args

import numpy as np

from occ.control import Control
from occ.errors import Status
from occ.integration import IntegrationError
from occ.model.dynamics import parametric_functions
from occ.numeric import evaluate_many
from occ.objectives import INTEGRALS
from occ.plant import Plant
from occ.referee.loads import Loads, loads
from occ.referee.record import Record
from occ.referee.reference import servo_end_state
from occ.referee.replay import Replay, ReplaySettings, Samples
from occ.task import Claim, ClaimedKeep, EndClass, Solution, StartClass, Task
from occ.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """What the referee lets pass.

    Args:
        path: [m] and [m/s times max(1, program speed)] distance of B from its program.
        start: distance of the start state from the claimed class of starts, in SI units.
        end: distance of the end state from the claimed class of ends, in SI units.
        replay: [m] distance between claimed and true motion.
        energy: residual of the energy ledger, relative to the sum of its terms' sizes.
        limit: excess over a limit, relative to it.
        integration: settings of the replay.
    """

    path: float = 1e-7
    start: float = 1e-9
    end: float = 1e-5
    replay: float = 1e-4
    energy: float = 1e-9
    limit: float = 1e-6
    integration: ReplaySettings = field(default_factory=ReplaySettings)


@dataclass(frozen=True)
class Verdict:
    """A record and the true motion behind it; ``samples`` is None where there was none."""

    record: Record
    replay: Replay | None = None
    samples: Samples | None = None


def judge(task: Task, solution: Solution, tolerances: Tolerances | None = None) -> Record:
    """Recompute every measure of a solution and check each of its claims.

    Args:
        task: what was to be done.
        solution: what the player made of it.
        tolerances: what the referee lets pass.

    Returns:
        The row; its status is ``OK`` only if the solution is what it claims to be and holds the task's limits, and
        ``CRASHED`` if it is not even a solution.
    """
    return examine(task, solution, tolerances).record


def examine(task: Task, solution: Solution, tolerances: Tolerances | None = None) -> Verdict:
    """`judge`, together with the true motion."""
    tolerances = tolerances or Tolerances()
    malformed = _malformed(task, solution)
    if malformed:
        return Verdict(Record(status=Status.CRASHED, message=malformed, keep="", start="", end=""))
    claim = solution.claim
    record = Record(
        status=Status(solution.status),
        message=solution.message,
        # Off the model no claim of the player is held against it, and none makes its row a bound.
        keep="none" if task.off_model else claim.keep,
        start=claim.start,
        end="free" if task.off_model else claim.end,
        local_objective=None if task.off_model else solution.local_objective,
    )
    if record.status is not Status.OK:
        return Verdict(record)
    if solution.control is None or solution.start_state is None:
        return Verdict(replace(record, status=Status.FAILED, message="the player returned no control and no reason"))
    try:
        replay = _replay(task, solution.control, solution.start_state, tolerances.integration)
        samples = replay.samples()
    except IntegrationError as error:
        return Verdict(replace(record, status=Status.UNSTABLE, message=str(error)))
    borne = loads(task, replay, samples)
    measures = measure(task, solution, replay, samples, borne)
    status, message = _check(_Judged(task, solution, measures, replay, samples, tolerances))
    excess, sentence = borne.largest_excess
    if status is Status.OK and excess > tolerances.limit:
        status, message = Status.INFEASIBLE, sentence
    record = replace(record, measures=measures, status=status, message=message or record.message)
    return Verdict(record, replay, samples)


def _replay(task: Task, control: Control, start: np.ndarray, settings: ReplaySettings) -> Replay:
    """The true motion on the plant, from its own start and under a control that it may hold between samples."""
    plant = task.plant or Plant()
    offset = np.concatenate([plant.start_offset, np.zeros(3)])
    return Replay(task.true_platform, control, start + offset, task.duration, settings, plant.sample_rate)


def _malformed(task: Task, solution: Any) -> str:
    """Why what a player returned cannot be judged at all, or an empty text.

    Without this a single torque would pass for all wheels, and a status that is a mere text for a verdict.
    """
    if not isinstance(solution, Solution):
        return f"the player returned {_kind(solution)}, not a Solution"
    claim: Any = solution.claim
    claimed: Any = solution.claimed
    if solution.status not in set(Status):
        return f"the player returned the status {solution.status!r}, not one of {', '.join(Status)}"
    if not isinstance(claim, Claim):
        return f"the player returned {_kind(claim)} as its claim, not a Claim"
    for part, options in (
        ("keep", get_args(ClaimedKeep)),
        ("start", get_args(StartClass)),
        ("end", get_args(EndClass)),
    ):
        if getattr(claim, part) not in options:
            return f"the player claims the {part} {getattr(claim, part)!r}, not one of {', '.join(options)}"
    if (claim.keep == "tube") != (isinstance(claim.radius, float) and 0 < claim.radius < np.inf):
        return f"the player claims the keep {claim.keep!r} with the radius {claim.radius!r}; a tube has one in m"
    if not isinstance(claimed, Trajectory | None):
        return f"the player returned {_kind(claimed)} as its claimed motion, not a Trajectory"
    if solution.status != Status.OK or solution.control is None or solution.start_state is None:
        return ""
    try:
        state = np.asarray(solution.start_state, dtype=float)
    except (TypeError, ValueError):
        return f"the player returned {_kind(solution.start_state)} as its start state, not 6 numbers"
    if state.shape != (6,):
        return f"the player returned a start state of the shape {state.shape}, not (6,)"
    control, wheels = solution.control, task.platform.wheel_count
    first = min((float(t) for t in control.knots if t > 0), default=task.duration)
    one = control.segment(0.0, min(first, task.duration))(0.0, state)
    two = control.torque(np.zeros(2), np.column_stack([state, state]))
    for torque, shape in ((one, (wheels,)), (two, (wheels, 2))):
        if np.shape(torque) != shape:
            return f"the control gives {_kind(torque)} of the shape {np.shape(torque)} as torques, not of {shape}"
        if np.asarray(torque).dtype.kind not in "fiu":
            return f"the control gives torques of the type {np.asarray(torque).dtype}, not real numbers"
    return ""


def _kind(value: object) -> str:
    """The value's type as a sentence says it."""
    name = type(value).__name__
    return "None" if value is None else f"{'an' if name[0] in 'aeiou' or name == 'ndarray' else 'a'} {name}"


def measure(task: Task, solution: Solution, replay: Replay, samples: Samples, borne: Loads) -> dict[str, float]:
    """All numbers of a row from the true motion.

    Args:
        task: platform, motion and limits.
        solution: for what it claimed.
        replay: the true motion.
        samples: the same on quadrature nodes.
        borne: by the wheels.

    Returns:
        By the names of `MEASURES`.
    """
    integrals = samples.integrands @ samples.weight
    measures = {item.column: float(integrals[i]) for i, item in enumerate(INTEGRALS.values())}
    kinetic = float(samples.kinetic_energy[-1] - samples.kinetic_energy[0])
    dissipation = float(samples.dissipation @ samples.weight)
    measures |= {
        "kinetic_change_J": kinetic,
        "dissipation_J": dissipation,
        "energy_residual_J": measures["work_J"] - kinetic - dissipation,
        "peak_torque_Nm": borne.torque,
        "peak_wheel_speed_rad_s": borne.wheel_speed,
        "peak_power_W": borne.power,
    }
    position, velocity = task.point_motion(samples.state)
    program, program_velocity, _ = task.motion.at(samples.t)
    distance = np.hypot(*(position - program))
    measures |= {
        "velocity_error_m_s": float(np.hypot(*(velocity - program_velocity)).max()),
        "position_error_m": float(distance.max()),
        "position_error_end_m": float(distance[-1]),
    }
    if solution.claim.keep != "ends":
        measures["tube_radius_m"] = solution.claim.radius or 0.0
    measures["defect"], measures["replay_error_m"] = _claim_errors(task, solution, replay)
    measures["limit_excess"] = borne.largest_excess[0]
    return measures


def _claim_errors(task: Task, solution: Solution, replay: Replay) -> tuple[float, float]:
    """Residual of the claimed motion in the equations of motion, and its distance from the true motion [m]."""
    claimed = solution.claimed
    if claimed is None:
        return 0.0, 0.0
    assert solution.control is not None
    torque = solution.control.torque(claimed.t, claimed.state)
    forward = parametric_functions(task.platform.wheel_count)["forward"]
    (rate,) = evaluate_many(forward, claimed.state, torque, task.platform.parameters(), shared=(2,))
    residual = np.abs(claimed.state_rate - rate) / np.maximum(1.0, np.abs(rate).max(axis=1, keepdims=True))
    true = replay.at(claimed.t)
    center = np.hypot(*(claimed.state[:2] - true[:2]))
    point = np.hypot(*(task.point_motion(claimed.state)[0] - task.point_motion(true)[0]))
    return float(residual.max()), float(max(center.max(), point.max()))


class _Judged(NamedTuple):
    """A solution, what was measured along its true motion, and what is let pass."""

    task: Task
    solution: Solution
    measures: dict[str, float]
    replay: Replay
    samples: Samples
    allowed: Tolerances


def _check(judged: _Judged) -> tuple[Status, str]:
    """The first claim that does not hold, or ``OK``."""
    measures = judged.measures
    if not all(np.isfinite(value) for value in measures.values()):
        names = ", ".join(name for name, value in measures.items() if not np.isfinite(value))
        return Status.FAILED, f"not finite: {names}"
    claims = () if judged.task.off_model else (_check_keep, _check_claimed, _check_end)
    for check in (_check_energy, _check_start, *claims):
        reason = check(judged)
        if reason:
            return Status.FAILED, reason
    return Status.OK, ""


def _check_energy(judged: _Judged) -> str:
    measures, samples = judged.measures, judged.samples
    size = abs(measures["work_J"]) + abs(measures["kinetic_change_J"]) + measures["dissipation_J"]
    size += float(samples.kinetic_energy.max())
    residual = measures["energy_residual_J"]
    if abs(residual) > judged.allowed.energy * max(size, 1e-3):
        return f"the energy ledger does not close: work - kinetic change - dissipation = {residual:.3g} J"
    return ""


def _check_start(judged: _Judged) -> str:
    task, solution = judged.task, judged.solution
    state = solution.start_state
    assert state is not None
    if solution.claim.start == "free" and solution.claim.end != "periodic":
        return "a free start belongs to a periodic end only: its kinetic energy would not be paid for"
    if solution.claim.start == "given":
        start = task.start.heading, task.start.heading_rate
        where = "the task's start"
    else:
        start = state[2], state[5]
        where = "a start with B on its program"
    distance = float(np.abs(task.state_on_program(0.0, *start) - state).max())
    if distance > judged.allowed.start:
        return f"the motion starts {distance:.3g} (SI units) away from {where}"
    return ""


def _check_keep(judged: _Judged) -> str:
    task, measures, allowed, claim = judged.task, judged.measures, judged.allowed, judged.solution.claim
    speed = float(np.hypot(*task.motion.at(judged.samples.t)[1]).max())
    allowed_distance = allowed.path * max(1.0, speed * task.duration)
    if claim.keep == "tube":
        assert claim.radius is not None
        if measures["position_error_m"] > claim.radius + allowed_distance:
            return (
                f"B leaves its program by {measures['position_error_m']:.6g} m; radius of the tube {claim.radius:g} m"
            )
    elif claim.keep == "path":
        if measures["velocity_error_m_s"] > allowed.path * max(1.0, speed):
            return f"B leaves its program velocity by {measures['velocity_error_m_s']:.3g} m/s"
        if measures["position_error_m"] > allowed_distance:
            return f"B leaves its program by {measures['position_error_m']:.3g} m"
    return ""


def _check_claimed(judged: _Judged) -> str:
    task, measures, claimed = judged.task, judged.measures, judged.solution.claimed
    if claimed is None:
        return ""
    if abs(claimed.t[0]) > 1e-12 or abs(claimed.t[-1] - task.duration) > 1e-9 * task.duration:
        return f"the claimed motion covers {claimed.t[0]:.6g} s to {claimed.t[-1]:.6g} s, not the whole horizon"
    if measures["replay_error_m"] > judged.allowed.replay:
        return f"the claimed motion is {measures['replay_error_m']:.3g} m away from the true one"
    return ""


def _check_end(judged: _Judged) -> str:
    task, solution, end = judged.task, judged.solution, judged.replay.end_state
    claim = solution.claim
    # A path keeper's position at the end is checked with its path.
    kept = claim.keep == "path"
    if claim.end == "free":
        wanted, where = _on_program(task, end) if claim.keep == "ends" else end, "B's program"
    elif claim.end == "law":
        try:
            wanted, where = servo_end_state(task), "the servo law's end state"
        except IntegrationError as error:
            return f"the end state to be compared with is not known: {error}"
    elif claim.end == "rest":
        position = _on_program(task, end)[:2] if claim.keep == "ends" else end[:2]
        wanted, where = np.concatenate([position, [end[2]], np.zeros(3)]), "rest"
    else:
        assert solution.start_state is not None
        turned = float(solution.start_state[2]) + 2 * np.pi * (claim.winding or 0)
        position = end[:2] if kept else task.state_on_program(task.duration, turned, end[5])[:2]
        wanted = np.concatenate([position, [turned], solution.start_state[3:]])
        where = f"its start with {claim.winding or 0} full turns"
    distance = float(np.abs(wanted - end).max())
    if distance > judged.allowed.end:
        return f"the motion ends {distance:.3g} (SI units) away from {where}"
    return ""


def _on_program(task: Task, end: np.ndarray) -> np.ndarray:
    """(6,) The state with this heading and yaw rate and B on its program at the end."""
    return task.state_on_program(task.duration, float(end[2]), float(end[5]))
