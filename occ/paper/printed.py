"""Numbers as the paper prints them: the value, and what rounding may have hidden."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from types import MappingProxyType

import casadi as ca
import numpy as np

from occ.model.presets import youbot


@dataclass(frozen=True)
class Printed:
    """A decimal number with its digits, trailing zeros included.

    Args:
        text: the digits as printed; a power of ten is part of the unit and not of the digits.
        power: of ten, by which one printed unit is larger than the SI unit.
    """

    text: str
    power: int = 0

    @property
    def number(self) -> float:
        """The value in the printed unit."""
        return float(self.text)

    @property
    def unit(self) -> float:
        """One printed unit in SI."""
        return 10.0**self.power

    @property
    def si(self) -> float:
        """The value in SI, the double nearest to the digits."""
        return float(Decimal(self.text).scaleb(self.power))

    @property
    def half(self) -> float:
        """Half a unit of the last printed digit, in the printed unit."""
        exponent = Decimal(self.text).as_tuple().exponent
        return 0.5 * 10.0 ** int(exponent)

    def holds(self, value: float) -> bool:
        """Whether a value, in the printed unit, is rounded to these digits.

        Args:
            value: in the printed unit.

        Returns:
            True within half a unit of the last digit, both ends included.
        """
        # The double nearest to a decimal number may itself lie past the half unit by a rounding error.
        return abs(value - self.number) <= self.half + 1e-12 * abs(self.number)

    def meets(self, low: float, high: float) -> bool:
        """Whether some number of an interval is rounded to these digits.

        Args:
            low: in the printed unit.
            high: in the printed unit.

        Returns:
            True where the interval and the half units about the digits have a number in common.
        """
        return self.holds(min(max(self.number, low), high))


PARAMETERS: Mapping[str, Printed] = MappingProxyType(
    {
        "platform_mass": Printed("29.94"),
        "wheel_mass": Printed("1.40"),
        "yaw_inertia": Printed("4.42"),
        "wheel_spin_inertia": Printed("5.87", -3),
        "mass_center_x": Printed("1.6", -2),
        "mass_center_y": Printed("-2.6", -2),
        "wheel_friction": Printed("0.110"),
        "roller_friction": Printed("5.78", -3),
        "half_track": Printed("0.150"),
        "half_wheelbase": Printed("0.235"),
        "wheel_radius": Printed("0.0475"),
        "roller_radius": Printed("0.014"),
    }
)
"""Eq. (2.17): the keys of `occ.model.presets.YouBot`, the centre of mass by its two coordinates; units to SI."""


@dataclass(frozen=True)
class Box:
    """p = p_0 + p_h u, |u_k| <= 1: what the printed parameters may have been before they were rounded.

    Args:
        parameters: by the keys of `PARAMETERS`, with their digits.
    """

    parameters: Mapping[str, Printed]

    @property
    def center(self) -> np.ndarray:
        """(12,) [SI] p_0, the parameters as printed."""
        return np.array([item.si for item in self.parameters.values()])

    @property
    def half(self) -> np.ndarray:
        """(12,) [SI] p_h, half a unit of the last digit of each."""
        return np.array([item.half * item.unit for item in self.parameters.values()])

    def platform_numbers(self, u: ca.SX) -> ca.SX:
        """The numbers of the platform at a place of the box.

        Args:
            u: (12,) in [-1, 1].

        Returns:
            (44,) in the order of `occ.model.platform.parameter_names`.
        """
        center = self.center
        numbers = self._preset(center)
        # Each number of the platform is a parameter, its negative, or no parameter at all: the map is affine, and its
        # columns are 0 or +-1.
        columns = [
            np.rint((self._preset(center + step) - numbers) / step.sum()) for step in np.diag(np.maximum(center, 1e-3))
        ]
        matrix = np.array(columns).T
        return ca.mtimes(ca.DM(matrix), ca.DM(center) + ca.DM(self.half) * u) + ca.DM(numbers - matrix @ center)

    def _preset(self, values: np.ndarray) -> np.ndarray:
        keys = dict(zip(self.parameters, map(float, values), strict=True))
        center = keys.pop("mass_center_x"), keys.pop("mass_center_y")
        return youbot(mass_center=center, **keys).parameters()
