"""Program motions r_B*(t) of the platform's point B.

A motion is ONE symbolic position; velocity and acceleration come from CasADi.  To add one: write a frozen dataclass
with `kind`, `position` and `period` in a file of this folder and put it into `MOTIONS`.
"""

from occ.motion.base import ProgramMotion, kinematics_function
from occ.motion.closed import Circle, Ellipse, FigureEight
from occ.motion.spline import SplineMotion
from occ.motion.straight import Line, RestToRestLine

MOTIONS: tuple[type[ProgramMotion], ...] = (Circle, Ellipse, FigureEight, Line, RestToRestLine, SplineMotion)

__all__ = [
    "MOTIONS",
    "Circle",
    "Ellipse",
    "FigureEight",
    "Line",
    "ProgramMotion",
    "RestToRestLine",
    "SplineMotion",
    "kinematics_function",
]
