"""What the wheels must deliver while B is on its circle: torques, speeds and powers of any rotation of the platform.

On a circle they depend on psi~ alone and not on time: with the program seen from its own radius the velocity of B is
(0, R_B omega_B) and its acceleration (-R_B omega_B^2, 0), and the heading is psi~.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ.checks import Vector2
from occ.model.coefficients import coefficients
from occ.model.constraint import path_functions
from occ.model.dynamics import dynamics
from occ.model.platform import Platform
from occ.numeric import evaluate_many


class WheelDemand(NamedTuple):
    """Of n wheels at N moments."""

    torque: np.ndarray  # (n, N) [N m] of least norm, eq. (3.13)
    speed: np.ndarray  # (n, N) [rad/s] eq. (2.4)
    power: np.ndarray  # (n, N) [W] torque times speed


def wheel_demand(
    platform: Platform, point: Vector2, circle: tuple[float, float], rotation: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> WheelDemand:
    """Pi_C = A pi'' + f + Z pi' on the circle, M = C_phi (C_phi^T C_phi)^-1 Pi_C, phi' = C_phi pi'.

    Args:
        platform: any platform.
        point: (2,) [m] B.
        circle: radius [m] and rate [rad/s] of the program motion.
        rotation: psi~ [rad], Omega [rad/s], Omega' [rad/s^2], each (N,).

    Returns:
        Torques, speeds and powers.

    Source: paper, eqs. (2.4), (3.6), (3.11)-(3.13).
    """
    radius, rate = circle
    psi, yaw_rate, yaw_acceleration = (np.asarray(value, dtype=float).reshape(1, -1) for value in rotation)
    functions = path_functions(platform.wheel_count)
    velocity, acceleration = np.array([0.0, radius * rate]), np.array([-radius * rate**2, 0.0])
    fixed = coefficients(platform), np.array(point)
    shared = (0, 1, 4, 5)
    (pseudo,) = evaluate_many(functions["velocity"], *fixed, psi, yaw_rate, velocity, acceleration, shared=shared)
    (torque,) = evaluate_many(
        functions["torque"],
        *fixed,
        psi,
        yaw_rate,
        velocity,
        acceleration,
        yaw_acceleration,
        np.zeros((platform.wheel_count - 3, psi.shape[1])),
        shared=shared,
    )
    speed = np.array(dynamics(platform).coefficients.wheel_rates) @ pseudo
    return WheelDemand(torque, speed, torque * speed)
