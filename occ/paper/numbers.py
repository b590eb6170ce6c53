"""The derived numbers that the paper prints, each as an expression of the parameters (2.17)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from occ.paper.printed import Printed
from occ.theory import CircleQuantities, YawCoefficients, circle_function, yaw_function

POINT = (0.40, 0.05)
"""[m] B in sections 4.1, 4.2 and 5."""
RATE = -0.4
"""[rad/s] omega_B, likewise."""
RADIUS = 0.7
"""[m] R_B of section 4.1, 4.3 and 5."""
PHASE = math.pi / 2
"""[rad] phi_B, likewise."""
WHEELS = 4
CENTIMETRE, KILOMETRE = -2, 3
"""Powers of ten of the printed units."""

Expression = Callable[[ca.SX], ca.SX]
"""From the platform's numbers (44,) to a quantity in SI units."""


@dataclass(frozen=True)
class PrintedNumber:
    """A number that follows from (2.17).

    Args:
        equation: and section, where it is printed.
        quantity: what it is, with its unit.
        printed: its digits.
        value: how it follows.
    """

    equation: str
    quantity: str
    printed: Printed
    value: Expression


def circle(numbers: ca.SX, point: ca.SX | tuple[float, float] = POINT, radius: float = RADIUS) -> CircleQuantities:
    """Eqs. (4.4)-(4.9) as expressions of the platform's numbers.

    Args:
        numbers: (44,) in the order of `occ.model.platform.parameter_names`.
        point: (2,) [m] B.
        radius: [m] R_B.

    Returns:
        Scalar expressions.
    """
    coefficients = yaw_function(WHEELS)(numbers, ca.vertcat(*point) if isinstance(point, tuple) else point)
    return CircleQuantities(*ca.vertsplit(circle_function()(coefficients, radius, RATE)))


def symbolic_singular_point(numbers: ca.SX) -> ca.SX:
    """The point B with xi_1 + kappa_22 omega_B = 0 = xi_2 - kappa_21 omega_B, section 4.3.

    Times J_a both conditions are linear in b: they are solved as such, without the formula (4.20).

    Args:
        numbers: (44,) of the platform.

    Returns:
        (2,) [m].
    """
    b = ca.SX.sym("b", 2)
    c = YawCoefficients(*ca.vertsplit(yaw_function(WHEELS)(numbers, b)))
    conditions = c.inertia * ca.vertcat(c.xi_1 + c.kappa_22 * RATE, c.xi_2 - c.kappa_21 * RATE)
    # Not at b = 0, where the theory takes couplings of the size of rounding for zero.
    anywhere = ca.SX([0.01, 0.01])
    matrix, value = (ca.substitute(item, b, anywhere) for item in (ca.jacobian(conditions, b), conditions))
    return anywhere - ca.solve(matrix, value)


def _critical_radius(numbers: ca.SX) -> ca.SX:
    return circle(numbers).critical_radius


def _critical_speed(numbers: ca.SX) -> ca.SX:
    return circle(numbers).critical_speed


PRINTED_POINT = (Printed("0.09", CENTIMETRE), Printed("0.1", CENTIMETRE))
"""The point (4.20) as printed."""

PRINTED_NUMBERS: tuple[PrintedNumber, ...] = (
    PrintedNumber("(4.5), section 4.1", "R~_B [m]", Printed("0.65"), _critical_radius),
    PrintedNumber("(4.5), section 4.1 after (4.8)", "V~_B [m/s]", Printed("26.58"), _critical_speed),
    PrintedNumber("(4.5), section 4.1, example", "V~_B [m/s]", Printed("26.58"), _critical_speed),
    PrintedNumber(
        "(4.6), section 4.1",
        "psi~_s, stable, at R_B = 0.7 m [rad]",
        Printed("-0.48"),
        lambda numbers: circle(numbers).stable_heading,
    ),
    PrintedNumber("(4.5), section 4.2 before Fig. 6", "R~_B [m]", Printed("0.65"), _critical_radius),
    PrintedNumber("(4.5), section 4.2 before Fig. 8", "R~_B [m]", Printed("0.6485"), _critical_radius),
    PrintedNumber(
        "(4.6), section 4.2 before Fig. 8",
        "psi~_s = -alpha at R_B = R~_B [rad]",
        Printed("-0.10"),
        lambda numbers: -circle(numbers).alpha,
    ),
    PrintedNumber(
        "(4.20), section 4.3", "b_X [cm]", PRINTED_POINT[0], lambda numbers: symbolic_singular_point(numbers)[0]
    ),
    PrintedNumber(
        "(4.20), section 4.3", "b_Y [cm]", PRINTED_POINT[1], lambda numbers: symbolic_singular_point(numbers)[1]
    ),
    PrintedNumber(
        "(4.5), section 4.3",
        "V~_B at the point (4.20) [km/s]",
        Printed("2.9", KILOMETRE),
        lambda numbers: circle(numbers, symbolic_singular_point(numbers)).critical_speed,
    ),
    PrintedNumber(
        "(4.5), section 4.3",
        "V~_B at the point (4.20) as printed, b = (0.09, 0.1) cm [km/s]",
        Printed("2.9", KILOMETRE),
        lambda numbers: circle(numbers, (PRINTED_POINT[0].si, PRINTED_POINT[1].si)).critical_speed,
    ),
)
