"""The numbers of a platform as an argument: those named stay symbols, all others are frozen."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from occ.errors import InputError
from occ.experiment.naming import nearest, suggestion
from occ.export.arguments import Argument
from occ.model.platform import BODY_PARAMETERS, WHEEL_PARAMETERS, Platform, parameter_names

ALL = "parameters"
"""Stands for every number of the platform."""
STEP = 2.0**-10
"""Relative change of a preset's key that shows which numbers of the platform it decides."""

_UNITS = dict(zip(BODY_PARAMETERS, ("kg", "m", "m", "kg m^2"), strict=True)) | dict(
    zip(WHEEL_PARAMETERS, ("m", "m", "rad", "rad", "m", "m", "kg", "kg m^2", "N m s", "N m s"), strict=True)
)
_SYMBOLS = dict(zip(BODY_PARAMETERS, ("m", "a_X", "a_Y", "I_s"), strict=True)) | dict(
    zip(
        WHEEL_PARAMETERS,
        (r"\rho_{X", r"\rho_{Y", r"\theta_{", r"\eta_{", "R_{", "r_{", "m_{1,", "J_{1,", r"\mu_{1,", r"\mu_{2,"),
        strict=True,
    )
)


@dataclass(frozen=True)
class Number:
    """A number that can stay a symbol: one of the platform's own, or a preset's key that decides several of them.

    Args:
        name: of `parameter_names`, or a key of the preset.
        value: of the platform at hand.
        unit: of the value.
        symbol: LaTeX.
        places: (place in `Platform.parameters`, factor) of each number that is the factor times this one.
    """

    name: str
    value: float
    unit: str
    symbol: str
    places: tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class PlatformNumbers:
    """A platform and the names under which its numbers can stay symbols.

    Args:
        platform: the numbers.
        source: the preset or the file, for people.
        preset: the dataclass instance with the keys that decide several numbers at once; None where there is none.
    """

    platform: Platform
    source: str
    preset: Any = None

    def names(self) -> list[str]:
        """Every name that can stay a symbol, the preset's keys first."""
        own = list(parameter_names(self.platform.wheel_count))
        return [*[key for key in self._keys if key not in own], *own]

    @cached_property
    def _keys(self) -> dict[str, Number]:
        """The preset's keys that are single numbers and decide multiples of themselves."""
        if self.preset is None:
            return {}
        values = {field.name: getattr(self.preset, field.name) for field in dataclasses.fields(self.preset)}
        found = {name: self._shared(name) for name, value in values.items() if isinstance(value, float)}
        return {name: number for name, number in found.items() if number}

    def find(self, names: Sequence[str]) -> tuple[Number, ...]:
        """The numbers of these names, ``parameters`` standing for all of the platform's own.

        Args:
            names: as after `--symbolic`.

        Returns:
            One number for each name.

        Raises:
            InputError: an unknown name, or two names that decide about the same number.
        """
        own = parameter_names(self.platform.wheel_count)
        expanded = [one for name in names for one in (own if name == ALL else (name,))]
        numbers = [self._number(name) for name in dict.fromkeys(expanded)]
        owner: dict[int, str] = {}
        for number in numbers:
            for place, _ in number.places:
                if place in owner:
                    raise InputError(
                        f"{owner[place]} and {number.name} both decide about {own[place]}; only one of them can be "
                        "symbolic"
                    )
                owner[place] = number.name
        return tuple(numbers)

    def _number(self, name: str) -> Number:
        own = parameter_names(self.platform.wheel_count)
        if name in own:
            place = own.index(name)
            wheel = re.fullmatch(r"wheel(\d+)_(\w+)", name)
            base = wheel.group(2) if wheel else name
            symbol = _SYMBOLS[base] + (f"{wheel.group(1)}}}" if wheel else "")
            return Number(name, float(self.platform.parameters()[place]), _UNITS[base], symbol, ((place, 1.0),))
        if name in self._keys:
            return self._keys[name]
        valid = self.names()
        near = nearest(name, valid)
        hint = suggestion(near, [key for key in valid if not key.startswith("wheel") or key in self._keys])
        raise InputError(f'unknown parameter "{name}" of the platform; {hint}')

    def _shared(self, key: str) -> Number | None:
        """A preset's key: which numbers follow it, found by moving it; None where one is no multiple of it."""
        value = getattr(self.preset, key)
        meta = next(field.metadata for field in dataclasses.fields(self.preset) if field.name == key)
        moved_value, moved = self._moved(key, value)
        numbers = self.platform.parameters()
        places = []
        for place in np.flatnonzero(moved != numbers):
            factor = float(moved[place] / moved_value)
            # cos(pi/4) r is a multiple of r up to its last digit.
            factor = round(factor) if abs(factor - round(factor)) < 1e-12 else factor
            if abs(factor * value - numbers[place]) > 1e-12 * abs(moved_value):
                return None
            places.append((int(place), factor))
        text = str(meta.get("symbol", "")).replace("mu", r"\mu")
        symbol = re.sub(r"_(\w+)", r"_{\1}", text) if re.fullmatch(r"\\?\w+", text) else rf"\mathit{{{key}}}"
        return Number(key, value, str(meta.get("unit", "SI")), symbol.replace("_}", "}"), tuple(places))

    def _moved(self, key: str, value: float) -> tuple[float, np.ndarray]:
        """Another value of a key and the platform's numbers with it."""
        step = STEP * (abs(value) or 1.0)
        try:
            moved = value + step
            return moved, dataclasses.replace(self.preset, **{key: moved}).platform().parameters()
        except InputError:
            # At the border of what is physical there is still the other side.
            moved = value - step
            return moved, dataclasses.replace(self.preset, **{key: moved}).platform().parameters()

    def vector(self, numbers: Sequence[Number], symbols: ca.SX) -> ca.SX:
        """All numbers of the platform, (4 + 10 n,), with symbols in the places of some.

        Args:
            numbers: that are symbols.
            symbols: (k,), one for each.

        Returns:
            CasADi column.
        """
        entries = [ca.SX(value) for value in self.platform.parameters()]
        for k, number in enumerate(numbers):
            for place, factor in number.places:
                entries[place] = factor * symbols[k]
        return ca.vertcat(*entries)


def parameters_argument(numbers: Sequence[Number]) -> Argument:
    """The argument ``parameters`` of a function with these numbers as symbols."""
    values = [number.value for number in numbers]
    return Argument(
        ALL,
        "numbers of the platform that are symbols",
        tuple(number.name for number in numbers),
        tuple(number.unit for number in numbers),
        tuple(number.symbol for number in numbers),
        tuple(value or 0.05 for value in values),
        tuple(0.1 * abs(value) or 0.02 for value in values),
    )
