"""An expression of the catalogue with its Jacobians, Hessians and Hessian-vector products as functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from occ.errors import InputError
from occ.experiment.naming import nearest, suggestion
from occ.export.arguments import Argument, centred
from occ.export.catalogue import Export
from occ.export.numbers import ALL, PlatformNumbers, parameters_argument
from occ.export.routine import Module, Routine
from occ.export.symbols import Program, Symbols

FIRST, SECOND = 1, 2
"""Orders of derivatives."""
LONGEST_NAME = 63
"""Characters of a function's name in MATLAB."""


@dataclass(frozen=True)
class Wanted:
    """What the user asks of every name.

    Args:
        platform: with its numbers.
        symbolic: names of numbers that stay symbols.
        motion: of B.
        variables: of derivatives.
        order: of the highest derivatives.
    """

    platform: PlatformNumbers
    symbolic: tuple[str, ...]
    motion: Program
    variables: tuple[str, ...] = ()
    order: int = FIRST


class _Expression:
    """An export as an expression of symbols.

    Args:
        export: of the catalogue.
        wanted: by the user.
        variable: of a derivative; where it is a frozen number of the platform, it is a symbol until `function`.
    """

    def __init__(self, export: Export, wanted: Wanted, variable: str = "") -> None:
        self.wanted = wanted
        numbers = wanted.platform
        self.symbolic = numbers.find(wanted.symbolic)
        moving = numbers.find([variable]) if self._is_number(variable) else ()
        self.frozen = tuple(number for number in moving if number not in self.symbolic)
        known = (*self.symbolic, *self.frozen)
        # Names that decide about the same number cannot be symbols at once.
        numbers.find([number.name for number in known])
        self.theta = ca.SX.sym("parameters", len(known))
        self.symbols = Symbols(numbers.vector(known, self.theta), numbers.platform.wheel_count, wanted.motion)
        self.value = ca.SX(export.build(self.symbols))
        self.names = self.symbols.arguments(export.arguments)

    def _is_number(self, name: str) -> bool:
        return (name == ALL and not self.wanted.symbolic) or name in self.wanted.platform.names()

    @property
    def parameters(self) -> ca.SX:
        """The symbols that stay."""
        return self.theta[: len(self.symbolic)]

    def described(self) -> tuple[Argument, ...]:
        """The function's arguments."""
        arguments = [self.symbols.described[name] for name in self.names]
        return (*arguments, *([parameters_argument(self.symbolic)] if self.symbolic else []))

    def inputs(self) -> list[ca.SX]:
        """The function's arguments as symbols."""
        return [*(self.symbols[name] for name in self.names), *([self.parameters] if self.symbolic else [])]

    def variable(self, name: str) -> tuple[ca.SX, tuple[str, ...], tuple[int, ...]] | None:
        """Whole symbol, units and places in it of a variable; None where the expression has no such argument."""
        if name in self.names:
            argument = self.symbols.described[name]
            return self.symbols[name], argument.units, tuple(range(argument.size))
        known = (*self.symbolic, *self.frozen)
        if not ca.depends_on(self.value, self.theta) or not (name == ALL or self._is_number(name)):
            return None
        wanted = self.symbolic if name == ALL and self.symbolic else self.wanted.platform.find([name])
        places = tuple(next(k for k, n in enumerate(known) if n.name == one.name) for one in wanted)
        return self.theta, tuple(number.unit for number in wanted), places

    def function(self, name: str, value: ca.SX, extra: Sequence[ca.SX] = ()) -> ca.Function:
        """The value at the platform's numbers, zeros taken out."""
        if self.frozen:
            # CasADi takes an empty slice for one entry.
            kept = [self.parameters] if self.symbolic else []
            value = ca.substitute(value, self.theta, ca.vertcat(*kept, *(number.value for number in self.frozen)))
        inputs = [*self.inputs(), *extra]
        names = [argument.name for argument in self.described()] + ["multiplier", "direction"][: len(extra)]
        return ca.Function(name, inputs, [ca.sparsify(value)], names, ["result"])


def module_of(
    export: Export, name: str, wanted: Wanted, options: Callable[[str, str, Sequence[str]], tuple[str, ...]]
) -> tuple[Module, list[str]]:
    """The functions of one name.

    Args:
        export: of the catalogue.
        name: of the files and of the function of the value.
        wanted: by the user.
        options: of the command, from the name, the export and the variables that it depends on.

    Returns:
        The module, and the variables on which the expression does not depend.

    Raises:
        InputError: names that cannot be meant, or an expression that this platform or motion does not have.
    """
    expression = _Expression(export, wanted)
    routines = [
        Routine(
            name,
            export.meaning,
            expression.described(),
            export.result,
            export.units,
            (),
            export.symbol,
            expression.function(name, expression.value),
        )
    ]
    missing = []
    variables = list(dict.fromkeys(wanted.variables))
    for variable in variables:
        moving = _Expression(export, wanted, variable)
        found = moving.variable(variable)
        if found is None:
            missing.append(variable)
        else:
            routines += _Derivatives(export, name, moving, variable, found).routines(wanted.order)
    for routine in routines:
        if len(routine.name) > LONGEST_NAME:
            raise InputError(
                f"{routine.name} is longer than {LONGEST_NAME} characters; {export.name}=NAME gives a shorter one"
            )
    command = options(name, export.name, [variable for variable in variables if variable not in missing])
    module = Module(name, export, tuple(routines), wanted.platform, expression.symbolic, wanted.motion, command)
    return module, missing


