"""Platforms with default numbers beside the youBot, and platforms given wheel by wheel."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import occ
from occ.errors import InputError
from occ.experiment.schema import ExperimentFile
from occ.model.dynamics import dynamics
from occ.model.platform import Platform, Wheel, wheel_rate_matrix
from occ.model.presets import PLATFORMS, PRESETS, OmniRing, WheelByWheel, YouBot, omni3, youbot
from tests.strategies import reals, states

ROOT3 = math.sqrt(3.0)


def matrix(platform: Platform, name: str) -> np.ndarray:
    """A or Z (3, 3) of a platform."""
    return np.array(getattr(dynamics(platform).coefficients, name))


def turn(angle: float) -> np.ndarray:
    """(3, 3) Pseudo-velocities in a body frame that is turned by an angle."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


class TestOmniRing:
    @given(state=states())
    def test_each_wheel_turns_with_the_tangential_velocity_of_its_contact(self, state: np.ndarray) -> None:
        v_x, v_y, omega = state[3:]
        d, radius, roller = 0.200, 0.050, 0.008
        # Tangents at 60, 180 and 300 degrees: (-sin, cos); the rollers give way along (cos, sin).
        tangential = np.array([(-ROOT3 * v_x + v_y) / 2, -v_y, (ROOT3 * v_x + v_y) / 2]) + d * omega
        radial = np.array([(v_x + ROOT3 * v_y) / 2, -v_x, (v_x - ROOT3 * v_y) / 2])
        functions = dynamics(omni3())
        np.testing.assert_allclose(
            np.array(functions.wheel_rates(state)).ravel(), tangential / radius, rtol=0, atol=1e-12
        )
        rollers = np.array(functions.roller_rates(state)).ravel()
        np.testing.assert_allclose(np.abs(rollers), np.abs(radial) / roller, rtol=0, atol=1e-11)

    def test_places_of_the_wheels(self) -> None:
        wheels = omni3(ring_radius=0.3).wheels
        expected = [(0.15, 0.15 * ROOT3), (-0.3, 0.0), (0.15, -0.15 * ROOT3)]
        np.testing.assert_allclose([wheel.position for wheel in wheels], expected, rtol=0, atol=1e-15)
        np.testing.assert_allclose([wheel.mounting_angle for wheel in wheels], np.radians([150, 270, 390]), rtol=1e-15)
        assert all(wheel.roller_angle == 0.0 for wheel in wheels)

    @pytest.mark.parametrize("count", [3, 4, 5])
    @pytest.mark.parametrize("name", ["inertia", "friction"])
    def test_a_turn_from_wheel_to_wheel_changes_nothing(self, count: int, name: str) -> None:
        found = matrix(omni3(wheel_count=count), name)
        back = turn(2 * math.pi / count)
        np.testing.assert_allclose(back.T @ found @ back, found, rtol=0, atol=1e-13 * np.abs(found).max())

    def test_a_mass_center_off_the_middle_does_break_that_symmetry(self) -> None:
        found = matrix(omni3(mass_center=(0.05, 0.0)), "inertia")
        back = turn(2 * math.pi / 3)
        assert np.abs(back.T @ found @ back - found).max() > 0.1

    @given(
        count=st.integers(3, 6),
        d=reals(0.1, 0.5),
        mass=reals(2.0, 30.0),
        wheel_mass=reals(0.0, 1.0),
        spin=reals(0.0, 5e-3),
        friction=reals(0.0, 0.1),
        roller_friction=reals(0.0, 1e-3),
    )
    def test_inertia_and_friction_in_closed_form(
        self,
        count: int,
        d: float,
        mass: float,
        wheel_mass: float,
        spin: float,
        friction: float,
        roller_friction: float,
    ) -> None:
        radius, roller, yaw_inertia = 0.05, 0.008, 5.0
        platform = omni3(
            wheel_count=count,
            ring_radius=d,
            platform_mass=mass,
            wheel_mass=wheel_mass,
            yaw_inertia=yaw_inertia,
            wheel_spin_inertia=spin,
            wheel_friction=friction,
            roller_friction=roller_friction,
        )
        # Sums of squares of n >= 3 evenly spaced unit vectors: sum sin^2 = sum cos^2 = n / 2, mixed sums vanish.
        share = count / 2
        across = mass + count * wheel_mass + share * spin / radius**2
        about = yaw_inertia + count * spin * (d / radius) ** 2
        np.testing.assert_allclose(
            matrix(platform, "inertia"), np.diag([across, across, about]), rtol=1e-12, atol=1e-12
        )
        across = share * (friction / radius**2 + roller_friction / roller**2)
        about = count * friction * (d / radius) ** 2
        np.testing.assert_allclose(
            matrix(platform, "friction"), np.diag([across, across, about]), rtol=1e-12, atol=1e-12
        )

    def test_it_is_the_same_platform_by_each_name(self) -> None:
        assert occ.omni3() == omni3() == OmniRing().platform() == PRESETS["omni3"]().platform()
        assert (omni3().name, omni3(wheel_count=4).name) == ("omni3", "omni4")

    def test_its_default_numbers_say_that_they_are_assumed(self) -> None:
        for name, field in OmniRing.__dataclass_fields__.items():
            assert "assumption" in field.metadata["source"], name
            assert "not measured" in field.metadata["source"], name

    @pytest.mark.parametrize(
        ("name", "value"),
        [
            ("wheel_count", 2),
            ("wheel_count", 3.0),
            ("wheel_count", True),
            ("wheel_count", 101),
            ("ring_radius", 0.0),
            ("ring_radius", math.nan),
            ("platform_mass", -8.5),
            ("wheel_friction", -0.01),
            ("mass_center", (0.0, math.inf)),
            ("roller_radius", "0.008"),
        ],
    )
    def test_an_override_that_is_not_physical_is_refused_by_its_name(self, name: str, value: Any) -> None:
        with pytest.raises(InputError, match=rf"^OmniRing: {name} should be .+, not "):
            omni3(**{name: value})

    def test_wheels_too_far_out_for_the_yaw_inertia_are_refused(self) -> None:
        with pytest.raises(InputError, match=r"^Platform: yaw_inertia .+ should exceed"):
            omni3(ring_radius=0.5)


