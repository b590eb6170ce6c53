"""The exact stability domain: its closed form against eigenvalues of the model, and against the full platform."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from occ.laws import ServoLaw
from occ.model.coefficients import coefficients
from occ.model.constraint import path_functions
from occ.model.platform import Platform
from occ.model.presets import youbot
from occ.numeric import BufferedFunction, evaluate_many
from occ.task import Task
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import yaw_coefficients, yaw_coefficients_many
from occ.theory.stability import (
    damping_rate,
    eigenvalues,
    stable_radii,
    sufficient,
)
from tests.tasks import POINT, paper_task

Printed = Callable[[str], object]


def linearised(
    platform: Platform, point: np.ndarray, radius: np.ndarray, rate: np.ndarray, psi: np.ndarray
) -> np.ndarray:
    """(N, 2, 2) Jacobian of (psi~', Omega') at steady rotations, from the model by CasADi: no formula of the theory."""
    servo = path_functions(platform.wheel_count)["servo"]
    k, b = ca.SX.sym("k", servo.size1_in(0)), ca.SX.sym("b", 2)
    angle, deviation, r, w = (ca.SX.sym(name) for name in ("angle", "deviation", "r", "w"))
    # t = 0 and phase 0: the heading is psi~.
    acceleration = servo(k, b, angle, w + deviation, ca.vertcat(0, r * w), ca.vertcat(-r * w**2, 0))
    row = ca.jacobian(acceleration, ca.vertcat(angle, deviation))
    function = ca.Function("row", [k, b, angle, r, w], [ca.substitute(row, deviation, 0).T])
    data = (point, *(values.reshape(1, -1) for values in (psi, radius, rate)))
    (rows,) = evaluate_many(function, coefficients(platform), *data, shared=(0,))
    matrices = np.zeros((len(psi), 2, 2))
    matrices[:, 0, 1] = 1.0
    matrices[:, 1] = rows.T
    return matrices


def random_circles(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    rate = 10 ** rng.uniform(-2, 3.3, count) * rng.choice([-1.0, 1.0], count)
    return rate, 10 ** rng.uniform(-2.5, 2.5, count)


class TestDomain:
    """The closed-form boundary agrees with eigenvalues of the model's linearisation everywhere."""

    def test_25000_random_circles_of_the_youbot(self) -> None:
        count = 25_000
        rate, radius = random_circles(count, 1)
        platform = youbot()
        c = yaw_coefficients(platform, POINT)
        q = circle_quantities(c, radius, rate)
        radii = stable_radii(c, rate)
        inside = (radii.lower < radius) & (radius < radii.upper)
        exists = q.radius_ratio > 1
        assert not inside[~exists].any()
        points = np.tile(np.array(POINT)[:, None], (1, count))
        for heading, expected in ((q.stable_heading, inside), (q.unstable_heading, np.zeros(count, dtype=bool))):
            matrices = linearised(platform, points[:, exists], radius[exists], rate[exists], heading[exists])
            growth = np.linalg.eigvals(matrices).real.max(axis=1)
            np.testing.assert_array_equal(growth < 0, expected[exists])
        # The sample sees both sides of every part of the boundary.
        assert 1000 < inside.sum() < exists.sum() - 500

    def test_random_points_between_the_centres_of_mass(self) -> None:
        # Between m a/m_a and m a/m_s the first two terms of the damping can be negative together, too.
        count = 4_000
        rng = np.random.default_rng(2)
        platform = youbot()
        center = 29.94 * np.array([0.016, -0.026])
        between = center[:, None] / rng.uniform(34.0, 47.0, count)
        point = between + rng.normal(scale=3e-4, size=(2, count))
        rate, radius = random_circles(count, 3)
        rate *= 30.0
        c = yaw_coefficients_many(4, platform.parameters(), point)
        q = circle_quantities(c, radius, rate)
        radii = stable_radii(c, rate)
        inside = (radii.lower < radius) & (radius < radii.upper)
        exists = q.radius_ratio > 1
        matrices = linearised(platform, point[:, exists], radius[exists], rate[exists], q.stable_heading[exists])
        growth = np.linalg.eigvals(matrices).real.max(axis=1)
        np.testing.assert_array_equal(growth < 0, inside[exists])
        # All cases occur: stable beyond R~_B, only beyond a larger radius, only below one, and nowhere.
        inner = exists & np.isfinite(radii.lower)
        assert (inner & (radii.lower > q.critical_radius * (1 + 1e-9))).any()
        assert (inner & np.isfinite(radii.upper)).any()
        assert (exists & ~np.isfinite(radii.lower)).any()

    def test_sufficient_conditions_are_inside(self) -> None:
        rate, radius = random_circles(20_000, 4)
        c = yaw_coefficients(youbot(), POINT)
        radii = stable_radii(c, rate)
        holds = sufficient(circle_quantities(c, radius, rate), radius, rate)
        assert holds.any()
        assert np.all((radii.lower < radius)[holds] & (radius < radii.upper)[holds])

    def test_without_spin_inertia_every_steady_family_is_stable(self) -> None:
        rate, _ = random_circles(1000, 5)
        c = yaw_coefficients(youbot(wheel_spin_inertia=0.0), POINT)
        radii = stable_radii(c, rate)
        np.testing.assert_array_equal(radii.lower, circle_quantities(c, 1.0, rate).critical_radius)
        assert np.all(radii.upper == np.inf)


