"""From a first mesh to a solution that is fine enough: knots at switching times, refinement, back-off from limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from occ.errors import Status
from occ.optimal.elastic import explained
from occ.optimal.error import ErrorEstimate, estimate_error, fine_points
from occ.optimal.formulation import Formulation, Rotation
from occ.optimal.limits import LimitedArcs, with_knots
from occ.optimal.mesh import SchemeName
from occ.optimal.problem import Bounds, Nodes, Numbers, Problem
from occ.optimal.refinement import MOST_INTERVALS, refine, resample
from occ.optimal.solvers import SolverOptions
from occ.optimal.transcription import Outcome, Transcription

ROUNDS = 16
"""Meshes that are tried at most."""
STALL = 3
"""Refinements in which the error should at least halve."""
STALL_AT_KINKS = 6
"""The same where powers change their sign: a mesh that misses such a time is no better than the one before."""
KNOT_ROUNDS = 4
"""Times that edges are moved to the switching times at most."""
BACKOFFS = 8
"""Tightenings of the limits that are tried at most."""
HELD = 3e-7
"""A limit is held if it is passed by at most this, relative to it; the referee allows three times as much."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """How to solve: degree of the polynomials, tolerance of the error between nodes, options of the solver."""

    degree: int
    tolerance: float
    options: SolverOptions


@cache
def transcription_of(
    problem: Problem, intervals: int, degree: int, scheme: SchemeName, options: SolverOptions
) -> Transcription:
    """The nonlinear program of a problem and a mesh size, built once in a process."""
    return Transcription(problem, intervals, degree, scheme, options)


@dataclass(frozen=True)
class Attempt:
    """One solve: the program, its numbers, what came out, and how good it is between the nodes."""

    transcription: Transcription
    numbers: Numbers
    outcome: Outcome
    guess: Nodes
    error: ErrorEstimate | None = None
    arcs: LimitedArcs | None = None

    @property
    def edges(self) -> np.ndarray:
        """(N + 1,) [s] its mesh."""
        return self.numbers.edges

    @property
    def excess_share(self) -> float:
        """Mean over time of the largest excess over a limit, relative to the limit: what a back-off would cost."""
        if self.arcs is None or not self.arcs.hard:
            return 0.0
        widths = np.diff(self.edges)
        return float(self.arcs.hard_excess.max(axis=0) @ widths / widths.sum())

    @property
    def largest_excess(self) -> float:
        """Part by which the largest torque is passed between the nodes, where it is the cost."""
        return float(self.arcs.soft_excess.max(initial=0.0)) if self.arcs is not None else 0.0

    @property
    def badness(self) -> float:
        """What knots can lower: excesses, and the error where powers change their sign inside an interval."""
        if self.arcs is None:
            return 0.0
        clipped = self.error.total if self.error is not None and len(self.arcs.clipped) else 0.0
        return max(self.excess_share, self.largest_excess, clipped)


@dataclass
class Search:
    """Solves one problem on better and better meshes.

    Args:
        formulation: task and problem.
        method: how.
        rounds: what each solve gave, for the record.
    """

    formulation: Formulation
    method: Method
    rounds: list[dict[str, Any]] = field(default_factory=list)

    def starts(self, edges: np.ndarray, rotations: Sequence[Rotation]) -> list[Attempt]:
        """A first solve from each guess.

        Args:
            edges: (N + 1,) [s] first mesh.
            rotations: guesses.

        Returns:
            One attempt for each.
        """
        return [self._attempt(edges, rotation) for rotation in rotations]

    def run(self, first: Attempt) -> tuple[Attempt, str]:
        """Solve until error and limits hold between the nodes.

        Args:
            first: on the first mesh.

        Returns:
            The last attempt, and why it is not good enough (empty where it is).
        """
        attempt, tolerance = self._place_knots(first), self.method.tolerance
        errors: list[float] = []
        stall = STALL_AT_KINKS if self.formulation.shape.slacks else STALL
        for _ in range(ROUNDS):
            if attempt.outcome.status is not Status.OK or attempt.error is None:
                attempt = self._explained(attempt)
                return attempt, attempt.outcome.message
            if attempt.error.total > tolerance:
                errors.append(attempt.error.total)
                if len(errors) > stall and min(errors[-stall:]) > errors[-1 - stall] / 2:
                    break
                mesh = self._refined(attempt, attempt.error)
            elif max(attempt.excess_share, attempt.largest_excess) > tolerance:
                mesh = split_excess(attempt, tolerance)
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

    def _explained(self, attempt: Attempt) -> Attempt:
        """The attempt with the contradicting limits named, where they are what keeps it from a solution."""
        rows = np.arange(len(self.formulation.hard_limits))
        outcome = explained(attempt.transcription, attempt.numbers, attempt.outcome, attempt.guess, rows)
        return replace(attempt, outcome=outcome)

    def _place_knots(self, first: Attempt) -> Attempt:
        """Move edges to the switching times while that lowers what is wrong between the nodes."""
        best, base = first, first.edges
        for _ in range(KNOT_ROUNDS):
            if best.arcs is None or best.badness <= self.method.tolerance:
                break
            attempt = self._attempt(with_knots(base, best.arcs.switching_times()), best)
            if attempt.arcs is None or attempt.badness > best.badness / 2:
                break
            best = attempt
        return best

    def _refined(self, attempt: Attempt, error: ErrorEstimate) -> np.ndarray:
        """A finer mesh, with edges where a clipped power changes its sign in an interval that is not fine enough."""
        mesh = refine(attempt.edges, error, self.method.tolerance)
        if attempt.arcs is None or not len(attempt.arcs.clipped):
            return mesh
        times = attempt.arcs.sign_changes()
        interval = np.clip(np.searchsorted(attempt.edges, times) - 1, 0, len(error.cost) - 1)
        coarse = np.abs(error.cost) > self.method.tolerance / (2 * len(error.cost))
        return with_knots(mesh, times[coarse[interval]])

    def _attempt(self, edges: np.ndarray, before: Attempt | Rotation, path: Bounds | None = None) -> Attempt:
        formulation, method = self.formulation, self.method
        scheme = formulation.settings.scheme
        transcription = transcription_of(formulation.problem(), len(edges) - 1, method.degree, scheme, method.options)
        numbers = formulation.numbers(transcription, edges)
        if path is not None:
            numbers = replace(numbers, path=path)
        if isinstance(before, Attempt):
            guess = resample(before.transcription, before.edges, before.outcome.nodes, transcription, edges)
        else:
            guess = formulation.guess(transcription, edges, before)
        outcome = transcription.solve(numbers, guess)
        attempt = Attempt(transcription, numbers, outcome, guess)
        if outcome.status is Status.OK:
            attempt = self._look_between_nodes(attempt)
        error = attempt.error.total if attempt.error else None
        excess = float(attempt.arcs.hard_excess.max(initial=0.0)) if attempt.arcs else 0.0
        self.rounds.append(outcome.statistics | {"intervals": len(edges) - 1, "error": error, "excess": excess})
        return attempt

    def _look_between_nodes(self, attempt: Attempt) -> Attempt:
        transcription, numbers, outcome = attempt.transcription, attempt.numbers, attempt.outcome
        fine = self.formulation.data(numbers.edges, fine_points(self.method.degree)[0])
        error = estimate_error(transcription, outcome.nodes, numbers, fine, outcome.cost)
        overpaid = self.formulation.overpaid(transcription, outcome.nodes, numbers)
        error = replace(error, cost=error.cost - overpaid / max(1.0, abs(outcome.cost)))
        arcs = self.formulation.arcs(transcription, outcome.nodes, numbers)
        return replace(attempt, error=error, arcs=arcs)

    def _back_off(self, attempt: Attempt) -> tuple[Attempt, str]:
        """Take what is passed between the nodes off the limits of that interval, until nothing is passed."""
        if attempt.arcs is None or not attempt.arcs.hard:
            return attempt, ""
        taken = np.zeros_like(attempt.arcs.hard_excess)
        for _ in range(BACKOFFS):
            assert attempt.arcs is not None
            excess = attempt.arcs.hard_excess
            if excess.max() <= HELD:
                return attempt, ""
            taken += 1.1 * excess
            before = attempt
            attempt = self._attempt(attempt.edges, attempt, self.formulation.path_bounds(taken, self.method.degree))
            if attempt.outcome.status is not Status.OK:
                return before, f"a limit is passed by {excess.max():.2g} of its value between nodes"
        return attempt, f"a limit is still passed by {self.rounds[-1]['excess']:.2g} of its value between nodes"


def split_excess(attempt: Attempt, tolerance: float) -> np.ndarray:
    """A mesh in which the intervals that contribute to the excesses of an attempt are cut into four.

    Where the control jumps no mesh avoids the excess, but it can be kept to ever shorter intervals.

    Args:
        attempt: with its excess in each interval.
        tolerance: for the mean over time.

    Returns:
        (M + 1,) [s] edges.
    """
    assert attempt.arcs is not None
    edges, widths = attempt.edges, np.diff(attempt.edges)
    marked = attempt.arcs.soft_excess.max(axis=0, initial=0.0) > tolerance
    if attempt.arcs.hard:
        shares = attempt.arcs.hard_excess.max(axis=0) * widths / widths.sum()
        marked |= shares > tolerance / (2 * len(widths))
    quarters = edges[:-1, None] + widths[:, None] * np.array([0.25, 0.5, 0.75])
    return np.sort(np.concatenate([edges, quarters[marked].ravel()]))
