"""What a motion costs: exact integrands, written once and used by the optimal controllers and by the referee.

To add an objective: write one `Objective` here and put it into `OBJECTIVES`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import casadi as ca

from occ.errors import InputError

COPPER_LOSS = 1.257
"""[W/(N m)^2] k of a youBot wheel: R_a / (k_t n)^2 with R_a = 0.942 ohm (nearest catalogue motor), k_t = 0.0335 N m/A and
gear ratio n = 25.84.  Confidence: low (the motor's resistance is a neighbour's)."""

Integrand = Callable[[ca.SX, ca.SX], ca.SX]


def _no_kinks(torque: ca.SX, rates: ca.SX) -> ca.SX:
    return ca.SX(0, 1)


@dataclass(frozen=True)
class Objective:
    """J = integral of integrand(M, phi') dt.

    Args:
        name: as in experiment files.
        column: of the results, with its unit.
        unit: in words.
        equation: for people.
        integrand: from torque (n,) [N m] and wheel rates (n,) [rad/s], CasADi.
        kinks: expressions at whose sign changes the integrand is not smooth, a CasADi column.
    """

    name: str
    column: str
    unit: str
    equation: str
    integrand: Integrand
    kinks: Integrand = _no_kinks


def _power(torque: ca.SX, rates: ca.SX) -> ca.SX:
    return torque * rates


OBJECTIVES: dict[str, Objective] = {
    objective.name: objective
    for objective in (
        Objective("work", "work_J", "J", "sum M_i phi_i'", lambda m, w: ca.dot(m, w)),
        Objective(
            "positive_work",
            "positive_work_J",
            "J",
            "sum max(M_i phi_i', 0)",
            lambda m, w: ca.sum1(ca.fmax(_power(m, w), 0)),
            _power,
        ),
        Objective(
            "absolute_work",
            "absolute_work_J",
            "J",
            "sum |M_i phi_i'|",
            lambda m, w: ca.sum1(ca.fabs(_power(m, w))),
            _power,
        ),
        Objective(
            "bus_work",
            "bus_work_J",
            "J",
            "max(sum M_i phi_i', 0)",
            lambda m, w: ca.fmax(ca.dot(m, w), 0),
            lambda m, w: ca.dot(m, w),
        ),
        Objective("torque_squared", "torque_squared_N2m2s", "N^2 m^2 s", "sum M_i^2", lambda m, w: ca.sumsqr(m)),
        Objective("copper_loss", "copper_loss_J", "J", "k sum M_i^2", lambda m, w: COPPER_LOSS * ca.sumsqr(m)),
        Objective(
            "electric",
            "electric_J",
            "J",
            "sum M_i phi_i' + k sum M_i^2",
            lambda m, w: ca.dot(m, w) + COPPER_LOSS * ca.sumsqr(m),
        ),
    )
}


def objective(name: str) -> Objective:
    """The objective of that name.

    Raises:
        InputError: an unknown name.
    """
    if name not in OBJECTIVES:
        raise InputError(f"unknown objective {name!r}; valid: {', '.join(OBJECTIVES)}")
    return OBJECTIVES[name]


@cache
def measure_function(wheel_count: int) -> ca.Function:
    """CasADi function (torque, wheel_rates) -> integrands of all objectives, and all kinks.

    Args:
        wheel_count: n.

    Returns:
        Function of torque (n,) and wheel_rates (n,) with outputs ``integrands`` (one each) and ``kinks`` (k,).
    """
    torque, rates = ca.SX.sym("torque", wheel_count), ca.SX.sym("wheel_rates", wheel_count)
    integrands = ca.vertcat(*(item.integrand(torque, rates) for item in OBJECTIVES.values()))
    # Several objectives share their kinks: the wheels' powers and their sum.
    columns = {str(kink): kink for item in OBJECTIVES.values() for kink in ca.vertsplit(item.kinks(torque, rates))}
    kinks = ca.vertcat(*columns.values())
    return ca.Function(
        "measures",
        [torque, rates],
        [ca.densify(integrands), ca.densify(kinks)],
        ["torque", "wheel_rates"],
        ["integrands", "kinks"],
    )
