"""What a motion on the circle costs, as trigonometric polynomials in psi~: dissipation and kinetic energy.

B keeps its program, so pi' = C Omega + V*, eq. (3.7), with V* = v (sin psi~, cos psi~, 0), v = R_B omega_B, eq. (4.2).
With u = psi~' = Omega - omega_B,

    dissipation      D = pi'^T Z pi' = Z Omega^2 + 2 d_2 Omega + d_1 = Z u^2 + 2 (Z omega_B + d_2) u + U(psi~)
    kinetic energy   T = J_a Omega^2 / 2 + k_1 Omega + k_0

where Z = C^T Z C = J_a xi_3, d_2 = C^T Z V*, d_1 = V*^T Z V*, U(psi~) = D(psi~, omega_B).  The term linear in u is the
rate of 2 (Z omega_B psi~ + G), G' = d_2, so that it integrates to a function of the end points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ.checks import Vector2
from occ.errors import InputError
from occ.model.platform import Platform
from occ.motion import Circle
from occ.task import Task
from occ.theory.coefficients import YawCoefficients, yaw_coefficients
from occ.theory.trigonometric import value


class CircleEnergy(NamedTuple):
    """Dissipation and kinetic energy on a circle; trigonometric polynomials as in `occ.theory.trigonometric`."""

    rate: np.ndarray  # [rad/s] omega_B
    friction: np.ndarray  # [N m s] Z = J_a xi_3, positive unless nothing resists a rotation about B
    inertia: np.ndarray  # [kg m^2] J_a
    power: np.ndarray  # (5, ...) [W] U, the dissipation at Omega = omega_B
    drag: np.ndarray  # (5, ...) [N m] d_2
    coupling: np.ndarray  # (5, ...) [N m s] k_1
    translation: np.ndarray  # (5, ...) [J] k_0, the kinetic energy at Omega = 0

    def dissipation(self, angle: np.ndarray | float, yaw_rate: np.ndarray | float) -> np.ndarray:
        """D(psi~, Omega) [W]."""
        u = np.asarray(yaw_rate) - self.rate
        linear = 2 * (self.friction * self.rate + value(self.drag, angle))
        return (self.friction * u + linear) * u + value(self.power, angle)

    def kinetic_energy(self, angle: np.ndarray | float, yaw_rate: np.ndarray | float) -> np.ndarray:
        """T(psi~, Omega) [J]."""
        omega = np.asarray(yaw_rate)
        return (self.inertia * omega / 2 + value(self.coupling, angle)) * omega + value(self.translation, angle)

    @property
    def rest_of_yaw(self) -> np.ndarray:
        """(5, ...) [J] T_min(psi~) = k_0 - k_1^2 / (2 J_a), the least kinetic energy over all yaw rates."""
        _, c, s, *_ = self.coupling
        size = 1 / (4 * self.inertia)
        zero = np.zeros_like(c)
        return self.translation - np.stack([(c * c + s * s), zero, zero, (c * c - s * s), 2 * c * s]) * size

    def of_end_points(self, angle: np.ndarray | float) -> np.ndarray:
        """2 (Z omega_B psi~ + G(psi~)) [J], the part of the dissipation that only the end points decide."""
        _, c, s, *_ = self.drag
        return 2 * (self.friction * self.rate * np.asarray(angle) + c * np.sin(angle) - s * np.cos(angle))


def circle_energy(c: YawCoefficients, radius: np.ndarray | float, rate: np.ndarray | float) -> CircleEnergy:
    """D = Z Omega^2 + 2 d_2 Omega + d_1 and T on circles, for any number of platforms and circles at once.

    Args:
        c: numbers or arrays that broadcast with the others.
        radius: [m] R_B.
        rate: [rad/s] omega_B.

    Returns:
        Arrays of the common shape.
    """
    *columns, radius, rate = np.broadcast_arrays(*c, radius, rate)
    c = YawCoefficients(*columns)
    speed = radius * rate
    zero = np.zeros_like(speed)
    friction = c.inertia * c.xi_3
    # C^T Z V* = J_a (xi_2 V_BX* - xi_1 V_BY*) and C^T A V* = J_a (kappa_12 V_BX* - kappa_11 V_BY*), eq. (3.9).
    drag = np.stack([zero, -c.xi_1 * c.inertia * speed, c.xi_2 * c.inertia * speed, zero, zero])
    coupling = np.stack([zero, -c.kappa_11 * c.inertia * speed, c.kappa_12 * c.inertia * speed, zero, zero])
    power = _quadratic(c.friction_xx, c.friction_xy, c.friction_yy) * speed**2 + 2 * rate * drag
    power[0] += friction * rate**2
    translation = _quadratic(c.mass_xx, c.mass_xy, c.mass_yy) * (speed**2 / 2)
    return CircleEnergy(rate, friction, c.inertia, power, drag, coupling, translation)


def _quadratic(xx: np.ndarray, xy: np.ndarray, yy: np.ndarray) -> np.ndarray:
    """(5, ...) xx sin^2 + 2 xy sin cos + yy cos^2."""
    zero = np.zeros_like(xx)
    return np.stack([(xx + yy) / 2, zero, zero, (yy - xx) / 2, xy])


def energy_of(platform: Platform, point: Vector2, circle: Circle) -> CircleEnergy:
    """The energies of one platform on one circle.

    Args:
        platform: any platform.
        point: (2,) [m] B in the body frame.
        circle: program motion of B.

    Returns:
        Numbers, each of shape () or (5,).
    """
    return circle_energy(yaw_coefficients(platform, point), circle.radius, circle.rate)


def circle_of(task: Task) -> Circle:
    """The task's program motion, if it is a circle.

    Raises:
        InputError: it is not.
    """
    if not isinstance(task.motion, Circle):
        raise InputError(
            f'motion.kind: {task.motion.kind}; should be "circle": the theory is of uniform circular motion'
        )
    return task.motion
