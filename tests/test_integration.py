"""The integrator: order, agreement of its two ways to make a step, an independent reference, pieces and failures."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from occ.integration import CompiledStep, IntegrationError, PythonStep, Settings, Step, integrate

Problem = tuple[Callable[[ca.SX, ca.SX], list[ca.SX]], list[float], float]
"""f, x(0) and T."""
PROBLEMS: dict[str, Problem] = {
    "pendulum": (lambda t, x: [x[1], -ca.sin(x[0])], [2.0, 0.1], 12.0),
    "Volterra": (lambda t, x: [x[0] * (1.5 - x[1]), x[1] * (x[0] - 3)], [10.0, 5.0], 6.0),
    "forced": (lambda t, x: [x[1], -x[0] + ca.cos(1.3 * t) - 0.2 * x[1]], [0.0, 0.0], 20.0),
    "stiff": (lambda t, x: [-30 * (x[0] - ca.cos(t))], [0.0], 3.0),
}


def steps_of(problem: Problem, way: str, tolerance: float) -> Step:
    right, start, _ = problem
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", len(start)), ca.SX.sym("p", 0)
    rate = ca.Function("rate", [t, x, p], [ca.vertcat(*right(t, x))])
    if way == "compiled":
        return CompiledStep(rate, tolerance)
    return PythonStep(lambda t, x: np.array(rate(t, x, np.zeros(0)))[:, 0], tolerance)


def run(problem: Problem, way: str, tolerance: float, edges: np.ndarray | None = None, longest: float = 1.0):
    _, start, end = problem
    settings = Settings(longest=longest, largest=np.full(len(start), 1e6))
    edges = np.array([0.0, end]) if edges is None else edges
    return integrate(steps_of(problem, way, tolerance), edges, np.array(start), settings, lambda k, x: None)


@pytest.mark.parametrize("name", PROBLEMS)
class TestMotions:
    """Against multistep methods, which share nothing with ours."""

    def test_both_ways_agree_with_an_independent_method(self, name: str) -> None:
        problem = PROBLEMS[name]
        right, start, end = problem
        t, x = ca.SX.sym("t"), ca.SX.sym("x", len(start))
        f = ca.Function("f", [t, x], [ca.vertcat(*right(t, x))])
        times = np.linspace(0.0, end, 57)
        reference = solve_ivp(
            lambda t, x: np.array(f(t, x))[:, 0], (0, end), start, method="LSODA", rtol=1e-12, atol=1e-13, t_eval=times
        ).y
        compiled, python = (run(problem, way, 1e-12) for way in ("compiled", "python"))
        np.testing.assert_allclose(compiled(times), reference, rtol=0, atol=3e-9)
        np.testing.assert_allclose(compiled(times), python(times), rtol=0, atol=3e-12)
        assert len(compiled.edges) == len(python.edges)

    def test_the_error_falls_with_the_tolerance(self, name: str) -> None:
        end = PROBLEMS[name][2]
        times = np.linspace(0.0, end, 301)
        best = run(PROBLEMS[name], "compiled", 1e-14, longest=0.02)(times)
        errors = [np.abs(run(PROBLEMS[name], "compiled", tol)(times) - best).max() for tol in (1e-6, 1e-9, 1e-12)]
        assert errors[0] > errors[1] > errors[2]
        assert errors[2] < 3e-10

    def test_pieces_change_nothing_where_nothing_jumps(self, name: str) -> None:
        end = PROBLEMS[name][2]
        edges = np.array([0.0, 1e-7, 0.3, 0.31, 1.7, end - 1e-9, end])
        times = np.linspace(0.0, end, 57)
        pieces, whole = (run(PROBLEMS[name], "compiled", 1e-13, e) for e in (edges, None))
        np.testing.assert_allclose(pieces(times), whole(times), rtol=0, atol=3e-10)
        assert np.isin(edges, pieces.edges).all()


@pytest.mark.parametrize("way", ["compiled", "python"])
def test_order_eight_at_the_ends_and_seven_between(way: str) -> None:
    """Equal steps: a tolerance that lets everything pass, and the longest step."""
    problem = PROBLEMS["pendulum"]
    times = np.linspace(0.0, problem[2], 997)
    exact = run(problem, "compiled", 1e-14, longest=0.02)
    errors = []
    for steps in (24, 48):
        edges = np.linspace(0.0, problem[2], steps + 1)
        found = run(problem, way, 1e3, edges, longest=100.0)
        assert len(found.first) == steps
        errors.append((np.abs(found.last - exact.last).max(), np.abs(found(times) - exact(times)).max()))
    at_end, between = np.log2(np.array(errors[0]) / np.array(errors[1]))
    assert 7.3 < at_end < 9.5
    assert 6.5 < between < 9.0


@pytest.mark.parametrize("way", ["compiled", "python"])
class TestFailures:
    """Said with the time; nothing is thrown by what a trial step meets."""

    def test_a_state_that_grows_beyond_all_bounds(self, way: str) -> None:
        with pytest.raises(IntegrationError, match=r"leaves every physical range at t = 1[34]\.") as caught:
            run((lambda t, x: [x[0]], [1.0], 20.0), way, 1e-10)
        assert caught.value.t == pytest.approx(np.log(1e6), abs=1.0)

    def test_a_pole(self, way: str) -> None:
        with pytest.raises(IntegrationError, match=r"at t = (0\.99|1\b)"):
            run((lambda t, x: [x[0] ** 2], [1.0], 2.0), way, 1e-10)

    def test_no_number_at_the_start(self, way: str) -> None:
        with pytest.raises(IntegrationError, match="at t = 0 s"):
            run((lambda t, x: [ca.sqrt(x[0] - 1)], [0.0], 2.0), way, 1e-10)

    def test_no_number_later(self, way: str) -> None:
        with pytest.raises(IntegrationError, match=r"at t = 0\.[45]"):
            run((lambda t, x: [-1 - 1e-9 * ca.sqrt(x[0])], [0.5], 2.0), way, 1e-10)


def test_what_is_told_before_a_piece_changes_the_equation() -> None:
    """x' = p with p = 1, -2, 3 on three pieces."""
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", 1), ca.SX.sym("p", 1)
    step = CompiledStep(ca.Function("rate", [t, x, p], [p]), 1e-12)
    seen = []

    def enter(k: int, x: np.ndarray) -> None:
        seen.append(float(x[0]))
        step.parameters([(1.0, -2.0, 3.0)[k]])

    edges = np.array([0.0, 0.5, 0.75, 2.0])
    motion = integrate(step, edges, np.zeros(1), Settings(longest=1.0, largest=np.ones(1) * 10), enter)
    np.testing.assert_allclose(seen, [0.0, 0.5, 0.0], atol=1e-15)
    np.testing.assert_allclose(motion(np.array([0.25, 0.6, 1.0, 2.0]))[0], [0.25, 0.3, 0.75, 3.75], atol=1e-14)


def test_the_polynomials_at_the_same_places_of_all_steps() -> None:
    steps = run(PROBLEMS["forced"], "compiled", 1e-9)
    places = np.array([0.0, 0.3, 0.77])
    times = (steps.edges[:-1, None] + np.diff(steps.edges)[:, None] * places).ravel()
    np.testing.assert_allclose(steps.on_each(places), steps(times), rtol=0, atol=1e-14)
