"""The servo-constraint against the paper's equations, its public check values, and Gauss's principle."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.laws import ServoLaw
from occ.laws.base import Moment
from occ.model.coefficients import coefficients, unpack
from occ.model.constraint import PathSymbols, on_program, path_functions, servo_yaw_acceleration
from occ.model.dynamics import dynamics
from occ.model.platform import Platform
from occ.model.presets import YouBot, youbot
from occ.motion import Circle, ProgramMotion
from tests.strategies import angles, circles, lines, motions, platforms, points, reals, vectors, youbots

POINT = (0.40, 0.05)
CIRCLE = Circle(radius=0.7, rate=-0.4, phase=math.pi / 2)

times = reals(-20.0, 20.0)
yaw_rates = reals(-3.0, 3.0)
any_platform, any_motion = platforms(), motions()


def column(result: ca.DM) -> np.ndarray:
    return np.array(result)[:, 0]


class Numeric:
    """The path-keeping functions of one platform and point along one motion, as functions of (t, psi, Omega)."""

    def __init__(self, platform: Platform, point: tuple[float, float], motion: ProgramMotion) -> None:
        self.platform, self.point, self.motion = platform, point, motion
        self.functions = path_functions(platform.wheel_count)

    def arguments(self, t: float, heading: float, yaw_rate: float) -> list[object]:
        _, velocity, acceleration = self.motion.at(t)
        return [coefficients(self.platform), self.point, heading, yaw_rate, velocity, acceleration]

    def velocity(self, t: float, heading: float, yaw_rate: float) -> np.ndarray:
        return column(self.functions["velocity"](*self.arguments(t, heading, yaw_rate)))

    def servo(self, t: float, heading: float, yaw_rate: float) -> float:
        return float(self.functions["servo"](*self.arguments(t, heading, yaw_rate)))

    def wrench(self, t: float, heading: float, yaw_rate: float, yaw_acceleration: float | None = None) -> np.ndarray:
        chosen = self.servo(t, heading, yaw_rate) if yaw_acceleration is None else yaw_acceleration
        return column(self.functions["wrench"](*self.arguments(t, heading, yaw_rate), chosen))

    def torque(self, t: float, heading: float, yaw_rate: float, yaw_acceleration: float) -> np.ndarray:
        null = np.zeros(self.platform.wheel_count - 3)
        return column(self.functions["torque"](*self.arguments(t, heading, yaw_rate), yaw_acceleration, null))


class Place(NamedTuple):
    """Where a platform is on its path, and how it turns there."""

    path: Numeric
    t: float
    heading: float
    yaw_rate: float


@st.composite
def places(
    draw: st.DrawFn,
    platform: st.SearchStrategy[Platform] = any_platform,
    motion: st.SearchStrategy[ProgramMotion] = any_motion,
) -> Place:
    """Any platform and point anywhere on any motion."""
    path = Numeric(draw(platform), draw(points()), draw(motion))
    return Place(path, draw(times), draw(angles()), draw(yaw_rates))


class PaperYaw:
    """Equations (3.10) and (4.3)-(4.5) retyped for the youBot."""

    def __init__(self, numbers: YouBot, point: tuple[float, float], rate: float, radius: float) -> None:
        n, (b_x, b_y), self.rate, self.radius = numbers, point, rate, radius
        m, (a_x, a_y), lever = n.platform_mass, n.mass_center, n.half_wheelbase + n.half_track
        spin = 4 * n.wheel_spin_inertia / n.wheel_radius**2
        wheel, roller = 4 * n.wheel_friction / n.wheel_radius**2, 8 * n.roller_friction / n.roller_radius**2
        zeta_x, zeta_y = wheel, wheel + roller
        mu_omega = wheel * lever**2 + roller * n.half_wheelbase**2
        m_s = m + 4 * n.wheel_mass
        m_a, i_a = m_s + spin, n.yaw_inertia + spin * lever**2
        j_a = i_a - 2 * m * (a_x * b_x + a_y * b_y) + m_a * (b_x**2 + b_y**2)
        self.kappa_11, self.kappa_12 = (m_a * b_x - m * a_x) / j_a, (m_a * b_y - m * a_y) / j_a
        self.kappa_21, self.kappa_22 = (m_s * b_x - m * a_x) / j_a, (m_s * b_y - m * a_y) / j_a
        # Coefficients that vanish, as all with B = O do, are differences of forces on the wheels of this size.
        self.size = (zeta_y + mu_omega + m_a + i_a) / j_a
        self.xi_1, self.xi_2 = zeta_y * b_x / j_a, zeta_x * b_y / j_a
        self.xi_3 = (mu_omega + zeta_x * b_y**2 + zeta_y * b_x**2) / j_a
        east, north = self.xi_1 + self.kappa_22 * rate, self.xi_2 - self.kappa_21 * rate
        self.critical_radius = self.ratio(self.xi_3, math.hypot(east, north))
        self.alpha = math.atan2(north, east)
        east, north = self.kappa_11 - self.kappa_21, self.kappa_12 - self.kappa_22
        self.critical_speed = self.ratio(self.xi_3, math.hypot(east, north))
        self.beta = math.atan2(north, east)

    @staticmethod
    def ratio(over: float, under: float) -> float:
        return over / under if under > 0 else math.inf

    def yaw_equation(self, v: np.ndarray, dv: np.ndarray, yaw_rate: float) -> float:
        """Omega' by (3.9)."""
        return sum(
            [
                -self.kappa_12 * dv[0],
                self.kappa_11 * dv[1],
                self.kappa_21 * yaw_rate * v[0],
                self.kappa_22 * yaw_rate * v[1],
                -self.xi_2 * v[0],
                self.xi_1 * v[1],
                -self.xi_3 * yaw_rate,
            ]
        )

    def circle_4_3(self, psi: float, rate_of_psi: float) -> float:
        """psi~'' by (4.3)."""
        speed, yaw_rate = self.radius * self.rate, rate_of_psi + self.rate
        cosine = self.kappa_12 * rate_of_psi - self.xi_1 - self.kappa_22 * yaw_rate
        sine = self.kappa_11 * rate_of_psi + self.xi_2 - self.kappa_21 * yaw_rate
        return -self.xi_3 * yaw_rate - speed * (cosine * math.cos(psi) + sine * math.sin(psi))

    def circle_4_4(self, psi: float, rate_of_psi: float) -> float:
        """psi~'' by (4.4)."""
        damping = 1 + self.radius * self.rate / self.critical_speed * math.sin(psi + self.beta)
        turning = 1 - self.radius / self.critical_radius * math.cos(psi + self.alpha)
        return -self.xi_3 * damping * rate_of_psi - self.rate * self.xi_3 * turning

    @property
    def stable_root(self) -> float:
        """Misprint 6 of the paper's errata: psi~_s = -alpha + sign(omega_B) arccos(R~_B / R_B) is the stable one."""
        return -self.alpha + math.copysign(math.acos(self.critical_radius / self.radius), self.rate)