@dataclass(frozen=True, eq=False)
class _Derivatives:
    """The derivatives of one expression with respect to one variable.

    Args:
        export: of the catalogue.
        name: of the function of the value.
        expression: whose variable is a symbol.
        variable: its name.
        found: whole symbol, units and places in it, as of `_Expression.variable`.
    """

    export: Export
    name: str
    expression: _Expression
    variable: str
    found: tuple[ca.SX, tuple[str, ...], tuple[int, ...]]

    def routines(self, order: int) -> list[Routine]:
        """The Jacobian and, where second derivatives are wanted, the Hessian of a scalar or a product of a column's."""
        if order < SECOND:
            return [self._first()]
        return [self._first(), self._hessian() if self._value.shape == (1, 1) else self._product()]

    @property
    def _at(self) -> list[int]:
        return list(self.found[2])

    @property
    def _word(self) -> str:
        """The variable in LaTeX."""
        return rf"\mathrm{{{_escaped(self.variable)}}}"

    @property
    def _rows(self) -> tuple[str, ...]:
        """Unit of each entry of the value."""
        return _row_units(self.export.units, self.expression.value.shape)

    @cached_property
    def _value(self) -> ca.SX:
        """The value row by row."""
        return ca.vec(ca.densify(self.expression.value.T))

    @cached_property
    def _jacobian(self) -> ca.SX:
        return ca.jacobian(self._value, self.found[0])[:, self._at]

    def _first(self) -> Routine:
        export, name = self.export, f"{self.name}_d_{self.variable}"
        return Routine(
            name,
            f"Jacobian of {export.name} with respect to {self.variable}",
            self.expression.described(),
            "jacobian",
            self._rows,
            self.found[1],
            rf"\frac{{\partial {export.symbol}}}{{\partial {self._word}}}",
            self.expression.function(name, self._jacobian),
        )

    def _hessian(self) -> Routine:
        export, name, units = self.export, f"{self.name}_hessian_{self.variable}", self.found[1]
        hessian = ca.jacobian(self._jacobian.T, self.found[0])[:, self._at]
        return Routine(
            name,
            f"Hessian of {export.name} with respect to {self.variable}",
            self.expression.described(),
            "hessian",
            tuple(f"{self._rows[0]}/({unit})" for unit in units),
            units,
            rf"\nabla^2_{{{self._word}}} {export.symbol}",
            self.expression.function(name, hessian),
        )

    def _product(self) -> Routine:
        export, name, units = self.export, f"{self.name}_hessian_product_{self.variable}", self.found[1]
        symbol, at, count = self.found[0], self._at, self._value.shape[0]
        multiplier, direction = ca.SX.sym("multiplier", count), ca.SX.sym("direction", len(at))
        whole = ca.SX.zeros(symbol.shape)
        for k, place in enumerate(at):
            whole[place] = direction[k]
        product = ca.jtimes(self._jacobian.T @ multiplier, symbol, whole)
        extra = (
            centred(
                "multiplier",
                f"factor of each entry of {export.name}, matrices row by row",
                [f"row{i + 1}" for i in range(count)],
                ("1",),
                [rf"\lambda_{{{i + 1}}}" for i in range(count)],
                1.0,
            ),
            centred(
                "direction",
                f"direction in the space of {self.variable}",
                [f"entry{i + 1}" for i in range(len(at))],
                units,
                [rf"d_{{{i + 1}}}" for i in range(len(at))],
                1.0,
            ),
        )
        return Routine(
            name,
            f"sum of multiplier_i times the Hessian of {export.name}_i with respect to {self.variable}, "
            "times direction",
            (*self.expression.described(), *extra),
            "product",
            tuple(f"sum of ({' | '.join(dict.fromkeys(self._rows))})/({unit})" for unit in units),
            (),
            rf"\lambda \cdot \nabla^2_{{{self._word}}} {export.symbol} \, d",
            self.expression.function(name, product, (multiplier, direction)),
        )


def _row_units(units: tuple[str, ...], shape: tuple[int, int]) -> tuple[str, ...]:
    """Unit of each entry, row by row."""
    rows = units * shape[0] if len(units) == 1 else units
    entries = []
    for row in rows:
        columns = row.split(", ")
        entries += columns * shape[1] if len(columns) == 1 else columns
    return tuple(entries)


def _escaped(name: str) -> str:
    return name.replace("_", r"\_")


def check_variables(variables: Sequence[str], exports: Sequence[Export], wanted: Wanted) -> None:
    """Refuse variables that none of the exports can have.

    Args:
        variables: as after `--wrt`.
        exports: of the catalogue.
        wanted: platform and motion.

    Raises:
        InputError: an unknown variable, with the nearest.
    """
    symbols = Symbols(ca.SX(0), wanted.platform.platform.wheel_count, wanted.motion)
    arguments = dict.fromkeys(name for export in exports for name in symbols.arguments(export.arguments))
    valid = [*arguments, ALL, *wanted.platform.names()]
    for name in variables:
        if name not in valid:
            near = nearest(name, valid)
            raise InputError(f'unknown variable "{name}" after --wrt; {suggestion(near, [*arguments, ALL])}')
