"""The optimal controllers: direct collocation with B on its program, on a mesh that is refined to a tolerance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le

from occ.checks import Positive, check_fields
from occ.control import SymbolicControl
from occ.errors import Status
from occ.laws.base import law_motion, open_loop_function, path_trajectory
from occ.laws.servo import ServoLaw
from occ.model.dynamics import friction_time
from occ.objectives import OBJECTIVES
from occ.optimal.error import ErrorEstimate, estimate_error, fine_points
from occ.optimal.mesh import SchemeName, bisect, graded_mesh
from occ.optimal.reduced import Structure, guess_from_law, numbers_of, program_data, reduced_transcription
from occ.optimal.transcription import Bounds, Outcome, SolverOptions, Transcription
from occ.task import Claim, Solution, Task
from occ.trajectory import PiecewisePolynomial

REFINEMENTS = 8
STALL = 2
"""Refinements in which the error should at least halve."""
MOST_INTERVALS = 2000
LAYER = 3.0
"""Width of the first and last interval in units of the platform's shortest time constant of friction."""
SINGULAR_LAYER = 0.03
"""The same where the cost has no curvature in the torque: its layers are jumps of the yaw rate."""


@dataclass(frozen=True, kw_only=True)
class Collocation:
    """min J over the yaw acceleration, with V_X and V_Y eliminated by eq. (3.6).

    Args:
        objective: what to minimise.
        keep: ``path``: B exactly on its program.
        end: ``free``, or ``law`` for the end state of the servo law from the same start.
        scheme: collocation points, Radau IIA or Gauss-Legendre.
        intervals: of the first mesh; the mesh is refined until the tolerance holds.
        degree: of the state's polynomials in each interval.
        tolerance: largest error between nodes, relative to max(1, size) of each state and of the cost.

    Source: Betts, Practical Methods for Optimal Control and Estimation, chapter 4.
    """

    kind: ClassVar[str] = "collocation"
    objective: Literal["work", "torque_squared"]
    keep: Literal["path"] = "path"
    end: Literal["free", "law"] = "free"
    scheme: SchemeName = "radau"
    intervals: Annotated[int, Ge(2), Le(MOST_INTERVALS)] = 16
    degree: Annotated[int, Ge(2), Le(12)] = 5
    tolerance: Positive = 1e-6

    def __post_init__(self) -> None:
        check_fields(self)

    def solve(self, task: Task) -> Solution:
        """Solve on a graded mesh, estimate the error between nodes, refine, and solve again until the tolerance holds.

        Args:
            task: what to do.

        Returns:
            Solution whose control is the yaw acceleration in time; its torques follow from heading and yaw rate.
        """
        start = task.state_on_program(0.0, task.start.heading, task.start.heading_rate)
        failed = Solution(control=None, start_state=start, claim=Claim(end=self.end), status=Status.FAILED)
        end = self._end_bounds(task)
        if end is None:
            return replace(failed, message="the servo law is unstable on this horizon, so that it has no end state")
        edges = self.first_mesh(task)
        rounds: list[dict[str, Any]] = []
        for _ in range(REFINEMENTS):
            transcription, outcome, error = self._solve_on(task, edges, end)
            rounds.append(outcome.statistics | {"intervals": len(edges) - 1, "error": error.total if error else None})
            if outcome.status is not Status.OK or error is None:
                return replace(failed, status=outcome.status, message=outcome.message, statistics={"rounds": rounds})
            if error.total <= self.tolerance:
                return self._solution(task, edges, transcription, outcome, start, rounds)
            if len(rounds) > STALL and error.total > rounds[-1 - STALL]["error"] / 2:
                break
            finer = refine(edges, error, self.tolerance)
            if len(finer) - 1 > MOST_INTERVALS:
                break
            edges = finer
        reason = (
            f"the error between nodes is still {rounds[-1]['error']:.2g} after {len(rounds)} meshes, the last of "
            f"{rounds[-1]['intervals']} intervals; tolerance {self.tolerance:g}"
        )
        if self.scheme == "legendre" and OBJECTIVES[self.objective].rest is None:
            reason += "; the end of the horizon is no Legendre point, which lets the yaw rate jump there: use radau"
        return replace(failed, message=reason, statistics={"rounds": rounds})

    def first_mesh(self, task: Task) -> np.ndarray:
        """(N + 1,) [s] Edges whose widths grow geometrically from the boundary layers at both ends."""
        layer = SINGULAR_LAYER if OBJECTIVES[self.objective].rest is None else LAYER
        width = layer * friction_time(task.platform) / task.duration
        return graded_mesh(self.intervals, width) * task.duration

    def _end_bounds(self, task: Task) -> Bounds | None:
        if self.end == "free":
            return Bounds.free(2)
        motion, _ = law_motion(ServoLaw(), task, np.array([0.0, task.duration]), tolerance=1e-12)
        return None if motion is None else Bounds.fixed(motion[:2, -1])

    def _solve_on(
        self, task: Task, edges: np.ndarray, end: Bounds
    ) -> tuple[Transcription, Outcome, ErrorEstimate | None]:
        structure = Structure(task.platform.wheel_count, self.objective, len(edges) - 1, self.degree, self.scheme)
        transcription = reduced_transcription(structure, SolverOptions())
        numbers = numbers_of(task, transcription, edges, end)
        outcome = transcription.solve(numbers, guess_from_law(task, transcription, edges))
        if outcome.status is not Status.OK:
            return transcription, outcome, None
        s, _ = fine_points(self.degree)
        fine = program_data(task, edges[:-1, None] + np.diff(edges)[:, None] * s)
        return transcription, outcome, estimate_error(transcription, outcome.nodes, numbers, fine, outcome.cost)

    def _solution(
        self,
        task: Task,
        edges: np.ndarray,
        transcription: Transcription,
        outcome: Outcome,
        start: np.ndarray,
        rounds: list[dict[str, Any]],
    ) -> Solution:
        points = transcription.scheme.points
        null = np.zeros((task.platform.wheel_count - 3, len(edges) - 1, self.degree))
        signal = PiecewisePolynomial(edges, points, np.concatenate([outcome.nodes.control, null]))
        law = open_loop_function(task.platform.wheel_count, *task.motion_structure)
        s = np.linspace(0.0, 1.0, 12, endpoint=False)
        t = np.append((edges[:-1, None] + np.diff(edges)[:, None] * s).ravel(), task.duration)
        state, _, control = transcription.interpolate(outcome.nodes, np.append(s, 1.0))
        inner = [np.append(row[:, :-1].ravel(), row[-1, -1]) for row in (*state, *control)]
        return Solution(
            control=SymbolicControl(law, task.path_data, signal),
            start_state=start,
            claim=Claim(end=self.end),
            claimed=path_trajectory(task, t, *inner),
            statistics={"claimed_cost": outcome.cost, "rounds": rounds},
            local_objective=self.objective,
        )


def refine(edges: np.ndarray, error: ErrorEstimate, tolerance: float) -> np.ndarray:
    """Bisect the intervals that contribute most, until those that remain could meet the tolerance together.

    The number of intervals is rounded up to a multiple of eight, so that cases of a sweep share their programs.

    Args:
        edges: (N + 1,).
        error: of each interval.
        tolerance: for their sum.

    Returns:
        A finer mesh.
    """
    each = error.each
    order = np.argsort(-each)
    remaining = each.sum() - np.cumsum(each[order])
    needed = 1 + int(np.argmax(remaining <= tolerance / 2))
    count = len(each)
    target = 8 * -(-(count + needed) // 8)
    marked = np.zeros(count, dtype=bool)
    marked[order[: min(target - count, count)]] = True
    return bisect(edges, marked)
