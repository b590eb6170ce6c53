"""What an optimal controller minimises: a weighted sum of objectives, the non-smooth ones in exact slack form.

The positive part of a power P is the least p with p >= 0 and p - P >= 0; the largest torque is the least m with
m - M_i >= 0 and m + M_i >= 0.  Both are smooth conditions of a nonlinear program, and at its solution one of each pair
p, p - P is zero: the complementarity residual says how well.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import casadi as ca
import numpy as np

from occ.checks import NonNegative, check_fields
from occ.errors import InputError
from occ.objectives import OBJECTIVES, Objective
from occ.task import Keep, Limits

REGULARISER = 1e-3
"""Copper loss, in units of the real one, that is added to a cost of powers which does not determine the torques.

It smooths jumps of the velocity over a few milliseconds; what that costs is found for each solution
(`occ.optimal.smoothing`)."""
LARGEST_REGULARISER = 1e-5
"""[N m/J] Copper loss that is added to the largest torque."""
LOOSE: dict[Keep, float] = {"path": 1.0, "tube": 10.0, "ends": 30.0}
"""Factor of both for each keep.  Where B may leave its path all three velocities have jumps, and wheels that may brake
for nothing do so in pulses unless the copper loss speaks against it.  From there on it is lowered as far as that is
affordable."""
SOFTER = (100.0, 10.0)
"""Factors of the added copper loss with which a search begins: each problem is the guess of the next, rougher one.
Before them all powers count with their signs: that problem has no slacks, and many starts meet in few minima."""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Factors of the objectives in a weighted sum; those that are left out are zero.

    Args:
        work: of the signed work in J.
        positive_work: of the positive work per wheel in J.
        absolute_work: of the absolute work in J.
        bus_work: of the work without regeneration at the bus in J.
        torque_squared: [J/(N^2 m^2 s)] of the squared torques.
        copper_loss: of the copper loss in J.
        electric: of the electric energy in J.
        electric_drawn: of the electric energy without regeneration in J.
        peak_torque: [J/(N m)] of the largest torque.
    """

    work: NonNegative = 0.0
    positive_work: NonNegative = 0.0
    absolute_work: NonNegative = 0.0
    bus_work: NonNegative = 0.0
    torque_squared: NonNegative = 0.0
    copper_loss: NonNegative = 0.0
    electric: NonNegative = 0.0
    electric_drawn: NonNegative = 0.0
    peak_torque: NonNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if not any(asdict(self).values()):
            raise InputError("Weights: all are zero; at least one should be positive")


@dataclass(frozen=True)
class Aim:
    """J = sum of weights * objectives.

    Args:
        terms: names of the objectives: what a program is built for.
        weights: their factors: numbers that may change between two solves.
        is_regularised: whether the last term is a copper loss that settles what the others leave open.
    """

    terms: tuple[str, ...]
    weights: tuple[float, ...]
    is_regularised: bool = False

    @classmethod
    def single(cls, name: str) -> Aim:
        """One objective."""
        return cls((name,), (1.0,))

    def regularised(self, keep: Keep, limits: Limits) -> Aim:
        """With a small copper loss where nothing else determines the torques, or bounds them.

        A linear cost of powers, or of one torque among many, has many minima or none that is attained; the copper loss
        is the physical cost that chooses among them.  Signed work needs it only where all that limits a torque is the
        wheel's power: a wheel at rest has none, and the optimum brakes with any torque while the wheel stops.

        Args:
            keep: of B.
            limits: of the wheels.

        Returns:
            The same where the cost has curvature in every torque, or does without it.
        """
        unbounded = limits.wheel_power is not None and limits.torque is None and limits.torque_speed_line is None
        if is_regular(self.terms) or not (is_non_smooth(self.terms) or (unbounded and keep != "path")):
            return self
        items = objectives_of(self.terms)
        powers = sum(weight for item, weight in zip(items, self.weights, strict=True) if not item.largest)
        largest = sum(weight for item, weight in zip(items, self.weights, strict=True) if item.largest)
        added = (REGULARISER * powers + LARGEST_REGULARISER * largest) * LOOSE[keep]
        return Aim((*self.terms, "copper_loss"), (*self.weights, added), is_regularised=True)

    def with_last(self, weight: float) -> Aim:
        """The same with another factor of the last term."""
        return replace(self, weights=(*self.weights[:-1], weight))

    def easier(self) -> list[Aim]:
        """Easier ones, the easiest first: signed, then with more of the added copper loss; none without kinks."""
        if not (self.is_regularised and is_non_smooth(self.terms)):
            return []
        rougher = [self.with_last(factor * self.weights[-1]) for factor in SOFTER]
        return [rougher[0].signed, *rougher]

    @property
    def signed(self) -> Aim:
        """The same with all powers counted with their signs, and without a largest torque; its largest weight is 1."""
        weights: dict[str, float] = {}
        for item, weight in zip(objectives_of(self.terms), self.weights, strict=True):
            if not item.largest:
                name = item.signed or item.name
                weights[name] = weights.get(name, 0.0) + weight
        largest = max(weights.values())
        return Aim(tuple(weights), tuple(weight / largest for weight in weights.values()))

    @classmethod
    def weighted(cls, weights: Weights) -> Aim:
        """All objectives with a factor that is not zero."""
        chosen = [(name, factor) for name, factor in asdict(weights).items() if factor]
        return cls(tuple(name for name, _ in chosen), tuple(factor for _, factor in chosen))


