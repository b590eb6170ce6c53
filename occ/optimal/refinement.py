"""Better meshes for any problem: shorter intervals where a solution is rough, higher degrees where it is smooth.

The error is that of `occ.optimal.error`: the residual of the differential equation between the nodes, and the cost on a
finer rule.  Where a doubled mesh is asked for, a solution is accepted when that is below the tolerance and a mesh with
every interval cut in two gives the same cost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from heapq import heapify, heappop, heappush
from typing import Any, Protocol

import numpy as np

from occ.errors import Status
from occ.optimal.attempt import Attempt, Grid, Guess, Method, transcription_of
from occ.optimal.error import ErrorEstimate, estimate_error, fine_points
from occ.optimal.mesh import SchemeName, bisect, scheme
from occ.optimal.problem import Nodes, Numbers, Problem
from occ.optimal.transcription import Transcription

MOST_INTERVALS = 2000
MOST_DEGREE = 12
ROUNDS = 24
"""Meshes that are tried at most."""
TOGETHER = 10.0
"""All solves together may take so many times as long as one of them."""
STALL = 5
"""Refinements in which the error should at least halve."""
STALL_OF_EXCESS = 5
"""Refinements in which the mean excess over limits and the largest torque should at least halve."""
LOW_DEGREE = 4
"""Below it there are too few coefficients to judge smoothness by: the degree is raised first."""
SMOOTH = 1.2
"""Coefficients of a control or a rate that fall at least like exp(-1.2 j) are those of a smooth arc: raising the degree
by two then gains more than cutting the interval in two, for the same number of unknowns."""
GAIN = 1 / 16
"""What is left of an interval's error when it is cut in two, for the choice of the next mesh; it is more where arcs are
rough and less where they are smooth."""


NumbersOf = Callable[[Transcription, np.ndarray], Numbers]
"""(transcription, edges (N + 1,) [s]) -> the numbers of a problem."""


class Posed(Protocol):
    """The numbers of a problem on any mesh."""

    def numbers(self, transcription: Transcription, edges: np.ndarray) -> Numbers:
        """On a mesh (N + 1,)."""

    def data(self, edges: np.ndarray, s: np.ndarray) -> np.ndarray:
        """(nd, N, m) Node data at the places s (m,) of each interval."""


class Refinement:
    """Solves one problem on better and better meshes, until the tolerance holds.

    Args:
        problem: what is solved.
        posed: its numbers on any mesh.
        method: how.

    Attributes:
        most_intervals: of a mesh.
        rounds: what each solve gave, for the record.
    """

    stall = STALL

    def __init__(self, problem: Problem, posed: Posed, method: Method) -> None:
        self.problem, self.posed, self.method = problem, posed, method
        self.most_intervals = MOST_INTERVALS
        self.rounds: list[dict[str, Any]] = []

    def attempt(
        self,
        grid: Grid,
        before: Attempt | Guess,
        *,
        restart: bool = False,
        numbers: NumbersOf | None = None,
        look: bool = True,
    ) -> Attempt:
        """Solve on a mesh.

        Args:
            grid: the mesh.
            before: a solution on another one, or a guess.
            restart: the one before is as good as the solution: start with a small barrier.
            numbers: of the problem; None for those that are posed.
            look: between the nodes, too, where there is a solution.

        Returns:
            The attempt.
        """
        transcription = transcription_of(self.problem, grid.intervals, grid.degree, grid.scheme, self.method.options)
        given = (numbers or self.posed.numbers)(transcription, grid.edges)
        if isinstance(before, Attempt):
            guess = resample(before.transcription, before.edges, before.outcome.nodes, transcription, grid.edges)
        else:
            guess = before(transcription, grid.edges)
        return self.solved(transcription, given, guess, restart, look)

    def solved(
        self, transcription: Transcription, numbers: Numbers, guess: Nodes, restart: bool = False, look: bool = True
    ) -> Attempt:
        """Solve with these numbers, and look between the nodes.

        Args:
            transcription: of the mesh.
            numbers: on it.
            guess: to start from.
            restart: the guess is the solution of a problem nearby.
            look: between the nodes.

        Returns:
            The attempt.
        """
        outcome = transcription.solve(numbers, guess, restart)
        attempt = Attempt(transcription, numbers, outcome, guess)
        if look and outcome.status is Status.OK:
            attempt = self.looked_at(attempt)
        self.rounds.append(
            outcome.statistics
            | {
                "intervals": transcription.intervals,
                "degree": transcription.degree,
                "error": attempt.error.total if attempt.error else None,
                "excess": attempt.hard_excess if attempt.error else None,
            }
        )
        return attempt

    def looked_at(self, attempt: Attempt) -> Attempt:
        """The attempt with its error between the nodes."""
        transcription, numbers, outcome = attempt.transcription, attempt.numbers, attempt.outcome
        fine = self.posed.data(numbers.edges, fine_points(transcription.degree)[0])
        return replace(attempt, error=estimate_error(transcription, outcome.nodes, numbers, fine, outcome.cost))

    def finer(self, attempt: Attempt) -> Grid | None:
        """The next mesh; None where the tolerance holds."""
        assert attempt.error is not None
        if attempt.error.total <= self.method.tolerance:
            return None
        falls = decay(attempt.transcription, attempt.outcome.nodes)
        return next_grid(attempt.grid, attempt.error, falls, self.method.tolerance)

    def finished(self, attempt: Attempt) -> Attempt | Grid:
        """What is left to do where `finer` has nothing to ask for: an attempt, or a mesh on which it can be done."""
        return attempt

    def on_doubled_mesh(self, attempt: Attempt) -> Attempt:
        """The same problem with every interval cut in two, solved only."""
        return self.attempt(attempt.grid.doubled, attempt, restart=True, look=False)

    def explained(self, attempt: Attempt) -> Attempt:
        """An attempt without a solution, with the reason in its message; or another attempt that has one."""
        return attempt

    def solve(self, grid: Grid, guess: Guess) -> tuple[Attempt, str]:
        """`run` from a first mesh and a guess."""
        return self.run(self.attempt(grid, guess))

    def run(self, first: Attempt) -> tuple[Attempt, str]:
        """Solve until the error holds between the nodes, and on a doubled mesh where the method asks for one.

        Args:
            first: on the first mesh.

        Returns:
            The last attempt, and why it is not good enough (empty where it is).
        """
        attempt = first
        errors: list[float] = []
        excesses: list[float] = []
        for _ in range(ROUNDS):
            if attempt.outcome.status is not Status.OK or attempt.error is None:
                attempt = self.explained(attempt)
            if attempt.outcome.status is not Status.OK or attempt.error is None:
                return attempt, attempt.outcome.message
            error, grid = attempt.error.total, self.finer(attempt)
            if grid is None:
                done = self.finished(attempt)
                if isinstance(done, Attempt):
                    accepted, attempt = self._confirmed(done)
                    if accepted or attempt.outcome.status is not Status.OK:
                        return attempt, attempt.outcome.message
                    continue
                grid = done
                excesses.append(attempt.excess_share)
                if _stalls(excesses, STALL_OF_EXCESS):
                    break
            elif error > self.method.tolerance:
                errors.append(error)
                if _stalls(errors, self.stall):
                    break
            if grid.intervals > self.most_intervals or self._out_of_time:
                break
            attempt = self.attempt(grid, attempt)
        reasons = self.shortcomings(attempt) or ["a mesh with twice as many intervals still changes the cost by more"]
        if self._out_of_time:
            reasons.append(f"all solves together used their time, {TOGETHER * self.method.options.seconds:g} s,")
        return attempt, (
            f"{' and '.join(reasons)} after {len(self.rounds)} solves, the last mesh of "
            f"{attempt.grid.intervals} intervals of degree {attempt.grid.degree}; tolerance {self.method.tolerance:g}"
        )

    @property
    def _out_of_time(self) -> bool:
        return sum(each.get("seconds", 0.0) for each in self.rounds) > TOGETHER * self.method.options.seconds

    def shortcomings(self, attempt: Attempt) -> list[str]:
        """What is not good enough in the last attempt, in words."""
        error = attempt.error.total if attempt.error else np.inf
        return [f"the error between nodes is still {error:.2g}"] if error > self.method.tolerance else []

    def _confirmed(self, attempt: Attempt) -> tuple[bool, Attempt]:
        """Whether the doubled mesh gives the same cost; the attempt with the change, or the doubled one where not."""
        if not self.method.doubled:
            return True, attempt
        if 2 * attempt.grid.intervals > MOST_INTERVALS:
            return True, replace(attempt, doubled=math.inf)
        if attempt.outcome.status is not Status.OK:
            return False, attempt
        twice = self.on_doubled_mesh(attempt)
        if twice.outcome.status is not Status.OK:
            return True, replace(attempt, doubled=math.inf)
        cost = twice.outcome.cost
        change = abs(cost - attempt.outcome.cost) / max(1.0, abs(cost))
        if change > self.method.tolerance:
            return False, self.looked_at(twice)
        growth = np.abs(twice.outcome.nodes.control).max() / np.abs(attempt.outcome.nodes.control).max(initial=1e-300)
        return True, replace(attempt, doubled=change, growth=float(growth))


def _stalls(values: list[float], count: int) -> bool:
    """None of the last so many values is half of the one before them."""
    return len(values) > count and min(values[-count:]) > values[-1 - count] / 2


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
    coefficients = np.abs(values @ _to_legendre(transcription.name, degree))
    size = coefficients.max(axis=2, keepdims=True)
    overall = np.abs(values).max(axis=(1, 2), keepdims=True)
    # What is below rounding tells nothing; a last coefficient that happens to vanish, little.
    relative = np.maximum(coefficients / np.maximum(size, 1e-12 * overall + 1e-300), 1e-14)
    tail = np.maximum(relative[:, :, -1], relative[:, :, -2])
    return np.asarray((-np.log(tail) / (degree - 1)).min(axis=0))


@cache
def _to_legendre(name: SchemeName, degree: int) -> np.ndarray:
    """(d, d) From values at a scheme's points to coefficients of Legendre's polynomials."""
    basis = np.polynomial.legendre.legvander(2 * scheme(name, degree).points - 1, degree - 1)
    return np.asarray(np.linalg.inv(basis).T)


def refine(edges: np.ndarray, error: ErrorEstimate, tolerance: float) -> np.ndarray:
    """Cut the intervals that contribute most in two until all together could meet the tolerance.

    Where the better half of the intervals is good enough, those in the layers are cut again and again in one go; where
    the error is everywhere, once.  The number of intervals is rounded up to a multiple of eight, so that cases of a
    sweep share their programs, by halving the worst of those that are whole: layers thinner than they need to be ask
    for torques whose work is lost in rounding.

    Args:
        edges: (N + 1,).
        error: of each interval.
        tolerance: for their sum.

    Returns:
        A finer mesh.
    """
    worst = [(-e, begin, end) for e, begin, end in zip(error.each, edges[:-1], edges[1:], strict=True)]
    heapify(worst)
    left, most = error.each.sum(), 2 * len(worst)
    gain = GAIN if np.sort(error.each)[: len(worst) // 2].sum() <= tolerance / 2 else 0.0
    while len(worst) < most and (left > tolerance / 2 or len(worst) == most // 2):
        each, begin, end = heappop(worst)
        half, middle = each * gain / 2, (begin + end) / 2
        left += each - 2 * half
        heappush(worst, (half, begin, middle))
        heappush(worst, (half, middle, end))
    finer = np.sort([edges[0], *(end for _, _, end in worst)])
    places = np.searchsorted(finer, edges)
    whole = np.flatnonzero(np.diff(places) == 1)
    order = places[whole[np.argsort(-error.each[whole], kind="stable")]]
    return filled_up(finer, order[: most - len(worst)])


def filled_up(edges: np.ndarray, order: np.ndarray) -> np.ndarray:
    """A mesh whose number of intervals is a multiple of eight, where there are enough to cut in two.

    Args:
        edges: (N + 1,).
        order: intervals, those to be cut in two come first.

    Returns:
        (M + 1,).
    """
    count = len(edges) - 1
    return bisect(edges, np.isin(np.arange(count), order[: -count % 8]))


def resample(old: Transcription, old_edges: np.ndarray, nodes: Nodes, new: Transcription, edges: np.ndarray) -> Nodes:
    """A solution as the guess on another mesh, or for a problem with further states and controls behind the same ones.

    Args:
        old: transcription of the solution.
        old_edges: (N + 1,) [s] its mesh.
        nodes: the solution.
        new: transcription of the new mesh.
        edges: (M + 1,) [s] the new mesh.

    Returns:
        States and controls at the new nodes; what is new is zero.
    """

    def at(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = np.clip(np.searchsorted(old_edges, t, side="right") - 1, 0, len(old_edges) - 2)
        return old.at_places(nodes, k, (t - old_edges[k]) / np.diff(old_edges)[k])

    points = new.node_times(edges)
    state, _ = at(edges)
    inner, control = at(points.ravel())
    nx, nu, *_ = new.sizes
    state, inner, control = (
        np.pad(rows, ((0, count - len(rows)), (0, 0))) for rows, count in ((state, nx), (inner, nx), (control, nu))
    )
    return Nodes(state, inner.reshape(nx, *points.shape), control.reshape(nu, *points.shape))