class TestKinematics:
    @given(place=places())
    def test_the_point_has_its_program_velocity(self, place: Place) -> None:
        # (3.3), and once more on the floor: v_O + Omega x b turned by psi is the program velocity.
        path, t, heading, yaw_rate = place
        v_x, v_y, omega = path.velocity(t, heading, yaw_rate)
        assert omega == yaw_rate
        c, s = math.cos(heading), math.sin(heading)
        body = np.array([v_x - path.point[1] * omega, v_y + path.point[0] * omega])
        floor = np.array([c * body[0] - s * body[1], s * body[0] + c * body[1]])
        np.testing.assert_allclose(floor, path.motion.at(t)[1][:, 0], rtol=0, atol=1e-13)

    @given(
        point=points(),
        motion=st.one_of(circles(), lines()),
        t=times,
        heading=angles(),
        yaw_rate=yaw_rates,
        yaw_acceleration=yaw_rates,
    )
    def test_pseudo_acceleration_is_the_derivative_of_the_velocity_on_the_program(
        self,
        point: tuple[float, float],
        motion: ProgramMotion,
        t: float,
        heading: float,
        yaw_rate: float,
        yaw_acceleration: float,
    ) -> None:
        # Along the random rotation psi + Omega s + Omega' s^2 / 2, on motions without knots.
        path = Numeric(youbot(), point, motion)

        def velocity(s: float) -> np.ndarray:
            turned = heading + yaw_rate * s + yaw_acceleration * s**2 / 2
            return path.velocity(t + s, turned, yaw_rate + yaw_acceleration * s)

        step = 1e-3
        near, far = (velocity(k * step) - velocity(-k * step) for k in (1, 2))
        _, program_velocity, program_acceleration = motion.at(t)
        found = on_program(ca.DM(point), ca.DM(heading), ca.DM(yaw_rate), program_velocity, program_acceleration)
        acceleration = column(ca.DM(found.direction * yaw_acceleration + found.rest))
        np.testing.assert_allclose(acceleration, (8 * near - far) / (12 * step), rtol=1e-9, atol=1e-9)

    @given(place=places())
    def test_the_laws_look_at_the_same_functions(self, place: Place) -> None:
        path, t, heading, yaw_rate = place
        _, program_velocity, program_acceleration = path.motion.at(t)
        matrices = unpack(ca.DM(coefficients(path.platform)), path.platform.wheel_count)
        point = ca.DM(path.point)
        moment = Moment(
            t=ca.DM(t),
            heading=ca.DM(heading),
            yaw_rate=ca.DM(yaw_rate),
            program_velocity=ca.DM(program_velocity),
            program_acceleration=ca.DM(program_acceleration),
            point=point,
            matrices=matrices,
            on_program=on_program(
                point, ca.DM(heading), ca.DM(yaw_rate), ca.DM(program_velocity), ca.DM(program_acceleration)
            ),
        )
        expected = path.servo(t, heading, yaw_rate)
        tolerance = 1e-11 * (abs(expected) + 1e3)
        assert float(ServoLaw().yaw_acceleration(moment)) == pytest.approx(expected, abs=tolerance)
        assert float(servo_yaw_acceleration(matrices, moment.on_program)) == pytest.approx(expected, abs=tolerance)

    def test_the_functions_take_the_fields_of_the_symbols_in_their_order(self) -> None:
        for name, function in path_functions(4).items():
            names = [function.name_in(i) for i in range(function.n_in())]
            assert names[:6] == list(PathSymbols._fields), name


