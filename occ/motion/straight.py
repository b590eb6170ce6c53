"""Straight lines: at constant velocity, and from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from occ.checks import Positive, Vector2
from occ.errors import InputError
from occ.motion.base import ProgramMotion


@dataclass(frozen=True, kw_only=True)
class Line(ProgramMotion):
    """r = r_0 + v t: a straight line at constant velocity.

    Args:
        velocity: (2,) [m/s] v.
        start: (2,) [m] r_0.
    """

    kind: ClassVar[str] = "line"
    velocity: Vector2
    start: Vector2 = (0.0, 0.0)

    @classmethod
    def position(cls, t: ca.SX, values: ca.SX, structure: tuple[int, ...]) -> ca.SX:
        return values[2:4] + values[0:2] * t

    @property
    def period(self) -> None:
        return None


@dataclass(frozen=True, kw_only=True)
class RestToRestLine(ProgramMotion):
    """r = r_0 + (r_1 - r_0) (10 u^3 - 15 u^4 + 6 u^5), u = t / duration: from rest to rest.

    Velocity and acceleration vanish at the ends; the largest speed is 15/8 of the mean one, in the middle.

    Args:
        start: (2,) [m] r_0.
        end: (2,) [m] r_1, not the start.
        duration: [s] of the way; B rests at the end afterwards.

    Source: Flash and Hogan, The coordination of arm movements, 1985 (the minimum-jerk law).
    """

    kind: ClassVar[str] = "rest_to_rest"
    start: Vector2
    end: Vector2
    duration: Positive

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start == self.end:
            raise InputError(
                f"RestToRestLine: end {list(self.end)} m is the start, which keeps B at rest; end should be another "
                "point of the floor"
            )

    @classmethod
    def position(cls, t: ca.SX, values: ca.SX, structure: tuple[int, ...]) -> ca.SX:
        start, end, duration = values[0:2], values[2:4], values[4]
        u = ca.fmin(ca.fmax(t / duration, 0), 1)
        return start + (end - start) * (u**3 * (10 + u * (6 * u - 15)))

    @property
    def period(self) -> None:
        return None

    def knots(self, duration: float) -> np.ndarray:
        return np.array([self.duration] if self.duration < duration else [])
