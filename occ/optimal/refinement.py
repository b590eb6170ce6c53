"""Better meshes for any problem: shorter intervals where a solution is rough, higher degrees where it is smooth.

The error is that of `occ.optimal.error`: the residual of the differential equation between the nodes, and the cost on a
finer rule.  A solution is accepted when that is below the tolerance and a mesh with every interval cut in two gives the
same cost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from occ.errors import Status
from occ.optimal.error import ErrorEstimate, estimate_error, fine_points
from occ.optimal.mesh import SchemeName, bisect
from occ.optimal.problem import Nodes, Numbers, Problem
from occ.optimal.solvers import SolverOptions
from occ.optimal.transcription import Outcome, Transcription

MOST_INTERVALS = 2000
MOST_DEGREE = 12
ROUNDS = 24
"""Meshes that are tried at most."""
STALL = 5
"""Solves in which the error should at least halve."""
LOW_DEGREE = 4
"""Below it there are too few coefficients to judge smoothness by: the degree is raised first."""
SMOOTH = 1.2
"""Coefficients of a control or a rate that fall at least like exp(-1.2 j) are those of a smooth arc: raising the degree
by two then gains more than cutting the interval in two, for the same number of unknowns."""


class Posed(Protocol):
    """A problem with its numbers on any mesh."""

    @property
    def problem(self) -> Problem:
        """What is solved."""

    def numbers(self, transcription: Transcription, edges: np.ndarray) -> Numbers:
        """On a mesh (N + 1,)."""

    def data(self, edges: np.ndarray, s: np.ndarray) -> np.ndarray:
        """(nd, N, m) Node data at the places s (m,) of each interval."""

    def guess(self, transcription: Transcription, edges: np.ndarray) -> Nodes:
        """Where the first solve starts."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Where a problem is solved: edges (N + 1,) [s], degree of the polynomials, collocation points."""

    edges: np.ndarray
    degree: int
    scheme: SchemeName = "radau"


@dataclass(frozen=True)
class Refined:
    """The last solve.

    Args:
        transcription: of the last mesh.
        numbers: with its edges.
        outcome: its message says where the tolerance was not reached.
        error: estimate on it; infinite where there was no solution.
        doubled: change of the cost when every interval was cut in two, relative to max(1, |J|).
        rounds: intervals, degree and error of each solve.
    """

    transcription: Transcription
    numbers: Numbers
    outcome: Outcome
    error: float
    doubled: float
    rounds: tuple[tuple[int, int, float], ...]


def solve_to_tolerance(posed: Posed, grid: Grid, tolerance: float, options: SolverOptions | None = None) -> Refined:
    """Solve, look between the nodes, refine, and solve again until the tolerance holds on a doubled mesh, too.

    Args:
        posed: the problem.
        grid: the first one.
        tolerance: of states and cost, relative to max(1, size).
        options: of the solver.

    Returns:
        The finest solve; ``FAILED`` with the error that was reached where the tolerance was not.
    """
    rounds: list[tuple[int, int, float]] = []
    last: _Solve | None = None
    confirmed: _Solve | None = None
    for _ in range(ROUNDS):
        solve = _solve(posed, grid, last, options)
        rounds.append((len(grid.edges) - 1, grid.degree, solve.error.total if solve.error else np.inf))
        if solve.error is None:
            return Refined(solve.transcription, solve.numbers, solve.outcome, np.inf, np.inf, tuple(rounds))
        doubled = np.inf
        if confirmed is not None:
            cost = solve.outcome.cost
            doubled = abs(cost - confirmed.outcome.cost) / max(1.0, abs(cost))
        if solve.error.total <= tolerance and doubled <= tolerance:
            return Refined(solve.transcription, solve.numbers, solve.outcome, solve.error.total, doubled, tuple(rounds))
        if solve.error.total <= tolerance:
            confirmed, grid = solve, replace(grid, edges=bisect(grid.edges, np.ones(len(grid.edges) - 1, dtype=bool)))
        else:
            confirmed, grid = (
                None,
                next_grid(grid, solve.error, decay(solve.transcription, solve.outcome.nodes), tolerance),
            )
        last = solve
        errors = [error for *_, error in rounds]
        stalled = len(errors) > STALL and errors[-1] > max(errors[-1 - STALL] / 2, tolerance)
        if stalled or len(grid.edges) - 1 > MOST_INTERVALS:
            break
    assert last is not None
    assert last.error is not None
    message = (
        f"the error between nodes is still {last.error.total:.2g} after {len(rounds)} meshes, the last of "
        f"{rounds[-1][0]} intervals of degree {rounds[-1][1]}; tolerance {tolerance:g}"
    )
    outcome = replace(last.outcome, status=Status.FAILED, message=message)
    return Refined(last.transcription, last.numbers, outcome, last.error.total, np.inf, tuple(rounds))


