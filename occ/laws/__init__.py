"""Control laws.  To add one: a file in this folder and its class in `LAWS`."""

from occ.laws.base import Moment, PathKeepingLaw
from occ.laws.rotation import PrescribedRotation
from occ.laws.servo import ServoLaw

LAWS: tuple[type[PathKeepingLaw], ...] = (ServoLaw, PrescribedRotation)

__all__ = ["LAWS", "Moment", "PathKeepingLaw", "PrescribedRotation", "ServoLaw"]
