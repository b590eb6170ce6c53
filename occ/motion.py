"""Program motions r_B*(t) of the platform's point B.

A motion is ONE symbolic position; velocity and acceleration come from CasADi.  To add one: write a frozen dataclass
with `kind`, `values` and `position` here and put it into `MOTIONS`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import astuple, dataclass
from functools import cache
from typing import ClassVar

import casadi as ca
import numpy as np

from occ.checks import Angle, Positive, Vector2, check_fields
from occ.errors import InputError
from occ.numeric import evaluate_many


@dataclass(frozen=True, kw_only=True)
class ProgramMotion(ABC):
    """r_B*(t): the program position of B on the floor; its fields are plain numbers."""

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        check_fields(self)

    def values(self) -> np.ndarray:
        """(k,) The motion's numbers, in the order in which `position` takes them."""
        flat: list[float] = []
        for value in astuple(self):
            flat.extend(np.ravel(value))
        return np.array(flat, dtype=float)

    def structure(self) -> tuple[int, ...]:
        """What of the motion shapes its formula (the number of its way-points, say), as opposed to its numbers."""
        return ()

    @classmethod
    @abstractmethod
    def position(cls, t: ca.SX, values: ca.SX, structure: tuple[int, ...]) -> ca.SX:
        """r_B*(t) [m], (2,), from the time and the entries of `values`, all symbolic."""

    @property
    @abstractmethod
    def period(self) -> float | None:
        """[s] Time of one lap; None where the motion does not return."""

    @property
    def turning_rate(self) -> float | None:
        """[rad/s] omega_B, the constant rate at which the velocity of B turns; None where there is no such rate."""
        return None

    def at(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """r_B*, r_B*', r_B*'' at the times t.

        Args:
            t: (N,) or scalar [s].

        Returns:
            Position [m], velocity [m/s] and acceleration [m/s^2], each (2, N).
        """
        function = kinematics_function(type(self), self.structure(), len(self.values()))
        times = np.atleast_1d(np.asarray(t, dtype=float))[None, :]
        position, velocity, acceleration = evaluate_many(function, times, self.values(), shared=(1,))
        return position, velocity, acceleration


@cache
def kinematics_function(motion: type[ProgramMotion], structure: tuple[int, ...], size: int) -> ca.Function:
    """CasADi function (t, values) -> r_B*, r_B*', r_B*''.

    Args:
        motion: the class of the motion.
        structure: `ProgramMotion.structure`.
        size: length of `ProgramMotion.values`.

    Returns:
        Function of t [s] and values (size,) with three outputs (2,) [m, m/s, m/s^2].
    """
    t = ca.SX.sym("t")
    values = ca.SX.sym("values", size)
    position = motion.position(t, values, structure)
    velocity = ca.jacobian(position, t)
    acceleration = ca.jacobian(velocity, t)
    outputs = [ca.densify(x) for x in (position, velocity, acceleration)]
    return ca.Function(motion.kind, [t, values], outputs, ["t", "values"], ["position", "velocity", "acceleration"])


@dataclass(frozen=True, kw_only=True)
class Circle(ProgramMotion):
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

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate == 0.0:
            raise InputError("Circle: rate 0 keeps B at rest; it should be a positive or negative rate in rad/s")

    @classmethod
    def position(cls, t: ca.SX, values: ca.SX, structure: tuple[int, ...]) -> ca.SX:
        radius, rate, phase = ca.vertsplit(values)
        return radius * ca.vertcat(ca.cos(rate * t + phase), ca.sin(rate * t + phase))

    @property
    def period(self) -> float:
        return 2 * math.pi / abs(self.rate)

    @property
    def turning_rate(self) -> float:
        return self.rate


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


MOTIONS: tuple[type[ProgramMotion], ...] = (Circle, Line)