class TestYawEquation:
    @given(place=places(platform=youbots()))
    def test_the_servo_law_is_equation_3_9_with_the_coefficients_3_10(self, place: Place) -> None:
        # V_B* in body axes, (4.1), and its derivative in time along psi' = Omega.
        path, t, heading, yaw_rate = place
        _, v, a = (row[:, 0] for row in path.motion.at(t))
        c, s = math.cos(heading), math.sin(heading)
        v_b = np.array([c * v[0] + s * v[1], -s * v[0] + c * v[1]])
        a_b = np.array([c * a[0] + s * a[1], -s * a[0] + c * a[1]])
        dv_b = a_b + yaw_rate * np.array([v_b[1], -v_b[0]])
        paper = PaperYaw(numbers_of(path.platform), path.point, 1.0, 1.0)
        found = path.servo(t, heading, yaw_rate)
        scale = paper.size * (np.abs(v_b).sum() * (1 + abs(yaw_rate)) + np.abs(dv_b).sum() + abs(yaw_rate))
        assert abs(found - paper.yaw_equation(v_b, dv_b, yaw_rate)) <= 1e-12 * scale

    @given(place=places(platform=youbots(), motion=circles()))
    def test_the_servo_law_on_a_circle_is_equations_4_3_and_4_4(self, place: Place) -> None:
        path, t, heading, yaw_rate = place
        circle = path.motion
        assert isinstance(circle, Circle)
        paper = PaperYaw(numbers_of(path.platform), path.point, circle.rate, circle.radius)
        psi = heading - circle.rate * t - circle.phase
        found = path.servo(t, heading, yaw_rate)
        speed = circle.radius * abs(circle.rate)
        scale = paper.size * (speed * (1 + abs(yaw_rate) + abs(circle.rate)) + abs(yaw_rate) + abs(circle.rate))
        assert abs(found - paper.circle_4_3(psi, yaw_rate - circle.rate)) <= 1e-12 * scale
        if paper.xi_3 > 0:  # without friction (4.4) divides zero by zero
            assert abs(found - paper.circle_4_4(psi, yaw_rate - circle.rate)) <= 1e-12 * scale

    def test_the_circles_constants_have_the_public_check_values(self, printed: Callable[[str], object]) -> None:
        # Source: public check values of the paper's errata; they tie the retyped (3.10), (4.5) to the errata.
        paper = PaperYaw(YouBot(), POINT, CIRCLE.rate, CIRCLE.radius)
        assert paper.xi_3 == printed("8.48641619001")
        assert abs(CIRCLE.rate) / paper.xi_3 == printed("0.0471341483901")
        assert paper.critical_radius == printed("0.647403193343")
        assert paper.critical_speed == printed("26.5482182534")
        assert paper.alpha == printed("0.0887386943436")
        assert paper.beta == printed("0.124354994547")
        assert paper.stable_root == printed("-0.478863232355")
        assert -paper.alpha + math.acos(paper.critical_radius / CIRCLE.radius) == printed("0.301385843667")


