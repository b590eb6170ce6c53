"""Direct collocation of an optimal control problem: one nonlinear program for one structure, solved for many numbers.

The transcription knows nothing of platforms.  It is built once for a structure (problem, number of intervals, degree,
scheme); widths, node data, parameters and bounds are numbers that are written into it at each solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from occ.errors import Status
from occ.numeric import evaluate_many
from occ.optimal.layout import Layout, blocks, stages
from occ.optimal.mesh import Scheme, SchemeName, scheme
from occ.optimal.problem import Bounds, Nodes, Numbers, Problem, flat
from occ.optimal.program import Program, collocation_program
from occ.optimal.solvers import SolverOptions, nonlinear_solver, read_verdict
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
    """

    status: Status
    message: str
    cost: float
    nodes: Nodes
    statistics: dict[str, Any]


class _Variant(NamedTuple):
    """What a solver is made for: bounds between the ends, conditions that couple the ends, a start from nearby."""

    bounded: bool
    boundary: bool
    restart: bool


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
        self._node = problem.node_function()
        self._programs: dict[bool, tuple[Program, Layout]] = {}
        self._solvers: dict[_Variant, ca.Function] = {}
        # What most solves use is built now, so that a solve builds nothing.
        self._solver(self._variant(self.sizes[4] > 0, False, False))

    @property
    def sizes(self) -> tuple[int, int, int, int, int, int]:
        """nx, nu, nd, np, nh, nb."""
        return self.problem.sizes

    def _variant(self, bounded: bool, boundary: bool, restart: bool) -> _Variant:
        # IPOPT takes void bounds and conditions at no cost.
        return _Variant(True, True, restart) if self.options.solver == "ipopt" else _Variant(bounded, boundary, restart)

    def _solver(self, variant: _Variant) -> tuple[ca.Function, Layout]:
        if variant.boundary not in self._programs:
            ipopt = self.options.solver == "ipopt"
            layout = (
                blocks(self.problem, self.scheme, self.intervals)
                if ipopt
                else stages(self.problem, self.scheme, self.intervals, variant.boundary)
            )
            self._programs[variant.boundary] = collocation_program(self.problem, self.scheme, layout, ipopt), layout
        program, layout = self._programs[variant.boundary]
        if variant not in self._solvers:
            self._solvers[variant] = nonlinear_solver(
                program, self.options, layout.stages, bounded=variant.bounded, restart=variant.restart
            )
        return self._solvers[variant], layout

    def solve(self, numbers: Numbers, guess: Nodes, restart: bool = False) -> Outcome:
        """Solve with these numbers.

        Args:
            numbers: mesh, data, parameters and bounds.
            guess: to start from.
            restart: the guess is the solution of a problem nearby, bounds included: start with a small barrier.

        Returns:
            The outcome, also where the solver fails.
        """
        bounded, boundary = (
            any(bounds is not None and bool(bounds.finite.any()) for bounds in group)
            for group in ((numbers.state, numbers.control, numbers.path), (numbers.boundary,))
        )
        solver, layout = self._solver(self._variant(bounded, boundary, restart))
        arguments = self._arguments(layout, numbers, guess)
        try:
            result = solver(**arguments)
            verdict = read_verdict(solver.stats(), self.options)
        except RuntimeError as error:
            return Outcome(
                status=Status.FAILED, message=f"the solver stopped: {error}", cost=np.nan, nodes=guess, statistics={}
            )
        status, message, cost = verdict.status, verdict.message, float(result["f"])
        nodes = _unpack(layout, result["x"].full()[:, 0])
        # A solver's own word is not enough: FATROP calls a cost that is no number a success.
        if not np.isfinite(cost) or verdict.not_finite:
            status, message = Status.FAILED, self._what_is_not_finite(numbers, nodes)
        elif status is Status.OK and _violation(arguments, result) > VIOLATION:
            message = f"the solver's answer violates its conditions by {_violation(arguments, result):.2g}"
            status = Status.FAILED
        return Outcome(status=status, message=message, cost=cost, nodes=nodes, statistics=dict(verdict.statistics))

    def _what_is_not_finite(self, numbers: Numbers, nodes: Nodes) -> str:
        """The first function and time at which it is no number, in words."""
        values = self.evaluate(flat(nodes.points), flat(nodes.control), flat(numbers.data), numbers.parameters)
        times = self.node_times(numbers.edges).ravel()
        for name, value in zip(("rate of the state", "integrand", "path condition"), values, strict=True):
            wrong = np.flatnonzero(~np.isfinite(np.atleast_2d(value)).all(axis=0))
            if wrong.size:
                return f"a function of the problem is not finite: the {name} at t = {times[wrong[0]]:.4g} s"
        return "a function of the problem, or a derivative of one, is not finite"

    def _arguments(self, layout: Layout, numbers: Numbers, guess: Nodes) -> dict[str, np.ndarray]:
        nx, nu, _, _, nh, nb = self.sizes
        state, control = numbers.state or Bounds.free(nx), numbers.control or Bounds.free(nu)
        path, boundary = numbers.path or Bounds.free(nh), numbers.boundary or Bounds.free(nb)

        def unknowns(side: str) -> np.ndarray:
            extreme = np.maximum if side == "lower" else np.minimum
            values = np.full(layout.unknowns, -np.inf if side == "lower" else np.inf)
            values[layout.points] = getattr(state, side)[:, None, None]
            values[layout.edges] = getattr(state, side)[:, None]
            for edge, bounds in ((0, numbers.start), (-1, numbers.end)):
                values[layout.edges[:, edge]] = extreme(values[layout.edges[:, edge]], getattr(bounds, side))
            values[layout.control] = getattr(control, side)[:, None, None]
            return values

        def conditions(side: str) -> np.ndarray:
            values = np.zeros(layout.conditions)
            bound = getattr(path, side)
            values[layout.path] = bound[:, None, None] if bound.ndim == 1 else bound
            if layout.boundary is not None:
                values[layout.boundary] = getattr(boundary, side)
            return values

        return {
            "x0": _pack(layout, guess),
            "p": np.concatenate([np.diff(numbers.edges), flat(numbers.data).ravel(order="F"), numbers.parameters]),
            "lbx": unknowns("lower"),
            "ubx": unknowns("upper"),
            "lbg": conditions("lower"),
            "ubg": conditions("upper"),
        }

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


def _pack(layout: Layout, nodes: Nodes) -> np.ndarray:
    x = np.zeros(layout.unknowns)
    x[layout.points], x[layout.edges], x[layout.control] = nodes.points, nodes.edges, nodes.control
    if layout.memory.size:
        x[layout.memory] = nodes.edges[:, :1]
    return x


def _violation(arguments: dict[str, np.ndarray], result: dict[str, ca.DM]) -> float:
    """Largest amount by which bounds and conditions are passed, relative to max(1, their size)."""
    worst = 0.0
    for value, low, high in (("x", "lbx", "ubx"), ("g", "lbg", "ubg")):
        found, lower, upper = result[value].full()[:, 0], arguments[low], arguments[high]
        for excess, bound in ((lower - found, lower), (found - upper, upper)):
            size = np.maximum(1.0, np.where(np.isfinite(bound), np.abs(bound), 1.0))
            worst = max(worst, float((excess / size).max(initial=0.0)))
    return worst


def _unpack(layout: Layout, x: np.ndarray) -> Nodes:
    return Nodes(x[layout.edges], x[layout.points], x[layout.control])
