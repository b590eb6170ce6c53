"""The servo-constraint B pi' = V_B*, eqs. (3.1)-(3.9): motion of the platform while B keeps its program velocity.

Everything here is a function of the heading, the yaw rate and the program's velocity and acceleration on the floor, so
that it holds for any program motion.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca

from occ.model.coefficients import Coefficients, packed_size, unpack


class OnProgram(NamedTuple):
    """pi' = C Omega + V* and what of pi'' = C Omega' + rest is not the yaw acceleration, eq. (3.7)."""

    direction: ca.SX  # (3,) C, dpi'/dOmega
    velocity: ca.SX  # (3,) pi'
    rest: ca.SX  # (3,) dV*/dt, the pseudo-acceleration at Omega' = 0


def on_program(point: ca.SX, heading: ca.SX, yaw_rate: ca.SX, velocity: ca.SX, acceleration: ca.SX) -> OnProgram:
    """V_X = b_Y Omega + V_BX*, V_Y = -b_X Omega + V_BY*, eq. (3.6), and its derivative in time.

    Args:
        point: (2,) [m] B in the body frame.
        heading: [rad] psi.
        yaw_rate: [rad/s] Omega.
        velocity: (2,) [m/s] program velocity of B on the floor.
        acceleration: (2,) [m/s^2] program acceleration of B on the floor.

    Returns:
        Direction C, pseudo-velocity and the rest of the pseudo-acceleration.
    """
    c, s = ca.cos(heading), ca.sin(heading)
    v_x, v_y = c * velocity[0] + s * velocity[1], -s * velocity[0] + c * velocity[1]
    a_x, a_y = c * acceleration[0] + s * acceleration[1], -s * acceleration[0] + c * acceleration[1]
    direction = ca.vertcat(point[1], -point[0], 1)
    # d/dt of the body components: the body frame turns with the yaw rate.
    rest = ca.vertcat(a_x + yaw_rate * v_y, a_y - yaw_rate * v_x, 0)
    return OnProgram(direction, direction * yaw_rate + ca.vertcat(v_x, v_y, 0), rest)


def servo_yaw_acceleration(k: Coefficients, motion: OnProgram) -> ca.SX:
    """C^T A C Omega' + C^T (A dV*/dt + f + Z pi') = 0, eq. (3.8), solved for Omega' [rad/s^2]."""
    c = motion.direction
    return -ca.dot(c, k.wrench(motion.velocity, motion.rest)) / ca.bilin(k.inertia, c, c)


class PathSymbols(NamedTuple):
    """Arguments of the path-keeping functions, in this order, as symbols."""

    coefficients: ca.SX  # packed, see occ.model.coefficients
    point: ca.SX  # (2,)
    heading: ca.SX
    yaw_rate: ca.SX
    program_velocity: ca.SX  # (2,)
    program_acceleration: ca.SX  # (2,)

    @classmethod
    def create(cls, wheel_count: int) -> PathSymbols:
        """Fresh symbols for n wheels."""
        sizes = (packed_size(wheel_count), 2, 1, 1, 2, 2)
        return cls(*(ca.SX.sym(name, size) for name, size in zip(cls._fields, sizes, strict=True)))

    def on_program(self) -> OnProgram:
        """The motion at these symbols."""
        return on_program(self.point, self.heading, self.yaw_rate, self.program_velocity, self.program_acceleration)


@cache
def path_functions(wheel_count: int) -> dict[str, ca.Function]:
    """CasADi functions of a platform whose point B keeps its program velocity; arguments as in `PathSymbols`.

    Args:
        wheel_count: n.

    Returns:
        ``velocity`` -> pi' (3,); ``servo`` -> the law's yaw acceleration, eq. (3.9) [rad/s^2];
        ``wrench`` (.., yaw_acceleration) -> Pi_C (3,), eqs. (3.11)-(3.13) for the servo law's yaw acceleration;
        ``torque`` (.., yaw_acceleration, null_torque) -> M (n,) [N m].
    """
    s = PathSymbols.create(wheel_count)
    k = unpack(s.coefficients, wheel_count)
    motion = s.on_program()
    yaw_acceleration = ca.SX.sym("yaw_acceleration")
    null_torque = ca.SX.sym("null_torque", wheel_count - 3)
    wrench = k.wrench(motion.velocity, motion.direction * yaw_acceleration + motion.rest)
    torque = k.min_norm @ wrench + k.null_torque @ null_torque
    names = list(s._fields)
    return {
        "velocity": ca.Function("velocity", [*s], [motion.velocity], names, ["velocity"]),
        "servo": ca.Function("servo", [*s], [servo_yaw_acceleration(k, motion)], names, ["yaw_acceleration"]),
        "wrench": ca.Function("wrench", [*s, yaw_acceleration], [wrench], [*names, "yaw_acceleration"], ["wrench"]),
        "torque": ca.Function(
            "torque",
            [*s, yaw_acceleration, null_torque],
            [torque],
            [*names, "yaw_acceleration", "null_torque"],
            ["torque"],
        ),
    }
