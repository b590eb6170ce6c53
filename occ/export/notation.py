"""How a language writes the steps of a straight-line program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from occ.export.program import CONSTANT, INPUT, Program, Step


@dataclass(frozen=True)
class Notation:
    """How a language writes values and operations of a straight-line program.

    Args:
        forms: of each operation, with {0} and {1} for its operands.
        value: of a step, with {0} for its number.
    """

    forms: Mapping[str, str]
    value: str = "v{0}"

    def operation(self, step: Step, operands: Sequence[str]) -> str:
        """The expression of one step."""
        return self.forms[step.operation].format(*operands)


def lines_of(program: Program, notation: Notation, atom: Mapping[int, str], assignment: str) -> list[str]:
    """One assignment for each operation of a program.

    Args:
        program: to print.
        notation: of the language.
        atom: how the constants and the inputs are written, by number of the step.
        assignment: with {0} for the name of the value and {1} for the expression.

    Returns:
        Lines in the order of evaluation.
    """
    names = names_of(program, notation, atom)
    return [
        assignment.format(names[k], notation.operation(step, [names[i] for i in step.operands]))
        for k, step in enumerate(program.steps)
        if step.operation not in (INPUT, CONSTANT)
    ]


def names_of(program: Program, notation: Notation, atom: Mapping[int, str]) -> list[str]:
    """How each step is written where another one takes it."""
    return [atom.get(k, notation.value.format(k)) for k in range(len(program.steps))]
