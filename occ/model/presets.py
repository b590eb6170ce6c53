"""Families of platforms that an experiment file can name, each with its default numbers and their source.

To add a platform: write a dataclass with a `platform` method here and put it into `PRESETS`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from occ.checks import NonNegative, Positive, Vector2, check_fields
from occ.model.platform import Platform, Wheel

SOURCE = "paper, eq. (2.17)"


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

    def __post_init__(self) -> None:
        check_fields(self)

    def platform(self) -> Platform:
        """The platform with wheels 1 to 4 as in Fig. 2: front left, front right, rear left, rear right."""
        h, l = self.half_wheelbase, self.half_track  # noqa: E741  (the paper's symbols)
        corners = ((h, l, -1), (h, -l, 1), (-h, l, 1), (-h, -l, -1))
        wheels = tuple(
            Wheel(
                position=(x, y),
                roller_angle=sign * math.pi / 4,
                radius=self.wheel_radius,
                roller_radius=self.roller_radius,
                mass=self.wheel_mass,
                spin_inertia=self.wheel_spin_inertia,
                friction=self.wheel_friction,
                roller_friction=self.roller_friction,
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


PRESETS: dict[str, type] = {"youbot": YouBot}


def youbot(**overrides: Any) -> Platform:
    """The KUKA youBot with the numbers of eq. (2.17); any of them can be overridden by name.

    Raises:
        InputError: an override that is not physical.
    """
    return YouBot(**overrides).platform()
