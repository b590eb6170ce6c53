"""Appell's equations dS/d(pi'') = Pi_F + Pi_C, eq. (2.5), derived by CasADi from the energy of accelerations S.

Nothing here is copied from the paper's final equations (2.13)-(2.15): wheel and roller rates are solved from the
contact condition (2.2), S is written down body by body, and CasADi differentiates it.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca

from occ.model.platform import BODY_PARAMETERS, WHEEL_PARAMETERS, parameter_names


class WheelSymbols(NamedTuple):
    """The numbers of one wheel as symbols, in the order of `WHEEL_PARAMETERS`."""

    x: ca.SX
    y: ca.SX
    mounting_angle: ca.SX
    roller_angle: ca.SX
    radius: ca.SX
    roller_radius: ca.SX
    mass: ca.SX
    spin_inertia: ca.SX
    friction: ca.SX
    roller_friction: ca.SX


class Derivation(NamedTuple):
    """The symbolic model of a platform with n wheels.

    ``velocity`` is pi' = (V_X, V_Y, Omega), ``acceleration`` is pi''; ``inertial_force`` = dS/d(pi'') = A pi'' + f.
    """

    parameters: ca.SX  # (4 + 10 n,)
    velocity: ca.SX  # (3,)
    acceleration: ca.SX  # (3,)
    wheel_rates: ca.SX  # (n,) phi'
    roller_rates: ca.SX  # (n,) gamma'
    kinetic_energy: ca.SX  # T, scalar
    inertial_force: ca.SX  # (3,)
    friction_force: ca.SX  # (3,) Pi_F


def _contact_rates(wheel: WheelSymbols, velocity: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Solve v_P = v_O + Omega x r + phi' a x (0, 0, -R) + gamma' e x (0, 0, -r) = 0, eq. (2.2), for phi' and gamma'."""
    rolling = wheel.mounting_angle
    roller = wheel.mounting_angle + wheel.roller_angle
    v_x = velocity[0] - velocity[2] * wheel.y
    v_y = velocity[1] + velocity[2] * wheel.x
    # The axle a is the rolling direction turned by +90 degrees, so a x (0, 0, -R) = -R (rolling direction).
    columns = ca.horzcat(
        -wheel.radius * ca.vertcat(ca.cos(rolling), ca.sin(rolling)),
        wheel.roller_radius * ca.vertcat(-ca.sin(roller), ca.cos(roller)),
    )
    rates = ca.solve(columns, -ca.vertcat(v_x, v_y))
    return rates[0], rates[1]


def _point_acceleration(velocity: ca.SX, acceleration: ca.SX, x: ca.SX, y: ca.SX) -> ca.SX:
    """Acceleration of the body's point (x, y), in body axes: the w_C of eq. (2.7)."""
    v_x, v_y, omega = ca.vertsplit(velocity)
    a_x, a_y, epsilon = ca.vertsplit(acceleration)
    return ca.vertcat(
        a_x - y * epsilon - omega * (v_y + x * omega),
        a_y + x * epsilon + omega * (v_x - y * omega),
    )


@cache
def derive(wheel_count: int) -> Derivation:
    """S = 1/2 {m w_C^2 + I_C Omega'^2} + sum 1/2 {m_1 w_Ci^2 + I_1 Omega'^2 + J_1 phi_i''^2}, eqs. (2.6)-(2.9).

    Args:
        wheel_count: n; all numbers of the platform stay symbols, so one derivation serves every platform with n wheels.

    Returns:
        The symbolic model; built once for each n.

    Source: paper, section 2.2.
    """
    names = parameter_names(wheel_count)
    parameters = ca.SX.sym("parameters", len(names))
    mass, center_x, center_y, yaw_inertia = ca.vertsplit(parameters[: len(BODY_PARAMETERS)])
    size = len(WHEEL_PARAMETERS)
    wheels = [
        WheelSymbols(*ca.vertsplit(parameters[len(BODY_PARAMETERS) + i * size : len(BODY_PARAMETERS) + (i + 1) * size]))
        for i in range(wheel_count)
    ]
    velocity = ca.SX.sym("velocity", 3)
    acceleration = ca.SX.sym("acceleration", 3)
    rates = [_contact_rates(wheel, velocity) for wheel in wheels]
    wheel_rates = ca.vertcat(*(rate[0] for rate in rates))
    roller_rates = ca.vertcat(*(rate[1] for rate in rates))
    wheel_accelerations = ca.jtimes(wheel_rates, velocity, acceleration)

    # I_s is the total about O; what the centres' distances from O do not account for is I_C + sum I_1.
    central_inertia = yaw_inertia - mass * (center_x**2 + center_y**2)
    central_inertia -= sum(wheel.mass * (wheel.x**2 + wheel.y**2) for wheel in wheels)
    center = _point_acceleration(velocity, acceleration, center_x, center_y)
    energy = mass * ca.sumsqr(center) + central_inertia * acceleration[2] ** 2
    for i, wheel in enumerate(wheels):
        energy += wheel.mass * ca.sumsqr(_point_acceleration(velocity, acceleration, wheel.x, wheel.y))
        energy += wheel.spin_inertia * wheel_accelerations[i] ** 2
    inertial_force = ca.gradient(energy / 2, acceleration)
    inertia = ca.jacobian(inertial_force, acceleration)

    # Virtual work of the bearing torques -mu_1 phi' and -mu_2 gamma', eq. (2.11) with mu_2 in its second term.
    dissipation = sum(
        wheel.friction * wheel_rates[i] ** 2 + wheel.roller_friction * roller_rates[i] ** 2
        for i, wheel in enumerate(wheels)
    )
    return Derivation(
        parameters=parameters,
        velocity=velocity,
        acceleration=acceleration,
        wheel_rates=wheel_rates,
        roller_rates=roller_rates,
        kinetic_energy=ca.bilin(inertia, velocity, velocity) / 2,
        inertial_force=inertial_force,
        friction_force=-ca.gradient(dissipation / 2, velocity),
    )
