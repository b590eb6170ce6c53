"""The paper's law: the control forces have the structure of the reactions of ideal constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from occ.laws.base import Moment, PathKeepingLaw
from occ.model.constraint import servo_yaw_acceleration


@dataclass(frozen=True, kw_only=True)
class ServoLaw(PathKeepingLaw):
    """Pi_C = B^T lambda, eq. (3.5): the yaw motion is inertial, C^T (A pi'' + f + Z pi') = 0, eq. (3.8).

    Args:
        allocation: of the wrench to the wheels: { kind = "min_norm" }, or another kind that holds the limits.
        stabilisation: { position = .., velocity = .. } in 1/s^2 and 1/s, the desired dynamics of B's error on the
            floor; position and velocity are measured then.

    Source: paper, eqs. (3.2)-(3.13), for any program motion.
    """

    kind: ClassVar[str] = "servo"

    def yaw_acceleration(self, moment: Moment) -> ca.SX:
        return servo_yaw_acceleration(moment.matrices, moment.on_program)


@dataclass(frozen=True, kw_only=True)
class MeasuredServoLaw(ServoLaw):
    """The servo law with measured V_X and V_Y instead of reconstructed ones: nothing but friction opposes an error.

    Args:
        allocation: of the wrench to the wheels: { kind = "min_norm" }, or another kind that holds the limits.
        stabilisation: as of servo, which is the same law then.
    """

    kind: ClassVar[str] = "servo_measured"
    measures_velocity: ClassVar[bool] = True
