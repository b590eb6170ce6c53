"""Rotation prescribed in advance: the rivals of the law in the paper's Fig. 10."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca

from occ.checks import Angle
from occ.errors import InputError
from occ.laws.base import Moment, PathKeepingLaw
from occ.task import Start, StartClass, Task


@dataclass(frozen=True, kw_only=True)
class PrescribedRotation(PathKeepingLaw):
    """psi(t) = heading + rate t: the second method of the paper's section 5.

    It starts on its own heading and yaw rate without a charge for getting there: start class ``own``.

    Args:
        rate: [rad/s] constant yaw rate, or ``program`` for omega_B, the rate at which the velocity of B turns.
        heading: [rad] psi(0).
        allocation: of the wrench to the wheels: { kind = "min_norm" }, or another kind that holds the limits.
        stabilisation: { position = .., velocity = .. } of B's error; the rotation itself is not stabilised.
    """

    kind: ClassVar[str] = "prescribed_rotation"
    start_class: ClassVar[StartClass] = "own"
    rate: float | Literal["program"]
    heading: Angle = 0.0

    def yaw_acceleration(self, moment: Moment) -> ca.SX:
        return ca.SX(0)

    def start(self, task: Task) -> Start:
        rate = task.motion.turning_rate if self.rate == "program" else self.rate
        if rate is None:
            raise InputError(
                f"prescribed_rotation: rate = 'program' needs a motion that turns at a constant rate; "
                f"{task.motion.kind} has none, so rate should be a number in rad/s"
            )
        return Start(heading=self.heading, heading_rate=rate)