def numbers_of(platform: Platform) -> YouBot:
    """The youBot's numbers of a platform that `youbot` built."""
    front_left = platform.wheels[0]
    return YouBot(
        platform_mass=platform.mass,
        wheel_mass=front_left.mass,
        yaw_inertia=platform.yaw_inertia,
        wheel_spin_inertia=front_left.spin_inertia,
        mass_center=platform.mass_center,
        wheel_friction=front_left.friction,
        roller_friction=front_left.roller_friction,
        half_track=front_left.position[1],
        half_wheelbase=front_left.position[0],
        wheel_radius=front_left.radius,
        roller_radius=front_left.roller_radius,
    )


class TestGauss:
    @given(place=places())
    def test_the_servo_wrench_has_no_component_along_the_free_rotation(self, place: Place) -> None:
        # C^T Pi_C = 0, i.e. Pi_C = B^T lambda, (3.5), (3.13).
        path, t, heading, yaw_rate = place
        f_x, f_y, moment = path.wrench(t, heading, yaw_rate)
        k = dynamics(path.platform).coefficients
        # The wrench is a difference of inertial, gyroscopic and viscous forces.
        velocity = path.velocity(t, heading, yaw_rate)
        scale = np.abs(np.array(k.friction)).max() * np.abs(velocity).max()
        scale += np.abs(np.array(k.inertia)).max() * (abs(path.servo(t, heading, yaw_rate)) + 50) + 1
        assert abs(moment + path.point[1] * f_x - path.point[0] * f_y) <= 1e-12 * scale

    @given(place=places())
    def test_the_servo_wrench_is_the_minimiser_of_gausss_quadratic_program(self, place: Place) -> None:
        # min 1/2 Pi^T A^-1 Pi over the wrenches under which B has its program acceleration on the floor.
        path, t, heading, yaw_rate = place
        state = np.concatenate([[0.0, 0.0, heading], path.velocity(t, heading, yaw_rate)])
        d = dynamics(path.platform)
        inertia = np.array(d.inertia_matrix(np.zeros(6)))
        resisting = column(d.inverse(state, np.zeros(3)))
        flexibility = np.linalg.inv(inertia)
        # Acceleration of B on the floor = turning (linear pi'' + still), with pi'' = flexibility (Pi - resisting).
        c, s = math.cos(heading), math.sin(heading)
        turning = np.array([[c, -s], [s, c]])
        b_x, b_y = path.point
        v_x, v_y, omega = state[3:]
        linear = turning @ np.array([[1.0, 0.0, -b_y], [0.0, 1.0, b_x]])
        still = turning @ np.array([-omega * v_y - omega**2 * b_x, omega * v_x - omega**2 * b_y])
        constraint = linear @ flexibility
        wanted = path.motion.at(t)[2][:, 0] - still + constraint @ resisting
        system = np.block([[flexibility, constraint.T], [constraint, np.zeros((2, 2))]])
        expected = np.linalg.solve(system, np.concatenate([np.zeros(3), wanted]))[:3]
        scale = np.abs(resisting).max() + np.abs(inertia).max() * np.abs(wanted).max() + 1e-3
        np.testing.assert_allclose(path.wrench(t, heading, yaw_rate), expected, rtol=0, atol=1e-10 * scale)

    @given(
        data=st.data(),
        platform=platforms(),
        point=points(),
        motion=motions(),
        t=times,
        heading=angles(),
        rates=vectors(2, 3.0),
    )
    def test_the_platform_under_the_torques_keeps_the_program_with_the_chosen_yaw_acceleration(
        self,
        data: st.DataObject,
        platform: Platform,
        point: tuple[float, float],
        motion: ProgramMotion,
        t: float,
        heading: float,
        rates: np.ndarray,
    ) -> None:
        # Any yaw acceleration and any null torque, through the forward dynamics and point kinematics on the floor.
        path = Numeric(platform, point, motion)
        yaw_rate, yaw_acceleration = rates
        null = data.draw(vectors(platform.wheel_count - 3, 1.0))
        arguments = path.arguments(t, heading, yaw_rate)
        torque = column(path.functions["torque"](*arguments, yaw_acceleration, null))
        state = np.concatenate([[0.0, 0.0, heading], path.velocity(t, heading, yaw_rate)])
        v_x, v_y, omega = state[3:]
        dv_x, dv_y, d_omega = column(dynamics(platform).forward(state, torque))[3:]
        b_x, b_y = point
        body = np.array(
            [
                dv_x - omega * v_y - d_omega * b_y - omega**2 * b_x,
                dv_y + omega * v_x + d_omega * b_x - omega**2 * b_y,
            ]
        )
        c, s = math.cos(heading), math.sin(heading)
        floor = np.array([c * body[0] - s * body[1], s * body[0] + c * body[1]])
        # Forces of hundreds of N on some kg cancel to leave the accelerations.
        force = np.abs(np.array(dynamics(platform).input_map(np.zeros(6)))) @ np.abs(torque)
        inertia = np.linalg.eigvalsh(np.array(dynamics(platform).inertia_matrix(np.zeros(6))))[0]
        tolerance = 1e-12 * (1 + force.max() / inertia)
        np.testing.assert_allclose(floor, motion.at(t)[2][:, 0], rtol=0, atol=tolerance)
        assert abs(d_omega - yaw_acceleration) <= tolerance
        # Power does not see the null torque: n . phi' = 0.
        least = path.torque(t, heading, yaw_rate, yaw_acceleration)
        powers = np.array(dynamics(platform).wheel_rates(state))[:, 0] * (torque - least)
        assert abs(powers.sum()) <= 1e-12 * (np.abs(powers).sum() + 1)


