"""Two solvers for one program: exact derivatives, agreement, and every way in which a solve can end."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from occ.errors import InputError, Status
from occ.optimal.chains import Chains, integrated
from occ.optimal.collocation import Collocation
from occ.optimal.layout import Layout, blocks, stages
from occ.optimal.mesh import scheme
from occ.optimal.problem import Bounds, Nodes, Numbers, Problem
from occ.optimal.program import collocation_program
from occ.optimal.solvers import SolverOptions
from occ.optimal.starts import starts_of
from occ.optimal.transcription import Transcription
from occ.referee import judge
from occ.task import Limits
from tests.tasks import paper_task


def coupled(curved_ends: bool = True) -> Problem:
    """Everything that a problem can have: data, parameters, path conditions, ends coupled in cost and conditions."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    d, p = ca.SX.sym("d", 1), ca.SX.sym("p", 2)
    start, end = ca.SX.sym("start", 2), ca.SX.sym("end", 2)
    return Problem(
        state=x,
        control=u,
        data=d,
        parameters=p,
        start=start,
        end=end,
        rate=ca.vertcat(x[1] * ca.cos(x[0]) + d, p[0] * u[0] - ca.sin(x[0]) * u[1]),
        integrand=u[0] ** 2 * (1 + x[0] ** 2) + ca.exp(u[1] * x[1]) + p[1] * d * x[0],
        terminal=start[0] * end[1] ** 2 + p[0] * end[0] if curved_ends else ca.sumsqr(end),
        path=ca.vertcat(x[0] * u[1], x[1] ** 2 + u[0]),
        boundary=ca.vertcat(end[0] - start[0], ca.sin(end[1]) * start[1]),
    )


