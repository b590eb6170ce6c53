"""What the expressions of the catalogue are made of: symbols of the arguments and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from occ.errors import InputError
from occ.export.arguments import Argument, motion_argument, plain_arguments
from occ.model.coefficients import Coefficients, coefficient_function
from occ.model.constraint import OnProgram, on_program
from occ.model.dynamics import parametric_functions
from occ.motion import ProgramMotion, kinematics_function

GIVEN = "given"
"""The kind of a program motion whose velocity and acceleration are arguments."""
PROGRAM = ("program_velocity", "program_acceleration")
"""Arguments that stand for time and numbers of a motion, where there is one."""


@dataclass(frozen=True)
class Program:
    """Which program motion B has.

    Args:
        motion: its class; None where velocity and acceleration of B are arguments.
        structure: of the motion.
        size: number of the motion's values.
        example: (size,) values; None where any positive numbers make a motion.
    """

    motion: type[ProgramMotion] | None
    structure: tuple[int, ...] = ()
    size: int = 0
    example: tuple[float, ...] | None = None

    @property
    def kind(self) -> str:
        """As in experiment files, or ``given``."""
        return self.motion.kind if self.motion else GIVEN


class Symbols:
    """The arguments of all exports as symbols, made when they are first asked for.

    Args:
        numbers: (4 + 10 n,) of the platform, some of them symbols.
        wheel_count: n.
        program: motion of B.
    """

    def __init__(self, numbers: ca.SX, wheel_count: int, program: Program) -> None:
        self.numbers, self.wheel_count, self.program_motion = numbers, wheel_count, program
        self.described: dict[str, Argument] = dict(plain_arguments(wheel_count))
        if program.motion:
            example = None if program.example is None else np.array(program.example)
            self.described["motion"] = motion_argument(program.motion, program.size, example)
        self._made: dict[str, ca.SX] = {}

    def __getitem__(self, name: str) -> ca.SX:
        """The symbol of an argument."""
        if name not in self._made:
            self._made[name] = ca.SX.sym(name, self.described[name].size)
        return self._made[name]

    def arguments(self, declared: tuple[str, ...]) -> tuple[str, ...]:
        """Names of a function's arguments, with time and the motion's numbers in the place of the program's motion."""
        names = set(declared)
        if self.program_motion.motion and names & set(PROGRAM):
            names = names - set(PROGRAM) | {"t", "motion"}
        return tuple(name for name in self.described if name in names)

    def program(self, derivative: int) -> ca.SX:
        """Position, velocity or acceleration of B on the floor in its program.

        Args:
            derivative: 0, 1 or 2.

        Returns:
            (2,) [m], [m/s] or [m/s^2].

        Raises:
            InputError: the position where only velocity and acceleration are given.
        """
        motion = self.program_motion
        if motion.motion:
            function = kinematics_function(motion.motion, motion.structure, motion.size)
            return function(self["t"], self["motion"])[derivative]
        if derivative == 0:
            raise InputError('the position of B in its program needs a motion; --motion should be another than "given"')
        return self[PROGRAM[derivative - 1]]

    def model(self, name: str, *arguments: ca.SX) -> ca.SX:
        """A function of the platform's model at these numbers."""
        return parametric_functions(self.wheel_count)[name](*arguments, self.numbers)

    @cached_property
    def matrices(self) -> Coefficients:
        """The platform's matrices, eq. (2.16), without the null torques, which no expression here takes from it."""
        inertia, h_x, h_y, h_yaw, friction, rates, min_norm = coefficient_function(self.wheel_count)(self.numbers)
        null = ca.SX(self.wheel_count, self.wheel_count - 3)
        return Coefficients(inertia, (h_x, h_y, h_yaw), friction, rates, min_norm, null)

    @cached_property
    def on_program(self) -> OnProgram:
        """Pseudo-velocity and its rate with B on its program, eqs. (3.6), (3.7)."""
        state = self["state"]
        return on_program(self["point"], state[2], state[5], self.program(1), self.program(2))
