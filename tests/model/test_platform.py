"""Platforms as data, what they refuse, and their kinematics against the paper and against the contact condition."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.errors import InputError
from occ.model.dynamics import dynamics
from occ.model.platform import Platform, Wheel, parameter_names, wheel_rate_matrix
from occ.model.presets import PRESETS, YouBot, youbot
from tests.strategies import angles, platforms, states, vectors

WHEEL: dict[str, Any] = {"position": (0.2, 0.1), "roller_angle": 0.7, "radius": 0.05, "roller_radius": 0.01}


def omni_wheel(angle: float, **changes: Any) -> Wheel:
    """A wheel 0.2 m from O that pushes along the tangent of the circle around O."""
    place = {"position": (0.2 * math.cos(angle), 0.2 * math.sin(angle)), "mounting_angle": angle + math.pi / 2}
    return Wheel(**({"roller_angle": 0.0, "radius": 0.05, "roller_radius": 0.01} | place | changes))


def three_wheels() -> tuple[Wheel, ...]:
    return tuple(omni_wheel(2 * math.pi * i / 3) for i in range(3))


BODY: dict[str, Any] = {"mass": 10.0, "mass_center": (0.0, 0.0), "yaw_inertia": 1.0}


class TestRefusals:
    @pytest.mark.parametrize("name", ["radius", "roller_radius"])
    @pytest.mark.parametrize("value", [0.0, -0.01, math.nan, math.inf, -math.inf, True, "0.05", None])
    def test_a_wheel_needs_positive_finite_radii(self, name: str, value: Any) -> None:
        with pytest.raises(InputError, match=rf"^Wheel: {name} should be .+, not "):
            Wheel(**(WHEEL | {name: value}))

    @pytest.mark.parametrize("name", ["mass", "spin_inertia", "friction", "roller_friction"])
    @pytest.mark.parametrize("value", [-1e-12, math.nan, math.inf, False, "1", None])
    def test_masses_and_frictions_of_a_wheel_are_not_negative(self, name: str, value: Any) -> None:
        with pytest.raises(InputError, match=rf"^Wheel: {name} should be .+, not "):
            Wheel(**(WHEEL | {name: value}))

    @pytest.mark.parametrize("name", ["roller_angle", "mounting_angle"])
    @pytest.mark.parametrize("value", [math.nan, math.inf, True, "0"])
    def test_angles_are_finite_numbers(self, name: str, value: Any) -> None:
        with pytest.raises(InputError, match=rf"^Wheel: {name} should be .*number, not "):
            Wheel(**(WHEEL | {name: value}))

    @pytest.mark.parametrize("value", [(0.1,), (0.1, 0.2, 0.3), (math.nan, 0.0), (0.0, True), 0.1, "ab", None])
    def test_positions_are_two_finite_numbers(self, value: Any) -> None:
        with pytest.raises(InputError, match=r"^Wheel: position should be a tuple"):
            Wheel(**(WHEEL | {"position": value}))
        with pytest.raises(InputError, match=r"^Platform: mass_center should be a tuple"):
            Platform(**(BODY | {"mass_center": value}), wheels=three_wheels())

    @pytest.mark.parametrize("name", ["mass", "yaw_inertia"])
    @pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, True, "1", None])
    def test_a_platform_needs_positive_finite_inertia(self, name: str, value: Any) -> None:
        with pytest.raises(InputError, match=rf"^Platform: {name} should be .+, not "):
            Platform(**(BODY | {name: value}), wheels=three_wheels())

    @pytest.mark.parametrize("quarter_turns", [-3, -1, 1, 3])
    def test_a_roller_axis_parallel_to_the_axle_is_refused(self, quarter_turns: int) -> None:
        with pytest.raises(InputError, match=r"^Wheel: roller_angle .+ parallel to the wheel's axle"):
            Wheel(**(WHEEL | {"roller_angle": quarter_turns * math.pi / 2}))

    def test_a_roller_is_smaller_than_its_wheel(self) -> None:
        Wheel(**(WHEEL | {"roller_radius": 0.05 * (1 - 1e-9)}))
        for value in (0.05, 0.0500001, 3.0):
            with pytest.raises(InputError, match=rf"^Wheel: roller_radius .+, 0\.05 m, not {value!r} m$"):
                Wheel(**(WHEEL | {"roller_radius": value}))

    @pytest.mark.parametrize("count", [0, 1, 2])
    def test_fewer_than_three_wheels_are_refused(self, count: int) -> None:
        with pytest.raises(InputError, match=rf"^Platform: {count} wheels .+ at least 3"):
            Platform(**BODY, wheels=three_wheels()[:count])

    @pytest.mark.parametrize("wheels", [None, 4, ("a", "b", "c"), (None, None, None)])
    def test_what_is_not_a_tuple_of_wheels_is_refused(self, wheels: Any) -> None:
        with pytest.raises(InputError, match=r"^Platform: wheels should be a tuple"):
            Platform(**BODY, wheels=wheels)

    def test_wheels_that_all_push_in_one_direction_are_refused(self) -> None:
        parallel = tuple(omni_wheel(2 * math.pi * i / 3, mounting_angle=0.4) for i in range(3))
        with pytest.raises(InputError, match=r"^Platform: the wheels' input map has rank below 3"):
            Platform(**BODY, wheels=parallel)

    @given(meeting=vectors(2, 0.5), turn=angles(), count=st.integers(3, 6))
    def test_wheels_whose_roller_axes_meet_in_one_point_are_refused(
        self, meeting: np.ndarray, turn: float, count: int
    ) -> None:
        # A force along such an axis has no moment about the meeting point.
        wheels = []
        for i in range(count):
            axis = turn + math.pi * i / count
            x, y = meeting + (0.1 + 0.05 * i) * np.array([math.cos(axis), math.sin(axis)])
            wheels.append(Wheel(**(WHEEL | {"position": (x, y), "mounting_angle": axis - WHEEL["roller_angle"]})))
        with pytest.raises(InputError, match=r"^Platform: the wheels' input map has rank below 3"):
            Platform(**BODY, wheels=tuple(wheels))

    def test_a_yaw_inertia_below_that_of_the_masses_distances_is_refused(self) -> None:
        # The paper's I_s = I_O + 4 (I_1 + m_1 (h^2 + l^2)), after (2.15), with I_C = I_1 = 0.
        least = 29.94 * (0.016**2 + 0.026**2) + 4 * 1.40 * (0.235**2 + 0.150**2)
        youbot(yaw_inertia=least * (1 + 1e-9))
        with pytest.raises(InputError, match=r"^Platform: yaw_inertia .+ should exceed"):
            youbot(yaw_inertia=least * (1 - 1e-9))
        with pytest.raises(InputError, match=r"^Platform: yaw_inertia .+ should exceed"):
            youbot(wheel_mass=100.0)

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            ("platform_mass", 0.0),
            ("platform_mass", -29.94),
            ("wheel_mass", -1.4),
            ("yaw_inertia", 0.0),
            ("wheel_spin_inertia", -1e-3),
            ("wheel_friction", math.nan),
            ("roller_friction", math.inf),
            ("half_track", 0.0),
            ("half_wheelbase", True),
            ("wheel_radius", 0),
            ("roller_radius", "0.014"),
            ("mass_center", (0.0, math.nan)),
            ("mass_center", (0.0,)),
        ],
    )
    def test_an_override_that_is_not_physical_is_refused_by_its_name(self, name: str, value: Any) -> None:
        with pytest.raises(InputError, match=rf"^YouBot: {name} should be .+, not "):
            youbot(**{name: value})


class TestYouBot:
    def test_its_numbers_are_those_of_equation_2_17(self) -> None:
        names, numbers = parameter_names(4), youbot().parameters()
        found = dict(zip(names, numbers, strict=True))
        body = {"platform_mass": 29.94, "mass_center_x": 0.016, "mass_center_y": -0.026, "yaw_inertia": 4.42}
        common = {"mass": 1.40, "spin_inertia": 5.87e-3, "friction": 0.110, "roller_friction": 5.78e-3}
        common |= {"radius": 0.0475, "roller_radius": 0.014, "mounting_angle": 0.0}
        # Section 2.1: delta_i, rho_Xi, rho_Yi.
        places = [(0.235, 0.150, -45), (0.235, -0.150, 45), (-0.235, 0.150, 45), (-0.235, -0.150, -45)]
        expected = dict(body)
        for i, (x, y, degrees) in enumerate(places, start=1):
            wheel = common | {"x": x, "y": y, "roller_angle": math.radians(degrees)}
            expected |= {f"wheel{i}_{name}": value for name, value in wheel.items()}
        assert found == expected

    def test_overrides_reach_the_platform_and_leave_the_rest_alone(self) -> None:
        changed = {
            "platform_mass": 20.0,
            "wheel_mass": 2.0,
            "yaw_inertia": 5.0,
            "wheel_spin_inertia": 0.01,
            "mass_center": (0.01, 0.02),
            "wheel_friction": 0.2,
            "roller_friction": 0.003,
            "half_track": 0.2,
            "half_wheelbase": 0.3,
            "wheel_radius": 0.06,
            "roller_radius": 0.02,
        }
        assert {*changed, "friction_scale"} == set(YouBot.__dataclass_fields__)
        assert youbot(friction_scale=2.0) == youbot(wheel_friction=0.22, roller_friction=0.01156)
        entries = {
            "platform_mass": ["platform_mass"],
            "yaw_inertia": ["yaw_inertia"],
            "mass_center": ["mass_center_x", "mass_center_y"],
        }
        per_wheel = {
            "wheel_mass": "mass",
            "wheel_spin_inertia": "spin_inertia",
            "wheel_friction": "friction",
            "roller_friction": "roller_friction",
            "half_track": "y",
            "half_wheelbase": "x",
            "wheel_radius": "radius",
            "roller_radius": "roller_radius",
        }
        entries |= {name: [f"wheel{i}_{wheel}" for i in range(1, 5)] for name, wheel in per_wheel.items()}
        names, before = parameter_names(4), youbot().parameters()
        for name, value in changed.items():
            after = youbot(**{name: value}).parameters()
            moved = [names[k] for k in np.flatnonzero(after != before)]
            assert moved == entries[name], name
            values = np.abs([after[names.index(entry)] for entry in entries[name]])
            np.testing.assert_array_equal(values, np.broadcast_to(value, values.shape))

    def test_zero_wheel_masses_and_frictions_are_legal(self) -> None:
        bare = youbot(wheel_mass=0.0, wheel_spin_inertia=0.0, wheel_friction=0.0, roller_friction=0.0)
        assert np.all(np.array(dynamics(bare).friction(np.ones(6))) == 0.0)
        # Without wheels m_a = m and I_a = I_s, after (2.15).
        inertia = np.array(dynamics(bare).inertia_matrix(np.zeros(6)))
        np.testing.assert_allclose(np.diag(inertia), [29.94, 29.94, 4.42], rtol=1e-15)

    def test_numpy_numbers_make_the_same_platform_as_python_numbers(self) -> None:
        assert youbot(platform_mass=np.float64(30.0), mass_center=np.array([0.0, 0.01])) == youbot(
            platform_mass=30, mass_center=(0.0, 0.01)
        )
        assert hash(youbot(platform_mass=np.float64(30.0))) == hash(youbot(platform_mass=30.0))

    def test_every_preset_builds_a_platform_and_names_unit_symbol_and_source_of_each_number(self) -> None:
        for name, preset in PRESETS.items():
            assert preset().platform().name == name
            for entry in preset.__dataclass_fields__.values():
                assert set(entry.metadata) >= {"unit", "symbol", "source"}, entry.name


class TestKinematics:
    def test_wheel_rates_are_the_matrix_c_phi_of_equation_2_4(self) -> None:
        h, l, radius = 0.235, 0.150, 0.0475
        c_phi = np.array([[1, -1, -h - l], [1, 1, l + h], [1, 1, -h - l], [1, -1, l + h]]) / radius
        platform = youbot()
        np.testing.assert_allclose(wheel_rate_matrix(platform), c_phi, rtol=1e-14)
        np.testing.assert_allclose(np.array(dynamics(platform).input_map(np.zeros(6))).T, c_phi, rtol=1e-14)
        rates = np.array(dynamics(platform).jacobian("wheel_rates", "state")(np.zeros(6)))
        np.testing.assert_allclose(rates, np.hstack([np.zeros((4, 3)), c_phi]), rtol=1e-14, atol=1e-13)

    def test_roller_rates_are_minus_the_printed_c_gamma(self) -> None:
        # Misprint 1 of the paper's errata: C_gamma after (2.4) lacks the minus sign that (2.4) itself has.
        h, roller_radius = 0.235, 0.014
        c_gamma = -math.sqrt(2) / roller_radius * np.array([[0, 1, h], [0, 1, h], [0, 1, -h], [0, 1, -h]])
        rates = np.array(dynamics(youbot()).jacobian("roller_rates", "state")(np.zeros(6)))
        np.testing.assert_allclose(rates, np.hstack([np.zeros((4, 3)), c_gamma]), rtol=1e-14, atol=1e-13)

    @given(platform=platforms(), state=states())
    def test_the_contact_points_do_not_slip(self, platform: Platform, state: np.ndarray) -> None:
        # (2.2) with three-dimensional cross products: v_O + Omega x r_OP + phi' a x r_CP + gamma' e x r_KP = 0.
        wheel_rates = np.array(dynamics(platform).wheel_rates(state))[:, 0]
        roller_rates = np.array(dynamics(platform).roller_rates(state))[:, 0]
        velocity = np.array([state[3], state[4], 0.0])
        yaw = np.array([0.0, 0.0, state[5]])
        for wheel, wheel_rate, roller_rate in zip(platform.wheels, wheel_rates, roller_rates, strict=True):
            axle = np.array([-math.sin(wheel.mounting_angle), math.cos(wheel.mounting_angle), 0.0])
            delta = wheel.mounting_angle + wheel.roller_angle
            roller = np.array([math.cos(delta), math.sin(delta), 0.0])
            terms = [
                velocity,
                np.cross(yaw, [*wheel.position, 0.0]),
                np.cross(wheel_rate * axle, [0.0, 0.0, -wheel.radius]),
                np.cross(roller_rate * roller, [0.0, 0.0, -wheel.roller_radius]),
            ]
            assert np.max(np.abs(np.sum(terms, axis=0))) <= 1e-13 * max(np.max(np.abs(terms)), 1e-3)

    @given(platform=platforms(), velocity=vectors(3, 3.0), turn=angles())
    def test_a_turned_body_frame_changes_no_wheel_rate(
        self, platform: Platform, velocity: np.ndarray, turn: float
    ) -> None:
        c, s = math.cos(turn), math.sin(turn)
        rotation = np.array([[c, -s], [s, c]])
        turned = Platform(
            mass=platform.mass,
            mass_center=tuple(rotation @ platform.mass_center),
            yaw_inertia=platform.yaw_inertia,
            wheels=tuple(
                Wheel(
                    position=tuple(rotation @ wheel.position),
                    mounting_angle=wheel.mounting_angle + turn,
                    roller_angle=wheel.roller_angle,
                    radius=wheel.radius,
                    roller_radius=wheel.roller_radius,
                )
                for wheel in platform.wheels
            ),
        )
        state = np.concatenate([np.zeros(3), velocity])
        turned_state = np.concatenate([np.zeros(3), rotation @ velocity[:2], velocity[2:]])
        for name in ("wheel_rates", "roller_rates"):
            rates = np.array(dynamics(platform).functions[name](state))
            turned_rates = np.array(dynamics(turned).functions[name](turned_state))
            scale = np.linalg.norm(velocity) / min(wheel.roller_radius for wheel in platform.wheels)
            np.testing.assert_allclose(turned_rates, rates, rtol=0, atol=1e-13 * scale)

    @given(platform=platforms())
    def test_the_closed_form_of_the_rank_check_is_the_derived_wheel_rate_matrix(self, platform: Platform) -> None:
        derived = np.array(dynamics(platform).input_map(np.zeros(6))).T
        np.testing.assert_allclose(wheel_rate_matrix(platform), derived, rtol=0, atol=1e-13 * np.abs(derived).max())
