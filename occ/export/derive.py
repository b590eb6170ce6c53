"""An expression of the catalogue with its Jacobians, Hessians and Hessian-vector products as functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
            routines += _derivatives(export, name, moving, variable, found, wanted.order)
    for routine in routines:
        if len(routine.name) > LONGEST_NAME:
            raise InputError(
                f"{routine.name} is longer than {LONGEST_NAME} characters; {export.name}=NAME gives a shorter one"
            )
    command = options(name, export.name, [variable for variable in variables if variable not in missing])
    module = Module(name, export, tuple(routines), wanted.platform, expression.symbolic, wanted.motion, command)
    return module, missing


def _derivatives(
    export: Export,
    name: str,
    expression: _Expression,
    variable: str,
    found: tuple[ca.SX, tuple[str, ...], tuple[int, ...]],
    order: int,
) -> list[Routine]:
    symbol, units, places = found
    value = ca.vec(ca.densify(expression.value.T))  # row by row
    at = list(places)
    jacobian = ca.jacobian(value, symbol)[:, at]
    rows = _row_units(export.units, expression.value.shape)
    latex = rf"\frac{{\partial {export.symbol}}}{{\partial \mathrm{{{_escaped(variable)}}}}}"
    first = f"{name}_d_{variable}"
    routines = [
        Routine(
            first,
            f"Jacobian of {export.name} with respect to {variable}",
            expression.described(),
            "jacobian",
            rows,
            units,
            latex,
            expression.function(first, jacobian),
        )
    ]
    if order < SECOND:
        return routines
    if value.shape == (1, 1):
        second = f"{name}_hessian_{variable}"
        hessian = ca.jacobian(jacobian.T, symbol)[:, at]
        routines.append(
            Routine(
                second,
                f"Hessian of {export.name} with respect to {variable}",
                expression.described(),
                "hessian",
                tuple(f"{rows[0]}/({unit})" for unit in units),
                units,
                rf"\nabla^2_{{\mathrm{{{_escaped(variable)}}}}} {export.symbol}",
                expression.function(second, hessian),
            )
        )
        return routines
    multiplier = ca.SX.sym("multiplier", value.shape[0])
    direction = ca.SX.sym("direction", len(at))
    second = f"{name}_hessian_product_{variable}"
    gradient = jacobian.T @ multiplier
    whole = ca.SX.zeros(symbol.shape)
    for k, place in enumerate(at):
        whole[place] = direction[k]
    extra = (
        centred(
            "multiplier",
            f"factor of each entry of {export.name}, matrices row by row",
            [f"row{i + 1}" for i in range(value.shape[0])],
            ("1",),
            [rf"\lambda_{{{i + 1}}}" for i in range(value.shape[0])],
            1.0,
        ),
        centred(
            "direction",
            f"direction in the space of {variable}",
            [f"entry{i + 1}" for i in range(len(at))],
            units,
            [rf"d_{{{i + 1}}}" for i in range(len(at))],
            1.0,
        ),
    )
    product = ca.jtimes(gradient, symbol, whole)
    routines.append(
        Routine(
            second,
            f"sum of multiplier_i times the Hessian of {export.name}_i with respect to {variable}, times direction",
            (*expression.described(), *extra),
            "product",
            tuple(f"sum of ({' | '.join(dict.fromkeys(rows))})/({unit})" for unit in units),
            (),
            rf"\lambda \cdot \nabla^2_{{\mathrm{{{_escaped(variable)}}}}} {export.symbol} \, d",
            expression.function(second, product, (multiplier, direction)),
        )
    )
    return routines


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
