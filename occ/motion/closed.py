"""Closed curves with a formula: circle, ellipse, figure-eight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from occ.checks import Angle, Positive
from occ.errors import InputError
from occ.motion.base import ProgramMotion


class ClosedCurve(ProgramMotion):
    """A curve that its parameter goes round once in T = 2 pi / |rate|; each one has the field ``rate`` [rad/s]."""

    rate: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate == 0.0:
            name = type(self).__name__
            raise InputError(f"{name}: rate 0 keeps B at rest; it should be a positive or negative rate in rad/s")

    @property
    def period(self) -> float:
        return 2 * math.pi / abs(self.rate)


@dataclass(frozen=True, kw_only=True)
class Circle(ClosedCurve):
    """x = R_B cos(omega_B t + phi_B), y = R_B sin(omega_B t + phi_B): the circle before eq. (4.1).

    Args:
        radius: [m] R_B.
        rate: [rad/s] omega_B; its sign is the direction of travel, zero is refused.
        phase: [rad] phi_B.
    """

    kind: ClassVar[str] = "circle"
    radius: Positive
    rate: float
    phase: Angle = 0.0

    @classmethod
    def position(cls, t: ca.SX, values: ca.SX, structure: tuple[int, ...]) -> ca.SX:
        radius, rate, phase = ca.vertsplit(values)
        return radius * ca.vertcat(ca.cos(rate * t + phase), ca.sin(rate * t + phase))

    @property
    def turning_rate(self) -> float:
        return self.rate


@dataclass(frozen=True, kw_only=True)
class Ellipse(ClosedCurve):
    """r = R(tilt) (a cos(rate t + phase), b sin(rate t + phase)): an ellipse about the origin of the floor.

    Args:
        semi_axes: (2,) [m] a, b, both positive.
        rate: [rad/s] of the parameter, not of the velocity's direction; its sign is the direction of travel, zero is
            refused.
        phase: [rad] of the parameter at t = 0.
        tilt: [rad] from the floor's x axis to the semi-axis a.
    """

    kind: ClassVar[str] = "ellipse"
    semi_axes: tuple[Positive, Positive]
    rate: float
    phase: Angle = 0.0
    tilt: Angle = 0.0

    @classmethod
    def position(cls, t: ca.SX, values: ca.SX, structure: tuple[int, ...]) -> ca.SX:
        a, b, rate, phase, tilt = ca.vertsplit(values)
        x, y = a * ca.cos(rate * t + phase), b * ca.sin(rate * t + phase)
        c, s = ca.cos(tilt), ca.sin(tilt)
        return ca.vertcat(c * x - s * y, s * x + c * y)


@dataclass(frozen=True, kw_only=True)
class FigureEight(ClosedCurve):
    """x = a sin(rate t + phase), y = b sin(2 (rate t + phase)): the Lissajous figure 1:2, which crosses itself at 0.

    Args:
        semi_axes: (2,) [m] a, b, both positive: half the length and half the width of the eight.
        rate: [rad/s] of the slow parameter; its sign is the direction of travel, zero is refused.
        phase: [rad] of the slow parameter at t = 0; 0 starts at the crossing.
    """

    kind: ClassVar[str] = "figure_eight"
    semi_axes: tuple[Positive, Positive]
    rate: float
    phase: Angle = 0.0

    @classmethod
    def position(cls, t: ca.SX, values: ca.SX, structure: tuple[int, ...]) -> ca.SX:
        a, b, rate, phase = ca.vertsplit(values)
        angle = rate * t + phase
        return ca.vertcat(a * ca.sin(angle), b * ca.sin(2 * angle))
