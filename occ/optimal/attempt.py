"""What the refinement of meshes works with: a mesh, a method, and one solve with what it is worth between its nodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from occ.optimal.error import ErrorEstimate
from occ.optimal.limits import LimitedArcs
from occ.optimal.mesh import SchemeName, bisect
from occ.optimal.problem import Nodes, Numbers, Problem
from occ.optimal.solvers import ACCEPTABLE, STOPPED_SHORT, SolverOptions
from occ.optimal.transcription import Outcome, Transcription

Guess = Callable[[Transcription, np.ndarray], Nodes]
"""(transcription, edges (N + 1,) [s]) -> where a first solve starts."""

PROGRAMS = 64
"""Nonlinear programs that a process keeps: each takes some megabytes, and sweeps use many mesh sizes."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Where a problem is solved: edges (N + 1,) [s], degree of the polynomials, collocation points."""

    edges: np.ndarray
    degree: int
    scheme: SchemeName = "radau"

    @property
    def intervals(self) -> int:
        """N."""
        return len(self.edges) - 1

    @property
    def doubled(self) -> Grid:
        """Every interval cut in two."""
        return replace(self, edges=bisect(self.edges, np.ones(self.intervals, dtype=bool)))


@dataclass(frozen=True, kw_only=True)
class Method:
    """How to solve.

    Args:
        degree: of the polynomials on the first mesh.
        tolerance: of the error between nodes, relative to max(1, size) of states and cost.
        options: of the solver.
        doubled: whether a doubled mesh has to confirm the cost.
    """

    degree: int
    tolerance: float
    options: SolverOptions
    doubled: bool = False


@lru_cache(maxsize=PROGRAMS)
def transcription_of(
    problem: Problem, intervals: int, degree: int, scheme: SchemeName, options: SolverOptions
) -> Transcription:
    """The nonlinear program of a problem and a mesh size, built once in a process as long as it is among the latest."""
    return Transcription(problem, intervals, degree, scheme, options)


@dataclass(frozen=True)
class Attempt:
    """One solve: the program, its numbers, what came out, and how good it is between the nodes.

    Args:
        transcription: of its mesh.
        numbers: with its edges and bounds.
        outcome: of the solver.
        guess: where the solver started.
        error: between the nodes; None where there is no solution.
        arcs: limits and clipped powers between the nodes; None where there are none.
        doubled: change of the cost when every interval was cut in two, relative to max(1, |J|); NaN where that was not
            tried, infinite where it had no solution or would have too many intervals.
        growth: largest control on the doubled mesh, in units of that on this one; about 2 where a jump is spread over
            one interval; NaN where there is none.
        dearer: what it costs to hold the limits between the nodes, too, relative to max(1, |J|).
    """

    transcription: Transcription
    numbers: Numbers
    outcome: Outcome
    guess: Nodes
    error: ErrorEstimate | None = None
    arcs: LimitedArcs | None = None
    doubled: float = np.nan
    growth: float = np.nan
    dearer: float = 0.0

    @property
    def edges(self) -> np.ndarray:
        """(N + 1,) [s] its mesh."""
        return self.numbers.edges

    @property
    def grid(self) -> Grid:
        """Its mesh, with degree and collocation points."""
        return Grid(edges=self.edges, degree=self.transcription.degree, scheme=self.transcription.name)

    @property
    def excess_share(self) -> float:
        """Mean over time of the largest excess over a limit, relative to the limit: what a back-off would cost."""
        if self.arcs is None or not len(self.arcs.largest):
            return 0.0
        widths = np.diff(self.edges)
        return float(self.arcs.excess.max(axis=0) @ widths / widths.sum())

    @property
    def hard_excess(self) -> float:
        """Largest part by which a limit of the task is passed between the nodes."""
        return float(self.arcs.hard_excess.max(initial=0.0)) if self.arcs is not None else 0.0

    def passes(self, part: float) -> np.ndarray:
        """(N,) of booleans: intervals in which a limit of the task is passed by more than this part of it."""
        if self.arcs is None or not self.arcs.hard:
            return np.zeros(len(self.edges) - 1, dtype=bool)
        return np.asarray(self.arcs.hard_excess.max(axis=0) > part)

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

    @property
    def quality(self) -> dict[str, float | None]:
        """What is claimed of a solution that is fine, for the record of the run."""
        assert self.error is not None
        return {
            "claimed_cost": self.outcome.cost,
            "error": self.error.total,
            "doubled_mesh": self.doubled if math.isfinite(self.doubled) else None,
            "control_growth": self.growth if math.isfinite(self.growth) else None,
            "limits_cost": self.dearer,
        }

    @property
    def words(self) -> str:
        """The achieved error, for a message."""
        assert self.error is not None
        grid = f"{len(self.edges) - 1} intervals of degree {self.transcription.degree}"
        twice = f"; twice as many change the cost by {self.doubled:.1g} of it" if np.isfinite(self.doubled) else ""
        if self.doubled == math.inf:
            twice = "; not confirmed by twice as many, which have no solution or are too many"
        held = f"; holding the limits between nodes costs {self.dearer:.1g} of it" if self.dearer > 0.0 else ""
        proven = f"; {self.arcs.words}" if self.arcs is not None and self.arcs.words else ""
        short = self.outcome.statistics.get("return_status") == STOPPED_SHORT
        loose = f"; its optimality conditions hold to {ACCEPTABLE:.0e} only" if short else ""
        return f"error between nodes {self.error.total:.1g} on {grid}{twice}{loose}{held}{proven}"
