"""The paper's task, and other tasks that several tests share."""

from __future__ import annotations

import math
from typing import Any

from occ.model.presets import youbot
from occ.motion import Circle
from occ.task import Task

LAP = 2 * math.pi / 0.4
POINT = (0.40, 0.05)


def paper_task(duration: float = LAP, rate: float = -0.4, radius: float = 0.7, **overrides: Any) -> Task:
    """Section 4 and 5 of the paper: b = (0.40, 0.05) m, omega_B = -0.4 rad/s, R_B = 0.7 m, phi_B = 90 degrees."""
    motion = Circle(radius=radius, rate=rate, phase=math.pi / 2)
    return Task(**({"platform": youbot(), "point": POINT, "motion": motion, "duration": duration} | overrides))
