"""Why a problem has no solution: the smallest relaxation that gives it one, and the conditions that need it most.

    min e  subject to  x' = f,  lower_i - sigma_i e <= q_i <= upper_i + sigma_i e,  e >= 0,

where q are the bounded path conditions, states, controls and ends, and sigma_i the size of each bound: e is the part by
which all limits would have to give way together (bounds of squares by 2 e + e^2).  It is an optimal control problem
itself, with e as a constant state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from occ.errors import Status
from occ.optimal.problem import Bounds, Nodes, Numbers, Problem, Row, flat
from occ.optimal.solvers import SolverOptions
from occ.optimal.transcription import Transcription

REGULARISATION = 1e-7
"""Of the controls: what the smallest relaxation leaves open is settled by the smallest mean square."""
CONTRADICTION = 1e-5
"""A relaxation below this is the solver's own tolerance, not a contradiction."""
ROUNDING = 1e-3
"""Of the last printed digit: what a solver's tolerance may add to it."""
SHARE = 0.5
"""Conditions that need at least this part of the relaxation are named."""


@dataclass(frozen=True)
class Violation:
    """One condition that the relaxed problem goes beyond.

    Args:
        row: what it is.
        value: the farthest value that it needs, in the row's unit or its square.
        bound: its bound there.
        time: [s] when.
        part: excess over the size of the bound.
    """

    row: Row
    value: float
    bound: float
    time: float
    part: float

    def __str__(self) -> str:
        unit = f" {self.row.unit}" if self.row.unit else ""
        value, bound = (
            math.copysign(math.sqrt(abs(x)), x) if self.row.squared else x for x in (self.value, self.bound)
        )
        # A limit set to the printed number has to be wide enough.
        needed = away(value, up=value > bound)
        return f"{self.row.name} needs {needed:.4g}{unit} at t = {self.time:.4g} s; limit {bound:.4g}"


@dataclass(frozen=True)
class Relaxation:
    """The smallest one.

    Args:
        part: e; every limit gives way by this part of its size.
        violations: the most violated conditions, the worst first, one for each row.
        nodes: the relaxed motion.
        note: on how it was found, for its words.
    """

    part: float
    violations: tuple[Violation, ...]
    nodes: Nodes
    note: str = ""

    @property
    def contradicts(self) -> bool:
        """The conditions cannot hold together as they are."""
        return self.part > CONTRADICTION

    def words(self, most: int = 3) -> str:
        """What is violated, and what would help.

        Args:
            most: conditions that are named.

        Returns:
            Text, with numbers and units.
        """
        named = "; ".join(str(violation) for violation in self.violations[:most])
        wider = away(100 * self.part, up=True, digits=3)
        return f"{named}; with every limit wider by {wider:.3g} % there is a solution{self.note}"


def away(value: float, *, up: bool, digits: int = 4) -> float:
    """The number rounded to some digits, up or down; what is below the solver's tolerance changes none of them."""
    unit = 10.0 ** (math.floor(math.log10(abs(value))) + 1 - digits) if value else 1.0
    rounded = math.ceil(value / unit - ROUNDING) if up else math.floor(value / unit + ROUNDING)
    return rounded * unit


@dataclass(frozen=True)
class _Soft:
    """Conditions that give way: where they stand, their bounds at all nodes (k, N, d) or at the ends (k, 1, 1), and
    which of them are of squares (k,)."""

    vector: str
    index: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    squared: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """(k,) sigma: the size of the bound, or 1 where it is zero."""
        sides = np.stack([np.where(np.isfinite(side), np.abs(side), 0.0) for side in (self.lower, self.upper)])
        largest = sides.max(axis=(0, 2, 3))
        return np.where(largest > 0.0, largest, 1.0)


def smallest_relaxation(
    transcription: Transcription, numbers: Numbers, guess: Nodes, rows: np.ndarray | None = None
) -> Relaxation | None:
    """Solve the elastic problem on the same mesh: limits give way first, and the ends too where that is not enough.

    Args:
        transcription: of the problem without a solution.
        numbers: with which it has none.
        guess: to start from.
        rows: path conditions that may give way; None for all, and for the bounds of states and controls.

    Returns:
        The relaxation; None where not even the elastic problem could be solved, or nothing may give way.
    """
    inner, ends = _soft_conditions(transcription, numbers, rows)
    found = _relaxation(transcription, numbers, guess, inner, []) if inner else None
    if found is None and ends:
        found = _relaxation(transcription, numbers, guess, inner, ends)
    return found


