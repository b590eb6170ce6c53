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
        allocation: of the wrench to the wheels: { kind = "min_norm" }, or { kind = "box_qp" } within limits.torque.

    Source: paper, eqs. (3.2)-(3.13), for any program motion.
    """

    kind: ClassVar[str] = "servo"

    def yaw_acceleration(self, moment: Moment) -> ca.SX:
        return servo_yaw_acceleration(moment.matrices, moment.on_program)