def chained() -> Problem:
    """The same, but with a chain of two integrators, one of one, and a constant; a third control is in no rate."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 3)
    d, p = ca.SX.sym("d", 1), ca.SX.sym("p", 2)
    start, end = ca.SX.sym("start", 4), ca.SX.sym("end", 4)
    return Problem(
        state=x,
        control=u,
        data=d,
        parameters=p,
        start=start,
        end=end,
        rate=ca.vertcat(x[1], 2 * u[0], u[1] - 0.5 * u[0], 0),
        integrand=u[0] ** 2 * (1 + ca.sin(x[0]) ** 2) + ca.exp(u[1] * x[1]) + p[1] * d * x[2] + (u[2] - x[3]) ** 2,
        terminal=start[0] * end[1] ** 2 + p[0] * end[0],
        path=ca.vertcat(x[0] * u[2] + d, x[1] ** 2 + u[0] / p[0] - x[3] * x[2]),
        boundary=ca.vertcat(end[0] - start[0], ca.sin(end[1]) * start[1]),
    )


def layouts(problem: Problem, name: str, intervals: int) -> list[Layout]:
    points = scheme(name, 3)
    kinds = [blocks(problem, points, intervals), stages(problem, points, intervals, boundary=True)]
    return [*kinds, stages(problem, points, intervals, boundary=False)]


def assert_derivatives(problem: Problem, name: str, layout: Layout, rng: np.random.Generator) -> None:
    """All derivatives of a program are those of automatic differentiation."""
    program = collocation_program(problem, scheme(name, 3), layout, upper=layout.stages is None)
    x, p, f, g = (program.nlp[key] for key in "xpfg")
    lam = ca.MX.sym("lam", layout.conditions)
    lagrangian = 0.7 * f + ca.dot(lam, g)
    truth = ca.Function("truth", [x, p, lam], [ca.jacobian(g, x), ca.gradient(f, x), *ca.hessian(lagrangian, x), g])
    at = rng.normal(size=layout.unknowns), rng.uniform(0.5, 2.0, p.numel()), rng.normal(size=layout.conditions)
    jacobian, gradient, hessian, of_lagrangian, conditions = outputs(truth, *at)
    found = {
        key: outputs(function, *at[:2])
        for key, function in program.functions.items()
        if "_h" not in key and key != "nlp_grad"
    }
    np.testing.assert_allclose(found["nlp_jac_g"][1], jacobian, atol=1e-11)
    np.testing.assert_allclose(found["nlp_jac_g"][0], conditions, atol=1e-11)
    np.testing.assert_allclose(found["nlp_grad_f"][-1], gradient, atol=1e-11)
    second = outputs(program.functions["nlp_hess_l"], *at[:2], 0.7, at[2])
    if layout.stages is None:
        np.testing.assert_allclose(second[0], np.triu(hessian), atol=1e-10)
    else:
        np.testing.assert_allclose(second[1], hessian, atol=1e-10)
        np.testing.assert_allclose(second[0], of_lagrangian, atol=1e-10)


def outputs(function: ca.Function, *arguments: object) -> list[np.ndarray]:
    return [np.array(value) for value in function.call([ca.DM(np.asarray(a)) for a in arguments])]


@pytest.mark.parametrize("name", ["radau", "legendre"])
@pytest.mark.parametrize("kind", range(3))
@pytest.mark.parametrize("curved_ends", [True, False])
def test_derivatives_are_those_of_automatic_differentiation(name: str, kind: int, curved_ends: bool) -> None:
    problem = coupled(curved_ends)
    assert_derivatives(problem, name, layouts(problem, name, 3)[kind], np.random.default_rng(kind))


@pytest.mark.parametrize("name", ["radau", "legendre"])
@pytest.mark.parametrize("boundary", [True, False])
def test_derivatives_where_states_are_integrals(name: str, boundary: bool) -> None:
    layout = stages(chained(), scheme(name, 3), 3, boundary, integrated=True)
    assert_derivatives(chained(), name, layout, np.random.default_rng(0))


def by_interval(edges: np.ndarray, control: np.ndarray) -> np.ndarray:
    """x_k, u_1 .. u_d of each interval."""
    return np.concatenate([edges[:, :-1], *control.transpose(2, 0, 1)])


@pytest.mark.parametrize("name", ["radau", "legendre"])
def test_integrated_states_are_those_that_the_conditions_would_give(name: str) -> None:
    # From controls and edges that fit, the program with the points as unknowns has the same cost and conditions.
    problem, points, rng = chained(), scheme(name, 3), np.random.default_rng(1)
    long, short = (stages(problem, points, 4, False, integrated) for integrated in (False, True))
    chains = Chains.of(problem)
    assert chains is not None
    maps, widths = integrated(chains, points), rng.uniform(0.2, 2.0, 4)
    control, edges = rng.normal(size=(3, 4, 3)), np.zeros((4, 5))
    edges[:, 0] = rng.normal(size=4)
    for k, h in enumerate(widths):
        at_points = maps.states(by_interval(edges, control), widths)[:, k]
        # The polynomial through the edge and the points, at its end.
        edges[:, k + 1] = np.concatenate([edges[:, [k]], at_points], axis=1) @ points.end
        rates = np.stack([at_points[1], 2 * control[0, k], control[1, k] - 0.5 * control[0, k], np.zeros(3)])
        slopes = np.concatenate([edges[:, [k]], at_points], axis=1) @ points.derivative
        np.testing.assert_allclose(slopes, h * rates, atol=1e-12)
    states = maps.states(by_interval(edges, control), widths)
    values, p = [], np.concatenate([widths, rng.normal(size=12), rng.uniform(0.5, 2.0, 2)])
    for layout in (long, short):
        program = collocation_program(problem, points, layout, upper=False)
        x = np.zeros(layout.unknowns)
        x[layout.edges], x[layout.control] = edges, control
        if layout.points is not None:
            x[layout.points] = states
        f, g = outputs(program.functions["nlp_f"], x, p), outputs(program.functions["nlp_g"], x, p)
        path = g[0][layout.path.ravel(), 0]
        # x(0) is carried along for the boundary conditions, which are left out.
        motion = np.concatenate([layout.defects.ravel(), layout.ends.ravel()])
        np.testing.assert_allclose(g[0][motion, 0], 0.0, atol=1e-11)
        values.append((f[0].item(), path))
    assert values[0][0] == pytest.approx(values[1][0], rel=1e-13)
    np.testing.assert_allclose(values[0][1], values[1][1], atol=1e-12)


def test_the_program_of_more_intervals_has_no_more_operations() -> None:
    # Building and solving are linear in the number of intervals: vectors grow, the graph does not.
    points, counts = scheme("radau", 3), []
    for intervals in (4, 64):
        for problem, layout in (
            (coupled(), blocks(coupled(), points, intervals)),
            (chained(), stages(chained(), points, intervals, boundary=True, integrated=True)),
        ):
            program = collocation_program(problem, points, layout, upper=layout.stages is None)
            counts.append({name: function.n_instructions() for name, function in program.functions.items()})
    assert counts[:2] == counts[2:]


class TestAgreement:
    """IPOPT and FATROP, on the same mesh."""

    @pytest.mark.parametrize(
        ("options", "limits", "relative"),
        [
            ({}, None, 1e-9),
            ({"scheme": "legendre"}, None, 1e-9),
            ({"end": "law"}, None, 1e-9),
            ({"end": "periodic", "winding": 0}, None, 1e-9),
            # One lap may begin anywhere on its circle: a family of optima that only the mesh tells apart.
            ({"end": "periodic", "winding": 0, "start": "free"}, None, 1e-6),
            # With inequalities FATROP stops at a larger barrier parameter.
            ({}, Limits(torque=1.1), 1e-7),
            ({}, Limits(torque=0.9), 1e-6),
            ({}, Limits(wheel_power=8.0), 1e-7),
        ],
        ids=["free", "legendre", "law", "periodic", "free start", "1.1 N m", "0.9 N m", "8 W"],
    )
    def test_cost_and_heading(self, options: dict[str, object], limits: Limits | None, relative: float) -> None:
        task = paper_task(limits=limits) if limits else paper_task()
        player = Collocation(objective="torque_squared", **options)
        formulation = player.posed(task, options.get("winding"))
        assert formulation is not None
        edges, rotation = player.first_mesh(task), starts_of(task, 1, formulation.settings.ends.turn)[0].rotation
        costs, headings = [], []
        for solver in ("ipopt", "fatrop"):
            options_of = SolverOptions(solver=solver)
            transcription = Transcription(
                formulation.problem(), len(edges) - 1, player.degree, player.scheme, options_of
            )
            guess = formulation.guess(transcription, edges, rotation)
            outcome = transcription.solve(formulation.numbers(transcription, edges), guess)
            assert outcome.status is Status.OK, outcome.message
            assert outcome.statistics["solver"] == solver
            costs.append(outcome.cost)
            free = options.get("start") == "free"
            headings.append(0.0 if free else outcome.nodes.edges[0, -1])
        assert costs[1] == pytest.approx(costs[0], rel=relative)
        assert headings[1] == pytest.approx(headings[0], abs=1e-5)

    def test_through_the_whole_search(self) -> None:
        # Each on its own mesh in the end: to the tolerance that was asked for.
        task, costs = paper_task(limits=Limits(torque=1.1)), []
        for solver in ("ipopt", "fatrop"):
            solution = Collocation(objective="torque_squared", solver=solver, tolerance=1e-5, starts=1).solve(task)
            assert {r["solver"] for r in solution.statistics["rounds"]} == {solver}
            costs.append(judge(task, solution).measures["torque_squared_N2m2s"])
        assert costs[1] == pytest.approx(costs[0], rel=1e-5)

    def test_min_work(self) -> None:
        task = paper_task()
        costs = [
            judge(task, Collocation(objective="work", solver=solver).solve(task)).measures["work_J"]
            for solver in ("ipopt", "fatrop")
        ]
        assert costs[1] == pytest.approx(costs[0], rel=1e-9)


def line(
    intervals: int, path: Bounds, end: float, solver: str, **options: float
) -> tuple[Transcription, Numbers, Nodes]:
    """x' = u, |u| as bounded, from 0 to `end` in unit time, least integral of u^2."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = Problem(
        state=x,
        control=u,
        data=ca.SX(0, 1),
        parameters=ca.SX(0, 1),
        start=ca.SX.sym("start"),
        end=ca.SX.sym("end"),
        rate=u,
        integrand=u**2,
        path=u,
    )
    transcription = Transcription(problem, intervals, 3, options=SolverOptions(solver=solver, **options))
    numbers = Numbers(
        edges=np.linspace(0, 1, intervals + 1),
        data=np.zeros((0, intervals, 3)),
        parameters=np.zeros(0),
        start=Bounds.fixed(np.zeros(1)),
        end=Bounds.fixed(np.array([end])),
        path=path,
    )
    zeros = Nodes(np.zeros((1, intervals + 1)), np.zeros((1, intervals, 3)), np.zeros((1, intervals, 3)))
    return transcription, numbers, zeros


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
class TestHowASolveCanEnd:
    """Each is a status with a reason."""

    def test_too_few_iterations(self, solver: str) -> None:
        player = Collocation(objective="torque_squared", solver=solver, iterations=2)
        record = judge(paper_task(), player.solve(paper_task()))
        assert record.status is Status.FAILED
        assert "used all its 2 iterations" in record.message

    def test_contradicting_limits_are_named(self, solver: str) -> None:
        task = paper_task(limits=Limits(torque=0.8))
        solution = Collocation(objective="torque_squared", solver=solver).solve(task)
        assert solution.status is Status.INFEASIBLE
        assert "wheel 3 torque needs" in solution.message
        assert "N m at t = " in solution.message

    def test_a_function_that_is_not_finite(self, solver: str) -> None:
        x, u = ca.SX.sym("x"), ca.SX.sym("u")
        ends = {"start": ca.SX.sym("start"), "end": ca.SX.sym("end")}
        empty = {"data": ca.SX(0, 1), "parameters": ca.SX(0, 1)}
        problem = Problem(state=x, control=u, rate=u, integrand=ca.sqrt(x - 5), **ends, **empty)
        transcription = Transcription(problem, 2, 2, options=SolverOptions(solver=solver))
        numbers = Numbers(
            edges=np.linspace(0, 1, 3),
            data=np.zeros((0, 2, 2)),
            parameters=np.zeros(0),
            start=Bounds.fixed(np.zeros(1)),
            end=Bounds.free(1),
        )
        guess = Nodes(np.zeros((1, 3)), np.zeros((1, 2, 2)), np.zeros((1, 2, 2)))
        outcome = transcription.solve(numbers, guess)
        assert outcome.status is Status.FAILED
        # The first Radau point of degree 2 is at a third of the interval.
        assert "not finite: the integrand at t = 0.1667 s" in outcome.message

    def test_a_restart_needs_fewer_iterations_and_no_multipliers(self, solver: str) -> None:
        bound = Bounds(lower=np.array([-1.0]), upper=np.array([1.0]))
        transcription, numbers, zeros = line(8, bound, 0.999, solver)
        assert not [key for key in transcription._solver(transcription._variant(bounded=True)).inputs if "lam" in key]
        cold = transcription.solve(numbers, zeros)
        warm = transcription.solve(numbers, cold.nodes, restart=True)
        assert cold.status is warm.status is Status.OK
        assert warm.cost == pytest.approx(0.999**2, rel=1e-6)
        assert warm.statistics["iterations"] < cold.statistics["iterations"]


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_too_little_time(solver: str) -> None:
    task = paper_task(limits=Limits(torque=1.1))
    solution = Collocation(objective="torque_squared", solver=solver, seconds=1e-4).solve(task)
    record = judge(task, solution)
    assert record.status is Status.FAILED
    assert "used all its time, 0.0001 s" in record.message