def _relaxation(
    transcription: Transcription, numbers: Numbers, guess: Nodes, inner: list[_Soft], ends: list[_Soft]
) -> Relaxation | None:
    problem = transcription.problem
    elastic = _elastic_problem(problem, inner, ends)
    options = SolverOptions(tolerance=1e-8)
    relaxed = Transcription(elastic, transcription.intervals, transcription.degree, transcription.name, options)
    start = _elastic_guess(transcription, numbers, guess, inner)
    outcome = relaxed.solve(_elastic_numbers(numbers, transcription, inner, ends), start)
    if outcome.status is not Status.OK:
        return None
    nodes = Nodes(outcome.nodes.edges[:-1], outcome.nodes.points[:-1], outcome.nodes.control)
    violations = _violations(transcription, numbers, nodes, inner) + _end_violations(
        transcription, numbers, nodes, ends
    )
    part = float(outcome.nodes.edges[-1, -1])
    worst = sorted((v for v in violations if v.part > SHARE * part), key=lambda v: -v.part)
    return Relaxation(part, tuple(worst), nodes)


def _soft_conditions(
    transcription: Transcription, numbers: Numbers, rows: np.ndarray | None
) -> tuple[list[_Soft], list[_Soft]]:
    count, degree = transcription.intervals, transcription.degree

    def soft(vector: str, bounds: Bounds | None, among: np.ndarray | None, shape: tuple[int, int]) -> list[_Soft]:
        if bounds is None:
            return []
        sides = [s[:, None, None] if s.ndim == 1 else s for s in (bounds.lower, bounds.upper)]
        lower, upper = (np.broadcast_to(s, (len(s), *shape)) for s in sides)
        index = np.flatnonzero((np.isfinite(lower) | np.isfinite(upper)).any(axis=(1, 2)))
        if among is not None:
            index = np.intersect1d(index, among)
        named = vector in ("path", "state", "control")
        squared = [named and transcription.problem.names.of(vector, int(i)).squared for i in index]
        return [_Soft(vector, index, lower[index], upper[index], np.array(squared))] if index.size else []

    at_nodes, once = (count, degree), (1, 1)
    others = None if rows is None else np.zeros(0, dtype=int)
    inner = [
        *soft("path", numbers.path, rows, at_nodes),
        *soft("state", numbers.state, others, at_nodes),
        *soft("control", numbers.control, others, at_nodes),
    ]
    return inner, [*soft("end", numbers.end, None, once), *soft("boundary", numbers.boundary, None, once)]


def _elastic_problem(problem: Problem, inner: list[_Soft], ends: list[_Soft]) -> Problem:
    part, first, last = (ca.SX.sym(name) for name in ("part", "first_part", "last_part"))
    vectors = {name: getattr(problem, name) for name in ("path", "state", "control", "end", "boundary")}

    def sized(soft: list[_Soft], label: str) -> tuple[ca.SX, ca.SX]:
        values = ca.vertcat(*(vectors[s.vector][s.index.tolist()] for s in soft)) if soft else ca.SX(0, 1)
        return values, ca.SX.sym(f"{label}_size", values.numel())

    values, size = sized(inner, "inner")
    squared = np.concatenate([s.squared for s in inner]) if inner else np.zeros(0)
    give = size * (part + ca.DM(squared.astype(float)) * (part + part**2))
    end_values, end_size = sized(ends, "end")
    smallness = ca.SX.sym("smallness")
    hard = np.setdiff1d(np.arange(problem.path.numel()), [i for s in inner if s.vector == "path" for i in s.index])
    return Problem(
        state=ca.vertcat(problem.state, part),
        control=problem.control,
        data=problem.data,
        parameters=ca.vertcat(problem.parameters, size, end_size, smallness),
        start=ca.vertcat(problem.start, first),
        end=ca.vertcat(problem.end, last),
        rate=ca.vertcat(problem.rate, 0),
        integrand=smallness * ca.sumsqr(problem.control),
        terminal=last,
        path=ca.vertcat(*(problem.path[int(i)] for i in hard), values - give, values + give),
        boundary=ca.vertcat(
            *([end_values - end_size * last, end_values + end_size * last] if ends else [problem.boundary])
        ),
    )


