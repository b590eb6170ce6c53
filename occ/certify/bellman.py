"""Bounds of what a motion on a circle costs, from any function V that satisfies Bellman's inequality.

With psi~ = x, Omega = omega_B + s w, Omega' = p a and t = T (1 + tau) / 2, if for all tau in [-1, 1], x, w, a

    L(x, w, a) + (2 / T) V_tau + s w V_x + (p / s) a V_w >= 0,

then V(0, start) - V(T, end) is at most the integral of L along every motion.  What is made of it depends on the ends:

    start and end given      V(0, start) - V(T, end)
    end free                 V(0, start), if V(T, .) is nowhere above the cost of the end
    a cycle                  c, if V(0, x, w) - V(T, x - omega_B T, w) >= c everywhere
    for ever, V without t    c, if the inequality holds with L - c: the least mean of L while the yaw rate is bounded

V has period 2 pi in x, so that ends that differ by full turns are one end.  With a term of V that is linear in x they
are not: for all ends with at most, or at least, so many turns the bound is that of the outermost one if that term falls
towards it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from flint import arb

from occ.certify.balls import Ball
from occ.certify.proofs import SquaresProof, TurnsProof
from occ.certify.series import Key, Number, Series

CONSTANT: Key = (0, 0, 0, 0)


class Scales(NamedTuple):
    """Powers of two, so that they cost no rounding."""

    rate: float  # [rad/s] s
    acceleration: float  # [rad/s^2] p


class State(NamedTuple):
    """psi~ and w as balls."""

    angle: Ball  # [rad]
    rate: Ball  # [1] w


@dataclass(frozen=True)
class Inequality:
    """What is to be bounded, in balls.

    Args:
        cost: [1/s] L, per second.
        scales: of w and a.
        regular: whether V may depend on the yaw rate; otherwise L has no a, and Omega may jump.
        duration: [s] T; None for ever.
        start: None where it is free.
        end: None where it is free.
        end_cost: what a free end costs.
        paid: what is paid for start and end in any case.
        turn: [rad] omega_B T, where the motion is a cycle.
        side: -1 where a given end has at most so many full turns, +1 where it has at least so many, 0 for any number.
        turns: that number.
    """

    cost: Series
    scales: Scales
    regular: bool = True
    duration: Ball | None = None
    start: State | None = None
    end: State | None = None
    end_cost: Series | None = None
    paid: Ball = 0
    turn: Ball | None = None
    side: int = 0
    turns: int = 0

    def flow(self, v: Series, level: Number, slope: Number = 0.0) -> Series:
        """The left side of the inequality; V has the term slope x, too."""
        rate, acceleration = self.scales
        parts = [self.cost, (v.by_angle() + Series({CONSTANT: slope})) * Series({(1, 0, 0, 0): rate})]
        if self.regular:
            parts.append(v.by_rate() * Series({(0, 1, 0, 0): acceleration / rate}))
        if self.duration is None:
            parts.append(Series({CONSTANT: -level}))
        else:
            parts.append(v.by_time() * (2 / self.duration))
        return Series.sum(parts)

    def boundary(self, v: Series, level: Number) -> Series | None:
        """What must not be negative at the ends; None where the ends are given, or far away."""
        if self.duration is None or (self.start and self.end):
            return None
        last = v.at_time(1)
        if self.start:
            assert self.end_cost is not None
            return self.end_cost - last
        assert self.turn is not None
        last = last.turned(harmonics(-self.turn, v.degree))
        return v.at_time(-1) - last - Series({CONSTANT: level})

    def bound(self, v: Series, level: Number, slope: Number = 0.0) -> Ball:
        """The bound that is proven where both inequalities hold, with so many turns of the end."""
        if self.start is None:
            return arb(level) + self.paid
        value = value_at(v.at_time(-1), self.start) + self.paid
        if not self.end:
            return value
        way = self.end.angle - self.start.angle + 2 * arb.pi() * self.turns
        return value - value_at(v.at_time(1), self.end) - way * slope


def end_force(problem: Inequality, proof: SquaresProof | TurnsProof) -> float:
    """|V_psi~| + |V_Omega| at a given end: by how much the bound moves with it; 0 where the end is free.

    Of a cycle, whose end is not known, the most that it is for yaw rates up to s about omega_B.
    """
    if isinstance(proof, TurnsProof):
        return max(end_force(problem, part) for part in (proof.upto, proof.above))
    last = Series({key: arb(c) for key, c in proof.value.items()}).at_time(1)
    if problem.turn is not None:
        parts = (abs(c) * (abs(h) + i / problem.scales.rate) for (i, _, _, h), c in last.terms.items())
        return float(sum(parts, arb(0)).upper())
    if problem.end is None:
        return 0.0
    slopes = (
        value_at(last.by_angle(), problem.end) + proof.slope,
        value_at(last.by_rate(), problem.end) / problem.scales.rate,
    )
    return float(sum(abs(arb(slope)) for slope in slopes).upper())


def harmonics(angle: Ball, degree: int) -> dict[int, Ball]:
    """cos h x for h >= 0 and sin |h| x for h < 0, by h."""
    ball = arb(angle)
    sines = {-h: (h * ball).sin() for h in range(1, degree + 1)}
    return {h: (h * ball).cos() for h in range(degree + 1)} | sines


def value_at(series: Series, state: State) -> Ball:
    """The value of a series without time at a state."""
    return series.at(harmonics(state.angle, series.degree), arb(state.rate))