def objectives_of(terms: tuple[str, ...]) -> list[Objective]:
    """The objectives of a sum."""
    return [OBJECTIVES[name] for name in terms]


def is_regular(terms: tuple[str, ...]) -> bool:
    """Whether some term has curvature in every torque, so that optimal torques are bounded."""
    return any(item.regular for item in objectives_of(terms))


def is_non_smooth(terms: tuple[str, ...]) -> bool:
    """Whether some term has slacks or is a largest value."""
    return any(item.clipped or item.largest for item in objectives_of(terms))


def wants_null_torque(terms: tuple[str, ...]) -> bool:
    """Whether torques that make no wrench can lower the cost."""
    return any(item.wheel_by_wheel for item in objectives_of(terms))


def has_largest(terms: tuple[str, ...]) -> bool:
    """Whether a largest value is among the terms."""
    return any(item.largest for item in objectives_of(terms))


def slack_count(terms: tuple[str, ...], wheel_count: int) -> int:
    """Number of slacks for the positive parts of the terms."""
    torque, rates = ca.SX.sym("torque", wheel_count), ca.SX.sym("rates", wheel_count)
    return sum(int(item.clipped(torque, rates).numel()) for item in objectives_of(terms) if item.clipped)


@dataclass(frozen=True)
class Cost:
    """The pieces of a problem that come from its cost, CasADi SX.

    Args:
        integrand: g.
        work_weight: factor of the signed work, whose kinetic part is a terminal cost.
        peak_weight: factor of the largest torque, a terminal cost, too.
        slacks: (k,) further controls p, at least 0.
        slack_rows: (k,) p - P, at least 0.
        peak: (1,) further state m with m' = 0, or (0,).
        peak_rows: (2 n,) m - M and m + M, at least 0, or (0,).
    """

    integrand: ca.SX
    work_weight: ca.SX
    peak_weight: ca.SX
    slacks: ca.SX
    slack_rows: ca.SX
    peak: ca.SX
    peak_rows: ca.SX


def cost_of(terms: tuple[str, ...], weights: ca.SX, torque: ca.SX, rates: ca.SX, dissipation: ca.SX) -> Cost:
    """J = integral of (work share of the dissipation + smooth rest + shares of the slacks) dt + terminal costs.

    Signed work is taken as change of kinetic energy plus dissipation, which holds exactly along every motion and leaves
    no quadrature error of the torque for the optimiser to exploit.

    Args:
        terms: names of objectives.
        weights: (k,) their factors.
        torque: (n,) M.
        rates: (n,) phi'.
        dissipation: pi'^T Z pi'.

    Returns:
        Integrand, slacks and the conditions on them.
    """
    integrand, work_weight, peak_weight = ca.SX(0), ca.SX(0), ca.SX(0)
    slacks, rows = [], []
    for j, item in enumerate(objectives_of(terms)):
        weight = weights[j]
        work_weight += weight * item.work_share
        if item.rest:
            integrand += weight * item.rest(torque, rates)
        if item.clipped:
            power = item.clipped(torque, rates)
            slack = ca.SX.sym(f"slack_{j}", power.numel())
            integrand += weight * item.clipped_share * ca.sum1(slack)
            slacks.append(slack)
            rows.append(slack - power)
        if item.largest:
            peak_weight += weight
    peak = ca.SX.sym("peak", 1 if has_largest(terms) else 0)
    return Cost(
        integrand=integrand + work_weight * dissipation,
        work_weight=work_weight,
        peak_weight=peak_weight,
        slacks=ca.vertcat(*slacks) if slacks else ca.SX(0, 1),
        slack_rows=ca.vertcat(*rows) if rows else ca.SX(0, 1),
        peak=peak,
        peak_rows=ca.vertcat(peak - torque, peak + torque) if peak.numel() else ca.SX(0, 1),
    )


def slack_shares(terms: tuple[str, ...], weights: tuple[float, ...], wheel_count: int) -> np.ndarray:
    """(k,) Factor of each slack in the integrand.

    Args:
        terms: names of objectives.
        weights: their factors.
        wheel_count: n.

    Returns:
        Factors in the order of `Cost.slacks`.
    """
    shares: list[float] = []
    for name, weight in zip(terms, weights, strict=True):
        shares += [weight * OBJECTIVES[name].clipped_share] * slack_count((name,), wheel_count)
    return np.array(shares)
