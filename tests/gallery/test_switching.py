"""Costates and switching functions from the solver's multipliers, against closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from occ.errors import Status
from occ.optimal.problem import Bounds
from occ.optimal.solvers import SolverOptions
from occ.optimal.switching import switching
from tests.gallery import problems as gallery
from tests.gallery.problems import Posed, at, posed

SOLVERS = [SolverOptions(solver="ipopt"), SolverOptions(solver="fatrop")]
by_both_solvers = pytest.mark.parametrize("options", SOLVERS, ids=lambda options: options.solver)


def regulator(horizon: float = 2.0) -> Posed:
    """x' = sin u, least integral of (x^2 + sin^2 u) / 2, free end: p = x(0) sinh(T - t) / cosh T.

    The linear regulator x' = v in other clothes: p = tanh(T - t) x (Bryson and Ho, section 5.2).
    """
    problem = posed(1, 1, lambda x, u: {"rate": ca.sin(u), "integrand": (x**2 + ca.sin(u) ** 2) / 2})
    return Posed(problem, horizon, at(0.5), Bounds.free(1), [0.5], [0.2], [0.0])


@pytest.mark.parametrize(("degree", "options"), [(2, SOLVERS[0]), (3, SOLVERS[1])], ids=["ipopt-2", "fatrop-3"])
@pytest.mark.parametrize(("scheme", "shift"), [("radau", 0), ("legendre", 1)])
def test_costates_have_the_order_of_their_points(scheme: str, shift: int, degree: int, options: SolverOptions) -> None:
    problem, errors = regulator(), []
    for intervals in (8, 16, 32):
        transcription, numbers, outcome = problem.solve(problem.mesh(intervals), degree, scheme, options)
        assert outcome.costates is not None
        t = transcription.node_times(numbers.edges)
        errors.append(np.abs(outcome.costates[0] - 0.5 * np.sinh(2.0 - t) / np.cosh(2.0)).max())
        # No bound is active: phi vanishes by itself.
        found = switching(problem.problem, outcome.nodes, numbers, outcome.costates)
        assert np.abs(found.values).max() < 1e-7
    assert np.log2(errors[1] / errors[2]) == pytest.approx(degree + shift, abs=0.25)


@by_both_solvers
def test_of_the_least_time_of_a_double_integrator(options: SolverOptions) -> None:
    # Over s = t / T: p_1 = -2 / (a T), p_2 = 2 (s - 1/2) / a, phi = T p_2.
    distance, limit = 2.0, 0.5
    problem = gallery.bang_bang(distance, limit)
    transcription, numbers, outcome = problem.solve(problem.mesh(8), 3, options=options)
    assert outcome.status is Status.OK
    assert outcome.costates is not None
    time, s = 2 * np.sqrt(distance / limit), transcription.node_times(numbers.edges).ravel()
    np.testing.assert_allclose(outcome.costates[0], -2 / (limit * time), rtol=1e-5)
    phi = switching(problem.problem, outcome.nodes, numbers, outcome.costates).values[0].ravel()
    slope, zero = np.polynomial.Polynomial.fit(s, phi, 1).convert().coef[::-1]
    np.testing.assert_allclose(phi, slope * s + zero, atol=1e-5)
    assert slope == pytest.approx(2 * time / limit, rel=1e-5)
    # Where the control changes from one node to the next, phi is zero somewhere between these nodes.
    assert abs(-zero / slope - 0.5) <= np.diff(s).max()
    assert np.all(np.sign(phi) == -np.sign(outcome.nodes.control[0].ravel()))


def mixed(t: np.ndarray, first: float, second: float, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Costates (2, N) and phi (N,) of the catalyst under 1, level, 0: products of matrix exponentials."""

    def system(u: float) -> np.ndarray:
        return np.array([[-u, 10 * u], [u, -10 * u - (1 - u)]])

    arcs = [(0.0, first, system(1.0)), (first, second, system(level)), (second, 1.0, system(0.0))]
    costates, phi = [], []
    for time in t:
        state, costate = np.array([1.0, 0.0]), np.array([1.0, 1.0])
        for begin, end, matrix in arcs:
            state = expm(matrix * max(min(time, end) - begin, 0.0)) @ state
        for begin, end, matrix in arcs[::-1]:
            costate = expm(matrix.T * max(end - max(time, begin), 0.0)) @ costate
        costates.append(costate)
        phi.append(costate @ np.array([[-1.0, 10.0], [1.0, -9.0]]) @ state)
    return np.array(costates).T, np.array(phi)


@pytest.mark.parametrize("degree", [2, 3])
def test_of_a_singular_arc(degree: int) -> None:
    exact, arcs = gallery.catalyst_arcs()
    problem, errors = gallery.catalyst_mixing(list(arcs[:2])), []
    for intervals in (12, 24):
        transcription, numbers, outcome = problem.solve(problem.mesh(intervals), degree)
        assert outcome.cost == pytest.approx(exact, abs=1e-5)
        assert outcome.costates is not None
        costates, phi = mixed(transcription.node_times(numbers.edges).ravel(), *arcs)
        found = switching(problem.problem, outcome.nodes, numbers, outcome.costates)
        errors.append(
            [np.abs(outcome.costates.reshape(2, -1) - costates).max(), np.abs(found.values.ravel() - phi).max()]
        )
        third = intervals // 3
        bang, singular, off = np.split(found.values[0], [third, 2 * third])
        # u = 1 where phi < 0, u = 0 where phi > 0, and between them phi = 0.
        assert np.all(bang < 0.0)
        assert np.all(off > 0.0)
        assert np.abs(singular).max() < 1e-7 * np.abs(phi).max()
        # Kelley's condition, with its value from the closed form of the second derivative of phi.
        assert np.all(found.kelley[0, third : 2 * third] > 5.0)
    orders = np.log2(np.array(errors[0]) / errors[1])
    assert np.all(orders > degree - 0.6), orders


def test_kelleys_expression_of_a_double_integrator() -> None:
    # x'' = u, least integral of x^2 / 2: phi = p_2, phi'' = x_1 , d/du phi'' = 0; with x_2^2 / 2: phi'' = -u.
    for integrand, expected in ((lambda x: x[0] ** 2 / 2, 0.0), (lambda x: x[1] ** 2 / 2, 1.0)):
        problem = posed(2, 1, lambda x, u, g=integrand: {"rate": ca.vertcat(x[1], u), "integrand": g(x)})
        problem_of = Posed(
            problem, 1.0, at(1, 0), Bounds.free(2), [1, 0], [1, 0], [0], control=gallery.between([-1.0], [1.0])
        )
        _, numbers, outcome = problem_of.solve(problem_of.mesh(4), 3)
        assert outcome.costates is not None
        found = switching(problem, outcome.nodes, numbers, outcome.costates)
        np.testing.assert_allclose(found.kelley, expected, atol=1e-12)