def _elastic_numbers(numbers: Numbers, transcription: Transcription, inner: list[_Soft], ends: list[_Soft]) -> Numbers:
    nx, *_ = transcription.sizes
    shape = transcription.intervals, transcription.degree
    sizes = [s.size for s in (*inner, *ends)]
    duration = float(numbers.edges[-1] - numbers.edges[0])

    def relaxed(soft: list[_Soft], shape: tuple[int, int]) -> Bounds:
        lower = np.concatenate([s.lower for s in soft]) if soft else np.zeros((0, *shape))
        upper = np.concatenate([s.upper for s in soft]) if soft else np.zeros((0, *shape))
        return Bounds(
            lower=np.concatenate([np.full_like(lower, -np.inf), lower]),
            upper=np.concatenate([upper, np.full_like(upper, np.inf)]),
        )

    path, boundary, end = relaxed(inner, shape), numbers.boundary, numbers.end
    if ends:
        given = relaxed(ends, (1, 1))
        boundary = Bounds(lower=given.lower[:, 0, 0], upper=given.upper[:, 0, 0])
        end = Bounds.free(nx)
    if numbers.path is not None:
        soft = [i for s in inner if s.vector == "path" for i in s.index]
        hard = [i for i in range(len(numbers.path.lower)) if i not in soft]
        sides = [s[:, None, None] if s.ndim == 1 else s for s in (numbers.path.lower, numbers.path.upper)]
        lower, upper = (np.broadcast_to(s, (len(s), *shape))[hard] for s in sides)
        path = Bounds(lower=np.concatenate([lower, path.lower]), upper=np.concatenate([upper, path.upper]))
    soft_vectors = {s.vector for s in inner}
    return Numbers(
        edges=numbers.edges,
        data=numbers.data,
        parameters=np.concatenate([numbers.parameters, *sizes, [REGULARISATION / duration]]),
        start=_with_part(numbers.start, 0.0),
        end=_with_part(end, -np.inf),
        state=None if numbers.state is None or "state" in soft_vectors else _with_part(numbers.state, -np.inf),
        control=None if "control" in soft_vectors else numbers.control,
        path=path,
        boundary=boundary,
    )


def _with_part(bounds: Bounds, least: float) -> Bounds:
    return Bounds(lower=np.append(bounds.lower, least), upper=np.append(bounds.upper, np.inf))


def _elastic_guess(transcription: Transcription, numbers: Numbers, guess: Nodes, inner: list[_Soft]) -> Nodes:
    parts = [
        _parts(s, value)[0].max() for s, value in zip(inner, _values(transcription, numbers, guess, inner), strict=True)
    ]
    part = max([0.0, *(float(p) for p in parts if np.isfinite(p))])
    edges = np.concatenate([guess.edges, np.full((1, guess.edges.shape[1]), part)])
    points = np.concatenate([guess.points, np.full((1, *guess.points.shape[1:]), part)])
    return Nodes(edges, points, guess.control)


def _values(transcription: Transcription, numbers: Numbers, nodes: Nodes, soft: list[_Soft]) -> list[np.ndarray]:
    """(k, N, d) Values of soft conditions at the nodes."""
    path = transcription.evaluate(flat(nodes.points), flat(nodes.control), flat(numbers.data), numbers.parameters)[2]
    path = path.reshape(-1, *nodes.points.shape[1:])
    table = {"path": path, "state": nodes.points, "control": nodes.control}
    return [table[s.vector][s.index] for s in soft]


def _parts(soft: _Soft, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Excess over the nearer bound by its size, and that bound, both like the values."""
    size = soft.size[:, None, None]
    over, under = (values - soft.upper) / size, (soft.lower - values) / size
    # Of squares, the part by which the quantity itself would have to give way.
    roots = soft.squared[:, None, None]
    over, under = (np.where(roots, np.sqrt(np.maximum(1.0 + x, 0.0)) - 1.0, x) for x in (over, under))
    return np.maximum(over, under), np.where(over >= under, soft.upper, soft.lower)


def _violations(transcription: Transcription, numbers: Numbers, nodes: Nodes, inner: list[_Soft]) -> list[Violation]:
    found = []
    times = transcription.node_times(numbers.edges)
    for soft, values in zip(inner, _values(transcription, numbers, nodes, inner), strict=True):
        parts, bounds = _parts(soft, values)
        for row, index in enumerate(soft.index):
            # The first of the places that are as bad as the worst.
            part = parts[row].max()
            first = int(np.argmax(parts[row] >= part - CONTRADICTION * (1.0 + abs(part))))
            interval, point = divmod(first, times.shape[1])
            name = transcription.problem.names.of(soft.vector, int(index))
            at = (row, interval, point)
            found.append(
                Violation(name, float(values[at]), float(bounds[at]), float(times[interval, point]), float(parts[at]))
            )
    return found


def _end_violations(transcription: Transcription, numbers: Numbers, nodes: Nodes, ends: list[_Soft]) -> list[Violation]:
    found = []
    start, end = nodes.edges[:, 0], nodes.edges[:, -1]
    boundary = np.array(transcription.problem.boundary_function(start, end, numbers.parameters)[1])[:, 0]
    for soft in ends:
        vector, source = ("state", end) if soft.vector == "end" else ("boundary", boundary)
        parts, bounds = _parts(soft, source[soft.index][:, None, None])
        for row, index in enumerate(soft.index):
            name = transcription.problem.names.of(vector, int(index))
            name = Row(f"{name.name} at the end", name.unit)
            value = float(source[index])
            time = float(numbers.edges[-1])
            found.append(Violation(name, value, float(bounds[row, 0, 0]), time, float(parts[row, 0, 0])))
    return found
