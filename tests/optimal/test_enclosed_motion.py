"""Proven distances of the true motion from polynomials: never too small, and sharp."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.control import SymbolicControl
from occ.model.presets import youbot
from occ.optimal import driven, enclosed_motion
from occ.optimal.driven import DrivenMotion
from occ.optimal.enclosed_motion import (
    RESOLVED,
    EnclosedVelocity,
    Matrices,
    enclosed_pose,
    enclosed_velocity,
    panel_counts,
)
from occ.optimal.full import open_loop_torque
from occ.optimal.powers import (
    Panels,
    chebyshev_coefficients,
    cut,
    derivative,
    integral,
    integral_slack,
    size_of,
    through,
    values_at,
)
from occ.trajectory import PiecewisePolynomial
from tests.tasks import paper_task

NODES = np.array([0.1, 0.5, 0.9])


def torques(seed: int, intervals: int = 12, duration: float = 3.0, size: float = 1.0) -> PiecewisePolynomial:
    """Polynomials that jump from one interval to the next."""
    values = np.random.default_rng(seed).uniform(-size, size, (4, intervals, len(NODES)))
    return PiecewisePolynomial(np.linspace(0.0, duration, intervals + 1), NODES, values)


def motion_of(signal: PiecewisePolynomial, tolerance: float, monkeypatch: pytest.MonkeyPatch) -> DrivenMotion:
    monkeypatch.setattr(driven, "TOLERANCE", tolerance)
    task = paper_task(float(signal.edges[-1]))
    start = np.array([0.1, -0.2, 0.7, 0.2, -0.1, 0.4])
    return DrivenMotion(task, SymbolicControl(open_loop_torque(4), np.zeros(0), signal), start)


def panels_of(signal: PiecewisePolynomial, matrices: Matrices, motion: DrivenMotion) -> Panels:
    return Panels.of(signal.edges, signal.powers, panel_counts(matrices, motion, signal.edges))


def exactly(powers: np.ndarray, x: Fraction) -> Fraction:
    """The value of one polynomial without rounding."""
    return sum((Fraction(c) * x**k for k, c in enumerate(powers.tolist())), Fraction(0))


class TestPolynomials:
    """Against NumPy's."""

    x = np.linspace(-1.0, 1.0, 41)
    edges = np.array([0.0, 0.4, 1.0])
    powers = np.random.default_rng(1).normal(size=(2, 2, 5))

    def test_derivative_is_the_inverse_of_the_integral(self) -> None:
        start = np.array([0.3, -0.7])
        whole = integral(self.powers, self.edges, start)
        np.testing.assert_allclose(derivative(whole, self.edges), self.powers, atol=1e-13)
        ends = values_at(whole, np.array([-1.0, 1.0]))
        np.testing.assert_allclose(ends[:, 0, 0], start, atol=1e-14)
        np.testing.assert_allclose(ends[:, 1, 0], ends[:, 0, 1], atol=1e-14)
        exact = np.polynomial.Polynomial(self.powers[0, 0], domain=[0.0, 0.4]).integ(lbnd=0.0, k=0.3)
        np.testing.assert_allclose(ends[0, 0, 1], exact(0.4), atol=1e-14)

    def test_panels_are_the_same_polynomials(self) -> None:
        found = values_at(cut(self.powers, 3), np.array([-1.0, 0.2, 1.0])).reshape(2, 2, 9)
        places = (np.array([-1.0, 0.2, 1.0]) + np.array([[-2.0], [0.0], [2.0]])) / 3
        np.testing.assert_allclose(found, values_at(self.powers, places.ravel()), atol=1e-13)

    def test_through_values(self) -> None:
        x = -np.cos(np.pi * np.arange(21) / 20)
        values = np.stack([np.exp(x), np.sin(3 * x)])[None]
        found = values_at(through(values), self.x)
        np.testing.assert_allclose(found, np.stack([np.exp(self.x), np.sin(3 * self.x)])[None], atol=1e-12)
        np.testing.assert_allclose(
            np.polynomial.chebyshev.chebval(self.x, chebyshev_coefficients(values)[0, 0]), np.exp(self.x), atol=1e-13
        )

    def test_sizes_are_bounds(self) -> None:
        assert np.all(np.abs(values_at(self.powers, self.x)).max(axis=2) <= size_of(self.powers))
        slack = integral_slack(integral(self.powers, self.edges, np.zeros(2)), self.edges, 1.0)
        np.testing.assert_allclose(slack, [[0.4, 1.0]] * 2, rtol=1e-9)

    def test_rounding_of_integrals(self) -> None:
        # Against sums of fractions; many intervals gather rounding, and no more than is allowed for.
        rng = np.random.default_rng(3)
        edges = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 1.0, 60))])
        powers = rng.normal(size=(1, 60, 6)) + 1.0
        found = integral(powers, edges, np.array([5.0]))
        slack, value, most = integral_slack(found, edges), Fraction(5), Fraction(0)
        for k in range(60):
            half = (Fraction(edges[k + 1]) - Fraction(edges[k])) / 2
            errors = []
            for x in (Fraction(-1), Fraction(1, 3), Fraction(1)):
                exact = value + half * sum(
                    Fraction(c) * (x ** (j + 1) - (-1) ** (j + 1)) / (j + 1)
                    for j, c in enumerate(powers[0, k].tolist())
                )
                errors.append(abs(exactly(found[0, k], x) - exact))
            assert max(errors) <= slack[0, k]
            value, most = exact, max(most, *errors)
        assert most > 1e-15
        assert slack.max() < 2e-11

    def test_panels_of_intervals(self) -> None:
        edges, counts = np.array([0.0, 0.1, 0.7, 30.1]), np.array([3, 1, 7])
        powers = np.random.default_rng(2).normal(size=(2, 3, 4))
        panels = Panels.of(edges, powers, counts)
        np.testing.assert_array_equal(panels.first, [0, 3, 4])
        np.testing.assert_array_equal(panels.edges[[0, 3, 4, 11]], edges)
        assert np.all(panels.slack[:, 3] == 0.0)
        of = np.repeat(np.arange(3), counts)
        for panel, k in enumerate(of):
            begin, end = (Fraction(t) for t in panels.edges[panel : panel + 2].tolist())
            first, last = (Fraction(t) for t in edges[k : k + 2].tolist())
            for x in (Fraction(-1), Fraction(2, 7), Fraction(1)):
                # The same instant, by the panel's edges as they are rounded.
                s = 2 * ((begin + end) / 2 + x * (end - begin) / 2 - first) / (last - first) - 1
                for row in range(2):
                    error = abs(exactly(panels.powers[row, panel], x) - exactly(powers[row, k], s))
                    assert error <= panels.slack[row, panel]
        values = np.arange(11.0)[None]
        np.testing.assert_array_equal(panels.largest(values), [[2.0, 3.0, 10.0]])
        np.testing.assert_array_equal(panels.largest(-values), [[0.0, -3.0, -4.0]])
        assert panels.slack.max() < 1e-13
        assert panels.rows(1).powers.shape == (*panels.rows(1).slack.shape, 4)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_the_gyroscopic_force_does_no_work(velocity: list[float]) -> None:
    matrices, v = Matrices.of(paper_task().dynamics.coefficients), np.array(velocity)
    without = matrices._replace(friction=np.zeros((3, 3)))
    power = v @ without.balance(v, np.zeros(3), np.zeros(4))
    assert abs(power) <= 1e-12 * (1.0 + np.abs(v).max() ** 3 * 100)


