"""FATROP without CasADi in between: the same bits by whatever way, nothing built for an interval, every status."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from occ import compiler
from occ.errors import Status
from occ.optimal import direct, transcription
from occ.optimal.problem import Bounds, Nodes, Numbers, Problem
from occ.optimal.solvers import SolverOptions
from occ.optimal.transcription import Outcome, Transcription

pytestmark = pytest.mark.skipif(
    not any(shutil.which(name) for name in compiler.COMPILERS), reason="no C compiler on this machine"
)
PLAIN = SolverOptions(solver="fatrop")
FAST = replace(PLAIN, compiled=True)
INF = np.inf


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One folder for all: each problem is compiled once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


DEGREE = 2


def cart(paths: bool) -> Problem:
    """x'' = u, y' = v - u with data, parameters, curved costs at both ends, and two curved path conditions or none."""
    x, u, d, p = ca.SX.sym("x", 3), ca.SX.sym("u", 2), ca.SX.sym("d", 2), ca.SX.sym("p", 2)
    start, end = ca.SX.sym("start", 3), ca.SX.sym("end", 3)
    cost = ca.sqrt(p[0]) * ca.sumsqr(u) + (1 - ca.cos(x[0] - d[0])) * x[1] ** 2 + (x[2] - ca.sin(d[1])) ** 2
    path = ca.vertcat(u[0] + p[1] * x[1] ** 2, u[1] * ca.cos(x[0]) + d[0]) if paths else ca.SX(0, 1)
    terminal = ca.exp(start[2]) + start[2] ** 2 + ca.cos(end[0]) * end[2] + 2 * end[2] ** 2
    symbols = {"state": x, "control": u, "data": d, "parameters": p, "start": start, "end": end}
    rate = ca.vertcat(x[1], u[0], u[1] - u[0])
    return Problem(**symbols, rate=rate, integrand=cost, terminal=terminal, path=path)


CARTS = {paths: cart(paths) for paths in (True, False)}


def posed(problem: Problem, intervals: int, seed: int) -> tuple[Numbers, Nodes]:
    """Random numbers from a start at rest to x = 1, x' = 0; y is free at both ends, bounded at the first."""
    rng = np.random.default_rng(seed)
    width = rng.uniform(1.3, 1.7)
    path = Bounds(lower=np.array([-INF, -width]), upper=np.array([2 * width, width]))
    edges = np.concatenate([[0.0], np.cumsum(rng.uniform(0.2, 0.6, intervals))])
    numbers = Numbers(
        edges=edges,
        data=rng.normal(scale=0.3, size=(2, intervals, DEGREE)),
        parameters=rng.uniform(0.5, 1.5, 2),
        start=Bounds(lower=np.array([0.0, 0.0, -1.0]), upper=np.array([0.0, 0.0, 1.0])),
        end=Bounds(lower=np.array([1.0, 0.0, -INF]), upper=np.array([1.0, 0.0, INF])),
        path=path if problem.path.numel() else None,
    )
    guess = Nodes(
        *(rng.normal(scale=0.3, size=(k, intervals, *n)) for k, n in ((3, ()), (3, (DEGREE,)), (2, (DEGREE,))))
    )
    return numbers, replace(guess, edges=np.column_stack([guess.edges, np.zeros(3)]))


def held(numbers: Numbers) -> Numbers:
    """With bounds of the controls, point by point: none in the first interval, equations in the last, one side else."""
    shape = 2, len(numbers.edges) - 1, DEGREE
    lower, upper = np.full(shape, -2.5), np.full(shape, INF)
    lower[:, 0], upper[:, 0] = -INF, INF
    lower[1, -1] = upper[1, -1] = 0.25
    return replace(numbers, control=Bounds(lower=lower, upper=upper))


def equations(numbers: Numbers) -> Numbers:
    """With the second path condition as an equation."""
    return replace(numbers, path=Bounds(lower=np.array([-INF, 0.4]), upper=np.array([3.0, 0.4])))


def free(numbers: Numbers) -> Numbers:
    """With no inequality anywhere."""
    return replace(numbers, start=Bounds.fixed(np.zeros(3)), path=None)


def impossible(numbers: Numbers) -> Numbers:
    """With bounds that no control can keep."""
    return replace(numbers, path=Bounds(lower=np.array([50.0, -INF]), upper=np.array([60.0, -5.0])))


