"""Coefficients, critical radius and speed, steady rotations: check values, the model itself, limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings

from occ.model.coefficients import coefficients
from occ.model.constraint import path_functions
from occ.model.platform import Platform
from occ.model.presets import omni3, youbot
from occ.motion import Circle
from occ.numeric import BLOCK
from occ.theory.circle import circle_function, circle_quantities
from occ.theory.coefficients import yaw_coefficients, yaw_coefficients_many
from occ.theory.equation import reduced_motion, scaled_equation, scaled_right_side, yaw_acceleration
from occ.theory.stability import singular_point
from tests.strategies import angles, circles, platforms, points, reals
from tests.tasks import POINT

Printed = Callable[[str], object]


class TestCheckValues:
    """Public check values of the paper's errata."""

    def test_coefficients(self, printed: Printed) -> None:
        c = yaw_coefficients(youbot(), POINT)
        assert float(c.inertia) == printed("13.1234677618")
        assert float(c.xi_3) == printed("8.48641619001")
        assert float(c.friction_xx) == printed("195.013850416")
        assert float(c.friction_yy) == printed("430.932217762")
        assert float(c.mass_xx) == printed("45.9466481994")

    def test_circle(self, printed: Printed) -> None:
        q = circle_quantities(yaw_coefficients(youbot(), POINT), 0.7, -0.4)
        assert float(q.critical_radius) == printed("0.647403193343")
        assert float(q.critical_speed) == printed("26.5482182534")
        assert float(q.alpha) == printed("0.0887386943436")
        assert float(q.beta) == printed("0.124354994547")
        assert float(q.epsilon) == printed("0.0471341483901")
        assert float(q.stable_heading) == printed("-0.478863232355")
        assert float(q.unstable_heading) == printed("0.301385843667")

    def test_singular_point(self, printed: Printed) -> None:
        b_x, b_y = singular_point(youbot(), -0.4)
        assert b_x == printed("0.000753166689804")
        assert b_y == printed("0.000927672480453")


class TestManyPoints:
    """Arrays by NumPy are CasADi's numbers, point by point."""

    @settings(max_examples=15)
    @given(platform=platforms(), point=points(), circle=circles())
    def test_arrays_are_the_functions(self, platform: Platform, point: tuple[float, float], circle: Circle) -> None:
        radii = circle.radius * np.array([0.3, 1.0, 4.0])
        c = yaw_coefficients(platform, point)
        many = yaw_coefficients_many(platform.wheel_count, platform.parameters(), np.tile(point, (3, 1)).T)
        found = circle_quantities(many, radii, circle.rate)
        for k, radius in enumerate(radii):
            np.testing.assert_allclose([value[k] for value in many], c, rtol=1e-14, atol=0)
            expected = np.array(circle_function()(np.array(c), radius, circle.rate))[:, 0]
            np.testing.assert_allclose([value[k] for value in found], expected, rtol=1e-13, atol=1e-13)

    def test_more_points_than_one_block_and_numbers_among_arrays(self) -> None:
        c, radii = yaw_coefficients(youbot(), POINT), np.linspace(0.05, 1.5, 2 * BLOCK + 3).reshape(5, -1)
        assert radii.size == 2 * BLOCK + 3
        found = circle_quantities(c, radii, -0.4)
        for place in ((0, 0), (2, 7), (4, -1)):
            one = circle_quantities(c, radii[place], -0.4)
            np.testing.assert_array_equal([value[place] for value in found], one)