def test_ipopt_takes_over_where_fatrop_finds_no_step() -> None:
    # A wheel speed that the first guess is far above: FATROP gets stuck in its restoration phase.
    task, costs = paper_task(limits=Limits(wheel_speed=7.7)), []
    for solver in ("ipopt", "fatrop"):
        solution = Collocation(objective="torque_squared", solver=solver, tolerance=1e-4, starts=1).solve(task)
        record = judge(task, solution)
        assert record.status is Status.OK, record.message
        costs.append(record.measures["torque_squared_N2m2s"])
        assert ("1 of " in record.message and "solves by ipopt: fatrop gave up" in record.message) is (
            solver == "fatrop"
        )
    assert costs[1] == pytest.approx(costs[0], rel=1e-4)


def test_torques_that_are_constant_in_each_interval() -> None:
    # The conditions that hold a control constant are rows of FATROP's stages, too.
    task = paper_task(duration=1.0)
    player = Collocation(objective="torque_squared", keep="ends", control="constant", intervals=8, degree=3)
    formulation = player.posed(task)
    assert formulation is not None
    edges, rotation, costs = player.first_mesh(task), starts_of(task, 1, None)[0].rotation, []
    for solver in ("ipopt", "fatrop"):
        transcription = Transcription(formulation.problem(), 8, 3, options=SolverOptions(solver=solver))
        guess = formulation.guess(transcription, edges, rotation)
        outcome = transcription.solve(formulation.numbers(transcription, edges), guess)
        assert outcome.status is Status.OK, outcome.message
        assert outcome.statistics["solver"] == solver
        torque = outcome.nodes.control[:4]
        np.testing.assert_allclose(torque, torque[:, :, :1].repeat(3, axis=2), atol=1e-9)
        costs.append(outcome.cost)
    assert costs[1] == pytest.approx(costs[0], rel=1e-7)


@pytest.mark.parametrize(
    "options",
    [{"solver": "ipopt2"}, {"linear_solver": "ma99"}, {"tolerance": 0.0}, {"iterations": -1}, {"barrier": -1}],
)
def test_options_are_checked_before_they_reach_a_solver(options: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(options))):
        SolverOptions(**options)
