"""What a problem of a task is built for, and how it is put."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.optimal.cost import Aim, has_largest, slack_count, wants_null_torque
from occ.optimal.limits import NEEDS_NULL_TORQUE, limit_names
from occ.optimal.mesh import SchemeName
from occ.optimal.problem import Row
from occ.task import EndClass, Keep

ERRORS = (("velocity", "m/s"), ("acceleration", "m/s^2"))


@dataclass(frozen=True)
class Shape:
    """What a problem is built for; everything else is numbers.

    Args:
        wheel_count: n.
        terms: names of the objectives in the cost.
        limits: names of the limited quantities.
        full: six states and n torques, not the reduced two states.
        keep: of B.
        constant: torques are constant in each interval.
    """

    wheel_count: int
    terms: tuple[str, ...]
    limits: tuple[str, ...] = ()
    full: bool = False
    keep: Keep = "path"
    constant: bool = False

    @property
    def has_torque_states(self) -> bool:
        """The control's place is taken by its derivative, so that torques do not jump."""
        return "torque_rate" in self.limits

    @property
    def starts_on_path(self) -> bool:
        """The torques at the start are states that have to give B the acceleration of its program."""
        return self.full and self.keep == "path" and self.has_torque_states

    @property
    def wants_null_torque(self) -> bool:
        """Torques that make no wrench can lower the cost or help to hold a limit."""
        return bool(set(self.limits) & set(NEEDS_NULL_TORQUE)) or wants_null_torque(self.terms)

    @property
    def slacks(self) -> int:
        """Number of slacks, the last controls."""
        return slack_count(self.terms, self.wheel_count)

    @property
    def peaks(self) -> int:
        """1 where the largest torque is a last state; 0 elsewhere."""
        return int(has_largest(self.terms))

    def following(self) -> tuple[int, int, int, int]:
        """Numbers of path conditions after the limits: tube, velocity and acceleration, slacks, largest torque."""
        velocity = (2 + 2 * self.has_torque_states) * (self.full and self.keep == "path")
        return int(self.keep == "tube"), velocity, self.slacks, 2 * self.wheel_count * self.peaks

    def path_names(self) -> tuple[Row, ...]:
        """What each path condition is."""
        tube, velocity, slacks, peaks = self.following()
        rows = list(limit_names(self.limits, self.wheel_count))
        rows += [Row("distance of B from its program", "radii of the tube", squared=True)] * tube
        errors = [Row(f"{what} error of B in {axis}", unit) for what, unit in ERRORS for axis in "xy"]
        rows += errors[:velocity]
        rows += [Row(f"slack {j + 1} above its power", "W") for j in range(slacks)]
        wheels = [1 + j % self.wheel_count for j in range(peaks)]
        return (*rows, *[Row("largest torque above torque", "N m", wheel) for wheel in wheels])


@dataclass(frozen=True, eq=False, kw_only=True)
class EndConditions:
    """What holds at both ends.

    Args:
        start: ``given`` or ``free``.
        end: class of the end.
        winding: net full turns where the end is periodic.
        law_end: (6,) the servo law's end state, where the end is ``law``.
    """

    start: str = "given"
    end: EndClass = "free"
    winding: int | None = None
    law_end: np.ndarray | None = None

    @property
    def turn(self) -> float | None:
        """[rad] Net turn of the heading; None where it is not prescribed."""
        return None if self.winding is None else 2 * np.pi * self.winding


@dataclass(frozen=True, eq=False, kw_only=True)
class Settings:
    """How the problem is put.

    Args:
        aim: what to minimise.
        ends: what holds at both ends.
        keep: of B.
        radius: [m] of the tube; None for the other keeps.
        scheme: of collocation.
        constant: torques are constant in each interval.
        aside: (10,) by how much to aim beside the end, where the torques miss what the polynomials hit: state, and
            position and velocity of B; None where they do not.
        tolerance: of the cost, by which the one that settles torque rates is measured; 0 leaves them open.
    """

    aim: Aim
    ends: EndConditions
    keep: Keep = "path"
    radius: float | None = None
    scheme: SchemeName = "radau"
    constant: bool = False
    aside: np.ndarray | None = None
    tolerance: float = 0.0
