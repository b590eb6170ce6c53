"""Direct collocation of an optimal control problem: one nonlinear program for one structure, solved for many numbers.

The transcription knows nothing of platforms.  It is built once for a structure (problem, number of intervals, degree,
scheme); widths, node data, parameters and bounds are numbers that are written into it at each solve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from occ.errors import Status
from occ.numeric import evaluate_many
from occ.optimal.chains import Chains, integrated
from occ.optimal.direct import DirectCode, DirectSolver, direct_code
from occ.optimal.engines import CasadiEngine, Engine
from occ.optimal.exchange import Exchange
from occ.optimal.layout import Layout, blocks, stages
from occ.optimal.mesh import Scheme, SchemeName, scheme
from occ.optimal.problem import Nodes, Numbers, Problem, flat
from occ.optimal.program import Program, collocation_program
from occ.optimal.solvers import PATIENCE, Effort, SolverOptions, fatrop_settings, nonlinear_solver, read_verdict
from occ.trajectory import lagrange_basis

VIOLATION = 1e-6
"""Conditions that are passed by more, relative to max(1, their size), are not met."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What the solver returned.

    Args:
        status: ``OK`` where it converged.
        message: what happened otherwise, in words.
        cost: claimed value of the objective.
        nodes: the solution.
        statistics: iterations and times.
        costates: (nx, N, d) p at the collocation points, of H = g + p . f; None where the solver has none.
    """

    status: Status
    message: str
    cost: float
    nodes: Nodes
    statistics: dict[str, Any]
    costates: np.ndarray | None = None


class _Variant(NamedTuple):
    """What a solver is made for.

    Args:
        bounded: bounds between the ends.
        boundary: conditions that couple the ends.
        integrated: states between the edges are integrals of the controls, and not unknowns.
        restart: a start from nearby.
        iterations: at most.
    """

    bounded: bool
    boundary: bool
    integrated: bool
    restart: bool
    iterations: int


class Transcription:
    """One nonlinear program for one structure: D^T x = h f(x, u) at every collocation point of every interval.

    Args:
        problem: the optimal control problem.
        intervals: N.
        degree: d, of the state's polynomial in each interval.
        name: of the collocation scheme.
        options: which solver, and its tolerance and limits.

    Source: Betts, Practical Methods for Optimal Control and Estimation, chapter 4; Biegler, Nonlinear Programming,
        chapter 10.
    """

    def __init__(
        self,
        problem: Problem,
        intervals: int,
        degree: int,
        name: SchemeName = "radau",
        options: SolverOptions | None = None,
    ) -> None:
        self.problem, self.intervals, self.degree, self.name = problem, intervals, degree, name
        self.scheme: Scheme = scheme(name, degree)
        self.options = options or SolverOptions()
        self._node = problem.node_function
        self._chains = Chains.of(problem) if self.options.solver == "fatrop" else None
        self._maps = None if self._chains is None else integrated(self._chains, self.scheme)
        self._layouts: dict[tuple[bool, bool], Layout] = {}
        self._programs: dict[tuple[bool, bool], Program] = {}
        self._solvers: dict[_Variant, Exchange] = {}
        self._paces: dict[tuple[bool, bool], float] = {}
        self._other: Transcription | None = None
        # What most solves use is built now, so that a solve builds nothing.
        self._solver(self._variant(bounded=self.sizes[4] > 0))

    @property
    def sizes(self) -> tuple[int, int, int, int, int, int]:
        """nx, nu, nd, np, nh, nb."""
        return self.problem.sizes

    def _variant(
        self, *, bounded: bool, boundary: bool = False, states: bool = False, restart: bool = False
    ) -> _Variant:
        if self.options.solver == "ipopt":
            # It takes void bounds and conditions at no cost.
            return _Variant(True, True, False, restart, self.options.iterations)
        integrated = self._maps is not None and not states
        return _Variant(bounded, boundary, integrated, restart, min(self.options.iterations, PATIENCE))

    def _layout(self, boundary: bool, integrated: bool) -> Layout:
        key = boundary, integrated
        if key not in self._layouts:
            if self.options.solver == "ipopt":
                self._layouts[key] = blocks(self.problem, self.scheme, self.intervals)
            else:
                self._layouts[key] = stages(self.problem, self.scheme, self.intervals, boundary, integrated)
        return self._layouts[key]

    def _program(self, boundary: bool, integrated: bool) -> Program:
        key = boundary, integrated
        if key not in self._programs:
            upper, layout = self.options.solver == "ipopt", self._layout(boundary, integrated)
            self._programs[key] = collocation_program(
                self.problem, self.scheme, layout, upper=upper, compiled=self.options.compiled
            )
        return self._programs[key]

    @property
    def _code(self) -> DirectCode | None:
        """For FATROP without CasADi in between; None where that is not asked for or cannot be had."""
        if self._chains is None or not self.options.compiled:
            return None
        return direct_code(self.problem, self._chains, self.scheme)

    def _engine(self, variant: _Variant) -> Engine:
        options = replace(self.options, iterations=variant.iterations)
        layout = self._layout(variant.boundary, variant.integrated)
        if layout.only_steps and self._code is not None:
            settings = fatrop_settings(options, bounded=variant.bounded, restart=variant.restart)
            return DirectSolver(self._code, self.intervals, settings)
        program = self._program(variant.boundary, variant.integrated)
        solver = nonlinear_solver(program, options, layout.stages, bounded=variant.bounded, restart=variant.restart)
        return CasadiEngine(solver, program.functions, careful=self.options.solver == "fatrop")

    def _solver(self, variant: _Variant) -> Exchange:
        if variant not in self._solvers:
            _, _, data, parameters, _, _ = self.sizes
            numbers = self.intervals * (1 + data * self.degree) + parameters
            layout = self._layout(variant.boundary, variant.integrated)
            self._solvers[variant] = Exchange(self._engine(variant), layout, numbers)
        return self._solvers[variant]

    def solve(self, numbers: Numbers, guess: Nodes, restart: bool = False) -> Outcome:
        """Solve with these numbers.

        Args:
            numbers: mesh, data, parameters and bounds.
            guess: to start from.
            restart: the guess is the solution of a problem nearby, bounds included: start with a small barrier.

        Returns:
            The outcome, also where the solver fails.
        """
        states, between, boundary = (
            any(bounds is not None and bool(bounds.finite.any()) for bounds in group)
            for group in ((numbers.state,), (numbers.control, numbers.path), (numbers.boundary,))
        )
        bounded = states or between or numbers.start.has_room or numbers.end.has_room
        variant = self._variant(bounded=bounded, boundary=boundary, states=states, restart=restart)
        in_time = self._in_time(variant, numbers, guess)
        outcome, gave_up = self._solve(in_time, numbers, guess, hurried=in_time != variant)
        return self._by_another_solver(outcome, numbers, guess) if gave_up else outcome

    def _solve(self, variant: _Variant, numbers: Numbers, guess: Nodes, *, hurried: bool) -> tuple[Outcome, bool]:
        """One run of the solver, and whether another one may do better."""
        solver = self._solver(variant)
        solver.write(numbers, guess)
        begin = perf_counter()
        try:
            statistics = solver.solve()
        except RuntimeError as error:
            message = f"the solver stopped: {error}"
            return Outcome(status=Status.FAILED, message=message, cost=np.nan, nodes=guess, statistics={}), False
        effort = Effort(variant.iterations, hurried, perf_counter() - begin)
        verdict = read_verdict(statistics, self.options, effort)
        status, message, cost = verdict.status, verdict.message, float(solver.outputs["f"][0])
        nodes = solver.read(self._maps, numbers.edges)
        # A solver's own word is not enough: FATROP calls a cost that is no number a success.
        finite = np.isfinite(cost) and not verdict.not_finite
        if not finite:
            status, message = Status.FAILED, self._what_is_not_finite(numbers, nodes)
        elif status is Status.OK and (violation := solver.violation(VIOLATION)) > VIOLATION:
            status = Status.FAILED
            message = f"the solver's answer violates its conditions by {violation:.2g}"
        outcome = Outcome(
            status=status,
            message=message,
            cost=cost,
            nodes=nodes,
            statistics=dict(verdict.statistics),
            costates=solver.costates(self.scheme.weights),
        )
        return outcome, verdict.gave_up and bool(finite)

    def _in_time(self, variant: _Variant, numbers: Numbers, guess: Nodes) -> _Variant:
        """For FATROP, which has no clock: with the iterations, by powers of two, that fit into the time."""
        if self.options.solver == "ipopt":
            return variant
        key = variant.boundary, variant.integrated
        if key not in self._paces:
            solver = self._solver(variant)
            solver.write(numbers, guess)
            self._paces[key] = solver.pace()
        affordable = self.options.seconds / self._paces[key]
        if affordable >= variant.iterations:
            return variant
        return variant._replace(iterations=2 ** int(np.log2(max(affordable, 1.0))))

    def _by_another_solver(self, outcome: Outcome, numbers: Numbers, guess: Nodes) -> Outcome:
        """What IPOPT finds where FATROP gave up; its statistics say so."""
        if self._other is None:
            options = replace(self.options, solver="ipopt")
            self._other = Transcription(self.problem, self.intervals, self.degree, self.name, options)
        other = self._other.solve(numbers, guess)
        gave_up = f"fatrop gave up after {outcome.statistics['iterations']} iterations"
        return replace(other, statistics=other.statistics | {"instead": gave_up})

    def _what_is_not_finite(self, numbers: Numbers, nodes: Nodes) -> str:
        """The first function and time at which it is no number, in words."""
        values = self.evaluate(flat(nodes.points), flat(nodes.control), flat(numbers.data), numbers.parameters)
        times = self.node_times(numbers.edges).ravel()
        for name, value in zip(("rate of the state", "integrand", "path condition"), values, strict=True):
            wrong = np.flatnonzero(~np.isfinite(np.atleast_2d(value)).all(axis=0))
            if wrong.size:
                return f"a function of the problem is not finite: the {name} at t = {times[wrong[0]]:.4g} s"
        return "a function of the problem, or a derivative of one, is not finite"

    def node_times(self, edges: np.ndarray) -> np.ndarray:
        """(N, d) [s] times of the collocation points on a mesh (N + 1,)."""
        return edges[:-1, None] + np.diff(edges)[:, None] * self.scheme.points

    def interpolate(self, nodes: Nodes, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """State, its derivative in the interval's own variable, and control at places s in every interval.

        Args:
            nodes: values on the mesh.
            s: (m,) in [0, 1].

        Returns:
            (nx, N, m), (nx, N, m), (nu, N, m).
        """
        values = np.concatenate([nodes.edges[:, :-1, None], nodes.points], axis=2)
        state = values @ lagrange_basis(self.scheme.nodes, s)
        # The derivative has degree d - 1, so its values at the collocation points determine it.
        derivative = values @ self.scheme.derivative @ lagrange_basis(self.scheme.points, s)
        return state, derivative, nodes.control @ lagrange_basis(self.scheme.points, s)

    def at_places(self, nodes: Nodes, interval: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """State and control at single places.

        Args:
            nodes: values on the mesh.
            interval: (m,) number of the interval of each place.
            s: (m,) in [0, 1].

        Returns:
            (nx, m), (nu, m).
        """
        values = np.concatenate([nodes.edges[:, :-1, None], nodes.points], axis=2)
        state = np.einsum("xmj,jm->xm", values[:, interval], lagrange_basis(self.scheme.nodes, s))
        control = np.einsum("umj,jm->um", nodes.control[:, interval], lagrange_basis(self.scheme.points, s))
        return state, control

    def evaluate(
        self, state: np.ndarray, control: np.ndarray, data: np.ndarray, parameters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """f, g and h at many points at once.

        Args:
            state: (nx, M).
            control: (nu, M).
            data: (nd, M).
            parameters: (np,).

        Returns:
            (nx, M), (M,), (nh, M).
        """
        rate, integrand, path = evaluate_many(self._node, state, control, data, parameters, shared=(3,))
        return rate, integrand[0], path
