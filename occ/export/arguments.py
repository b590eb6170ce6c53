"""The arguments that exported functions can have: names, sizes, units, symbols of the paper, and random values."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from occ.experiment.documentation import argument_texts
from occ.model.dynamics import STATE
from occ.motion import ProgramMotion


@dataclass(frozen=True)
class Argument:
    """One argument: a column of numbers.

    Args:
        name: an identifier.
        meaning: in words.
        entries: name of each entry.
        units: of each entry.
        symbols: of each entry, LaTeX, as in the paper.
        middle: of the random values of each entry, in the table that comes with an export.
        spread: largest distance of the random values from the middle.
    """

    name: str
    meaning: str
    entries: tuple[str, ...]
    units: tuple[str, ...]
    symbols: tuple[str, ...]
    middle: tuple[float, ...]
    spread: tuple[float, ...]

    @property
    def size(self) -> int:
        """Number of entries."""
        return len(self.entries)


def centred(
    name: str,
    meaning: str,
    entries: Sequence[str],
    units: Sequence[str],
    symbols: Sequence[str],
    spread: float | Sequence[float],
) -> Argument:
    """An argument whose random values lie about zero.

    Args:
        name: an identifier.
        meaning: in words.
        entries: name of each entry.
        units: of each entry, or one for all.
        symbols: of each entry.
        spread: of each entry, or one for all.

    Returns:
        The argument.
    """
    size = len(entries)
    units = [units[0]] * size if len(units) == 1 else units
    spreads = [spread] * size if isinstance(spread, float) else spread
    return Argument(name, meaning, tuple(entries), tuple(units), tuple(symbols), (0.0,) * size, tuple(spreads))


def positive(name: str, meaning: str, unit: str, symbol: str, most: float) -> Argument:
    """A scalar argument whose random values lie between a tenth of ``most`` and ``most``."""
    return Argument(name, meaning, (name,), (unit,), (symbol,), (0.55 * most,), (0.45 * most,))


@cache
def plain_arguments(wheel_count: int) -> dict[str, Argument]:
    """All arguments but the motion's and the platform's numbers, by name, in the order in which functions take them.

    Args:
        wheel_count: n.

    Returns:
        Arguments by name.
    """
    wheels = range(1, wheel_count + 1)
    motions = [f"M_{{{i}}}" for i in wheels]
    arguments = (
        positive("t", "time", "s", "t", 10.0),
        centred(
            "program_velocity",
            "program velocity of B on the floor",
            ("x", "y"),
            ("m/s",),
            (r"\dot{x}_B^*", r"\dot{y}_B^*"),
            1.0,
        ),
        centred(
            "program_acceleration",
            "program acceleration of B on the floor",
            ("x", "y"),
            ("m/s^2",),
            (r"\ddot{x}_B^*", r"\ddot{y}_B^*"),
            1.0,
        ),
        centred(
            "state",
            "position of O on the floor, heading, pseudo-velocities of O, yaw rate",
            STATE,
            ("m", "m", "rad", "m/s", "m/s", "rad/s"),
            ("x_O", "y_O", r"\psi", "V_X", "V_Y", r"\Omega"),
            (2.0, 2.0, 3.0, 1.0, 1.0, 2.0),
        ),
        centred("torque", "wheel torques", [f"wheel{i}" for i in wheels], ("N m",), motions, 5.0),
        centred(
            "acceleration",
            "pseudo-accelerations of O, yaw acceleration",
            ("x", "y", "yaw"),
            ("m/s^2", "m/s^2", "rad/s^2"),
            (r"\dot{V}_X", r"\dot{V}_Y", r"\dot{\Omega}"),
            2.0,
        ),
        centred(
            "wrench",
            "generalised control forces",
            ("force_x", "force_y", "yaw_moment"),
            ("N", "N", "N m"),
            ("F_X", "F_Y", r"M_{\Omega}"),
            (60.0, 60.0, 20.0),
        ),
        positive("limit", "largest torque of each wheel", "N m", r"M_{\max}", 5.0),
        centred("point", "B in the body frame", ("x", "y"), ("m",), ("b_X", "b_Y"), 0.5),
    )
    return {argument.name: argument for argument in arguments}


ORDER = (*plain_arguments(4), "motion", "parameters")
"""In which functions take their arguments."""

_MOTION_SYMBOLS = {"circle": ("R_B", r"\omega_B", r"\varphi_B")}


def motion_argument(motion: type[ProgramMotion], size: int, example: np.ndarray | None) -> Argument:
    """The numbers of a program motion.

    Args:
        motion: its class.
        size: how many.
        example: (size,) of a motion; None where any positive numbers make one.

    Returns:
        Names and units from the fields of the class, where the numbers are its fields.
    """
    entries, units = [f"value_{k + 1}" for k in range(size)], ["SI"] * size
    if motion.values is ProgramMotion.values:
        described = argument_texts(motion)
        named = [pair for field in dataclasses.fields(motion) for pair in _entries(field, described)]
        entries, units = [name for name, _ in named], [unit for _, unit in named]
    symbols = _MOTION_SYMBOLS.get(motion.kind, tuple(f"q_{{{k + 1}}}" for k in range(size)))
    middle = np.ones(size) if example is None else np.asarray(example)
    # The times of a spline have to stay in order, so an example is moved a little only.
    spread = np.full(size, 0.5) if example is None else 0.01 * np.maximum(np.abs(middle), 0.1)
    return Argument(
        "motion",
        f"numbers of the program motion ({motion.kind})",
        tuple(entries),
        tuple(units),
        symbols,
        tuple(middle.tolist()),
        tuple(spread.tolist()),
    )


def _entries(field: dataclasses.Field[object], described: dict[str, str]) -> list[tuple[str, str]]:
    """Name and unit of each number in a field of a motion."""
    unit = re.search(r"\[(.*?)\]", described.get(field.name, ""))
    # The rates and angles of parameters have their unit in words or none.
    text = unit.group(1) if unit else "SI"
    pair = str(field.type).startswith(("tuple", "Vector2"))
    return [(f"{field.name}_{axis}", text) for axis in "xy"] if pair else [(field.name, text)]


def motion_size(motion: type[ProgramMotion]) -> int:
    """How many numbers a motion has whose numbers are its fields."""
    return sum(len(_entries(field, {})) for field in dataclasses.fields(motion))
