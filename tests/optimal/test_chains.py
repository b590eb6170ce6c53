"""Chains of integrators: what counts as one, and that the collocation equations are solved exactly."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from occ.optimal.chains import Chains, integrated
from occ.optimal.collocation import Collocation
from occ.optimal.mesh import scheme
from occ.optimal.problem import Problem
from occ.optimal.reduced import Reduced
from tests.tasks import paper_task

X, U, D, P = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("d"), ca.SX.sym("p")


def with_rate(*rate: ca.SX | float) -> Problem:
    start, end = ca.SX.sym("start", 2), ca.SX.sym("end", 2)
    return Problem(
        state=X, control=U, data=D, parameters=P, start=start, end=end, rate=ca.vertcat(*rate), integrand=ca.sumsqr(U)
    )


@pytest.mark.parametrize(
    ("rate", "powers"),
    [
        ((X[1], U[0]), [0, 1, 2, 0]),
        ((U[0], U[1]), [0, 0, 1, 1]),
        ((3 * U[0] - U[1], U[0]), [0, 0, 1, 1]),
        ((X[1] + U[0], 0), [0, 1, 1, 0]),
        ((0, 0), [0, 0, 0, 0]),
    ],
    ids=["two in a row", "two beside each other", "mixed", "with a constant", "constants"],
)
def test_powers_of_the_width(rate: tuple[ca.SX, ...], powers: list[int]) -> None:
    chains = Chains.of(with_rate(*rate))
    assert chains is not None
    assert chains.powers.tolist() == powers


@pytest.mark.parametrize(
    "rate",
    [
        (X[1], -ca.sin(X[0])),
        (X[1], P * U[0]),
        (X[1] + D, U[0]),
        (X[1], U[0] + 1),
        (X[1], -X[0]),
        (X[0], U[0]),
        (X[1] + U[0], U[0]),
    ],
    ids=["nonlinear", "by a parameter", "with data", "with an offset", "oscillator", "by itself", "no powers fit"],
)
def test_what_is_no_chain(rate: tuple[ca.SX, ...]) -> None:
    assert Chains.of(with_rate(*rate)) is None


def test_the_reduced_formulation_is_one() -> None:
    formulation = Collocation(objective="torque_squared").posed(paper_task())
    assert isinstance(formulation, Reduced)
    chains = Chains.of(formulation.problem())
    assert chains is not None
    assert chains.powers.tolist() == [0, 1, 2]


@pytest.mark.parametrize("name", ["radau", "legendre"])
@pytest.mark.parametrize("degree", [2, 3, 5])
def test_polynomial_controls_are_integrated_exactly(name: str, degree: int) -> None:
    # x'' = u: with u of degree d - 2 both states have degree d at most, which the collocation polynomial holds.
    chains = Chains.of(with_rate(X[1], U[0]))
    assert chains is not None
    points = scheme(name, degree)
    maps = integrated(chains, points)
    u = np.polynomial.Polynomial(np.arange(1.0, degree))
    rate = u.integ() + 0.3
    x = rate.integ() - 0.7
    edges = np.array([0.0, 0.5, 2.0])
    t = edges[:-1, None] + np.diff(edges)[:, None] * points.points
    at_edges, controls = np.array([x(edges), rate(edges)]), np.array([u(t), np.zeros_like(t)])
    y = np.concatenate([at_edges[:, :-1], controls.transpose(2, 0, 1).reshape(2 * degree, 2)])
    np.testing.assert_allclose(maps.states(y, np.diff(edges)), [x(t), rate(t)], atol=1e-12)
    # The end of the first interval, which is half as wide as the unit one.
    scaled = y[:, 0] * 0.5**maps.powers
    end = maps.end @ scaled / 0.5 ** np.array([0, 1])
    np.testing.assert_allclose(end, at_edges[:, 1], atol=1e-12)