@pytest.mark.parametrize(
    ("degree", "seed"),
    [(4, 0), (20, 0), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((7, 0), (4, 1), (20, 1)))],
)
def test_the_true_motion_is_within_the_distance(seed: int, degree: int, monkeypatch: pytest.MonkeyPatch) -> None:
    signal = torques(seed)
    true = motion_of(signal, 1e-13, monkeypatch)
    rough = motion_of(signal, 1e-6, monkeypatch)
    # A low degree makes errors that can be seen; the bound has to hold all the same.
    monkeypatch.setattr(enclosed_motion, "DEGREE", degree)
    enclosed_motion._integrals.cache_clear()
    task = rough.task
    matrices = Matrices.of(task.dynamics.coefficients)
    velocity = enclosed_velocity(matrices, rough, panels_of(signal, matrices, rough))
    pose = enclosed_pose(velocity, rough.start[:3], task.point)
    enclosed_motion._integrals.cache_clear()
    x = np.linspace(-1.0, 1.0, 41)[1:-1]
    middle, half = (signal.edges[1:] + signal.edges[:-1]) / 2, np.diff(signal.edges) / 2
    state = true((middle[:, None] + half[:, None] * x).ravel()).reshape(6, len(half), len(x))
    error = state[3:] - values_at(velocity.powers, x)
    sizes = np.sqrt(np.einsum("ink,ij,jnk->nk", error, matrices.inertia, error)).max(axis=1)
    rounding = 2e-12
    assert np.all(sizes <= velocity.distance + rounding)
    rows = np.concatenate([matrices.wheel_rates, np.eye(3)])
    assert np.all(np.abs(np.tensordot(rows, error, 1)).max(axis=2) <= velocity.within(rows) + 1e-10)
    near = np.concatenate([values_at(pose.powers, x), values_at(velocity.powers, x)]).reshape(6, -1)
    distance = np.hypot(*(task.point_motion(near)[0] - task.point_motion(state.reshape(6, -1))[0]))
    assert np.all(distance.reshape(len(half), -1).max(axis=1) <= pose.point + rounding)
    # And no more than an order or so above the truth; in the position errors of both signs would cancel.
    assert velocity.distance.max() <= 30 * sizes.max() + 1e-9
    if degree == 20:
        # Nothing of the integrator's errors is left, neither inside the intervals nor as jumps between them.
        assert velocity.distance.max() < 1e-10
        assert pose.point.max() < 1e-9
    if degree == 4:
        assert sizes.max() > 1e-6


