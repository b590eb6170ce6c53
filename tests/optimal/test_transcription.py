"""The transcription on problems with known answers: orders of convergence, parametric re-solves, failures."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from occ.errors import Status
from occ.model.presets import youbot
from occ.optimal.collocation import Collocation
from occ.optimal.error import estimate_error, fine_points
from occ.optimal.mesh import bisect, graded_mesh, scheme
from occ.optimal.problem import Bounds, Nodes, Numbers, Problem
from occ.optimal.solvers import SolverOptions
from occ.optimal.starts import starts_of
from occ.optimal.transcription import Outcome, Transcription
from occ.task import Limits
from tests.tasks import paper_task


def symbols(nx: int, nu: int, nd: int = 0, np_: int = 0) -> dict[str, ca.SX]:
    sizes = {"state": nx, "control": nu, "data": nd, "parameters": np_, "start": nx, "end": nx}
    return {name: ca.SX.sym(name, size) for name, size in sizes.items()}


def regulator() -> Problem:
    """min integral of x^2 + u^2, x' = u, x(0) = 1, J = tanh T (Riccati equation p' = p^2 - 1, p(T) = 0)."""
    s = symbols(1, 1)
    return Problem(**s, rate=s["control"], integrand=s["state"] ** 2 + s["control"] ** 2)


def pendulum() -> Problem:
    """A nonlinear one: min integral of u^2 with x_1' = x_2, x_2' = -sin x_1 + u."""
    s = symbols(2, 1)
    x, u = s["state"], s["control"]
    return Problem(**s, rate=ca.vertcat(x[1], -ca.sin(x[0]) + u), integrand=u**2)


def double_integrator() -> Problem:
    """min integral of u^2, x'' = u."""
    s = symbols(2, 1)
    return Problem(**s, rate=ca.vertcat(s["state"][1], s["control"]), integrand=s["control"] ** 2)


def zeros(problem: Problem, intervals: int, degree: int) -> Nodes:
    nx, nu = problem.state.numel(), problem.control.numel()
    return Nodes(np.zeros((nx, intervals + 1)), np.zeros((nx, intervals, degree)), np.zeros((nu, intervals, degree)))


def solve(
    problem: Problem,
    start: list[float],
    end: list[float] | None,
    mesh: np.ndarray,
    degree: int,
    name: str = "radau",
    options: SolverOptions | None = None,
) -> tuple[Transcription, Numbers, Outcome]:
    intervals = len(mesh) - 1
    transcription = Transcription(problem, intervals, degree, name, options)
    numbers = Numbers(
        edges=mesh,
        data=np.zeros((0, intervals, degree)),
        parameters=np.zeros(0),
        start=Bounds.fixed(np.array(start)),
        end=Bounds.free(len(start)) if end is None else Bounds.fixed(np.array(end)),
    )
    return transcription, numbers, transcription.solve(numbers, zeros(problem, intervals, degree))


def observed_order(errors: np.ndarray, intervals: np.ndarray, floor: float) -> float:
    """Slope of log error against log N over the meshes whose error is above the rounding floor."""
    above = errors > floor
    assert above.sum() >= 3, f"too few meshes above the floor: {errors}"
    return -float(np.polyfit(np.log(intervals[above]), np.log(errors[above]), 1)[0])


@pytest.mark.parametrize("degree", [2, 3, 4])
@pytest.mark.parametrize(("name", "shift"), [("radau", -1), ("legendre", 0)])
class TestOrder:
    """Hairer and Wanner II, IV.5: order 2 d - 1 (Radau IIA) and 2 d (Gauss)."""

    def test_of_the_cost_of_a_regulator(self, name: str, shift: int, degree: int) -> None:
        intervals = np.array([4, 6, 8, 12] if degree > 2 else [8, 16, 32, 64])
        costs = [solve(regulator(), [1.0], None, np.linspace(0, 4, n + 1), degree, name)[2].cost for n in intervals]
        errors = np.abs(np.array(costs) - np.tanh(4.0))
        assert observed_order(errors, intervals, 1e-13) == pytest.approx(2 * degree + shift, abs=0.3)

    def test_of_the_end_state_of_a_nonlinear_equation(self, name: str, shift: int, degree: int) -> None:
        # With the control fixed to zero the transcription is a plain collocation method: x'' = -sin x.
        intervals = np.array([4, 8, 16, 32] if degree < 4 else [2, 4, 8, 16])
        errors = []
        for n in intervals:
            transcription = Transcription(pendulum(), int(n), degree, name)
            numbers = Numbers(
                edges=np.linspace(0, 2, n + 1),
                data=np.zeros((0, n, degree)),
                parameters=np.zeros(0),
                start=Bounds.fixed(np.array([1.0, 0.0])),
                end=Bounds.free(2),
                control=Bounds.fixed(np.zeros(1)),
            )
            outcome = transcription.solve(numbers, zeros(pendulum(), int(n), degree))
            assert outcome.status is Status.OK
            errors.append(abs(outcome.nodes.edges[0, -1] - pendulum_angle(2.0)))
        assert observed_order(np.array(errors), intervals, 1e-12) == pytest.approx(2 * degree + shift, abs=0.3)


def pendulum_angle(t: float) -> float:
    """x'' = -sin x, x(0) = 1, x'(0) = 0: sin(x/2) = k sn(K + t, k), k = sin(1/2); Landau and Lifshitz I, 11."""
    from scipy.special import ellipj, ellipk

    k = np.sin(0.5)
    sn, _, _, _ = ellipj(ellipk(k**2) + t, k**2)
    return float(2 * np.arcsin(k * sn))