def test_the_youbot_is_what_it_was() -> None:
    # Its numbers are compared with eq. (2.17) in test_platform.py.
    assert PRESETS["youbot"] is YouBot
    assert youbot() == PRESETS["youbot"]().platform()
    assert (youbot().name, youbot().wheel_count) == ("youbot", 4)


class TestWheelByWheel:
    def table(self, platform: Platform, **changes: Any) -> dict[str, Any]:
        """The platform as plain tables, as TOML has them."""
        names = Wheel.__dataclass_fields__
        wheels = [{name: getattr(wheel, name) for name in names} for wheel in platform.wheels]
        for wheel in wheels:
            wheel["position"] = list(wheel["position"])
        body = {"platform_mass": platform.mass, "mass_center": list(platform.mass_center)}
        return body | {"preset": "wheels", "yaw_inertia": platform.yaw_inertia, "wheels": wheels} | changes

    def built(self, table: dict[str, Any]) -> Platform:
        """The platform of an experiment file with this table."""
        file = {
            "platform": table,
            "point": {"x": 0.1, "y": 0.0},
            "motion": {"kind": "line", "velocity": [0.1, 0.0]},
            "horizon": {"duration": 1.0},
            "controller": [{"name": "law", "kind": "servo"}],
        }
        validated = ExperimentFile.model_validate(file)
        # What is stored of a case is the same again.
        again = ExperimentFile.model_validate(validated.model_dump(mode="json", exclude_none=True))
        assert again.task().platform == validated.task().platform
        return validated.task().platform

    @pytest.mark.parametrize("platform", [youbot(), omni3(wheel_count=5)], ids=lambda platform: str(platform.name))
    def test_a_preset_can_be_written_wheel_by_wheel(self, platform: Platform) -> None:
        built = self.built(self.table(platform))
        assert built.name == "wheels"
        assert built.wheels == platform.wheels
        np.testing.assert_array_equal(built.parameters(), platform.parameters())
        np.testing.assert_array_equal(wheel_rate_matrix(built), wheel_rate_matrix(platform))

    def test_masses_frictions_and_mounting_of_a_wheel_may_be_left_out(self) -> None:
        table = self.table(omni3(wheel_count=4, wheel_mass=0.0))
        for name in ("mass", "spin_inertia", "friction", "roller_friction"):
            del table["wheels"][1][name]
        wheel = self.built(table).wheels[1]
        assert (wheel.mass, wheel.spin_inertia, wheel.friction, wheel.roller_friction) == (0.0, 0.0, 0.0, 0.0)

    @pytest.mark.parametrize(
        ("name", "value", "words"),
        [
            ("wheels", [], "at least 3 needed"),
            ("wheels", 3, "valid tuple"),
            ("wheels", [3, 4, 5], "valid dictionary"),
            ("yaw_inertia", True, "valid number"),
            ("platform_mass", 0.0, "greater than 0"),
            ("tyres", 4, "not permitted"),
        ],
    )
    def test_what_is_no_platform_is_refused(self, name: str, value: Any, words: str) -> None:
        with pytest.raises(ValueError, match=words) as caught:
            self.built(self.table(omni3(), **{name: value}))
        assert name in str(caught.value)

    @pytest.mark.parametrize(
        ("name", "value", "words"),
        [
            ("radius", -0.05, "greater than 0"),
            ("radius", True, "valid number"),
            ("position", [0.1], "Field required"),
            ("position", [0.1, math.nan], "finite number"),
            ("roller_angle", math.pi / 2, "parallel to the wheel's axle"),
            ("spokes", 5, "not permitted"),
        ],
    )
    def test_what_is_no_wheel_is_refused(self, name: str, value: Any, words: str) -> None:
        table = self.table(omni3())
        table["wheels"][1][name] = value
        with pytest.raises(ValueError, match=words) as caught:
            self.built(table)
        assert "wheels.1" in str(caught.value)

    def test_in_python_wheels_are_wheels(self) -> None:
        numbers: dict[str, Any] = {"platform_mass": 8.5, "mass_center": (0.0, 0.0), "yaw_inertia": 0.25}
        assert WheelByWheel(**numbers, wheels=omni3().wheels).platform().wheels == omni3().wheels
        with pytest.raises(InputError, match=r"^WheelByWheel: wheels should be a tuple whose entries are a Wheel"):
            WheelByWheel(**numbers, wheels=(1, 2, 3))

    def test_it_is_no_preset_as_it_has_no_numbers_of_its_own(self) -> None:
        assert set(PLATFORMS) - set(PRESETS) == {"wheels"}
