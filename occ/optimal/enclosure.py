"""Balls that hold every value of a CasADi function, by NumPy on many panels of time at once.

A panel is t = t_m + w x, |x| <= 1.  E_rho is the ellipse of complex x with foci -1 and 1 whose semi-axes add up to rho.
Each operation of an analytic expression q is done on discs |z - c| <= r, c the real value at the middle of the panel,
that hold its values on all of E_rho.  Then the polynomial p of degree n through q's values at the n + 1 Chebyshev
points is near it on the panel:

    |q - p| <= 4 r rho^(-n) / (rho - 1).

With single points in place of ellipses the same operations bound the rounding errors of the values.  Every operation
widens its disc by its own rounding, elementary functions by that of four units in the last place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from occ.numeric import operations
from occ.optimal.powers import UNIT

TINY = 1e-300
"""Stands for underflow."""


@dataclass(frozen=True)
class Balls:
    """Discs |z - c| <= r.

    Args:
        centre: c, real.
        radius: r of the same shape, or of one that broadcasts with it; infinite where nothing is known.
    """

    centre: np.ndarray
    radius: np.ndarray

    @classmethod
    def exact(cls, value: np.ndarray | float) -> Balls:
        """Numbers without an error."""
        return cls(np.asarray(value, dtype=float), np.zeros(()))

    def __add__(self, other: Balls) -> Balls:
        return _rounded(self.centre + other.centre, self.radius + other.radius)

    def __sub__(self, other: Balls) -> Balls:
        return _rounded(self.centre - other.centre, self.radius + other.radius)

    def __mul__(self, other: Balls) -> Balls:
        radius = np.abs(self.centre) * other.radius + (np.abs(other.centre) + other.radius) * self.radius
        return _rounded(self.centre * other.centre, radius)

    def __neg__(self) -> Balls:
        return Balls(-self.centre, self.radius)

    def squared(self) -> Balls:
        """z^2."""
        return _rounded(self.centre**2, (2 * np.abs(self.centre) + self.radius) * self.radius)

    def inverse(self) -> Balls:
        """1 / z; |1/z - 1/c| <= r / (|c| (|c| - r))."""
        size = np.abs(self.centre)
        room = size - self.radius
        return _rounded(1.0 / self.centre, np.where(room > 0.0, self.radius / (size * room), np.inf))

    def sine(self) -> Balls:
        """sin z; |sin(c + w) - sin c| <= |sin c| (cosh r - 1) + |cos c| sinh r for |w| <= r."""
        s, c = np.sin(self.centre), np.cos(self.centre)
        return _rounded(s, _turned(s, c, self.radius))

    def cosine(self) -> Balls:
        """cos z; |cos(c + w) - cos c| <= |cos c| (cosh r - 1) + |sin c| sinh r for |w| <= r."""
        s, c = np.sin(self.centre), np.cos(self.centre)
        return _rounded(c, _turned(c, s, self.radius))


def _turned(here: np.ndarray, slope: np.ndarray, radius: np.ndarray) -> np.ndarray:
    # The values of sine and cosine are off by their rounding, too; cosh r - 1 = 2 sinh^2(r / 2) keeps its digits.
    return (np.abs(here) + UNIT) * 2 * np.sinh(radius / 2) ** 2 + (np.abs(slope) + UNIT) * np.sinh(radius)


def _rounded(centre: np.ndarray, radius: np.ndarray) -> Balls:
    return Balls(centre, radius * (1 + UNIT) + (UNIT * np.abs(centre) + TINY))


_ANALYTIC: dict[int, Callable[..., Balls]] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_ADD: Balls.__add__,
    ca.OP_SUB: Balls.__sub__,
    ca.OP_MUL: Balls.__mul__,
    ca.OP_DIV: lambda x, y: x * y.inverse(),
    ca.OP_NEG: Balls.__neg__,
    ca.OP_SQ: Balls.squared,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_INV: Balls.inverse,
    ca.OP_SIN: Balls.sine,
    ca.OP_COS: Balls.cosine,
}
_CHOICES: dict[int, Callable[..., np.ndarray]] = {
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NOT: np.logical_not,
    ca.OP_FLOOR: np.floor,
    ca.OP_FMIN: np.less_equal,
    ca.OP_FMAX: np.greater_equal,
}
"""Operations whose result is settled in the middle of a panel: between the knots of a motion it is always the same."""


@dataclass
class Enclosure:
    """One function on many panels, first on their ellipses, then at their points.

    Args:
        function: CasADi function of SX with one dense column as its output.

    Attributes:
        choices: what was settled in the middles of the panels, by the number of the instruction.
    """

    function: ca.Function
    choices: dict[int, np.ndarray] = field(default_factory=dict)

    def around(self, *arguments: Sequence[Balls]) -> list[Balls]:
        """The output over whole panels.

        Args:
            arguments: rows of each argument; the centres are values at the middles of the panels, (P,).

        Returns:
            Balls of the output's entries.
        """
        self.choices = {}
        return self._run(arguments, settled=False)

    def at(self, *arguments: Sequence[Balls]) -> list[Balls]:
        """The same at points of the panels that `around` has seen.

        Args:
            arguments: rows of each argument, (P, m).

        Returns:
            Balls of the output's entries.
        """
        return self._run(arguments, settled=True)

    def _run(self, arguments: tuple[Sequence[Balls], ...], *, settled: bool) -> list[Balls]:
        work: dict[int, Balls] = {}
        results = [Balls.exact(0.0)] * self.function.numel_out(0)
        with np.errstate(all="ignore"):
            for k, (operation, into, of, constant) in enumerate(operations(self.function)):
                if operation == ca.OP_CONST:
                    work[into[0]] = Balls.exact(constant)
                elif operation == ca.OP_INPUT:
                    work[into[0]] = arguments[of[0]][of[1]]
                elif operation == ca.OP_OUTPUT:
                    results[into[1]] = work[of[0]]
                elif operation in _ANALYTIC:
                    work[into[0]] = _ANALYTIC[operation](*(work[place] for place in of))
                else:
                    work[into[0]] = self._chosen(k, operation, [work[place] for place in of], settled)
        return results

    def _chosen(self, k: int, operation: int, values: list[Balls], settled: bool) -> Balls:
        if operation == ca.OP_IF_ELSE_ZERO:
            condition, value = values
            return Balls(np.where(condition.centre, value.centre, 0.0), np.where(condition.centre, value.radius, 0.0))
        if operation not in _CHOICES:
            # Nothing is known of it, and so nothing is proven.
            return Balls(values[0].centre, np.asarray(np.inf))
        if not settled:
            self.choices[k] = np.asarray(_CHOICES[operation](*(value.centre for value in values)))
        # One choice a panel, for all of its points.
        choice = self.choices[k][..., None] if settled else self.choices[k]
        if operation not in (ca.OP_FMIN, ca.OP_FMAX):
            return Balls.exact(choice)
        one, other = values
        return Balls(np.where(choice, one.centre, other.centre), np.where(choice, one.radius, other.radius))