class TestDoubleIntegrator:
    """min integral of u^2 from rest to rest over unit time and distance: J = 12, x = 3 t^2 - 2 t^3."""

    @pytest.mark.parametrize("name", ["radau", "legendre"])
    def test_is_exact_for_a_cubic(self, name: str) -> None:
        transcription, _, outcome = solve(double_integrator(), [0, 0], [1, 0], np.linspace(0, 1, 4), 3, name)
        assert outcome.cost == pytest.approx(12.0, rel=1e-10)
        s = np.linspace(0, 1, 7)
        state, _, control = transcription.interpolate(outcome.nodes, s)
        t = (np.arange(3)[:, None] + s) / 3
        np.testing.assert_allclose(state[0], 3 * t**2 - 2 * t**3, atol=1e-9)
        np.testing.assert_allclose(control[0], 6 - 12 * t, atol=1e-7)


def refuse_to_build(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on no solver and no function is made."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("built again")

    monkeypatch.setattr(ca, "nlpsol", refuse)
    monkeypatch.setattr(ca, "Function", refuse)


class TestParameters:
    """One structure, many numbers."""

    @pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
    @pytest.mark.parametrize("limited", [False, True])
    def test_another_circle_point_platform_or_limit_builds_nothing(
        self, solver: str, limited: bool, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        task = paper_task(limits=Limits(torque=1.2 if limited else None))
        motion = task.motion
        others = [
            replace(task, motion=replace(motion, radius=0.65)),
            replace(task, motion=replace(motion, rate=-0.35)),
            replace(task, point=(0.35, 0.1)),
            replace(task, platform=youbot(friction_scale=1.1)),
            replace(task, limits=Limits(torque=1.15)) if limited else task,
        ]
        player, costs = Collocation(objective="torque_squared", solver=solver), []
        formulation = player.posed(task)
        assert formulation is not None
        transcription = Transcription(formulation.problem(), 8, 4, options=SolverOptions(solver=solver))
        edges, rotation = graded_mesh(8, 0.02) * task.duration, starts_of(task, 1, None)[0].rotation
        for k, other in enumerate([task, *others]):
            formulation = player.posed(other)
            assert formulation is not None
            guess = formulation.guess(transcription, edges, rotation)
            outcome = transcription.solve(formulation.numbers(transcription, edges), guess)
            assert outcome.status is Status.OK, outcome.message
            costs.append(outcome.cost)
            if k == 0:
                refuse_to_build(monkeypatch)
        assert len(set(costs)) == (6 if limited else 5)

    @pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
    def test_a_resolve_with_other_numbers_builds_nothing(self, solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
        s = symbols(1, 1, np_=1)
        problem = Problem(**s, rate=s["control"], integrand=s["parameters"] * s["state"] ** 2 + s["control"] ** 2)
        transcription = Transcription(problem, 6, 4, options=SolverOptions(solver=solver))
        refuse_to_build(monkeypatch)
        for q, duration, start in ((1.0, 1.0, 1.0), (4.0, 2.0, -0.5), (0.25, 0.5, 3.0)):
            numbers = Numbers(
                edges=graded_mesh(6, 0.05) * duration,
                data=np.zeros((0, 6, 4)),
                parameters=np.array([q]),
                start=Bounds.fixed(np.array([start])),
                end=Bounds.free(1),
            )
            outcome = transcription.solve(numbers, zeros(problem, 6, 4))
            # Riccati: J = sqrt(q) tanh(sqrt(q) T) x(0)^2.
            expected = np.sqrt(q) * np.tanh(np.sqrt(q) * duration) * start**2
            assert outcome.cost == pytest.approx(expected, rel=1e-6)

    def test_data_at_the_nodes_enter_as_functions_of_time(self) -> None:
        # x' = u + d(t), min integral of u^2 from 0 to 1 in unit time: u = 1 - mean of d.
        s = symbols(1, 1, nd=1)
        problem = Problem(**s, rate=s["control"] + s["data"], integrand=s["control"] ** 2)
        transcription = Transcription(problem, 4, 5)
        edges = np.linspace(0, 1, 5)
        numbers = Numbers(
            edges=edges,
            data=np.cos(3 * transcription.node_times(edges))[None],
            parameters=np.zeros(0),
            start=Bounds.fixed(np.zeros(1)),
            end=Bounds.fixed(np.ones(1)),
        )
        outcome = transcription.solve(numbers, zeros(problem, 4, 5))
        assert outcome.cost == pytest.approx((1 - np.sin(3) / 3) ** 2, rel=1e-9)

    def test_terminal_cost_path_and_boundary_conditions(self) -> None:
        # min (x(1) - 2)^2 with x' = u, u <= 1 as a path condition, x(0) + x(1) = 1: x(0) = 0, x(1) = 1.
        s = symbols(1, 1)
        problem = Problem(
            **s,
            rate=s["control"],
            integrand=ca.SX(0),
            terminal=(s["end"] - 2) ** 2,
            path=s["control"],
            boundary=s["start"] + s["end"],
        )
        transcription = Transcription(problem, 3, 2)
        numbers = Numbers(
            edges=np.linspace(0, 1, 4),
            data=np.zeros((0, 3, 2)),
            parameters=np.zeros(0),
            start=Bounds.free(1),
            end=Bounds.free(1),
            path=Bounds(lower=np.array([-np.inf]), upper=np.array([1.0])),
            boundary=Bounds.fixed(np.array([1.0])),
        )
        outcome = transcription.solve(numbers, zeros(problem, 3, 2))
        assert outcome.cost == pytest.approx(1.0, abs=1e-6)
        assert outcome.nodes.edges[0, [0, -1]] == pytest.approx([0.0, 1.0], abs=1e-6)


class TestErrorEstimate:
    """The error between nodes, against the truth."""

    @pytest.mark.parametrize("name", ["radau", "legendre"])
    def test_bounds_the_true_error_between_nodes_and_falls_with_the_mesh(self, name: str) -> None:
        # x' = u with u = -tanh(1 - t) x for the regulator: x = cosh(1 - t) / cosh 1.
        totals = []
        for n in (2, 4, 8):
            transcription, numbers, outcome = solve(regulator(), [1.0], None, np.linspace(0, 1, n + 1), 3, name)
            s, _ = fine_points(3)
            estimate = estimate_error(transcription, outcome.nodes, numbers, np.zeros((0, n, len(s))), outcome.cost)
            dense = np.linspace(0, 1, 41)
            state, _, _ = transcription.interpolate(outcome.nodes, dense)
            # The estimate is of the state that the claimed control produces, not of the optimum.
            true = np.abs(self.integral_of_control(transcription, outcome, dense, numbers) - state[0]).max()
            assert true <= 1.2 * estimate.state.sum() + 1e-12
            assert estimate.state.sum() <= 60 * true + 1e-12
            totals.append(estimate.total)
        assert totals[0] > 4 * totals[1] > 16 * totals[2]

    @staticmethod
    def integral_of_control(
        transcription: Transcription, outcome: Outcome, dense: np.ndarray, numbers: Numbers
    ) -> np.ndarray:
        x, w = np.polynomial.legendre.leggauss(8)
        result, begin = [], 1.0
        for k, h in enumerate(np.diff(numbers.edges)):
            row = []
            for end in dense:
                _, _, u = transcription.interpolate(outcome.nodes, end * (x + 1) / 2)
                row.append(begin + h * end / 2 * float(u[0, k] @ w))
            result.append(row)
            begin = row[-1]
        return np.array(result)


class TestFailure:
    """A numerical failure is a value with a reason."""

    @pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
    def test_contradicting_constraints_are_infeasible(self, solver: str) -> None:
        s = symbols(1, 1)
        problem = Problem(**s, rate=s["control"], integrand=s["control"] ** 2, path=s["control"])
        transcription = Transcription(problem, 4, 3, options=SolverOptions(solver=solver))
        numbers = Numbers(
            edges=np.linspace(0, 1, 5),
            data=np.zeros((0, 4, 3)),
            parameters=np.zeros(0),
            start=Bounds.fixed(np.zeros(1)),
            end=Bounds.fixed(np.array([2.0])),
            path=Bounds(lower=np.array([-1.0]), upper=np.array([1.0])),
        )
        outcome = transcription.solve(numbers, zeros(problem, 4, 3))
        assert outcome.status is Status.INFEASIBLE
        assert "contradict" in outcome.message

    @pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
    def test_too_few_iterations(self, solver: str) -> None:
        options = SolverOptions(solver=solver, iterations=1)
        _, _, outcome = solve(pendulum(), [0, 0], [3, 0], np.linspace(0, 2, 5), 3, options=options)
        assert outcome.status is Status.FAILED
        assert outcome.message == "the solver used all its 1 iterations"

    @pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
    def test_too_little_time(self, solver: str) -> None:
        options = SolverOptions(solver=solver, seconds=1e-6)
        _, _, outcome = solve(pendulum(), [0, 0], [3, 0], np.linspace(0, 2, 5), 3, options=options)
        assert outcome.status is Status.FAILED
        assert outcome.message == "the solver used all its time, 1e-06 s"

    def test_more_iterations_than_fatrop_is_worth_go_to_ipopt(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("occ.optimal.transcription.PATIENCE", 2)
        options = SolverOptions(solver="fatrop")
        _, _, outcome = solve(pendulum(), [0, 0], [3, 0], np.linspace(0, 2, 5), 3, options=options)
        _, _, expected = solve(pendulum(), [0, 0], [3, 0], np.linspace(0, 2, 5), 3)
        assert outcome.status is Status.OK
        assert outcome.cost == expected.cost
        assert outcome.statistics["solver"] == "ipopt"
        assert outcome.statistics["instead"] == "fatrop gave up after 2 iterations"

    @pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
    def test_a_function_that_is_not_finite(self, solver: str) -> None:
        s = symbols(1, 1)
        problem = Problem(**s, rate=s["control"], integrand=ca.sqrt(s["state"] - 5))
        options = SolverOptions(solver=solver)
        _, _, outcome = solve(problem, [0.0], None, np.linspace(0, 1, 3), 2, options=options)
        assert outcome.status is Status.FAILED
        assert "not finite: the integrand at t = 0.1667 s" in outcome.message


class TestMesh:
    """Points, weights and edges."""

    @pytest.mark.parametrize("name", ["radau", "legendre"])
    @pytest.mark.parametrize("degree", [2, 3, 5, 8, 12])
    def test_weights_integrate_polynomials_to_the_schemes_order(self, name: str, degree: int) -> None:
        s = scheme(name, degree)
        for power in range(2 * degree - (1 if name == "radau" else 0)):
            assert s.weights @ s.points**power == pytest.approx(1 / (power + 1), rel=1e-11)

    @pytest.mark.parametrize("name", ["radau", "legendre"])
    def test_derivative_matrix_differentiates_polynomials(self, name: str) -> None:
        s = scheme(name, 4)
        for power in range(1, 5):
            np.testing.assert_allclose(s.nodes**power @ s.derivative, power * s.points ** (power - 1), atol=1e-12)
            assert s.nodes**power @ s.end == pytest.approx(1.0)

    @pytest.mark.parametrize(("intervals", "first"), [(8, 0.02), (9, 1e-3), (20, 1e-6), (5, 0.5), (2, 1e-3)])
    def test_graded_mesh(self, intervals: int, first: float) -> None:
        edges = graded_mesh(intervals, first)
        widths = np.diff(edges)
        assert len(widths) == intervals
        assert edges[[0, -1]] == pytest.approx([0.0, 1.0], abs=0)
        assert np.all(widths > 0)
        np.testing.assert_allclose(widths, widths[::-1], rtol=1e-6)
        if intervals >= 4 and first < 1 / intervals:
            assert widths[0] == pytest.approx(first, rel=1e-6)

    def test_bisect(self) -> None:
        edges = bisect(np.array([0.0, 1.0, 3.0]), np.array([False, True]))
        assert edges.tolist() == [0.0, 1.0, 2.0, 3.0]
