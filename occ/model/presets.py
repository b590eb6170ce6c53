"""Families of platforms that an experiment file can name, each with its default numbers and their source.

To add a platform: write a dataclass with a `platform` method here and put it into `PRESETS`; one without default
numbers belongs into `PLATFORMS` only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any

from annotated_types import Ge, Le

from occ.checks import NonNegative, Positive, Vector2, check_fields
from occ.model.platform import Platform, Wheel

SOURCE = "paper, eq. (2.17)"
ASSUMED = "an assumption typical of a laboratory robot of 10 kg, not measured"
MOST_WHEELS = 100
"""More wheels than this on a ring are taken for a mistake."""


def _number(default: Any, unit: str, symbol: str, source: str = SOURCE) -> Any:
    """A field with default, unit, symbol and source, which `occ list platforms` prints."""
    return field(default=default, metadata={"unit": unit, "symbol": symbol, "source": source})


@dataclass(frozen=True, kw_only=True)
class YouBot:
    """KUKA youBot: four Mecanum wheels on a rectangle, rollers at 45 degrees, eq. (2.17) and Fig. 2 of the paper."""

    platform_mass: Positive = _number(29.94, "kg", "m")
    wheel_mass: NonNegative = _number(1.40, "kg", "m_1")
    yaw_inertia: Positive = _number(4.42, "kg m^2", "I_s")
    wheel_spin_inertia: NonNegative = _number(5.87e-3, "kg m^2", "J_1")
    mass_center: Vector2 = _number((0.016, -0.026), "m", "a_X, a_Y")
    wheel_friction: NonNegative = _number(0.110, "N m s", "mu_1")
    roller_friction: NonNegative = _number(5.78e-3, "N m s", "mu_2")
    half_track: Positive = _number(0.150, "m", "l")
    half_wheelbase: Positive = _number(0.235, "m", "h")
    wheel_radius: Positive = _number(0.0475, "m", "R")
    roller_radius: Positive = _number(0.014, "m", "r")
    friction_scale: NonNegative = _number(1.0, "1", "common factor of mu_1 and mu_2", "occ: frictions as given")

    def __post_init__(self) -> None:
        check_fields(self)

    def platform(self) -> Platform:
        """The platform with wheels 1 to 4 as in Fig. 2: front left, front right, rear left, rear right."""
        h, l = self.half_wheelbase, self.half_track
        corners = ((h, l, -1), (h, -l, 1), (-h, l, 1), (-h, -l, -1))
        wheels = tuple(
            Wheel(
                position=(x, y),
                roller_angle=sign * math.pi / 4,
                radius=self.wheel_radius,
                roller_radius=self.roller_radius,
                mass=self.wheel_mass,
                spin_inertia=self.wheel_spin_inertia,
                friction=self.wheel_friction * self.friction_scale,
                roller_friction=self.roller_friction * self.friction_scale,
            )
            for x, y, sign in corners
        )
        return Platform(
            mass=self.platform_mass,
            mass_center=self.mass_center,
            yaw_inertia=self.yaw_inertia,
            wheels=wheels,
            name="youbot",
        )


@dataclass(frozen=True, kw_only=True)
class OmniRing:
    """Omni wheels evenly on a ring about O, rolling along its tangent: wheel k at the angle (2 k - 1) pi / n from OX.

    Three wheels stand at 60, 180 and 300 degrees, so that the front lies between two of them.  The rollers let a wheel
    slide along the ring's radius (roller_angle 0); all wheels roll forwards where the platform turns to the left.
    """

    wheel_count: Annotated[int, Ge(3), Le(MOST_WHEELS)] = _number(3, "1", "n", ASSUMED)
    ring_radius: Positive = _number(0.200, "m", "distance of the wheels from O", ASSUMED)
    platform_mass: Positive = _number(8.50, "kg", "m", ASSUMED)
    wheel_mass: NonNegative = _number(0.50, "kg", "m_1", ASSUMED)
    yaw_inertia: Positive = _number(0.25, "kg m^2", "I_s", ASSUMED)
    wheel_spin_inertia: NonNegative = _number(1.5e-3, "kg m^2", "J_1", ASSUMED)
    mass_center: Vector2 = _number((0.0, 0.0), "m", "a_X, a_Y", ASSUMED)
    wheel_friction: NonNegative = _number(0.020, "N m s", "mu_1", ASSUMED)
    roller_friction: NonNegative = _number(2.0e-4, "N m s", "mu_2", ASSUMED)
    wheel_radius: Positive = _number(0.050, "m", "R", ASSUMED)
    roller_radius: Positive = _number(0.008, "m", "r", ASSUMED)

    def __post_init__(self) -> None:
        check_fields(self)

    def platform(self) -> Platform:
        """The platform with wheel 1 first to the left of the front, the others counter-clockwise after it."""
        angles = [(2 * k + 1) * math.pi / self.wheel_count for k in range(self.wheel_count)]
        wheels = tuple(
            Wheel(
                position=(self.ring_radius * math.cos(angle), self.ring_radius * math.sin(angle)),
                mounting_angle=angle + math.pi / 2,
                roller_angle=0.0,
                radius=self.wheel_radius,
                roller_radius=self.roller_radius,
                mass=self.wheel_mass,
                spin_inertia=self.wheel_spin_inertia,
                friction=self.wheel_friction,
                roller_friction=self.roller_friction,
            )
            for angle in angles
        )
        return Platform(
            mass=self.platform_mass,
            mass_center=self.mass_center,
            yaw_inertia=self.yaw_inertia,
            wheels=wheels,
            name=f"omni{self.wheel_count}",
        )


@dataclass(frozen=True, kw_only=True)
class WheelByWheel:
    """A platform of one's own, given wheel by wheel: any number of wheels from three at any place and angle.

    Args:
        platform_mass: [kg] m, the platform without its wheels.
        mass_center: (2,) [m] a_X, a_Y, of the platform without its wheels.
        yaw_inertia: [kg m^2] I_s, of platform and wheels together about the vertical through O.
        wheels: one table for each wheel.
    """

    platform_mass: Positive
    mass_center: Vector2
    yaw_inertia: Positive
    wheels: tuple[Wheel, ...]

    def __post_init__(self) -> None:
        check_fields(self)

    def platform(self) -> Platform:
        """The platform."""
        return Platform(
            mass=self.platform_mass,
            mass_center=self.mass_center,
            yaw_inertia=self.yaw_inertia,
            wheels=self.wheels,
            name="wheels",
        )


PRESETS: dict[str, type] = {"youbot": YouBot, "omni3": OmniRing}
PLATFORMS: dict[str, type] = PRESETS | {"wheels": WheelByWheel}
"""All that an experiment file can name: the presets, and what has no default numbers."""


def youbot(**overrides: Any) -> Platform:
    """The KUKA youBot with the numbers of eq. (2.17); any of them can be overridden by name.

    Raises:
        InputError: an override that is not physical.
    """
    return YouBot(**overrides).platform()


def omni3(**overrides: Any) -> Platform:
    """A small platform on three omni wheels at 120 degrees; any number of `OmniRing` can be overridden by name.

    Raises:
        InputError: an override that is not physical.
    """
    return OmniRing(**overrides).platform()
