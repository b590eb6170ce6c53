"""The derived dynamics against the paper's printed equations, mechanics' own identities and finite differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.errors import InputError
from occ.model.coefficients import coefficients, packed_size, unpack
from occ.model.dynamics import Dynamics, dynamics, forward_function, friction_time, parametric_functions
from occ.model.platform import Platform, Wheel, parameter_names
from occ.model.presets import YouBot, youbot
from tests.strategies import platforms, states, vectors, youbot_overrides


class Paper:
    """Equations (2.11)-(2.15) retyped, with mu_2 in (2.11) (misprint 2 of the paper's errata)."""

    def __init__(self, numbers: YouBot) -> None:
        n = numbers
        m, m_1, i_s, j_1 = n.platform_mass, n.wheel_mass, n.yaw_inertia, n.wheel_spin_inertia
        mu_1, mu_2 = n.wheel_friction, n.roller_friction
        h, l, R, r = n.half_wheelbase, n.half_track, n.wheel_radius, n.roller_radius
        self.m, (self.a_x, self.a_y) = m, n.mass_center
        self.lever, self.R = h + l, R
        self.zeta_x = 4 * mu_1 / R**2
        self.zeta_y = 4 * mu_1 / R**2 + 8 * mu_2 / r**2
        self.mu_omega = 4 * mu_1 * (l + h) ** 2 / R**2 + 8 * mu_2 * h**2 / r**2
        self.m_s = m + 4 * m_1
        self.m_a = self.m_s + 4 * j_1 / R**2
        self.i_a = i_s + 4 * (l + h) ** 2 * j_1 / R**2

    def terms(self, state: np.ndarray, acceleration: np.ndarray) -> list[list[float]]:
        """Left-hand sides of (2.13), (2.14), (2.15), term by term."""
        v_x, v_y, omega = state[3:]
        dv_x, dv_y, d_omega = acceleration
        m, a_x, a_y = self.m, self.a_x, self.a_y
        return [
            [
                self.m_a * dv_x,
                -self.m_s * omega * v_y,
                -m * a_y * d_omega,
                -m * a_x * omega**2,
                self.zeta_x * v_x,
            ],
            [
                self.m_a * dv_y,
                self.m_s * omega * v_x,
                m * a_x * d_omega,
                -m * a_y * omega**2,
                self.zeta_y * v_y,
            ],
            [
                self.i_a * d_omega,
                -m * a_y * dv_x,
                m * a_y * omega * v_y,
                m * a_x * dv_y,
                m * a_x * omega * v_x,
                self.mu_omega * omega,
            ],
        ]

    def wrench(self, torque: np.ndarray) -> np.ndarray:
        """(2.12)."""
        m_1, m_2, m_3, m_4 = torque
        forces = [m_2 + m_1 + m_4 + m_3, m_2 - m_1 - m_4 + m_3, self.lever * (m_2 - m_1 + m_4 - m_3)]
        return np.array(forces) / self.R

    def torque(self, wrench: np.ndarray) -> np.ndarray:
        """The four formulas after (3.13)."""
        f_x, f_y, yaw = wrench[0], wrench[1], wrench[2] / self.lever
        return self.R / 4 * np.array([f_x - f_y - yaw, f_x + f_y + yaw, f_x + f_y - yaw, f_x - f_y + yaw])


def column(result: ca.DM) -> np.ndarray:
    return np.array(result)[:, 0]


class TestPaper:
    def test_reduced_coefficients_have_the_public_check_values(self, printed: Callable[[str], object]) -> None:
        # Source: public check values of the paper's errata.
        d = dynamics(youbot())
        friction, inertia = np.array(d.coefficients.friction), np.array(d.inertia_matrix(np.zeros(6)))
        assert friction[0, 0] == printed("195.013850416")
        assert friction[1, 1] == printed("430.932217762")
        assert friction[2, 2] == printed("41.9345198146")
        np.testing.assert_allclose(friction - np.diag(np.diag(friction)), 0, atol=1e-13)
        assert inertia[0, 0] == printed("45.9466481994")
        assert inertia[1, 1] == printed("45.9466481994")
        assert inertia[2, 2] == printed("5.96252542936")
        # m_s is what V_X Omega meets in the second row of f, (2.16).
        m_s = np.array(d.coefficients.gyroscopic[1])[0, 2]
        assert m_s == printed("35.54")
        point = np.array([0.40, 0.05])
        direction = np.array([point[1], -point[0], 1.0])
        assert direction @ inertia @ direction == printed("13.1234677618")

    @given(numbers=youbot_overrides(), state=states(), acceleration=vectors(3, 5.0))
    def test_inverse_is_equations_2_13_to_2_15(
        self, numbers: dict[str, Any], state: np.ndarray, acceleration: np.ndarray
    ) -> None:
        wrench = column(dynamics(youbot(**numbers)).inverse(state, acceleration))
        terms = Paper(YouBot(**numbers)).terms(state, acceleration)
        # What one wheel adds and the next takes away leaves a rounding error of the other rows' size.
        scale = np.abs(np.concatenate(terms)).sum()
        np.testing.assert_allclose(wrench, [sum(row) for row in terms], rtol=0, atol=1e-12 * scale)

    @given(numbers=youbot_overrides(), state=states(), torque=vectors(4, 3.0))
    def test_forward_satisfies_equations_2_13_to_2_15(
        self, numbers: dict[str, Any], state: np.ndarray, torque: np.ndarray
    ) -> None:
        paper = Paper(YouBot(**numbers))
        rate = column(dynamics(youbot(**numbers)).forward(state, torque))
        forces, terms = paper.wrench(torque), paper.terms(state, rate[3:])
        scale = np.abs(np.concatenate(terms)).sum() + np.abs(torque).sum() / paper.R
        np.testing.assert_allclose([sum(row) for row in terms], forces, rtol=0, atol=1e-12 * scale)
        # (2.1) solved for the motion on the floor.
        c, s = math.cos(state[2]), math.sin(state[2])
        position = [c * state[3] - s * state[4], s * state[3] + c * state[4], state[5]]
        np.testing.assert_allclose(rate[:3], position, rtol=0, atol=1e-14)

    @given(numbers=youbot_overrides(), state=states())
    def test_gyroscopic_and_friction_forces_are_f_and_pi_f_of_the_paper(
        self, numbers: dict[str, Any], state: np.ndarray
    ) -> None:
        p, d = Paper(YouBot(**numbers)), dynamics(youbot(**numbers))
        v_x, v_y, omega = state[3:]
        f = [
            -p.m_s * omega * v_y - p.m * p.a_x * omega**2,
            p.m_s * omega * v_x - p.m * p.a_y * omega**2,
            p.m * p.a_y * omega * v_y + p.m * p.a_x * omega * v_x,
        ]
        for found in (d.gyroscopic(state), d.coefficients.gyroscopic_force(state[3:])):
            np.testing.assert_allclose(column(found), f, rtol=0, atol=1e-12 * (p.m_s * 20))
        viscous = [-p.zeta_x * v_x, -p.zeta_y * v_y, -p.mu_omega * omega]
        np.testing.assert_allclose(column(d.friction(state)), viscous, rtol=0, atol=1e-12 * (p.zeta_y * 10 + 1))

    @given(numbers=youbot_overrides(), wrench=vectors(3, 50.0))
    def test_min_norm_torques_are_the_formulas_after_3_13(self, numbers: dict[str, Any], wrench: np.ndarray) -> None:
        paper = Paper(YouBot(**numbers))
        torque = column(dynamics(youbot(**numbers)).min_norm_torque(wrench))
        expected = paper.torque(wrench)
        np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-13 * (np.abs(wrench).sum() / paper.lever + 1))

    @given(numbers=youbot_overrides())
    def test_the_null_torque_of_a_youbot_is_proportional_to_1_1_minus_1_minus_1(self, numbers: dict[str, Any]) -> None:
        null = column(dynamics(youbot(**numbers)).coefficients.null_torque)
        np.testing.assert_allclose(null * np.sign(null[0]), [0.5, 0.5, -0.5, -0.5], rtol=0, atol=1e-13)


