"""Sums of squares by semidefinite programming: numbers for a proof, none of which needs to be right.

The coefficients of V and the Gram matrices are the unknowns, the bound is what is maximised.  A strict margin is asked
for, since the solver keeps its equations to some digits only; then the Gram matrices are projected on the equations,
and `occ.certify.checker.examine` decides what has been proven.

Source: Parrilo, Math. Program. 96 (2003), 293; Henrion, Lasserre, Savorgnan, Nonlinear optimal control synthesis via
occupation measures (2008); Peyrl, Parrilo, Theor. Comput. Sci. 409 (2008), 269 (projection).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from occ.certify.balls import Refused
from occ.certify.bellman import CONSTANT, Inequality, State
from occ.certify.proofs import Gram, SquaresProof
from occ.certify.series import Key, Series, entries

SOLVERS: dict[str, dict[str, float]] = {
    "CLARABEL": {"tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10, "max_iter": 60},
    "SCS": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iters": 20_000},
}
"""In the order in which they are tried; a strict margin is of use only above the solver's own tolerance."""


class Degree(NamedTuple):
    """Even degrees of V."""

    time: int
    angle: int


@dataclass(frozen=True)
class _Condition:
    """constant + columns v + level c = sum of the Gram matrices, for each term; without the columns of the latter."""

    constant: Series
    columns: list[Series]
    level: Series
    shapes: list[Gram]


def propose(problem: Inequality, degree: Degree, margin: float) -> SquaresProof:
    """Numbers for a proof.

    Args:
        problem: to be bounded.
        degree: of V.
        margin: by which the Gram matrices should be positive definite, relative to the size of the cost.

    Returns:
        To be checked by `occ.certify.checker.examine`.

    Raises:
        Refused: no solver finds any.
    """
    real = _in_floats(problem)
    if not real.cost.terms:
        raise Refused("nothing costs anything")
    unit = 2.0 ** round(math.log2(max(abs(c) for c in real.cost.terms.values())))
    real = replace(real, cost=real.cost * (1 / unit), end_cost=real.end_cost and real.end_cost * (1 / unit))
    basis = _value_basis(real, degree)
    conditions = [_flow_condition(real, basis, degree)]
    zero = real.boundary(Series({}), 0.0)
    if zero is not None:
        conditions.append(_end_condition(real, basis, zero, degree))
    gain = np.array([float(real.bound(Series({key: 1.0}), 0.0) - real.bound(Series({}), 0.0)) for key in basis])
    if real.side:
        line = real.flow(Series({}), 0.0, 1.0) - real.flow(Series({}), 0.0)
        conditions[0].columns.append(line)
        gain = np.append(gain, float(real.bound(Series({}), 0.0, 1.0) - real.bound(Series({}), 0.0)))
    numbers, level, grams = _solve(conditions, gain, real, margin)
    sizes = [len(condition.shapes) for condition in conditions]
    scaled = [replace(gram, matrix=unit * gram.matrix) for gram in grams]
    value = {key: unit * float(c) for key, c in zip(basis, numbers, strict=False)}
    end = scaled[sizes[0]] if len(sizes) > 1 else None
    # The sign is asked for; what the solver misses of it is left to the Gram matrix.
    slope = -real.side * max(0.0, -real.side * unit * float(numbers[-1])) if real.side else 0.0
    return SquaresProof(value, unit * level, tuple(scaled[: sizes[0]]), end, slope)


def _in_floats(problem: Inequality) -> Inequality:
    def plain(series: Series | None) -> Series | None:
        return series and Series({key: float(c) for key, c in series.terms.items()})

    def state(of: State | None) -> State | None:
        return of and State(float(of.angle), float(of.rate))

    cost = plain(problem.cost)
    assert cost is not None
    return replace(
        problem,
        cost=cost,
        duration=problem.duration if problem.duration is None else float(problem.duration),
        start=state(problem.start),
        end=state(problem.end),
        end_cost=plain(problem.end_cost),
        turn=problem.turn if problem.turn is None else float(problem.turn),
        paid=0.0,
    )


def _waves(degree: int) -> list[int]:
    """Harmonics up to a degree."""
    return [0, *(sign * h for h in range(1, degree + 1) for sign in (1, -1))]


def _value_basis(problem: Inequality, degree: Degree) -> list[Key]:
    steady = problem.duration is None
    powers = range(3) if problem.regular else range(1)
    # The Gram matrices hold a and w^2 without waves, so that V_1 and V_2 have half of V_0's; without w^4 in the cost
    # nothing could pay for w^3, which V_2 brings with its slope.
    half = degree.angle // 2
    waves = (degree.angle, half, half if (4, 0, 0, 0) in problem.cost.terms else 0)
    times = range(1 if steady else degree.time + 1)
    found = [(i, 0, k, h) for i in powers for k in times for h in _waves(waves[i])]
    # A constant in V makes no difference where start and end are both charged or both free.
    needless = steady or problem.start is None or problem.end is not None
    return [key for key in found if key != CONSTANT or not needless]


