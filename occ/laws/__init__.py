"""Control laws.  To add one: a file in this folder and its class in `LAWS`."""

from occ.laws.base import Moment, PathKeepingLaw, Stabilisation
from occ.laws.rotation import PrescribedRotation
from occ.laws.servo import MeasuredServoLaw, ServoLaw

LAWS: tuple[type[PathKeepingLaw], ...] = (ServoLaw, MeasuredServoLaw, PrescribedRotation)

__all__ = ["LAWS", "MeasuredServoLaw", "Moment", "PathKeepingLaw", "PrescribedRotation", "ServoLaw", "Stabilisation"]
