"""A wheeled omnidirectional platform as data: rigid body, wheels, viscous friction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from occ.checks import Angle, NonNegative, Positive, Vector2, check_fields
from occ.errors import InputError

WHEEL_PARAMETERS = (
    "x",
    "y",
    "mounting_angle",
    "roller_angle",
    "radius",
    "roller_radius",
    "mass",
    "spin_inertia",
    "friction",
    "roller_friction",
)
BODY_PARAMETERS = ("platform_mass", "mass_center_x", "mass_center_y", "yaw_inertia")


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A wheel with free rollers: contact without slipping v_P = 0, eq. (2.2).

    Args:
        position: (2,) [m] centre of the wheel (rho_X, rho_Y) in the body frame OXY.
        roller_angle: [rad] axis of the contacting roller, measured from the wheel's rolling direction
            (45 degrees in magnitude for a Mecanum wheel, 0 for an omni wheel).
        radius: [m] R, outer radius of the wheel.
        roller_radius: [m] r < R, radius of the roller's section at the contact.
        mounting_angle: [rad] rolling direction of the wheel, measured from the body axis OX.
        mass: [kg] m_1.
        spin_inertia: [kg m^2] J_1, about the wheel's axle.
        friction: [N m s] mu_1, viscous friction of the wheel's bearing and transmission.
        roller_friction: [N m s] mu_2, viscous friction of the roller's bearing.

    Raises:
        InputError: non-finite or non-physical numbers; a roller as large as its wheel, or with its axis parallel to the
            wheel's axle.

    Source: paper, section 2.1, Fig. 2.
    """

    position: Vector2
    roller_angle: Angle
    radius: Positive
    roller_radius: Positive
    mounting_angle: Angle = 0.0
    mass: NonNegative = 0.0
    spin_inertia: NonNegative = 0.0
    friction: NonNegative = 0.0
    roller_friction: NonNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.roller_radius < self.radius:
            # The roller's axis is at the distance R - r from the wheel's own.
            raise InputError(
                f"Wheel: roller_radius should be less than the wheel's radius, {self.radius!r} m, not "
                f"{self.roller_radius!r} m"
            )
        if abs(math.cos(self.roller_angle)) < 1e-9:
            raise InputError(
                f"Wheel: roller_angle {self.roller_angle!r} rad puts the roller axis parallel to the wheel's axle, so "
                "that the wheel cannot drive; it should differ from an odd multiple of pi/2"
            )


@dataclass(frozen=True, kw_only=True)
class Platform:
    """A rigid platform on wheels; pseudo-velocities (V_X, V_Y, Omega) of the geometric centre O, eq. (2.1).

    Args:
        mass: [kg] m, the platform without its wheels.
        mass_center: (2,) [m] (a_X, a_Y), centre of mass of the platform without wheels.
        yaw_inertia: [kg m^2] I_s, of platform and wheels together about the vertical through O.
        wheels: the wheels, at least three.
        name: for tables.

    Raises:
        InputError: non-finite or non-physical numbers; a wheel set whose input map has rank below 3.

    Source: paper, section 2.
    """

    mass: Positive
    mass_center: Vector2
    yaw_inertia: Positive
    wheels: tuple[Wheel, ...]
    name: str = "platform"

    def __post_init__(self) -> None:
        check_fields(self)
        if len(self.wheels) < 3:
            raise InputError(
                f"Platform: {len(self.wheels)} wheels cannot produce every planar wrench; at least 3 needed"
            )
        offsets = self.mass * math.hypot(*self.mass_center) ** 2
        offsets += sum(wheel.mass * math.hypot(*wheel.position) ** 2 for wheel in self.wheels)
        if not self.yaw_inertia > offsets:
            raise InputError(
                f"Platform: yaw_inertia {self.yaw_inertia!r} kg m^2 is the total about O and should exceed what the "
                f"masses' distances from O alone contribute, {offsets:.6g} kg m^2"
            )
        reach = max(math.hypot(*wheel.position) for wheel in self.wheels)
        rates = wheel_rate_matrix(self) / np.array([1.0, 1.0, max(reach, 1e-3)])
        singular = np.linalg.svd(rates, compute_uv=False)
        if singular[-1] < 1e-9 * singular[0]:
            raise InputError(
                "Platform: the wheels' input map has rank below 3, so that some wrench or motion is out of reach of "
                "every torque; change positions, mounting angles or roller angles"
            )

    @property
    def wheel_count(self) -> int:
        """n, the number of wheels."""
        return len(self.wheels)

    def parameters(self) -> np.ndarray:
        """All numbers of the platform in the order of `parameter_names`.

        Returns:
            (4 + 10 n,) [SI].
        """
        body = [self.mass, *self.mass_center, self.yaw_inertia]
        wheels = [
            [
                *wheel.position,
                wheel.mounting_angle,
                wheel.roller_angle,
                wheel.radius,
                wheel.roller_radius,
                wheel.mass,
                wheel.spin_inertia,
                wheel.friction,
                wheel.roller_friction,
            ]
            for wheel in self.wheels
        ]
        return np.concatenate([body, np.ravel(wheels)])


def parameter_names(wheel_count: int) -> tuple[str, ...]:
    """Names of the entries of `Platform.parameters`: the body's four, then ``wheel1_x`` and so on."""
    wheels = [f"wheel{i + 1}_{name}" for i in range(wheel_count) for name in WHEEL_PARAMETERS]
    return (*BODY_PARAMETERS, *wheels)


def wheel_rate_matrix(platform: Platform) -> np.ndarray:
    """phi' = C_phi pi', eq. (2.4), in closed form for the rank check that precedes any symbolic work.

    Returns:
        (n, 3) [1/m, 1/m, 1].
    """
    rows = []
    for wheel in platform.wheels:
        # Velocity of the contact along the direction in which the rollers cannot give way: their own axis.
        axis = wheel.mounting_angle + wheel.roller_angle
        e_x, e_y = math.cos(axis), math.sin(axis)
        x, y = wheel.position
        rows.append(np.array([e_x, e_y, x * e_y - y * e_x]) / (wheel.radius * math.cos(wheel.roller_angle)))
    return np.array(rows)
