"""What every program motion is: plain numbers and one symbolic position."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import astuple, dataclass
from functools import cache, cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from occ.checks import check_fields
from occ.numeric import evaluate_many


@dataclass(frozen=True, kw_only=True)
class ProgramMotion(ABC):
    """r_B*(t): the program position of B on the floor; its fields are plain numbers."""

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        check_fields(self)

    def values(self) -> np.ndarray:
        """(k,) The motion's numbers, in the order in which `position` takes them."""
        return self._values

    @cached_property
    def _values(self) -> np.ndarray:
        flat: list[float] = []
        for value in astuple(self):
            flat.extend(np.ravel(value))
        values = np.array(flat, dtype=float)
        values.flags.writeable = False
        return values

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

    def knots(self, duration: float) -> np.ndarray:
        """(K,) [s] Times inside (0, duration) at which a derivative of the position jumps; an integrator stops there.

        Args:
            duration: [s].

        Returns:
            Increasing times; none where the position is smooth.
        """
        return np.array([])

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