class TestPublicCheckValues:
    """Public check values of the paper's errata: b = (0.40, 0.05) m on a circle of 0.7 m at -0.4 rad/s."""

    path = Numeric(youbot(), POINT, CIRCLE)
    steady_heading = PaperYaw(YouBot(), POINT, CIRCLE.rate, CIRCLE.radius).stable_root + CIRCLE.phase

    def test_the_wrench_at_the_start(self, printed: Callable[[str], object]) -> None:
        f_x, f_y, moment = self.path.wrench(0.0, 0.0, 0.0)
        assert f_x == printed("53.4941384707")
        assert f_y == printed("1.31216362546")
        assert moment == printed("-2.14984147335")

    def test_the_stable_rotation_is_steady(self) -> None:
        for t in (0.0, 3.0):
            acceleration = self.path.servo(t, self.steady_heading + CIRCLE.rate * t, CIRCLE.rate)
            assert abs(acceleration) < 1e-13

    def test_the_steady_wrench(self, printed: Callable[[str], object]) -> None:
        f_x, f_y, moment = self.path.wrench(0.0, self.steady_heading, CIRCLE.rate)
        assert f_x == printed("19.9247438857")
        assert f_y == printed("-39.5650458818")
        assert moment == printed("-16.822255547")

    def test_the_steady_wheel_torques(self, printed: Callable[[str], object]) -> None:
        torque = self.path.torque(0.0, self.steady_heading, CIRCLE.rate, 0.0)
        expected = ["1.22530952523", "-0.752096857947", "0.285639685538", "0.187572981747"]
        for found, text in zip(torque, expected, strict=True):
            assert found == printed(text)

    def test_the_steady_power(self, printed: Callable[[str], object]) -> None:
        velocity = self.path.velocity(0.0, self.steady_heading, CIRCLE.rate)
        wrench = self.path.wrench(0.0, self.steady_heading, CIRCLE.rate)
        assert velocity @ wrench == printed("12.4027335158")

    def test_the_eigenvalues_at_the_stable_rotation(self, printed: Callable[[str], object]) -> None:
        # Linearised at fixed t: psi~ and psi differ by a function of time only.
        heading, yaw_rate = ca.SX.sym("heading"), ca.SX.sym("yaw_rate")
        _, velocity, acceleration = CIRCLE.at(0.0)
        servo = self.path.functions["servo"](coefficients(youbot()), POINT, heading, yaw_rate, velocity, acceleration)
        slopes = ca.Function("slopes", [heading, yaw_rate], [ca.jacobian(servo, ca.vertcat(heading, yaw_rate))])
        by_heading, by_rate = np.array(slopes(self.steady_heading, CIRCLE.rate))[0]
        fast, slow = sorted(np.linalg.eigvals([[0.0, 1.0], [by_heading, by_rate]]))
        assert fast == printed("-8.35032511858")
        assert slow == printed("-0.167160849869")

    def test_the_singular_point_turns_by_friction_alone(self, printed: Callable[[str], object]) -> None:
        # (4.20) retyped; at this B the program's steady speed exerts no moment: only Omega' = -xi_3 Omega remains,
        # up to the terms that J_1 leaves in psi~' (section 4.3).
        n, rate = YouBot(), CIRCLE.rate
        paper = PaperYaw(n, (0.0, 0.0), rate, CIRCLE.radius)
        zeta_x = 4 * n.wheel_friction / n.wheel_radius**2
        zeta_y = zeta_x + 8 * n.roller_friction / n.roller_radius**2
        m, m_s, (a_x, a_y) = n.platform_mass, n.platform_mass + 4 * n.wheel_mass, n.mass_center
        share = m * rate / (zeta_x * zeta_y + m_s**2 * rate**2)
        b_x, b_y = share * (m_s * rate * a_x + zeta_x * a_y), share * (m_s * rate * a_y - zeta_y * a_x)
        assert b_x == printed("0.000753166689804")
        assert b_y == printed("0.000927672480453")
        paper = PaperYaw(n, (b_x, b_y), rate, CIRCLE.radius)
        path = Numeric(youbot(), (b_x, b_y), CIRCLE)
        for heading in np.linspace(-3.0, 3.0, 7):
            assert path.servo(0.0, heading, rate) == pytest.approx(-paper.xi_3 * rate, abs=1e-12)