class TestAgainstTheModel:
    """The yaw equation of the law, which the model derives from the energy of accelerations, is eq. (4.3)."""

    @settings(max_examples=30)
    @given(platform=platforms(), point=points(), circle=circles(), psi=angles(), yaw_rate=reals(-3.0, 3.0))
    def test_yaw_acceleration(
        self, platform: Platform, point: tuple[float, float], circle: Circle, psi: float, yaw_rate: float
    ) -> None:
        t = 0.7
        _, velocity, acceleration = circle.at(t)
        heading = psi + circle.rate * t + circle.phase
        servo = path_functions(platform.wheel_count)["servo"]
        expected = float(servo(coefficients(platform), point, heading, yaw_rate, velocity[:, 0], acceleration[:, 0]))
        c = yaw_coefficients(platform, point)
        found = float(yaw_acceleration(c, circle.radius, circle.rate, psi, yaw_rate))
        scale = 1 + abs(expected) + float(c.xi_3) * abs(yaw_rate) + circle.radius * circle.rate**2 * 10
        assert found == pytest.approx(expected, abs=1e-11 * scale)
        eq = scaled_equation(c, circle.radius, circle.rate)
        if np.isfinite(eq.epsilon) and float(c.xi_3) > 1e-6:
            slope = (yaw_rate - circle.rate) / circle.rate
            _, scaled = scaled_right_side(eq)(0.0, np.array([psi + float(eq.alpha), slope]))
            # d theta'/d|u| = Omega'/(omega_B |omega_B|).
            assert scaled * circle.rate * abs(circle.rate) == pytest.approx(expected, abs=1e-9 * scale)

    @settings(max_examples=30)
    @given(platform=platforms(), point=points(), circle=circles())
    def test_steady_rotations_are_equilibria(
        self, platform: Platform, point: tuple[float, float], circle: Circle
    ) -> None:
        c = yaw_coefficients(platform, point)
        q = circle_quantities(c, circle.radius, circle.rate)
        if q.radius_ratio < 1:
            turn = np.linspace(-np.pi, np.pi, 721)
            push = yaw_acceleration(c, circle.radius, circle.rate, turn, circle.rate) * -np.sign(circle.rate)
            assert push.min() > -1e-9 * np.abs(push).max()
            return
        scale = float(c.xi_3) * abs(circle.rate) + circle.radius * circle.rate**2
        for heading, sign in ((q.stable_heading, 1.0), (q.unstable_heading, -1.0)):
            at = [float(yaw_acceleration(c, circle.radius, circle.rate, heading + x, circle.rate)) for x in (0, 1e-5)]
            assert at[0] == pytest.approx(0.0, abs=1e-8 * scale * float(max(q.radius_ratio, 1)) ** 0.5 + 1e-9)
            if float(q.stiffness) > 1e-2 * scale:
                assert (at[0] - at[1]) / 1e-5 == pytest.approx(sign * float(q.stiffness), rel=2e-2)

    def test_many_at_once(self) -> None:
        platform = youbot()
        given_points = np.array([[0.4, 0.1, -0.3], [0.05, 0.2, 0.0]])
        many = yaw_coefficients_many(4, platform.parameters(), given_points)
        for i in range(3):
            one = yaw_coefficients(platform, (float(given_points[0, i]), float(given_points[1, i])))
            assert [float(value) for value in one] == pytest.approx([values[i] for values in many], rel=1e-15)


class TestLimits:
    """Infinity where infinity is the answer; no warning, which would be an error here."""

    def test_no_spin_inertia(self) -> None:
        c = yaw_coefficients(youbot(wheel_spin_inertia=0.0), POINT)
        q = circle_quantities(c, 0.7, -0.4)
        assert q.critical_speed == np.inf
        assert q.k == 0
        # The damping is xi_3 at every steady rotation (after eq. (4.8)).
        assert q.stable_damping == q.unstable_damping == c.xi_3

    def test_b_at_the_origin(self) -> None:
        q = circle_quantities(yaw_coefficients(youbot(), (0.0, 0.0)), 0.7, -0.4)
        assert q.critical_speed == np.inf
        # xi_1 = xi_2 = 0 and kappa_2 = -m a/I_a.
        expected = 41.9345198146 / (29.94 * np.hypot(0.016, 0.026) * 0.4)
        assert float(q.critical_radius) == pytest.approx(expected, rel=1e-11)

    @pytest.mark.parametrize("rate", [-0.4, 0.4, -3.0])
    def test_singular_point(self, rate: float) -> None:
        for platform in (youbot(), youbot(mass_center=(0.03, 0.01)), omni3(mass_center=(0.02, -0.01))):
            q = circle_quantities(yaw_coefficients(platform, singular_point(platform, rate)), 0.7, rate)
            assert q.critical_radius == np.inf
            assert q.radius_ratio == 0
            assert np.isfinite(q.critical_speed)

    def test_everything_at_the_origin(self) -> None:
        q = circle_quantities(yaw_coefficients(omni3(mass_center=(0.0, 0.0)), (0.0, 0.0)), 0.7, 0.3)
        assert q.critical_radius == np.inf
        assert q.critical_speed == np.inf

    def test_no_friction(self) -> None:
        c = yaw_coefficients(youbot(wheel_friction=0.0, roller_friction=0.0), POINT)
        q = circle_quantities(c, 0.7, -0.4)
        assert q.critical_radius == 0
        assert q.epsilon == q.radius_ratio == np.inf
        assert not np.isnan([float(value) for value in q]).any()
        assert float(yaw_acceleration(c, 0.7, -0.4, q.stable_heading, -0.4)) == pytest.approx(0.0, abs=1e-15)


def test_reduced_motion_settles_at_the_stable_rotation(printed: Printed) -> None:
    c = yaw_coefficients(youbot(), POINT)
    psi, yaw_rate = reduced_motion(c, 0.7, -0.4, (-np.pi / 2, 0.0), np.array([0.0, 170.0]))
    assert psi[-1] == printed("-0.478863232355")
    assert yaw_rate[-1] == pytest.approx(-0.4, abs=1e-10)
