"""From a first mesh to a solution that is fine enough: knots at switching times, refinement, limits between nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from occ.errors import Status
from occ.optimal.attempt import Attempt, Grid, Guess, Method
from occ.optimal.backoff import JUMP, Tightening, tightened
from occ.optimal.between import limited_arcs
from occ.optimal.cost import is_regular
from occ.optimal.formulation import Formulation, Rotation
from occ.optimal.infeasible import least_relaxation
from occ.optimal.limit_proof import with_proof
from occ.optimal.limits import with_knots
from occ.optimal.nearby import Nearby
from occ.optimal.problem import Nodes, Numbers
from occ.optimal.refinement import NumbersOf, Refinement, filled_up
from occ.optimal.starts import NamedStart, same_minimum
from occ.optimal.transcription import Transcription

STALL = 3
"""Refinements in which the error should at least halve."""
STALL_AT_KINKS = 6
"""The same where powers change their sign: a mesh that misses such a time is no better than the one before."""
KNOT_ROUNDS = 4
"""Times that edges are moved to the switching times at most."""
BACKOFFS = 8
"""Tightenings of the limits that are tried at most on one mesh."""
AIMS = 4
"""Times that the end is aimed at again at most."""
COST = 0.1
"""Part of the tolerance that it may cost to hold the limits between the nodes."""
PATIENCE = 100.0
"""Mean excess over limits, in units of the tolerance, from which on a back-off is tried where the cost has no curvature
in the torques: there the jumps of the control are short and cost next to nothing."""
HELD = 3e-7
"""A limit is held if it is passed by at most this, relative to it, by a proven bound where there is one; the referee
allows three times as much."""


class Search(Refinement):
    """Solves one problem of the platform on better and better meshes.

    Args:
        formulation: task and problem.
        method: how.
    """

    def __init__(self, formulation: Formulation, method: Method) -> None:
        shape = formulation.shape
        if shape.slacks and shape.has_torque_states:
            method = replace(method, options=replace(method.options, ordering="minimum_degree"))
        super().__init__(formulation.problem(), formulation, method)
        self.formulation = formulation
        self.stall = STALL_AT_KINKS if shape.slacks else STALL
        self._patience = 1.0 if is_regular(formulation.settings.aim.terms) else PATIENCE
        task = formulation.task
        self._kept = task.motion.knots(task.duration)
        self._tightening: Tightening | None = None

    def starts(self, edges: np.ndarray, starts: Sequence[NamedStart]) -> dict[str, Attempt]:
        """A first solve from each guess, and where there are easier aims another one by way of the easiest.

        Args:
            edges: (N + 1,) [s] first mesh.
            starts: guesses.

        Returns:
            Attempts by the names of their ways.
        """
        grid = Grid(edges=edges, degree=self.method.degree, scheme=self.formulation.settings.scheme)
        ways: dict[str, Attempt | Rotation] = {start.name: start.rotation for start in starts}
        easier = self.formulation.easier()
        for formulation in easier[:1]:
            easy = self._with_aim(formulation)._met(grid, ways)
            ways |= {
                f"{name}, powers with their signs first": way for name, way in easy.items() if way is not ways[name]
            }
        for formulation in easier[1:]:
            ways = self._with_aim(formulation)._met(grid, ways)
        return self._from_each(grid, ways)

    def near(self, nearby: Nearby) -> dict[str, Attempt]:
        """A first solve on the mesh of a solution nearby and from its motion, which needs no easier aims.

        Args:
            nearby: the solution, on the horizon of the task.

        Returns:
            The attempt by the name of its way.
        """
        edges = with_knots(nearby.edges, self._kept) if self._kept.size else nearby.edges
        grid = Grid(edges=edges, degree=self.method.degree, scheme=self.formulation.settings.scheme)
        return self._from_each(grid, {"a solution nearby": nearby})

    def _with_aim(self, formulation: Formulation) -> Search:
        """Another search of the same kind; its rounds count as this one's."""
        search = Search(formulation, self.method)
        search.rounds = self.rounds
        return search

    def _from_each(self, grid: Grid, ways: dict[str, Attempt | Rotation]) -> dict[str, Attempt]:
        """A solve from each start; one for those that are the same, none where one has failed before."""
        found: dict[int, Attempt] = {}
        for start in ways.values():
            if isinstance(start, Attempt) and start.outcome.status is not Status.OK:
                found[id(start)] = start
            elif id(start) not in found:
                before = start if isinstance(start, Attempt) else partial(self.formulation.guess, rotation=start)
                # Of many only the best will be looked at.
                found[id(start)] = self.attempt(grid, before, look=len(ways) == 1)
        return {name: found[id(start)] for name, start in ways.items()}

    def _met(self, grid: Grid, ways: dict[str, Attempt | Rotation]) -> dict[str, Attempt | Rotation]:
        """The solution from each start, the same one where they met in one minimum; the starts where there is none."""
        met: list[Attempt] = []
        attempts = self._from_each(grid, ways)
        for name, attempt in attempts.items():
            if attempt.outcome.status is Status.OK:
                twins = (other for other in met if same_minimum(self.formulation, other, attempt))
                attempts[name] = next(twins, attempt)
                met += [attempts[name]] if attempts[name] is attempt else []
        return {**attempts} if met else ways

    def attempt(
        self,
        grid: Grid,
        before: Attempt | Guess,
        *,
        restart: bool = False,
        numbers: NumbersOf | None = None,
        look: bool = True,
    ) -> Attempt:
        # Where slacks choose between their two bounds, a start with a large barrier would choose again; in the middle
        # of a tube, where its condition has no slope, the first step of such a start may leave it by far.
        shape, followed = self.formulation.shape, isinstance(before, Attempt)
        near = followed and bool(shape.slacks or shape.peaks)
        attempt = super().attempt(grid, before, restart=restart or near, numbers=numbers, look=look)
        if attempt.outcome.status is not Status.OK and (near or (shape.keep == "tube" and not followed)):
            attempt = super().attempt(grid, before, restart=not near, numbers=numbers, look=look)
        return attempt

    def solved(
        self, transcription: Transcription, numbers: Numbers, guess: Nodes, restart: bool = False, look: bool = True
    ) -> Attempt:
        guess = self.formulation.with_slacks(transcription, numbers.edges, guess)
        return super().solved(transcription, numbers, guess, restart, look)

    def run(self, first: Attempt) -> tuple[Attempt, str]:
        """Place knots, then solve until error and limits hold between the nodes.

        Args:
            first: on the first mesh.

        Returns:
            The last attempt, and why it is not good enough (empty where it is).
        """
        if first.outcome.status is Status.OK and first.error is None:
            first = self.looked_at(first)
        return super().run(self._place_knots(first))

    def looked_at(self, attempt: Attempt) -> Attempt:
        attempt = super().looked_at(attempt)
        assert attempt.error is not None
        transcription, numbers, outcome = attempt.transcription, attempt.numbers, attempt.outcome
        overpaid = self.formulation.overpaid(transcription, outcome.nodes, numbers) / max(1.0, abs(outcome.cost))
        error = replace(attempt.error, cost=attempt.error.cost - overpaid)
        arcs = limited_arcs(self.formulation, transcription, outcome.nodes, numbers)
        return replace(attempt, error=error, arcs=arcs)

    def finer(self, attempt: Attempt) -> Grid | None:
        grid = super().finer(attempt)
        if grid is None:
            return None
        if attempt.arcs is None or not len(attempt.arcs.clipped) or grid.degree > attempt.grid.degree:
            return grid
        # Edges where a clipped power changes its sign in an interval that is not fine enough.
        assert attempt.error is not None
        times = attempt.arcs.sign_changes()
        interval = np.clip(np.searchsorted(attempt.edges, times) - 1, 0, len(attempt.error.cost) - 1)
        coarse = np.abs(attempt.error.cost) > self.method.tolerance / (2 * len(attempt.error.cost))
        return replace(grid, edges=with_knots(grid.edges, times[coarse[interval]], self._kept))

    def finished(self, attempt: Attempt) -> Attempt | Grid:
        """Limits held between the nodes, too; where that fails or costs too much, a finer mesh for it."""
        self._tightening = None
        attempt = self._proven(self._hitting(attempt))
        if attempt.outcome.status is not Status.OK or self._holds(attempt):
            return attempt
        if attempt.excess_share <= self._patience * self.method.tolerance:
            best = self._backed_off(attempt)
            if self._is_affordable(best) and self._holds(best):
                return best
        jumps, passed = attempt.passes(JUMP), attempt.passes(HELD)
        marked = (jumps if jumps.any() else passed) | self._passes_largest(attempt)
        return replace(attempt.grid, edges=quartered(attempt.edges, marked))

    def _holds(self, attempt: Attempt) -> bool:
        """No limit, and no largest torque that is the cost, is passed between the nodes."""
        return attempt.hard_excess <= HELD and attempt.largest_excess <= self.method.tolerance

    def _passes_largest(self, attempt: Attempt) -> np.ndarray:
        """(N,) of booleans: intervals in which the largest torque is passed by more than the tolerance."""
        if attempt.arcs is None:
            return np.zeros(attempt.grid.intervals, dtype=bool)
        return np.asarray(attempt.arcs.soft_excess.max(axis=0, initial=0.0) > self.method.tolerance)

    def _proven(self, attempt: Attempt) -> Attempt:
        """An attempt that seems to hold its limits with the proof of it, or of the contrary."""
        return with_proof(self.formulation, attempt) if attempt.hard_excess <= HELD else attempt

    def _backed_off(self, attempt: Attempt) -> Attempt:
        """The last of several solves with tighter and tighter limits."""
        # An optimum that holds its limits at the nodes only costs no more than one that holds them everywhere.
        least, best = attempt.outcome.cost, attempt
        for _ in range(BACKOFFS):
            self._tightening = tightened(self.formulation, best, self._tightening, self.method.tolerance)
            if not self._tightening.is_possible or self._out_of_time:
                break
            best = self._proven(self._tighter(best, self._tightening))
            best = replace(best, dearer=(best.outcome.cost - least) / max(1.0, abs(least)))
            if self._holds(best) or not self._is_affordable(best):
                break
        return best

    def _is_affordable(self, attempt: Attempt) -> bool:
        tolerance = self.method.tolerance
        return attempt.error is not None and attempt.error.total <= tolerance and attempt.dearer <= COST * tolerance

    def _hitting(self, attempt: Attempt) -> Attempt:
        """The problem of an attempt aimed so that the torques, and not only the polynomials, hit the end."""
        for _ in range(AIMS):
            aimed = self.formulation.aimed(attempt.transcription, attempt.edges, attempt.outcome.nodes)
            if aimed is None or attempt.outcome.status is not Status.OK:
                break
            self.formulation = self.posed = aimed
            attempt = self.attempt(attempt.grid, attempt, restart=True)
        return attempt

    def _tighter(self, attempt: Attempt, tightening: Tightening) -> Attempt:
        """The problem of an attempt with its limits tightened: from nearby, and from afar where that fails."""
        transcription, nodes = attempt.transcription, tightening.guess(attempt.outcome.nodes)
        numbers = self._tight_numbers(tightening, transcription, attempt.edges)
        following = self.solved(transcription, numbers, nodes, restart=True)
        return following if following.outcome.status is Status.OK else self.solved(transcription, numbers, nodes)

    def _tight_numbers(self, tightening: Tightening, transcription: Transcription, edges: np.ndarray) -> Numbers:
        numbers = self.formulation.numbers(transcription, edges)
        return tightening.applied(self.formulation, numbers, transcription.degree)

    def shortcomings(self, attempt: Attempt) -> list[str]:
        found = super().shortcomings(attempt)
        if attempt.hard_excess > HELD:
            found.append(f"a limit is still passed by {attempt.hard_excess:.2g} of its value between nodes")
        if attempt.largest_excess > self.method.tolerance:
            found.append(f"the largest torque is still passed by {attempt.largest_excess:.2g} of its value")
        return found

    def on_doubled_mesh(self, attempt: Attempt) -> Attempt:
        if self._tightening is None:
            return super().on_doubled_mesh(attempt)
        numbers = partial(self._tight_numbers, self._tightening.doubled)
        return self.attempt(attempt.grid.doubled, attempt, restart=True, numbers=numbers, look=False)

    def explained(self, attempt: Attempt) -> Attempt:
        """The attempt with the contradicting limits named, or one from a motion that holds them all."""
        outcome = attempt.outcome
        if outcome.status is Status.OK or outcome.statistics.get("exhausted"):
            return attempt
        relaxation = least_relaxation(self.formulation, attempt)
        if relaxation is None:
            return attempt
        if relaxation.contradicts:
            message = f"the limits contradict each other: {relaxation.words()}"
            return replace(attempt, outcome=replace(outcome, status=Status.INFEASIBLE, message=message))
        again = self.solved(attempt.transcription, attempt.numbers, relaxation.nodes, restart=True)
        if again.error is not None:
            return again
        message = f"{outcome.message}, although the limits can be held"
        return replace(attempt, outcome=replace(outcome, status=Status.FAILED, message=message))

    def _place_knots(self, first: Attempt) -> Attempt:
        """Move edges to the switching times while that lowers what is wrong between the nodes."""
        best, base = first, first.edges
        for _ in range(KNOT_ROUNDS):
            # Less than that will be taken off the limits.
            if best.arcs is None or best.badness <= self._patience * self.method.tolerance:
                break
            edges = with_knots(base, best.arcs.switching_times(), self._kept)
            attempt = self.attempt(replace(best.grid, edges=edges), best)
            if attempt.arcs is None or attempt.badness > best.badness / 2:
                break
            best = attempt
        return best


def quartered(edges: np.ndarray, marked: np.ndarray) -> np.ndarray:
    """A mesh with every marked interval cut into four.

    The number of intervals is rounded up to a multiple of eight by halving the widest ones, so that cases of a sweep
    share their programs.

    Args:
        edges: (N + 1,) [s].
        marked: (N,) of booleans.

    Returns:
        (M + 1,) [s].
    """
    quarters = edges[:-1, None] + np.diff(edges)[:, None] * np.array([0.25, 0.5, 0.75])
    finer = np.sort(np.concatenate([edges, quarters[marked].ravel()]))
    return filled_up(finer, np.argsort(-np.diff(finer), kind="stable"))
