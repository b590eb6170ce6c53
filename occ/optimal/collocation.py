"""The optimal controllers: direct collocation with B on its program, on a mesh that is refined to a tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le

from occ.checks import Positive, check_fields
from occ.control import SymbolicControl
from occ.errors import InputError, Status
from occ.laws.base import law_motion, open_loop_function, path_trajectory
from occ.laws.servo import ServoLaw
from occ.model.dynamics import friction_time
from occ.objectives import OBJECTIVES
from occ.optimal.limits import with_knots
from occ.optimal.mesh import SchemeName, graded_mesh
from occ.optimal.reduced import Ends
from occ.optimal.search import MOST_INTERVALS, Attempt, Method, Search
from occ.optimal.transcription import Bounds
from occ.task import Claim, EndClass, Solution, Task
from occ.trajectory import PiecewisePolynomial

LAYER = 3.0
"""Width of the first and last interval in units of the platform's shortest time constant of friction."""
SINGULAR_LAYER = 0.03
"""The same where the cost has no curvature in the torque: its layers are jumps of the yaw rate."""
EXTRA_TURNS = 1
"""Windings that ``any`` tries beyond those between no turn and the turns of the program."""


@dataclass(frozen=True, kw_only=True)
class Collocation:
    """min J over the yaw acceleration (and the null torques), with V_X and V_Y eliminated by eq. (3.6).

    Args:
        objective: what to minimise.
        keep: ``path``: B exactly on its program.
        end: ``free``; ``law`` for the end state of the servo law from the same start; ``periodic`` for the start's
            heading, up to full turns, and yaw rate; ``rest`` for no velocity.
        start: ``given``; ``free`` (only with end ``periodic``) chooses heading and yaw rate, too.
        winding: net full turns of the heading where the end is ``periodic``; ``any`` tries several and keeps the best.
        scheme: collocation points, Radau IIA or Gauss-Legendre.
        intervals: of the first mesh; the mesh is refined until the tolerance holds.
        degree: of the state's polynomials in each interval.
        tolerance: largest error between nodes, relative to max(1, size) of each state and of the cost.

    Raises:
        InputError: keys that contradict each other.

    Source: Betts, Practical Methods for Optimal Control and Estimation, chapter 4.
    """

    kind: ClassVar[str] = "collocation"
    objective: Literal["work", "torque_squared", "electric", "copper_loss"]
    keep: Literal["path"] = "path"
    end: EndClass = "free"
    start: Literal["given", "free"] = "given"
    winding: int | Literal["any"] | None = None
    scheme: SchemeName = "radau"
    intervals: Annotated[int, Ge(2), Le(MOST_INTERVALS)] = 16
    degree: Annotated[int, Ge(2), Le(12)] = 5
    tolerance: Positive = 1e-6

    def __post_init__(self) -> None:
        check_fields(self)
        if self.start == "free" and self.end != "periodic":
            raise InputError(
                "Collocation: start should be 'given' unless end is 'periodic'; a free start that nobody pays for is "
                "no optimum"
            )
        if self.winding is not None and self.end != "periodic":
            raise InputError(f"Collocation: winding should be left out where end is {self.end!r}, not 'periodic'")

    def check(self, task: Task) -> None:
        """Refuse a task whose program cannot end as asked.

        Raises:
            InputError: end ``rest`` on a program that moves at the end, ``periodic`` on one whose velocity differs.
        """
        _, velocity, _ = task.motion.at(np.array([0.0, task.duration]))
        speed = float(np.hypot(*velocity).max())
        if self.end == "rest" and np.hypot(*velocity[:, 1]) > 1e-9 * max(1.0, speed):
            raise InputError(
                f"collocation: end = 'rest' needs a motion that is at rest at t = {task.duration:g} s; there B should "
                f"move at {np.hypot(*velocity[:, 1]):.4g} m/s"
            )
        if self.end == "periodic" and np.abs(velocity[:, 1] - velocity[:, 0]).max() > 1e-9 * max(1.0, speed):
            raise InputError(
                "collocation: end = 'periodic' needs a motion with the same velocity at start and end; the horizon "
                "should be a whole number of laps"
            )

    def solve(self, task: Task) -> Solution:
        """Solve on a graded mesh, look between the nodes, refine, and solve again until tolerance and limits hold.

        Args:
            task: what to do.

        Returns:
            Solution whose control is the yaw acceleration in time; its torques follow from heading and yaw rate.

        Raises:
            InputError: a task whose program cannot end as asked.
        """
        self.check(task)
        best, tried = None, {}
        for winding in self._windings(task):
            solution = self._solve(task, winding)
            tried[winding] = solution.statistics.get("claimed_cost")
            better = best is None or (best.status is not Status.OK and solution.status is Status.OK)
            if best is not None and best.status is solution.status is Status.OK:
                better = solution.statistics["claimed_cost"] < best.statistics["claimed_cost"]
            if better:
                best = solution
        assert best is not None
        return replace(best, statistics=best.statistics | {"windings": tried}) if len(tried) > 1 else best

    def first_mesh(self, task: Task) -> np.ndarray:
        """(N + 1,) [s] Edges whose widths grow from the boundary layers at both ends, and the program's knots."""
        layer = SINGULAR_LAYER if OBJECTIVES[self.objective].rest is None else LAYER
        width = layer * friction_time(task.platform) / task.duration
        mesh = graded_mesh(self.intervals, width) * task.duration
        knots = task.motion.knots(task.duration)
        return with_knots(mesh, knots) if knots.size else mesh

    def _windings(self, task: Task) -> list[int | None]:
        if self.end != "periodic":
            return [None]
        if isinstance(self.winding, int):
            return [self.winding]
        turns = round((task.motion.turning_rate or 0.0) * task.duration / (2 * math.pi))
        return list(range(min(0, turns) - EXTRA_TURNS, max(0, turns) + EXTRA_TURNS + 1))

    def _solve(self, task: Task, winding: int | None) -> Solution:
        claim = Claim(start=self.start, end=self.end, winding=winding)
        failed = Solution(control=None, start_state=None, claim=claim, status=Status.FAILED)
        ends = self._ends(task, winding)
        if ends is None:
            return replace(failed, message="the servo law is unstable on this horizon, so that it has no end state")
        method = Method(objective=self.objective, scheme=self.scheme, degree=self.degree, tolerance=self.tolerance)
        turn = None if winding is None else 2 * math.pi * winding
        search = Search(task, method, ends, turn)
        attempt, reason = search.run(self.first_mesh(task))
        if attempt.outcome.status is not Status.OK or reason:
            status = attempt.outcome.status if attempt.outcome.status is not Status.OK else Status.FAILED
            return replace(failed, status=status, message=reason, statistics={"rounds": search.rounds})
        statistics = {"claimed_cost": attempt.outcome.cost, "rounds": search.rounds}
        return replace(self._solution(task, attempt), claim=claim, statistics=statistics)

    def _ends(self, task: Task, winding: int | None) -> Ends | None:
        given = np.array([task.start.heading, task.start.heading_rate])
        start, end, difference = Bounds.fixed(given), Bounds.free(2), Bounds.free(2)
        if self.end == "law":
            motion, _ = law_motion(ServoLaw(), task, np.array([0.0, task.duration]), tolerance=1e-12)
            if motion is None:
                return None
            end = Bounds.fixed(motion[:2, -1])
        elif self.end == "rest":
            end = Bounds(lower=np.array([-np.inf, 0.0]), upper=np.array([np.inf, 0.0]))
        elif winding is not None:
            difference = Bounds.fixed(np.array([2 * math.pi * winding, 0.0]))
        if self.start == "free":
            # Headings that differ by full turns are the same start.
            turn = np.array([math.pi, np.inf])
            start = Bounds(lower=given - turn, upper=given + turn)
        return Ends(start=start, end=end, difference=difference)

    def _solution(self, task: Task, attempt: Attempt) -> Solution:
        transcription, nodes, edges = attempt.transcription, attempt.outcome.nodes, attempt.edges
        null_count = task.platform.wheel_count - 3
        missing = null_count + 1 - len(nodes.control)
        signals = np.concatenate([nodes.control, np.zeros((missing, *nodes.control.shape[1:]))])
        signal = PiecewisePolynomial(edges, transcription.scheme.points, signals)
        law = open_loop_function(task.platform.wheel_count, *task.motion_structure)
        s = np.linspace(0.0, 1.0, 12, endpoint=False)
        t = np.append((edges[:-1, None] + np.diff(edges)[:, None] * s).ravel(), task.duration)
        state, _, control = transcription.interpolate(nodes, np.append(s, 1.0))
        inner = [np.append(row[:, :-1].ravel(), row[-1, -1]) for row in (*state, control[0])]
        return Solution(
            control=SymbolicControl(law, task.path_data, signal, task.motion.knots(task.duration)),
            start_state=task.state_on_program(0.0, *nodes.edges[:, 0]),
            claimed=path_trajectory(task, t, *inner),
            local_objective=self.objective,
        )
