"""From a first mesh to a solution that is fine enough: knots at switching times, refinement, back-off from limits."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from occ.errors import Status
from occ.optimal.error import ErrorEstimate, estimate_error, fine_points
from occ.optimal.limits import (
    LimitedArcs,
    limit_values,
    limited_arcs,
    limited_quantities,
    sample_places,
    with_knots,
)
from occ.optimal.mesh import SchemeName, bisect
from occ.optimal.reduced import (
    Ends,
    Structure,
    damping,
    guess_from_law,
    numbers_of,
    program_data,
    reduced_transcription,
)
from occ.optimal.transcription import Bounds, Nodes, Numbers, Outcome, SolverOptions, Transcription
from occ.task import Task

ROUNDS = 16
"""Meshes that are tried at most."""
STALL = 3
"""Refinements in which the error should at least halve."""
KNOT_ROUNDS = 4
"""Times that edges are moved to the switching times at most."""
BACKOFFS = 8
"""Tightenings of the limits that are tried at most."""
HELD = 3e-7
"""A limit is held if it is passed by at most this, relative to it; the referee allows three times as much."""
MOST_INTERVALS = 2000


@dataclass(frozen=True, kw_only=True)
class Method:
    """How to solve: objective, scheme, degree of the polynomials, tolerance of the error between nodes."""

    objective: str
    scheme: SchemeName
    degree: int
    tolerance: float


@dataclass(frozen=True)
class Attempt:
    """One solve: the program, its numbers, what came out, and how good it is between the nodes."""

    transcription: Transcription
    numbers: Numbers
    outcome: Outcome
    error: ErrorEstimate | None = None
    arcs: LimitedArcs | None = None

    @property
    def edges(self) -> np.ndarray:
        """(N + 1,) [s] its mesh."""
        return self.numbers.edges

    @property
    def excess_share(self) -> float:
        """Mean over time of the largest excess over a limit, relative to the limit: what a back-off would cost."""
        if self.arcs is None:
            return 0.0
        widths = np.diff(self.edges)
        return float(self.arcs.excess.max(axis=0) @ widths / widths.sum())


@dataclass
class Search:
    """Solves one task on better and better meshes.

    Args:
        task: what to do.
        method: how.
        ends: bounds at both ends.
        turn: [rad] net turn of the first guess; None is the law's.
        rounds: what each solve gave, for the record.
    """

    task: Task
    method: Method
    ends: Ends
    turn: float | None = None
    rounds: list[dict[str, Any]] = field(default_factory=list)

    def run(self, edges: np.ndarray) -> tuple[Attempt, str]:
        """Solve until error and limits hold between the nodes.

        Args:
            edges: (N + 1,) [s] first mesh.

        Returns:
            The last attempt, and why it is not good enough (empty where it is).
        """
        attempt = self._place_knots(self._attempt(edges, None))
        for _ in range(ROUNDS):
            if attempt.outcome.status is not Status.OK or attempt.error is None:
                return attempt, attempt.outcome.message
            if attempt.error.total > self.method.tolerance:
                if self._stalled():
                    break
                mesh = refine(attempt.edges, attempt.error, self.method.tolerance)
            elif attempt.excess_share > self.method.tolerance:
                mesh = split_excess(attempt, self.method.tolerance)
            else:
                return self._back_off(attempt)
            if len(mesh) - 1 > MOST_INTERVALS:
                break
            attempt = self._attempt(mesh, attempt)
        last = self.rounds[-1]
        return attempt, (
            f"the error between nodes is still {last['error']:.2g} after {len(self.rounds)} meshes, the last of "
            f"{last['intervals']} intervals, and limits are passed by {last['excess']:.2g}; tolerance "
            f"{self.method.tolerance:g}"
        )

    def _place_knots(self, first: Attempt) -> Attempt:
        """Move edges to the switching times while that lowers what is passed between the nodes."""
        best, base = first, first.edges
        for _ in range(KNOT_ROUNDS):
            if best.arcs is None or best.excess_share <= self.method.tolerance:
                break
            attempt = self._attempt(with_knots(base, best.arcs.switching_times()), best)
            if attempt.arcs is None or attempt.excess_share > best.excess_share / 2:
                break
            best = attempt
        return best

    def _stalled(self) -> bool:
        errors = [r["error"] for r in self.rounds]
        return len(errors) > STALL and errors[-1] > errors[-1 - STALL] / 2

    def _attempt(self, edges: np.ndarray, before: Attempt | None, path: Bounds | None = None) -> Attempt:
        limits = limited_quantities(self.task.limits)
        wheels, method = self.task.platform.wheel_count, self.method
        structure = Structure(wheels, method.objective, len(edges) - 1, method.degree, method.scheme, limits)
        transcription = reduced_transcription(structure, SolverOptions())
        numbers = numbers_of(self.task, transcription, edges, self.ends, damping(self.task, structure))
        if path is not None:
            numbers = replace(numbers, path=path)
        if before is None:
            guess = guess_from_law(self.task, transcription, edges, self.turn)
        else:
            guess = resample(before, transcription, edges)
        outcome = transcription.solve(numbers, guess)
        attempt = Attempt(transcription, numbers, outcome)
        if outcome.status is Status.OK:
            attempt = self._look_between_nodes(attempt, limits)
        error = attempt.error.total if attempt.error else None
        excess = float(attempt.arcs.excess.max()) if attempt.arcs else 0.0
        self.rounds.append(outcome.statistics | {"intervals": len(edges) - 1, "error": error, "excess": excess})
        return attempt

    def _look_between_nodes(self, attempt: Attempt, limits: tuple[str, ...]) -> Attempt:
        transcription, numbers, outcome = attempt.transcription, attempt.numbers, attempt.outcome

        def data_at(s: np.ndarray) -> np.ndarray:
            edges = numbers.edges
            return program_data(self.task, edges[:-1, None] + np.diff(edges)[:, None] * s)

        fine = data_at(fine_points(self.method.degree)[0])
        error = estimate_error(transcription, outcome.nodes, numbers, fine, outcome.cost)
        if not limits:
            return replace(attempt, error=error)
        values = limit_values(self.task.limits, self.task.platform.wheel_count)
        arcs = limited_arcs(transcription, outcome.nodes, numbers, data_at(sample_places()), values)
        return replace(attempt, error=error, arcs=arcs)

    def _back_off(self, attempt: Attempt) -> tuple[Attempt, str]:
        """Take what is passed between the nodes off the limits of that interval, until nothing is passed."""
        if attempt.arcs is None:
            return attempt, ""
        values = limit_values(self.task.limits, self.task.platform.wheel_count)
        taken = np.zeros_like(attempt.arcs.excess)
        for _ in range(BACKOFFS):
            assert attempt.arcs is not None
            excess = attempt.arcs.excess
            if excess.max() <= HELD:
                return attempt, ""
            taken += 1.1 * excess
            tight = np.repeat((values[:, None] * (1.0 - taken))[:, :, None], self.method.degree, axis=2)
            before = attempt
            attempt = self._attempt(attempt.edges, attempt, Bounds(lower=-tight, upper=tight))
            if attempt.outcome.status is not Status.OK:
                return before, f"a limit is passed by {excess.max():.2g} of its value between nodes"
        return attempt, f"a limit is still passed by {self.rounds[-1]['excess']:.2g} of its value between nodes"


def resample(before: Attempt, transcription: Transcription, edges: np.ndarray) -> Nodes:
    """A solution as the guess on another mesh.

    Args:
        before: with the solution.
        transcription: of the new mesh.
        edges: (M + 1,) [s] the new mesh.

    Returns:
        States and controls at the new nodes.
    """
    old, old_edges = before.transcription, before.edges

    def at(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = np.clip(np.searchsorted(old_edges, t, side="right") - 1, 0, len(old_edges) - 2)
        s = (t - old_edges[k]) / np.diff(old_edges)[k]
        return old.at_places(before.outcome.nodes, k, s)

    points = transcription.node_times(edges)
    state, _ = at(edges)
    inner, control = at(points.ravel())
    return Nodes(state, inner.reshape(len(inner), *points.shape), control.reshape(len(control), *points.shape))


def split_excess(attempt: Attempt, tolerance: float) -> np.ndarray:
    """A mesh in which the intervals that contribute to `Attempt.excess_share` are cut into four.

    Where the control jumps no mesh avoids the excess, but it can be kept to ever shorter intervals.

    Args:
        attempt: with its excess in each interval.
        tolerance: for the mean over time.

    Returns:
        (M + 1,) [s] edges.
    """
    assert attempt.arcs is not None
    edges, widths = attempt.edges, np.diff(attempt.edges)
    shares = attempt.arcs.excess.max(axis=0) * widths / widths.sum()
    marked = shares > tolerance / (2 * len(widths))
    quarters = edges[:-1, None] + widths[:, None] * np.array([0.25, 0.5, 0.75])
    return np.sort(np.concatenate([edges, quarters[marked].ravel()]))


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
