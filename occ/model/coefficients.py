"""The constant matrices of a platform: A pi'' + f(pi') + Z pi' = C_phi^T M, eq. (2.16), packed into one vector.

Every symbolic expression of the upper rooms takes this vector as an argument.  So an optimal control problem that has
been built once is solved again for another mass, friction or wheel by writing other numbers into it.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from occ.model.appell import derive
from occ.model.platform import Platform

PLATFORMS = 32
"""Platforms whose matrices are remembered: sweeps over millions of platforms are no reason to keep them all."""


class Coefficients(NamedTuple):
    """The matrices of eq. (2.16), as CasADi expressions or numbers; n wheels."""

    inertia: ca.SX  # (3, 3) A
    gyroscopic: tuple[ca.SX, ca.SX, ca.SX]  # three (3, 3): f_k = 1/2 pi'^T H_k pi'
    friction: ca.SX  # (3, 3) Z, Pi_F = -Z pi'
    wheel_rates: ca.SX  # (n, 3) C_phi
    min_norm: ca.SX  # (n, 3) C_phi (C_phi^T C_phi)^-1, the line after eq. (3.13)
    null_torque: ca.SX  # (n, n - 3) orthonormal torques that produce no wrench

    def gyroscopic_force(self, velocity: ca.SX) -> ca.SX:
        """f = (1/2 pi'^T H_k pi')_k, eq. (2.16); pi' (3,), result (3,) [N, N, N m]."""
        return ca.vertcat(*(ca.bilin(h, velocity, velocity) / 2 for h in self.gyroscopic))

    def wrench(self, velocity: ca.SX, acceleration: ca.SX) -> ca.SX:
        """Pi_C = A pi'' + f + Z pi', eq. (2.16); pi', pi'' (3,), result (3,) [N, N, N m]."""
        return self.inertia @ acceleration + self.gyroscopic_force(velocity) + self.friction @ velocity

    def acceleration(self, velocity: ca.SX, torque: ca.SX) -> ca.SX:
        """pi'' = A^-1 (C_phi^T M - f - Z pi'), eq. (2.16); pi' (3,), M (n,), result (3,) [m/s^2, m/s^2, rad/s^2]."""
        force = self.wheel_rates.T @ torque - self.gyroscopic_force(velocity) - self.friction @ velocity
        return ca.solve(self.inertia, force)

    def kinetic_energy(self, velocity: ca.SX) -> ca.SX:
        """T = 1/2 pi'^T A pi' [J]; pi' (3,)."""
        return ca.bilin(self.inertia, velocity, velocity) / 2


def _shapes(wheel_count: int) -> list[tuple[int, int]]:
    n = wheel_count
    return [(3, 3)] * 5 + [(n, 3), (n, 3), (n, n - 3)]


@cache
def coefficient_function(wheel_count: int) -> ca.Function:
    """CasADi function (parameters) -> A, H_1, H_2, H_3, Z, C_phi, C_phi (C_phi^T C_phi)^-1.

    Args:
        wheel_count: n.

    Returns:
        The function ``coefficients``; its outputs are derivatives of the model of `derive`.
    """
    model = derive(wheel_count)
    forces = ca.substitute(model.inertial_force, model.acceleration, ca.SX.zeros(3))
    rates = ca.jacobian(model.wheel_rates, model.velocity)
    outputs = [
        ca.jacobian(model.inertial_force, model.acceleration),
        *(ca.hessian(forces[k], model.velocity)[0] for k in range(3)),
        -ca.jacobian(model.friction_force, model.velocity),
        rates,
        ca.solve(rates.T @ rates, rates.T).T,
    ]
    names = ["inertia", "gyroscopic_x", "gyroscopic_y", "gyroscopic_yaw", "friction", "wheel_rates", "min_norm"]
    dense = [ca.densify(output) for output in outputs]
    return ca.Function("coefficients", [model.parameters], dense, ["parameters"], names)


@lru_cache(maxsize=PLATFORMS)
def coefficients(platform: Platform) -> np.ndarray:
    """The packed matrices of one platform, the argument of `unpack`.

    Args:
        platform: any platform.

    Returns:
        (45 + 6 n + n (n - 3),) [SI], read-only.
    """
    matrices = [np.array(m) for m in coefficient_function(platform.wheel_count)(platform.parameters())]
    # The rows of V^T beyond the rank (3, checked by Platform) span the null space of C_phi^T.
    matrices.append(np.linalg.svd(matrices[5].T)[2][3:].T)
    packed = np.concatenate([m.ravel(order="F") for m in matrices])
    packed.setflags(write=False)
    return packed


def unpack(packed: ca.SX | ca.DM, wheel_count: int) -> Coefficients:
    """The matrices in a packed vector, symbolic or numeric.

    Args:
        packed: (45 + 6 n + n (n - 3),), `coefficients` or a symbol of that length.
        wheel_count: n.

    Returns:
        The matrices by name.
    """
    blocks, start = [], 0
    for rows, columns in _shapes(wheel_count):
        blocks.append(ca.reshape(packed[start : start + rows * columns], rows, columns))
        start += rows * columns
    inertia, h_1, h_2, h_3, friction, rates, min_norm, null = blocks
    return Coefficients(inertia, (h_1, h_2, h_3), friction, rates, min_norm, null)


def packed_size(wheel_count: int) -> int:
    """Length of the packed vector for n wheels."""
    return sum(rows * columns for rows, columns in _shapes(wheel_count))