def same(one: Outcome, other: Outcome) -> bool:
    """To the last bit, and in all that is told but the time."""
    told = [{k: v for k, v in o.statistics.items() if k != "seconds"} for o in (one, other)]
    values = [(o.cost, o.nodes.edges, o.nodes.points, o.nodes.control) for o in (one, other)]
    equal = all(np.array_equal(a, b, equal_nan=True) for a, b in zip(*values, strict=True))
    return equal and told[0] == told[1] and (one.status, one.message) == (other.status, other.message)


@pytest.mark.parametrize("change", [replace, held, equations, free], ids=lambda change: change.__name__)
@pytest.mark.parametrize("intervals", [5, 4])
def test_both_ways_give_the_same_bits(change: Callable[[Numbers], Numbers], intervals: int) -> None:
    numbers, guess = posed(CARTS[True], intervals, seed=intervals)
    numbers = change(numbers)
    plain, fast = (Transcription(CARTS[True], intervals, DEGREE, options=options) for options in (PLAIN, FAST))
    assert fast._code is not None
    expected, found = plain.solve(numbers, guess), fast.solve(numbers, guess)
    assert expected.status is Status.OK
    assert expected.statistics["solver"] == "fatrop"
    assert same(expected, found)
    assert not fast._programs
    assert same(*(t.solve(numbers, expected.nodes, restart=True) for t in (plain, fast)))


@pytest.mark.parametrize("intervals", [1, 3])
def test_without_path_conditions_and_with_points_inside(intervals: int) -> None:
    numbers, guess = posed(CARTS[False], intervals, seed=1)
    plain, fast = (Transcription(CARTS[False], intervals, DEGREE, "legendre", options) for options in (PLAIN, FAST))
    expected, found = plain.solve(numbers, guess), fast.solve(numbers, guess)
    assert expected.status is Status.OK
    assert same(expected, found)
    assert not fast._programs


def test_a_solver_that_is_kept_does_not_remember(monkeypatch: pytest.MonkeyPatch) -> None:
    """One transcription solves one problem after the other, failures among them, as if each were its first."""
    options = replace(FAST, iterations=25)
    fast, statuses = Transcription(CARTS[True], 4, DEGREE, options=options), set()
    code = fast._code
    # The code is shared, the solvers are not.
    monkeypatch.setattr(transcription, "DirectCode", lambda *_: code)
    for seed in range(24):
        numbers, guess = posed(CARTS[True], 4, seed)
        if seed % 3 == 2:
            guess = replace(guess, control=40.0 * guess.control)
        numbers = (replace, impossible, replace, replace, held, held, equations)[seed % 7](numbers)
        variant = fast._variant(bounded=True)
        first = Transcription(CARTS[True], 4, DEGREE, options=options)
        outcomes = [t._solve(variant, numbers, guess, hurried=False)[0] for t in (first, fast)]
        assert same(*outcomes)
        statuses.add(outcomes[0].status)
    assert statuses == {Status.OK, Status.FAILED}


@pytest.mark.parametrize("case", [{"iterations": 1}, {"seconds": 1e-7}], ids=["too few iterations", "too little time"])
def test_limits_are_told_in_the_same_words(case: dict[str, float]) -> None:
    numbers, guess = posed(CARTS[True], 4, seed=0)
    expected, found = (
        Transcription(CARTS[True], 4, DEGREE, options=replace(options, **case)).solve(numbers, guess)
        for options in (PLAIN, FAST)
    )
    assert found.status is Status.FAILED
    assert found.message == expected.message
    assert "the solver used all its" in found.message


def test_a_contradiction_goes_to_the_other_solver() -> None:
    numbers, guess = posed(CARTS[True], 2, seed=0)
    outcome = Transcription(CARTS[True], 2, DEGREE, options=FAST).solve(impossible(numbers), guess)
    assert outcome.status is Status.INFEASIBLE
    assert outcome.statistics["instead"].startswith("fatrop gave up after")