class TestFullPlatform:
    """Deviations of the six-state platform under the law grow or decay as the linearised yaw equation says."""

    @pytest.mark.parametrize(
        ("rate", "radius", "stable"),
        [
            (-0.4, 0.7, True),
            (-0.4, 3.0, True),
            (0.4, 0.7, True),
            (3.0, 1.0, True),
            pytest.param(-300.0, 3.0, True, marks=pytest.mark.slow),
            pytest.param(-300.0, 16.0, False, marks=pytest.mark.slow),
            (300.0, 7.0, True),
        ],
    )
    def test_growth(self, rate: float, radius: float, stable: bool) -> None:
        task = paper_task(1.0, rate=rate, radius=radius)
        c = yaw_coefficients(task.platform, task.point)
        radii = stable_radii(c, rate)
        assert (radii.lower < radius < radii.upper) == stable
        q = circle_quantities(c, radius, rate)
        linear = np.array([[0.0, 1.0], [-float(q.stiffness), -float(q.stable_damping)]])
        fastest = np.abs(np.linalg.eigvals(linear)).max()
        duration = 2.0 / abs(np.linalg.eigvals(linear).real.max())
        times = np.linspace(0.0, duration, 9)
        first = 1e-5 * np.array([1.0, 0.3 * fastest])
        after = deviations(task, float(q.stable_heading), first, times)
        expected = np.array([expm(linear * t) @ first for t in times[1:]])
        weights = np.array([1.0, 1.0 / fastest])
        assert np.abs((after - expected) * weights).max() < 1e-3 * np.abs(expected * weights).max()
        assert (np.abs(after[-1] * weights).max() < np.abs(first * weights).max()) == stable

    def test_growth_on_slippery_wheels(self) -> None:
        # With a hundredth of the friction the domain ends at rates that a real platform reaches.
        platform = youbot(wheel_friction=0.0011, roller_friction=5.78e-5)
        c = yaw_coefficients(platform, POINT)
        assert -4.0 < float(damping_rate(c)) < -2.0
        upper = float(stable_radii(c, -4.0).upper)
        for factor, grows in ((0.3, False), (3.0, True)):
            task = paper_task(1.0, rate=-4.0, radius=factor * upper, platform=platform)
            q = circle_quantities(c, factor * upper, -4.0)
            assert (float(q.stable_damping) < 0) == grows
            linear = np.array([[0.0, 1.0], [-float(q.stiffness), -float(q.stable_damping)]])
            first, times = np.array([1e-5, 0.0]), np.array([0.0, 2.0 / abs(float(q.stable_damping))])
            after = deviations(task, float(q.stable_heading), first, times)[-1]
            expected = expm(linear * times[-1]) @ first
            assert after == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())

    def test_the_unstable_root_is_left(self) -> None:
        task = paper_task(1.0, rate=-0.4, radius=0.7)
        q = circle_quantities(yaw_coefficients(task.platform, task.point), 0.7, -0.4)
        after = deviations(task, float(q.unstable_heading), np.array([1e-6, 0.0]), np.array([0.0, 30.0]))
        assert abs(after[-1, 0]) > 5e-5


