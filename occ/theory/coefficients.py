"""The coefficients (3.10) of the yaw equation, for any platform and any point B, many of them at once.

While B keeps its program, pi' = C Omega + V*, eq. (3.7), and everything that the theory needs of the platform are the
products of the matrices of eq. (2.16) with C and with the two translations.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from occ.checks import Vector2
from occ.model.appell import derive
from occ.model.coefficients import coefficient_function
from occ.model.platform import Platform
from occ.numeric import on_arrays

ROUNDING = 1e-14
"""A coupling that is smaller than this part of the largest one possible is taken for zero."""


class YawCoefficients(NamedTuple):
    """Coefficients of the yaw equation and of the dissipation; each a number or an array, in the order of CasADi's.

    Omega' + kappa_12 V_BX*' - kappa_11 V_BY*' - kappa_21 Omega V_BX* - kappa_22 Omega V_BY*
    + xi_2 V_BX* - xi_1 V_BY* + xi_3 Omega = 0, eq. (3.9), which keeps its form for any wheels.
    """

    inertia: np.ndarray  # [kg m^2] J_a = C^T A C
    kappa_11: np.ndarray  # [1/m]
    kappa_12: np.ndarray  # [1/m]
    kappa_21: np.ndarray  # [1/m]
    kappa_22: np.ndarray  # [1/m]
    xi_1: np.ndarray  # [1/(m s)]
    xi_2: np.ndarray  # [1/(m s)]
    xi_3: np.ndarray  # [1/s]
    friction_xx: np.ndarray  # [N s/m] zeta_X of eq. (2.11)
    friction_xy: np.ndarray  # [N s/m] zero for the paper's platform
    friction_yy: np.ndarray  # [N s/m] zeta_Y
    mass_xx: np.ndarray  # [kg] m_a of eq. (2.13)
    mass_xy: np.ndarray  # [kg] zero for the paper's platform
    mass_yy: np.ndarray  # [kg] m_a of eq. (2.14)

    def of(self, rows: np.ndarray | slice | int) -> YawCoefficients:
        """Those of some of the platforms and points."""
        return YawCoefficients(*(values[rows] for values in self))


@cache
def yaw_function(wheel_count: int) -> ca.Function:
    """CasADi function (parameters, point) -> the `YawCoefficients` as a column, from eqs. (2.16), (3.7), (3.8).

    Args:
        wheel_count: n.

    Returns:
        The function ``yaw_coefficients`` of the platform's numbers (4 + 10 n,), in the order of `parameter_names`, and
        the point B (2,) [m].
    """
    parameters = derive(wheel_count).parameters
    point = ca.SX.sym("point", 2)
    inertia, *gyroscopic, friction, _, _ = coefficient_function(wheel_count)(parameters)
    c = ca.vertcat(point[1], -point[0], 1)
    yaw_inertia = ca.bilin(inertia, c, c)
    coupling = inertia @ c
    drag = friction @ c
    # f is quadratic in pi'; of C^T f at C Omega + V* only the product of Omega and V* is left, since pi'^T f = 0.
    product = sum(c[k] * (gyroscopic[k] @ c) for k in range(3))
    drag_of_rotation = ca.bilin(friction, c, c)
    coupling, product = (_cleared(terms, inertia, yaw_inertia) for terms in (coupling, product))
    drag = _cleared(drag, friction, drag_of_rotation)
    numerators = (-coupling[1], coupling[0], -product[0], -product[1], -drag[1], drag[0], drag_of_rotation)
    column = ca.vertcat(
        yaw_inertia,
        ca.vertcat(*numerators) / yaw_inertia,
        *(friction[i, j] for i, j in ((0, 0), (0, 1), (1, 1))),
        *(inertia[i, j] for i, j in ((0, 0), (0, 1), (1, 1))),
    )
    return ca.Function(
        "yaw_coefficients", [parameters, point], [ca.densify(column)], ["parameters", "point"], ["coefficients"]
    )


def _cleared(coupling: ca.SX, translation: ca.SX, rotation: ca.SX) -> ca.SX:
    """Couplings of translation and rotation without what rounding leaves of a sum over the wheels that cancels."""
    noise = [ROUNDING * ca.sqrt(translation[i, i] * rotation) for i in range(2)]
    return ca.vertcat(*(ca.if_else(ca.fabs(coupling[i]) <= noise[i], 0, coupling[i]) for i in range(2)))


def yaw_coefficients(platform: Platform, point: Vector2) -> YawCoefficients:
    """Eq. (3.10) for one platform and point B.

    Args:
        platform: any platform.
        point: (2,) [m] B in the body frame.

    Returns:
        Numbers, each of shape ().
    """
    column = np.array(yaw_function(platform.wheel_count)(platform.parameters(), point))[:, 0]
    return YawCoefficients(*(np.asarray(value) for value in column))


def yaw_coefficients_many(wheel_count: int, parameters: np.ndarray, point: np.ndarray) -> YawCoefficients:
    """Eq. (3.10) for many platforms or points.

    Args:
        wheel_count: n.
        parameters: (4 + 10 n, N) [SI] or (4 + 10 n,), the same for all.
        point: (2, N) [m] or (2,), the same for all; one of the two has columns.

    Returns:
        Arrays (N,).
    """
    (columns,) = on_arrays(yaw_function(wheel_count), parameters, point)
    return YawCoefficients(*columns)