@pytest.mark.parametrize("options", [PLAIN, FAST], ids=["through CasADi", "direct"])
@pytest.mark.parametrize("where", ["cost", "guess"])
def test_what_is_not_finite_ends_the_solve(options: SolverOptions, where: str) -> None:
    """FATROP itself never comes back from it."""
    numbers, guess = posed(CARTS[True], 2, seed=0)
    transcription = Transcription(CARTS[True], 2, DEGREE, options=options)
    honest = transcription.solve(numbers, guess)
    if where == "cost":
        outcome = transcription.solve(replace(numbers, parameters=np.array([-1.0, 1.0])), guess)
        assert "not finite: the integrand at t = " in outcome.message
    else:
        broken = guess.control.copy()
        broken[0, 1, 1] = np.nan
        outcome = transcription.solve(numbers, replace(guess, control=broken))
        assert "not finite: the rate of the state at t = " in outcome.message
    assert outcome.status is Status.FAILED
    assert same(transcription.solve(numbers, guess), honest)


def test_nothing_is_built_for_an_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("built")

    for name in ("collocation_program", "nonlinear_solver"):
        monkeypatch.setattr(transcription, name, refuse)
    numbers, guess = posed(CARTS[True], 40, seed=0)
    outcome = Transcription(CARTS[True], 40, DEGREE, options=FAST).solve(numbers, guess)
    assert outcome.status is Status.OK


def effort() -> Problem:
    """Integral of u^2 + p exp(10 x) with x'' = u."""
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")
    ends = {"start": ca.SX.sym("start", 2), "end": ca.SX.sym("end", 2)}
    rate, integrand = ca.vertcat(x[1], u), u**2 + p * ca.exp(10 * x[0])
    return Problem(state=x, control=u, data=ca.SX.sym("d", 0), parameters=p, **ends, rate=rate, integrand=integrand)


EFFORT = effort()


def least_effort(solver: Transcription, end: float, p: float) -> Outcome:
    """From rest at 0 to rest, from a guess that stands still."""
    intervals, degree = solver.intervals, solver.degree
    numbers = Numbers(
        edges=np.linspace(0.0, 1.0, intervals + 1),
        data=np.zeros((0, intervals, degree)),
        parameters=np.array([p]),
        start=Bounds.fixed(np.zeros(2)),
        end=Bounds.fixed(np.array([end, 0.0])),
    )
    points = np.zeros((2, intervals, degree))
    return solver.solve(numbers, Nodes(np.zeros((2, intervals + 1)), points, points[:1]))


def test_least_effort_is_met_exactly_by_any_mesh() -> None:
    """From rest to rest: x = 3 t^2 - 2 t^3 costs 12."""
    for intervals in (1, 2, 7):
        outcome = least_effort(Transcription(EFFORT, intervals, 3, options=FAST), end=1.0, p=0.0)
        assert outcome.cost == pytest.approx(12.0, rel=1e-13)
        t = np.linspace(0.0, 1.0, intervals + 1)
        np.testing.assert_allclose(outcome.nodes.edges, [3 * t**2 - 2 * t**3, 6 * t - 6 * t**2], atol=1e-13)


def test_a_derivative_that_is_not_finite_on_the_way_ends_the_solve() -> None:
    """The first step reaches the end, where exp(10 x) is nearly the largest number, and its derivative none at all."""
    solver = Transcription(EFFORT, 2, 3, options=FAST)
    outcome = least_effort(solver, end=70.9, p=1.0)
    assert outcome.status is Status.FAILED
    assert outcome.statistics["iterations"] > 0
    assert outcome.message == "a function of the problem, or a derivative of one, is not finite"
    assert least_effort(solver, end=1.0, p=0.0).status is Status.OK


@pytest.mark.parametrize("missing", ["library", "headers"])
def test_without_the_parts_casadi_stands_in_between(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if missing == "library":
        monkeypatch.setattr(direct, "LIBRARIES", ("no-such-library",))
    else:
        monkeypatch.setattr(direct, "HEADER", "no/such/header.h")
    numbers, guess = posed(CARTS[False], 3, seed=1)
    fast = Transcription(CARTS[False], 3, DEGREE, options=FAST)
    assert fast._code is None
    assert fast.solve(numbers, guess).status is Status.OK
    assert fast._programs


def test_what_couples_the_ends_goes_through_casadi() -> None:
    coupled = CARTS[False]
    coupled = replace(coupled, terminal=(coupled.end[2] - coupled.start[2]) ** 2)
    with_boundary = replace(CARTS[False], boundary=coupled.end[2] - coupled.start[2])
    for problem in (coupled, with_boundary):
        fast = Transcription(problem, 3, DEGREE, options=PLAIN)
        assert not fast._layout(boundary=True, integrated=True).only_steps
    assert fast._layout(boundary=False, integrated=True).only_steps