def next_grid(grid: Grid, error: ErrorEstimate, falls: np.ndarray, tolerance: float) -> Grid:
    """A higher degree where nearly all of the error is on smooth arcs, otherwise more intervals where it is.

    Args:
        grid: the present one.
        error: of each interval.
        falls: (N,) `decay` of each interval.
        tolerance: for the sum of the errors.

    Returns:
        A finer grid.
    """
    each = error.each
    smooth = grid.degree < LOW_DEGREE or each[falls >= SMOOTH].sum() > 0.9 * each.sum()
    if smooth and grid.degree + 2 <= MOST_DEGREE:
        return replace(grid, degree=grid.degree + 2)
    return replace(grid, edges=refine(grid.edges, error, tolerance))


def decay(transcription: Transcription, nodes: Nodes) -> np.ndarray:
    """(N,) sigma of the coefficients a_j ~ exp(-sigma j) of the controls and rates in Legendre polynomials.

    Args:
        transcription: for its points.
        nodes: the solution.

    Returns:
        The slowest of all controls and states in each interval; large where they are constant.
    """
    points, degree = transcription.scheme.points, transcription.degree
    _, rates, control = transcription.interpolate(nodes, points)
    values = np.concatenate([rates, control])
    # Values at the points -> Legendre coefficients.
    basis = np.polynomial.legendre.legvander(2 * points - 1, degree - 1)
    coefficients = np.abs(values @ np.linalg.inv(basis).T)
    size = coefficients.max(axis=2, keepdims=True)
    overall = np.abs(values).max(axis=(1, 2), keepdims=True)
    # What is below rounding tells nothing; a last coefficient that happens to vanish, little.
    relative = np.maximum(coefficients / np.maximum(size, 1e-12 * overall + 1e-300), 1e-14)
    tail = np.maximum(relative[:, :, -1], relative[:, :, -2])
    return np.asarray((-np.log(tail) / (degree - 1)).min(axis=0))


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


def resample(old: Transcription, old_edges: np.ndarray, nodes: Nodes, new: Transcription, edges: np.ndarray) -> Nodes:
    """A solution as the guess on another mesh.

    Args:
        old: transcription of the solution.
        old_edges: (N + 1,) [s] its mesh.
        nodes: the solution.
        new: transcription of the new mesh.
        edges: (M + 1,) [s] the new mesh.

    Returns:
        States and controls at the new nodes.
    """

    def at(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = np.clip(np.searchsorted(old_edges, t, side="right") - 1, 0, len(old_edges) - 2)
        return old.at_places(nodes, k, (t - old_edges[k]) / np.diff(old_edges)[k])

    points = new.node_times(edges)
    state, _ = at(edges)
    inner, control = at(points.ravel())
    return Nodes(state, inner.reshape(len(inner), *points.shape), control.reshape(len(control), *points.shape))


@dataclass(frozen=True)
class _Solve:
    transcription: Transcription
    numbers: Numbers
    outcome: Outcome
    error: ErrorEstimate | None


def _solve(posed: Posed, grid: Grid, last: _Solve | None, options: SolverOptions | None) -> _Solve:
    transcription = Transcription(posed.problem, len(grid.edges) - 1, grid.degree, grid.scheme, options)
    numbers = posed.numbers(transcription, grid.edges)
    if last is None:
        guess = posed.guess(transcription, grid.edges)
    else:
        guess = resample(last.transcription, last.numbers.edges, last.outcome.nodes, transcription, grid.edges)
    outcome = transcription.solve(numbers, guess)
    if outcome.status is not Status.OK:
        return _Solve(transcription, numbers, outcome, None)
    fine = posed.data(grid.edges, fine_points(grid.degree)[0])
    error = estimate_error(transcription, outcome.nodes, numbers, fine, outcome.cost)
    return _Solve(transcription, numbers, outcome, error)
