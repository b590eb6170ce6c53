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
"""[W/(N m)^2] k of a youBot wheel: R_a / (k_t n)^2 with R_a = 0.942 ohm (nearest catalogue motor), k_t = 0.0335 N m/A,
gear ratio n = 25.84.  Confidence: low (the motor's resistance is a neighbour's)."""

Expression = Callable[[ca.SX, ca.SX], ca.SX]


@dataclass(frozen=True, kw_only=True)
class Objective:
    """J = integral of (work_share * sum M_i phi_i' + rest(M, phi')) dt.

    Signed work stands apart because it has an exact form without torques: change of kinetic energy plus dissipation.

    Args:
        name: as in experiment files.
        column: of the results, with its unit.
        unit: in words.
        equation: for people.
        work_share: factor of the signed work.
        rest: from torque (n,) [N m] and wheel rates (n,) [rad/s], CasADi; None where there is nothing else.
        kinks: expressions at whose sign changes `rest` is not smooth, a CasADi column; None where it is smooth.
    """

    name: str
    column: str
    unit: str
    equation: str
    work_share: float = 0.0
    rest: Expression | None = None
    kinks: Expression | None = None

    def integrand(self, torque: ca.SX, rates: ca.SX) -> ca.SX:
        """The exact integrand from torque (n,) [N m] and wheel rates (n,) [rad/s]."""
        value = self.work_share * ca.dot(torque, rates)
        return value + self.rest(torque, rates) if self.rest else value


def _power(torque: ca.SX, rates: ca.SX) -> ca.SX:
    return torque * rates


OBJECTIVES: dict[str, Objective] = {
    objective.name: objective
    for objective in (
        Objective(name="work", column="work_J", unit="J", equation="sum M_i phi_i'", work_share=1.0),
        Objective(
            name="positive_work",
            column="positive_work_J",
            unit="J",
            equation="sum max(M_i phi_i', 0)",
            rest=lambda m, w: ca.sum1(ca.fmax(_power(m, w), 0)),
            kinks=_power,
        ),
        Objective(
            name="absolute_work",
            column="absolute_work_J",
            unit="J",
            equation="sum |M_i phi_i'|",
            rest=lambda m, w: ca.sum1(ca.fabs(_power(m, w))),
            kinks=_power,
        ),
        Objective(
            name="bus_work",
            column="bus_work_J",
            unit="J",
            equation="max(sum M_i phi_i', 0)",
            rest=lambda m, w: ca.fmax(ca.dot(m, w), 0),
            kinks=ca.dot,
        ),
        Objective(
            name="torque_squared",
            column="torque_squared_N2m2s",
            unit="N^2 m^2 s",
            equation="sum M_i^2",
            rest=lambda m, _: ca.sumsqr(m),
        ),
        Objective(
            name="copper_loss",
            column="copper_loss_J",
            unit="J",
            equation="k sum M_i^2",
            rest=lambda m, _: COPPER_LOSS * ca.sumsqr(m),
        ),
        Objective(
            name="electric",
            column="electric_J",
            unit="J",
            equation="sum M_i phi_i' + k sum M_i^2",
            work_share=1.0,
            rest=lambda m, _: COPPER_LOSS * ca.sumsqr(m),
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
    expressions = [item.kinks(torque, rates) for item in OBJECTIVES.values() if item.kinks]
    columns = {str(kink): kink for expression in expressions for kink in ca.vertsplit(expression)}
    kinks = ca.vertcat(*columns.values())
    return ca.Function(
        "measures",
        [torque, rates],
        [ca.densify(integrands), ca.densify(kinks)],
        ["torque", "wheel_rates"],
        ["integrands", "kinks"],
    )