@pytest.mark.parametrize("duration", [0.02, 2.0, 40.0])
def test_against_a_closed_form(duration: float) -> None:
    # Straight ahead with mass centre at O: v = F / zeta + (v_0 - F / zeta) exp(-zeta t / m).
    task = replace(paper_task(duration), platform=youbot(mass_center=(0.0, 0.0)))
    matrices = Matrices.of(task.dynamics.coefficients)
    signal = PiecewisePolynomial(np.linspace(0.0, duration, 9), np.array([0.5]), np.full((4, 8, 1), 0.8))
    start = np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    motion = DrivenMotion(task, SymbolicControl(open_loop_torque(4), np.zeros(0), signal), start)
    found = enclosed_velocity(matrices, motion, panels_of(signal, matrices, motion))
    force = float((matrices.wheel_rates.T @ np.full(4, 0.8))[0])
    zeta, mass = matrices.friction[0, 0], matrices.inertia[0, 0]
    x = np.linspace(-1.0, 1.0, 21)
    t = (found.edges[:-1, None] + found.edges[1:, None]) / 2 + np.diff(found.edges)[:, None] / 2 * x
    exact = force / zeta + (0.1 - force / zeta) * np.exp(-zeta * t / mass)
    error = np.abs(values_at(found.powers, x)[0] - exact).max(axis=1)
    assert np.all(error <= found.within(np.eye(3)[:1])[0] + 1e-15)
    # Nothing but rounding is left in intervals of 2 ms and of 5 s, in which the fastest motion fades like exp(-47).
    assert found.within(np.eye(3)[:1]).max() < 3e-13


def test_panels_are_as_wide_as_is_resolved() -> None:
    task = paper_task(8.0)
    matrices = Matrices.of(task.dynamics.coefficients)
    edges = np.array([0.0, 0.01, 3.0, 8.0])
    signal = PiecewisePolynomial(edges, NODES, np.full((4, 3, 3), 0.5))
    motion = DrivenMotion(task, SymbolicControl(open_loop_torque(4), np.zeros(0), signal), np.zeros(6))
    fastest = np.linalg.eigvals(np.linalg.solve(matrices.inertia, matrices.friction)).real.max()
    counts = panel_counts(matrices, motion, edges)
    assert counts[0] == 1
    assert np.all(fastest * np.diff(edges) <= RESOLVED * counts)
    assert np.all(counts <= np.ceil(1.5 * fastest * np.diff(edges) / RESOLVED))


@pytest.mark.parametrize("degree", [5, 20])
@pytest.mark.parametrize("distance", [0.0, 1e-3])
def test_the_position_on_a_circle(distance: float, degree: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # V_X = 0.5 m/s and Omega = 3 rad/s are known exactly; only the position's rates are interpolated.
    monkeypatch.setattr(enclosed_motion, "DEGREE", degree)
    edges, speed, rate = np.linspace(0.0, 2.0, 5), 0.5, 3.0
    powers = np.zeros((3, 4, 1))
    powers[0], powers[2] = speed, rate
    inverse = np.diag([1.0 / 40.0, 1.0 / 40.0, 0.5])
    velocity = EnclosedVelocity(edges, powers, np.full(4, distance), inverse)
    pose = enclosed_pose(velocity, np.zeros(3), (0.0, 0.0))
    x = np.linspace(-1.0, 1.0, 41)
    # As fast as the distance lets it be, straight on and in the rotation.
    faster, turning = speed + distance / np.sqrt(40.0), rate + distance * np.sqrt(0.5)
    t = (edges[:-1, None] + edges[1:, None]) / 2 + 0.25 * x
    exact = faster / turning * np.stack([np.sin(turning * t), 1.0 - np.cos(turning * t)])
    error = np.hypot(*(values_at(pose.powers[:2], x) - exact)).max(axis=1)
    assert np.all(error <= pose.point)
    assert pose.point.max() <= 100 * error.max() + 1e-11
    if degree == 20 and not distance:
        assert pose.point.max() < 1e-11