def deviations(task: Task, heading: float, first: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(N - 1, 2) psi~ - psi~_s and Omega - omega_B of the platform's six states under the law's torques."""
    motion, dynamics = task.motion, task.dynamics
    law = ServoLaw().solve(task).control.segment(0.0, times[-1])
    forward = BufferedFunction(dynamics.forward)
    state, torque = forward.inputs

    def right_side(t: float, x: np.ndarray) -> np.ndarray:
        torque[:] = law(t, x)
        state[:] = x
        forward()
        return forward.outputs[0].copy()

    start = task.state_on_program(0.0, heading + motion.phase + first[0], motion.rate + first[1])
    # Between its steps the integrator interpolates with a lower order: steps are kept small.
    options = {"method": "DOP853", "t_eval": times[1:], "rtol": 1e-11, "atol": 1e-11, "max_step": 0.05}
    result = solve_ivp(right_side, (0.0, times[-1]), start, **options)
    psi = result.y[2] - motion.rate * times[1:] - motion.phase
    return np.array([psi - heading, result.y[5] - motion.rate]).T


class TestCheckValues:
    """Public check values of the errata, Fig. 3."""

    def test_eigenvalues(self, printed: Printed) -> None:
        q = circle_quantities(yaw_coefficients(youbot(), POINT), 0.7, -0.4)
        fast, slow = eigenvalues(q.stable_damping, q.stiffness)
        assert float(fast.real) == printed("-8.35032511858")
        assert float(slow.real) == printed("-0.167160849869")

    def test_fig_3(self, printed: Printed) -> None:
        c = yaw_coefficients(youbot(), POINT)
        # 1/R~_B^2 is a parabola in omega_B, and its vertex the largest critical radius.
        rates = np.array([-3.0, -2.0, -1.0])
        parabola = np.polynomial.Polynomial.fit(rates, circle_quantities(c, 1.0, rates).critical_radius ** -2.0, 2)
        (rate,) = parabola.deriv().roots()
        assert float(rate) == printed("-1.5701320")
        assert float(circle_quantities(c, 1.0, rate).critical_radius) == printed("0.65034713")
        assert float(circle_quantities(c, 1.0, 1e-12).critical_radius) == printed("0.64507505")
        assert float(damping_rate(c)) == printed("-207.0709558")

    def test_critical_rate_in_the_parameters_of_the_paper(self) -> None:
        b_x, b_y = POINT
        expected = -(430.932217762 * b_x**2 + 195.013850416 * b_y**2) / (29.94 * (0.016 * b_y + 0.026 * b_x))
        assert float(damping_rate(yaw_coefficients(youbot(), POINT))) == pytest.approx(expected, rel=1e-11)

    @pytest.mark.parametrize("rate", [-250.0, -1000.0, -5000.0])
    def test_upper_radius_of_the_errata(self, rate: float) -> None:
        c = yaw_coefficients(youbot(), POINT)
        q = circle_quantities(c, 1.0, rate)
        turn = float(q.alpha - q.beta)
        across = (float(q.critical_speed) / abs(rate) + float(q.critical_radius) * np.sin(turn)) / np.cos(turn)
        assert float(stable_radii(c, rate).upper) == pytest.approx(
            np.hypot(float(q.critical_radius), across), rel=1e-12
        )

    def test_the_domain_opens_at_the_critical_rate(self) -> None:
        c = yaw_coefficients(youbot(), POINT)
        at = float(damping_rate(c))
        assert stable_radii(c, at * 0.999).upper == np.inf
        assert np.isfinite(stable_radii(c, at * 1.001).upper)


class TestEigenvalues:
    """Roots of a quadratic, without cancellation."""

    def test_roots(self) -> None:
        rng = np.random.default_rng(7)
        damping, stiffness = rng.normal(size=(2, 500))
        for value in eigenvalues(damping, stiffness):
            residual = value**2 + damping * value + stiffness
            assert np.abs(residual).max() < 1e-13
        assert np.prod(eigenvalues(damping, stiffness), axis=0) == pytest.approx(stiffness, abs=1e-14)

    @pytest.mark.parametrize(
        ("damping", "stiffness", "roots"),
        [
            (0, 0, (0, 0)),
            (1, 0, (-1, 0)),
            (0, 4, (-2j, 2j)),
            (2, 1, (-1, -1)),
            (0, -4, (2, -2)),
            (1e9, 1, (-1e9, -1e-9)),
        ],
    )
    def test_limits(self, damping: float, stiffness: float, roots: tuple[complex, complex]) -> None:
        assert list(eigenvalues(damping, stiffness)) == pytest.approx(list(roots), rel=1e-15)