def _flow_condition(problem: Inequality, basis: list[Key], degree: Degree) -> _Condition:
    zero = problem.flow(Series({}), 0.0)
    columns = [problem.flow(Series({key: 1.0}), 0.0) - zero for key in basis]
    rows = [(0, 0), (1, 0)]
    short = [row for row in ((2, 0), (0, 1)) if (2 * row[0], 2 * row[1], 0, 0) in zero.terms and problem.regular]
    half = 0 if problem.duration is None else degree.time // 2
    # Long monomials need no waves: what they pay for is constant.
    waves = [(row, _waves(degree.angle // 2)) for row in rows] + [(row, [0]) for row in short]

    def shape(top: int, inside: bool) -> Gram:
        terms = tuple((*row, k, h) for row, own in waves for k in range(top + 1) for h in own)
        return Gram(terms, np.zeros((len(terms), len(terms))), inside)

    shapes = [shape(half, False)] + ([shape(half - 1, True)] if half else [])
    return _Condition(zero, columns, problem.flow(Series({}), 1.0) - zero, shapes)


def _end_condition(problem: Inequality, basis: list[Key], zero: Series, degree: Degree) -> _Condition:
    def boundary(key: Key) -> Series:
        found = problem.boundary(Series({key: 1.0}), 0.0)
        assert found is not None
        return found - zero

    rows = [(0, 0), (1, 0)] if problem.regular else [(0, 0)]
    terms = tuple((*row, 0, h) for row in rows for h in _waves(degree.angle // 2))
    shape = Gram(terms, np.zeros((len(terms), len(terms))))
    level = problem.boundary(Series({}), 1.0)
    assert level is not None
    return _Condition(zero, [boundary(key) for key in basis], level - zero, [shape])


class _Rows(NamedTuple):
    """A condition as matrices."""

    constant: np.ndarray
    columns: Any
    level: np.ndarray
    grams: list[Any]


def _rows(condition: _Condition) -> _Rows:
    from scipy.sparse import csr_matrix

    places: dict[Key, int] = {}
    found: list[tuple[list[int], list[int], list[float], int]] = []
    for shape in condition.shapes:
        parts = entries(shape.basis, shape.inside)
        n = len(shape.basis)
        # Each number of the lower triangle stands for two places of the matrix.
        rows = [places.setdefault(key, len(places)) for _, _, key, _ in parts]
        halves = [factor / 2 for *_, factor in parts]
        columns = [a * n + b for a, b, *_ in parts] + [b * n + a for a, b, *_ in parts]
        found.append((rows * 2, columns, halves * 2, n * n))
    series = [condition.constant, *condition.columns, condition.level]
    for part in series:
        for key, c in part.terms.items():
            if key not in places and c != 0:
                raise Refused(f"no product of the terms of the Gram matrices gives the term {key}")
    dense = np.zeros((len(places), len(series)))
    for column, part in enumerate(series):
        for key, c in part.terms.items():
            if c != 0:
                dense[places[key], column] += c
    grams = [csr_matrix((data, (rows, columns)), (len(places), size)) for rows, columns, data, size in found]
    return _Rows(dense[:, 0], csr_matrix(dense[:, 1:-1]), dense[:, -1], grams)


def _solve(
    conditions: list[_Condition], gain: np.ndarray, problem: Inequality, margin: float
) -> tuple[np.ndarray, float, list[Gram]]:
    import cvxpy as cp

    numbers, level = cp.Variable(len(gain)), cp.Variable()
    constraints: list[Any] = []
    found: list[tuple[_Rows, list[Gram], list[Any]]] = []
    for condition in conditions:
        rows = _rows(condition)
        unknown = [cp.Variable(shape.matrix.shape, PSD=True) for shape in condition.shapes]
        squares = sum(
            part @ (cp.vec(matrix, order="C") + margin * np.eye(matrix.shape[0]).ravel())
            for part, matrix in zip(rows.grams, unknown, strict=True)
        )
        constraints.append(rows.constant + rows.columns @ numbers + rows.level * level == squares)
        found.append((rows, condition.shapes, unknown))
    wants_level = problem.start is None
    if not wants_level:
        constraints.append(level == 0)
    if problem.side:
        constraints.append(problem.side * numbers[-1] <= 0)
    _run(cp.Problem(cp.Maximize(gain @ numbers + level), constraints))
    if numbers.value is None or not np.all(np.isfinite(numbers.value)):
        raise Refused("the solver has no numbers to offer")
    chosen = float(level.value) if wants_level else 0.0
    grams: list[Gram] = []
    for rows, shapes, unknown in found:
        wanted = rows.constant + rows.columns @ numbers.value + rows.level * chosen
        grams += _projected(
            rows, shapes, [matrix.value + margin * np.eye(len(matrix.value)) for matrix in unknown], wanted
        )
    return np.asarray(numbers.value), chosen, grams


def _run(program: Any) -> None:
    import cvxpy as cp

    for solver, options in SOLVERS.items():
        try:
            with warnings.catch_warnings():
                # The check decides how accurate it is.
                warnings.simplefilter("ignore")
                program.solve(solver=solver, **options)
        except cp.SolverError:
            continue
        if program.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            return
    raise Refused(f"no solver finds Gram matrices of this degree ({program.status})")


def _projected(rows: _Rows, shapes: list[Gram], matrices: Iterable[np.ndarray], wanted: np.ndarray) -> list[Gram]:
    """The nearest matrices that satisfy the equations, but for rounding."""
    from scipy.sparse import hstack
    from scipy.sparse.linalg import spsolve

    joint = hstack(rows.grams).tocsr()
    flat = np.concatenate([matrix.ravel() for matrix in matrices])
    normal = (joint @ joint.T).tocsc()
    for _ in range(2):
        flat = flat + joint.T @ spsolve(normal, wanted - joint @ flat)
    grams, first = [], 0
    for shape in shapes:
        n = len(shape.basis)
        matrix = flat[first : first + n * n].reshape(n, n)
        grams.append(replace(shape, matrix=(matrix + matrix.T) / 2))
        first += n * n
    return grams
