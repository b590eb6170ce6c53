"""Functions to be printed, and the modules that they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from occ.export.arguments import Argument
from occ.export.catalogue import Export
from occ.export.numbers import Number, PlatformNumbers
from occ.export.program import Program, program_of
from occ.export.symbols import Program as ProgramMotion
from occ.numeric import evaluate_many


@dataclass(frozen=True, eq=False)
class Routine:
    """One function.

    Args:
        name: an identifier.
        meaning: in words.
        arguments: in order.
        result: name of the value.
        row_units: of the value's rows, or one for all.
        column_units: that the rows' units are divided by, one for each column; none where the value is no derivative.
        symbol: of the value, LaTeX.
        function: of CasADi, with the arguments as columns.
    """

    name: str
    meaning: str
    arguments: tuple[Argument, ...]
    result: str
    row_units: tuple[str, ...]
    column_units: tuple[str, ...]
    symbol: str
    function: ca.Function

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the value."""
        return self.function.size_out(0)

    @cached_property
    def program(self) -> Program:
        """What the languages print."""
        return program_of(self.function)

    @property
    def nonzeros(self) -> list[tuple[int, int]]:
        """(row, column) of the entries that are not zero by structure, row by row."""
        return [(row, column) for row, column, _ in self.program.results]


def evaluate_function(function: ca.Function, inputs: Sequence[np.ndarray]) -> np.ndarray:
    """What CasADi makes of N inputs.

    Args:
        function: with one output.
        inputs: of each argument, (size, N).

    Returns:
        (rows times columns, N), row by row; N is 1 where there is no argument.
    """
    symbols = function.sx_in()
    flat = ca.vec(ca.densify(function.call(symbols)[0]).T)
    many = ca.Function(function.name(), symbols, [flat])
    return evaluate_many(many, *inputs)[0] if inputs else np.array(many.call([])[0])


@dataclass(frozen=True, eq=False)
class Module:
    """An expression with its derivatives: what goes into the files of one name.

    Args:
        name: of the files and of the function of the value; an identifier.
        export: of the catalogue.
        routines: the value first.
        platform: with its numbers.
        symbolic: numbers of the platform that are arguments.
        motion: of B.
        options: of the command that makes this module again, without languages and folder.
    """

    name: str
    export: Export
    routines: tuple[Routine, ...]
    platform: PlatformNumbers
    symbolic: tuple[Number, ...]
    motion: ProgramMotion
    options: tuple[str, ...]