class BodyByBody:
    """Kinetic energy and wheel rates from the contact condition (2.2), each wheel by a 2 x 2 solve in NumPy."""

    def __init__(self, platform: Platform) -> None:
        self.platform = platform

    @staticmethod
    def contact_rates(wheel: Wheel, velocity: np.ndarray) -> tuple[float, float]:
        axle = np.array([-math.sin(wheel.mounting_angle), math.cos(wheel.mounting_angle), 0.0])
        delta = wheel.mounting_angle + wheel.roller_angle
        roller = np.array([math.cos(delta), math.sin(delta), 0.0])
        moving = [
            np.cross(axle, [0.0, 0.0, -wheel.radius])[:2],
            np.cross(roller, [0.0, 0.0, -wheel.roller_radius])[:2],
        ]
        x, y = wheel.position
        carried = velocity[:2] + velocity[2] * np.array([-y, x])
        phi, gamma = np.linalg.solve(np.column_stack(moving), -carried)
        return float(phi), float(gamma)

    def rates(self, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pairs = np.array([self.contact_rates(wheel, velocity) for wheel in self.platform.wheels])
        return pairs[:, 0], pairs[:, 1]

    def kinetic_energy(self, velocity: np.ndarray) -> float:
        """Translation of every mass centre, rotation of the rest of I_s, spin of the wheels."""
        p = self.platform
        masses = [p.mass, *(wheel.mass for wheel in p.wheels)]
        centers = [p.mass_center, *(wheel.position for wheel in p.wheels)]
        energy, rest = 0.0, p.yaw_inertia
        for mass, (x, y) in zip(masses, centers, strict=True):
            energy += mass * ((velocity[0] - y * velocity[2]) ** 2 + (velocity[1] + x * velocity[2]) ** 2) / 2
            rest -= mass * (x**2 + y**2)
        energy += rest * velocity[2] ** 2 / 2
        spins = self.rates(velocity)[0]
        return energy + sum(w.spin_inertia * spin**2 / 2 for w, spin in zip(p.wheels, spins, strict=True))

    def dissipation(self, velocity: np.ndarray) -> float:
        """sum mu_1 phi'^2 + mu_2 gamma'^2."""
        phi, gamma = self.rates(velocity)
        wheels = self.platform.wheels
        return float(
            sum(w.friction * a**2 + w.roller_friction * b**2 for w, a, b in zip(wheels, phi, gamma, strict=True))
        )


class TestMechanics:
    @given(data=st.data(), platform=platforms(), state=states())
    def test_forward_and_inverse_are_inverses_of_each_other(
        self, data: st.DataObject, platform: Platform, state: np.ndarray
    ) -> None:
        d = dynamics(platform)
        torque = data.draw(vectors(platform.wheel_count, 3.0))
        acceleration = column(d.forward(state, torque))[3:]
        wrench = column(d.inverse(state, acceleration))
        rates = np.abs(np.array(d.input_map(np.zeros(6))))
        scale = rates @ np.abs(torque) + np.abs(np.array(d.inverse(state, np.zeros(3)))[:, 0]) + 1e-3
        assert np.all(np.abs(wrench - np.array(d.input_map(np.zeros(6))) @ torque) <= 1e-12 * scale.max())
        again = column(d.forward(state, column(d.min_norm_torque(wrench))))[3:]
        inertia = np.array(d.inertia_matrix(np.zeros(6)))
        np.testing.assert_allclose(inertia @ again, inertia @ acceleration, rtol=0, atol=1e-11 * scale.max())

    @given(platform=platforms(), state=states())
    def test_kinetic_energy_is_the_sum_over_the_bodies(self, platform: Platform, state: np.ndarray) -> None:
        expected = BodyByBody(platform).kinetic_energy(state[3:])
        found = float(dynamics(platform).kinetic_energy(state))
        assert found == pytest.approx(expected, rel=1e-12, abs=1e-14)
        velocity = state[3:]
        inertia = np.array(dynamics(platform).inertia_matrix(np.zeros(6)))
        assert velocity @ inertia @ velocity / 2 == pytest.approx(expected, rel=1e-12, abs=1e-14)
        matrices = unpack(ca.DM(coefficients(platform)), platform.wheel_count)
        assert float(matrices.kinetic_energy(velocity)) == pytest.approx(expected, rel=1e-12, abs=1e-14)

    @given(data=st.data(), platform=platforms(), state=states())
    def test_kinetic_energy_grows_by_power_less_dissipation(
        self, data: st.DataObject, platform: Platform, state: np.ndarray
    ) -> None:
        # Section 1 of the energy identity: dT/dt = sum M_i phi_i' - pi'^T Z pi'.
        twin, d = BodyByBody(platform), dynamics(platform)
        torque = data.draw(vectors(platform.wheel_count, 3.0))
        velocity = state[3:]
        acceleration = column(d.forward(state, torque))[3:]
        # T is a quadratic form: its derivative along pi'' is a difference without truncation error.
        growth = (twin.kinetic_energy(velocity + acceleration) - twin.kinetic_energy(velocity - acceleration)) / 2
        powers = torque * twin.rates(velocity)[0]
        dissipation = twin.dissipation(velocity)
        scale = (
            np.abs(powers).sum()
            + dissipation
            + twin.kinetic_energy(velocity + acceleration)
            + twin.kinetic_energy(velocity - acceleration)
        )
        assert abs(growth - powers.sum() + dissipation) <= 1e-12 * (scale + 1e-3)
        friction = np.array(d.coefficients.friction)
        assert velocity @ friction @ velocity == pytest.approx(dissipation, rel=1e-12, abs=1e-13)
        np.testing.assert_allclose(column(d.friction(state)), -friction @ velocity, rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(column(d.wheel_power(state, torque)), powers, rtol=1e-12, atol=1e-11)
        assert float(d.power(state, torque)) == pytest.approx(powers.sum(), rel=1e-12, abs=1e-11)

    @given(platform=platforms(), state=states())
    def test_gyroscopic_forces_do_no_work(self, platform: Platform, state: np.ndarray) -> None:
        force = column(dynamics(platform).gyroscopic(state))
        total = platform.mass + sum(wheel.mass for wheel in platform.wheels)
        speed = np.linalg.norm(state[3:])
        assert abs(state[3:] @ force) <= 1e-12 * total * speed**3

    @given(platform=platforms(), velocity=vectors(3, 3.0), acceleration=vectors(3, 5.0))
    def test_accelerating_forces_are_lagranges_of_the_kinetic_energy(
        self, platform: Platform, velocity: np.ndarray, acceleration: np.ndarray
    ) -> None:
        # Euler-Poincare: d/dt dT/dpi' + (-Omega p_Y, Omega p_X, V_X p_Y - V_Y p_X), with p = dT/dpi' of the carried
        # masses only: the spin's kinetic energy belongs to coordinates of its own (no gyroscopic term).
        def momentum(v: np.ndarray, twin: BodyByBody) -> np.ndarray:
            unit = np.eye(3)
            return np.array([twin.kinetic_energy(v + e) - twin.kinetic_energy(v - e) for e in unit]) / 2

        twin = BodyByBody(platform)
        still = BodyByBody(
            Platform(
                mass=platform.mass,
                mass_center=platform.mass_center,
                yaw_inertia=platform.yaw_inertia,
                wheels=tuple(
                    Wheel(
                        position=w.position,
                        roller_angle=w.roller_angle,
                        radius=w.radius,
                        roller_radius=w.roller_radius,
                        mounting_angle=w.mounting_angle,
                        mass=w.mass,
                    )
                    for w in platform.wheels
                ),
            )
        )
        p_x, p_y, _ = momentum(velocity, still)
        v_x, v_y, omega = velocity
        turning = np.array([-omega * p_y, omega * p_x, v_x * p_y - v_y * p_x])
        state = np.concatenate([np.zeros(3), velocity])
        d = dynamics(platform)
        found = column(d.inverse(state, acceleration)) - column(d.inverse(state, np.zeros(3)))
        total = momentum(acceleration, twin)
        scale = np.abs(total).sum() + platform.mass + twin.kinetic_energy(velocity) + twin.kinetic_energy(acceleration)
        np.testing.assert_allclose(found, total, rtol=0, atol=1e-11 * scale)
        np.testing.assert_allclose(column(d.gyroscopic(state)), turning, rtol=0, atol=1e-11 * scale)

    @given(data=st.data(), platform=platforms())
    def test_min_norm_torques_give_their_wrench_and_null_torques_none(
        self, data: st.DataObject, platform: Platform
    ) -> None:
        d = dynamics(platform)
        wrench = data.draw(vectors(3, 50.0))
        transposed = np.array(d.input_map(np.zeros(6)))
        torque = column(d.min_norm_torque(wrench))
        scale = (np.abs(transposed) @ np.abs(torque)).max() + 1e-3
        np.testing.assert_allclose(transposed @ torque, wrench, rtol=0, atol=1e-11 * scale)
        # The pseudo-inverse is the definition of the solution of least norm.
        np.testing.assert_allclose(torque, np.linalg.pinv(transposed) @ wrench, rtol=1e-10, atol=1e-11)
        null = np.array(d.coefficients.null_torque)
        assert null.shape == (platform.wheel_count, platform.wheel_count - 3)
        np.testing.assert_allclose(null.T @ null, np.eye(null.shape[1]), rtol=0, atol=1e-13)
        assert np.max(np.abs(transposed @ null), initial=0.0) <= 1e-12 * np.abs(transposed).max()

    @given(numbers=youbot_overrides())
    def test_friction_stops_the_fastest_stopping_motion_within_the_friction_time(self, numbers: dict[str, Any]) -> None:
        # With the mass centre in O, A and Z are diagonal: three decoupled decays exp(-zeta t / m).
        numbers |= {"mass_center": (0.0, 0.0)}
        p = Paper(YouBot(**numbers))
        fastest = max(p.zeta_x / p.m_a, p.zeta_y / p.m_a, p.mu_omega / p.i_a)
        assert friction_time(youbot(**numbers)) == (pytest.approx(1 / fastest, rel=1e-12) if fastest else math.inf)


class TestCoefficients:
    @given(data=st.data(), platform=platforms(), state=states())
    def test_the_packed_matrices_give_the_same_dynamics_as_the_functions(
        self, data: st.DataObject, platform: Platform, state: np.ndarray
    ) -> None:
        d, packed = dynamics(platform), coefficients(platform)
        assert packed.shape == (packed_size(platform.wheel_count),)
        k = unpack(ca.DM(packed), platform.wheel_count)
        acceleration = data.draw(vectors(3, 5.0))
        torque = data.draw(vectors(platform.wheel_count, 3.0))
        wrench = column(d.inverse(state, acceleration))
        scale = np.abs(wrench).max() + 100
        np.testing.assert_allclose(column(k.wrench(state[3:], acceleration)), wrench, rtol=0, atol=1e-12 * scale)
        forward = column(d.forward(state, torque))[3:]
        np.testing.assert_allclose(column(k.acceleration(state[3:], torque)), forward, rtol=1e-10, atol=1e-9)
        np.testing.assert_array_equal(np.array(k.wheel_rates).T, np.array(d.input_map(np.zeros(6))))

    @given(data=st.data(), platform=platforms(), state=states())
    def test_one_function_of_the_packed_matrices_is_the_forward_dynamics_of_every_platform(
        self, data: st.DataObject, platform: Platform, state: np.ndarray
    ) -> None:
        torque = data.draw(vectors(platform.wheel_count, 3.0))
        rate = column(forward_function(platform.wheel_count)(coefficients(platform), state, torque))
        np.testing.assert_allclose(rate, column(dynamics(platform).forward(state, torque)), rtol=1e-10, atol=1e-9)

    def test_nobody_can_change_the_packed_matrices_of_a_platform(self) -> None:
        with pytest.raises(ValueError, match="read-only"):
            coefficients(youbot())[0] = 1.0


def derivative_cases() -> Iterator[tuple[str, str]]:
    """Every function with every one of its arguments."""
    for name, function in parametric_functions(4).items():
        for i in range(function.n_in()):
            yield name, function.name_in(i)


STATE = np.array([0.3, -0.2, 0.9, 0.7, -0.4, 0.8])
ARGUMENTS = {
    "state": STATE,
    "torque": np.array([0.7, -1.1, 0.4, 0.9]),
    "acceleration": np.array([0.5, 1.2, -0.6]),
    "wrench": np.array([20.0, -35.0, 8.0]),
}


def uneven_platform() -> Platform:
    """Four different wheels, so that no derivative vanishes by symmetry."""
    places = [(0.25, 0.14), (0.22, -0.16), (-0.24, 0.17), (-0.21, -0.13)]
    wheels = tuple(
        Wheel(
            position=place,
            mounting_angle=0.1 * i - 0.2,
            roller_angle=(-1) ** (i * (i + 1) // 2) * (0.7 + 0.05 * i),
            radius=0.05 + 0.002 * i,
            roller_radius=0.014 + 0.001 * i,
            mass=1.4 + 0.1 * i,
            spin_inertia=5e-3 + 1e-3 * i,
            friction=0.11 + 0.01 * i,
            roller_friction=5e-3 + 5e-4 * i,
        )
        for i, place in enumerate(places)
    )
    return Platform(mass=29.94, mass_center=(0.016, -0.026), yaw_inertia=5.0, wheels=wheels)


def central_difference(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fourth-order central differences, one column for each entry of x, and the step of each column."""
    columns, steps = [], 1e-3 * np.maximum(np.abs(x), 1e-2)
    for step, unit in zip(steps, np.eye(len(x)), strict=True):
        near, far = (function(x + k * step * unit) - function(x - k * step * unit) for k in (1, 2))
        columns.append((8 * near - far) / (12 * step))
    return np.column_stack(columns), steps


@pytest.fixture(scope="module")
def uneven() -> Dynamics:
    return dynamics(uneven_platform())


class TestJacobian:
    def arguments_of(self, of: str) -> list[str]:
        function = parametric_functions(4)[of]
        return [function.name_in(i) for i in range(function.n_in())][:-1]

    @pytest.mark.parametrize(("of", "wrt"), list(derivative_cases()))
    def test_every_derivative_is_that_of_finite_differences(self, uneven: Dynamics, of: str, wrt: str) -> None:
        values = {name: ARGUMENTS[name] for name in self.arguments_of(of)}
        values["parameters"] = uneven.platform.parameters()

        def evaluate(x: np.ndarray) -> np.ndarray:
            result = parametric_functions(4)[of](*(values | {wrt: x}).values())
            return np.array(result).ravel(order="F")

        expected, steps = central_difference(evaluate, values[wrt])
        found = np.array(uneven.jacobian(of, wrt).call([values[name] for name in self.arguments_of(of)])[0])
        assert found.shape == expected.shape
        # Truncation is relative to the derivative, rounding to the value over the step.
        rounding = 1e-13 * np.abs(evaluate(values[wrt])).max() / steps
        error = np.abs(found - expected) - 1e-8 * np.abs(expected) - rounding
        worst = np.unravel_index(np.argmax(error), error.shape)
        assert error[worst] <= 0, (worst, found[worst], expected[worst])

    @pytest.mark.parametrize("of", list(parametric_functions(4)))
    def test_a_single_parameter_is_its_column_of_all_parameters(self, uneven: Dynamics, of: str) -> None:
        arguments = [ARGUMENTS[name] for name in self.arguments_of(of)]
        whole = np.array(uneven.jacobian(of, "parameters").call(arguments)[0])
        names = parameter_names(4)
        assert whole.shape[1] == len(names) == len(set(names))
        for name in ("yaw_inertia", "wheel1_friction", "wheel3_roller_angle", "wheel4_roller_friction"):
            single = np.array(uneven.jacobian(of, name).call(arguments)[0])
            np.testing.assert_array_equal(single[:, 0], whole[:, names.index(name)])

    def test_derivatives_by_parameter_names_are_derivatives_by_the_fields_of_the_platform(self) -> None:
        # By building other youBots, so that order and meaning of the names are checked, too.
        base, d = youbot(), dynamics(youbot())
        acceleration = ARGUMENTS["acceleration"]

        def wrench(**changes: Any) -> np.ndarray:
            return column(dynamics(youbot(**changes)).inverse(STATE, acceleration))

        def derivative(name: str) -> np.ndarray:
            return column(d.jacobian("inverse", name)(STATE, acceleration))

        for field, parameter in [
            ("platform_mass", "platform_mass"),
            ("yaw_inertia", "yaw_inertia"),
            ("wheel_mass", "mass"),
            ("wheel_friction", "friction"),
            ("roller_friction", "roller_friction"),
            ("wheel_spin_inertia", "spin_inertia"),
            ("wheel_radius", "radius"),
            ("roller_radius", "roller_radius"),
        ]:
            value = getattr(YouBot(), field)
            step = 1e-3 * value
            near, far = (wrench(**{field: value + k * step}) - wrench(**{field: value - k * step}) for k in (1, 2))
            expected = (8 * near - far) / (12 * step)
            if parameter in parameter_names(4):
                found = derivative(parameter)
            else:
                found = sum(derivative(f"wheel{i}_{parameter}") for i in range(1, 1 + base.wheel_count))
            np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max(), err_msg=field)

    @pytest.mark.parametrize(
        ("of", "wrt", "near"),
        [
            ("invers", "state", "inverse"),
            ("wheel_rate", "state", "wheel_rates"),
            ("inverse", "stat", "state"),
            ("inverse", "acceleraton", "acceleration"),
            ("forward", "wheel1_frictoin", "wheel1_friction"),
            ("forward", "yaw_inerta", "yaw_inertia"),
            ("forward", "wheel5_radius", "wheel4_radius|wheel3_radius|wheel2_radius|wheel1_radius"),
        ],
    )
    def test_an_unknown_name_is_refused_with_the_nearest_valid_one(self, of: str, wrt: str, near: str) -> None:
        with pytest.raises(InputError, match=rf"^unknown .+; did you mean '({near})'\?"):
            dynamics(youbot()).jacobian(of, wrt)

    def test_a_name_like_no_other_is_refused_with_all_valid_ones(self) -> None:
        with pytest.raises(InputError, match=r"valid: .*forward, inverse"):
            dynamics(youbot()).jacobian("zzz", "state")
        with pytest.raises(InputError, match=r"'torque' of inverse|variable of inverse 'torque'"):
            dynamics(youbot()).jacobian("inverse", "torque")

    def test_an_unknown_attribute_is_an_attribute_error(self) -> None:
        with pytest.raises(AttributeError, match="no function 'backward'"):
            _ = dynamics(youbot()).backward
