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
    """J = integral of (work_share sum M_i phi_i' + rest + clipped_share sum_j max(clipped_j, 0)) dt, or a peak.

    Signed work stands apart because it has an exact form without torques: change of kinetic energy plus dissipation.
    The clipped powers stand apart because their positive parts have an exact smooth form for an optimal controller:
    slacks p >= 0 with p - clipped >= 0 that are minimised.

    Args:
        name: as in experiment files.
        column: of the results, with its unit.
        unit: in words.
        equation: of the integrand, or of what is largest, for people.
        work_share: factor of the signed work.
        rest: smooth part from torque (n,) [N m] and wheel rates (n,) [rad/s], CasADi; None where there is none.
        clipped: column of powers of which only the positive parts count; None where there are none.
        clipped_share: factor of these positive parts.
        signed: name of the objective in which they count with their signs instead, and which is nowhere larger; None
            where there are none.
        regular: the integrand has curvature in every torque that makes a wrench, so that optimal torques are bounded.
        largest: the cost is the largest |M_i| over wheels and time, and no integral.
        wheel_by_wheel: other torques than those of least norm may be better for the same wrench.
    """

    name: str
    column: str
    unit: str
    equation: str
    work_share: float = 0.0
    rest: Expression | None = None
    clipped: Expression | None = None
    clipped_share: float = 1.0
    signed: str | None = None
    regular: bool = False
    largest: bool = False
    wheel_by_wheel: bool = False

    @property
    def meaning(self) -> str:
        """What the column of the results holds."""
        return self.equation if self.largest else f"integral of {self.equation} dt"

    def integrand(self, torque: ca.SX, rates: ca.SX) -> ca.SX:
        """The exact integrand from torque (n,) [N m] and wheel rates (n,) [rad/s]."""
        value = self.work_share * ca.dot(torque, rates)
        if self.rest:
            value += self.rest(torque, rates)
        if self.clipped:
            value += self.clipped_share * ca.sum1(ca.fmax(self.clipped(torque, rates), 0))
        return value


def _power(torque: ca.SX, rates: ca.SX) -> ca.SX:
    return torque * rates


def _copper_loss(torque: ca.SX, _: ca.SX) -> ca.SX:
    return COPPER_LOSS * ca.sumsqr(torque)


OBJECTIVES: dict[str, Objective] = {
    objective.name: objective
    for objective in (
        Objective(name="work", column="work_J", unit="J", equation="sum M_i phi_i'", work_share=1.0),
        Objective(
            name="positive_work",
            column="positive_work_J",
            unit="J",
            equation="sum max(M_i phi_i', 0)",
            clipped=_power,
            signed="work",
            wheel_by_wheel=True,
        ),
        Objective(
            name="absolute_work",
            column="absolute_work_J",
            unit="J",
            equation="sum |M_i phi_i'|",
            # |P| = 2 max(P, 0) - P; a quadrature of -P would reward torques that oscillate between the nodes.
            work_share=-1.0,
            clipped=_power,
            clipped_share=2.0,
            signed="work",
            wheel_by_wheel=True,
        ),
        Objective(
            name="bus_work",
            column="bus_work_J",
            unit="J",
            equation="max(sum M_i phi_i', 0)",
            clipped=ca.dot,
            signed="work",
        ),
        Objective(
            name="torque_squared",
            column="torque_squared_N2m2s",
            unit="N^2 m^2 s",
            equation="sum M_i^2",
            rest=lambda m, _: ca.sumsqr(m),
            regular=True,
        ),
        Objective(
            name="copper_loss",
            column="copper_loss_J",
            unit="J",
            equation="k sum M_i^2",
            rest=_copper_loss,
            regular=True,
        ),
        Objective(
            name="electric",
            column="electric_J",
            unit="J",
            equation="sum M_i phi_i' + k sum M_i^2",
            work_share=1.0,
            rest=_copper_loss,
            regular=True,
        ),
        Objective(
            name="electric_drawn",
            column="electric_drawn_J",
            unit="J",
            equation="max(sum M_i phi_i' + k sum M_i^2, 0)",
            clipped=lambda m, w: ca.dot(m, w) + _copper_loss(m, w),
            signed="electric",
        ),
        Objective(
            name="peak_torque",
            column="peak_torque_Nm",
            unit="N m",
            equation="largest |M_i| over wheels and time",
            largest=True,
            wheel_by_wheel=True,
        ),
    )
}
INTEGRALS: dict[str, Objective] = {name: item for name, item in OBJECTIVES.items() if not item.largest}
"""The objectives that are integrals over time."""


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
    """CasADi function (torque, wheel_rates) -> integrands of all `INTEGRALS`, and all kinks.

    Args:
        wheel_count: n.

    Returns:
        Function of torque (n,) and wheel_rates (n,) with outputs ``integrands`` (one each) and ``kinks`` (k,).
    """
    torque, rates = ca.SX.sym("torque", wheel_count), ca.SX.sym("wheel_rates", wheel_count)
    integrands = ca.vertcat(*(item.integrand(torque, rates) for item in INTEGRALS.values()))
    # The clipped powers change their sign there; several objectives share theirs.
    expressions = [item.clipped(torque, rates) for item in INTEGRALS.values() if item.clipped]
    columns = {str(kink): kink for expression in expressions for kink in ca.vertsplit(expression)}
    kinks = ca.vertcat(*columns.values())
    return ca.Function(
        "measures",
        [torque, rates],
        [ca.densify(integrands), ca.densify(kinks)],
        ["torque", "wheel_rates"],
        ["integrands", "kinks"],
    )
