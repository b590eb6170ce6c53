"""One walk over a CasADi expression graph: a straight-line program of named operations, which every language prints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from occ.errors import InputError

INPUT, CONSTANT = "input", "constant"
BINARY = (
    *("add", "sub", "mul", "div", "pow", "atan2", "hypot", "fmod", "fmin", "fmax", "copysign"),
    *("lt", "le", "eq", "ne", "and", "or", "if_else_zero"),
)
UNARY = (
    *("neg", "inv", "sq", "twice", "sqrt", "exp", "log", "log1p", "expm1", "fabs", "sign", "floor", "ceil", "not"),
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
)
OPERATIONS = (*BINARY, *UNARY)
"""What every language prints, by the names of CasADi's own codes in lower case."""
COMMUTATIVE = frozenset({"add", "mul", "eq", "ne", "and", "or"})
"""Operands in either order make the same bits."""

_CODES = {getattr(ca, f"OP_{name.upper()}"): name for name in OPERATIONS} | {ca.OP_CONSTPOW: "pow"}


@dataclass(frozen=True)
class Step:
    """One value of a program.

    Args:
        operation: one of `OPERATIONS`, ``input`` or ``constant``.
        operands: steps before this one, by number.
        number: of a constant.
        place: argument and entry of an input.
    """

    operation: str
    operands: tuple[int, ...] = ()
    number: float = 0.0
    place: tuple[int, int] = (-1, -1)


class Program(NamedTuple):
    """Steps in the order of evaluation, each value computed once, and where the results go.

    Args:
        steps: none of them without use.
        results: (row, column, step) of each entry that is not zero by structure, row by row.
    """

    steps: tuple[Step, ...]
    results: tuple[tuple[int, int, int], ...]

    def operations(self) -> set[str]:
        """Names of the operations that occur."""
        return {step.operation for step in self.steps} - {INPUT, CONSTANT}


def program_of(function: ca.Function) -> Program:
    """The straight-line program of an SX function with one output; equal values are computed once.

    Args:
        function: of CasADi, made of SX.

    Returns:
        The program; its results are those of the function bit by bit, where the elementary functions are the same.

    Raises:
        InputError: an operation that no language can print, or a constant that is not finite.
    """
    steps: list[Step] = []
    known: dict[object, int] = {}
    slots: dict[int, int] = {}
    results: list[tuple[int, int, int]] = []
    rows, columns = function.sparsity_out(0).get_triplet()

    def number_of(step: Step) -> int:
        key = (step.operation, step.operands, step.number.hex(), step.place)
        if key not in known:
            known[key] = len(steps)
            steps.append(step)
        return known[key]

    for k in range(function.n_instructions()):
        code, places = function.instruction_id(k), function.instruction_input(k)
        if code == ca.OP_OUTPUT:
            entry = function.instruction_output(k)[1]
            results.append((rows[entry], columns[entry], slots[places[0]]))
            continue
        (slot,) = function.instruction_output(k)
        if code == ca.OP_ASSIGN:
            slots[slot] = slots[places[0]]
        elif code == ca.OP_INPUT:
            slots[slot] = number_of(Step(INPUT, place=(places[0], places[1])))
        elif code == ca.OP_CONST:
            number = float(function.instruction_constant(k))
            if not math.isfinite(number):
                raise InputError(f"{function.name()}: the constant {number} in its expression; should be finite")
            slots[slot] = number_of(Step(CONSTANT, number=number))
        elif code in _CODES:
            operands = tuple(slots[place] for place in places[: 2 if _CODES[code] in BINARY else 1])
            if _CODES[code] in COMMUTATIVE:
                operands = tuple(sorted(operands))
            slots[slot] = number_of(Step(_CODES[code], operands))
        else:
            raise InputError(
                f"{function.name()}: the operation {_name(code)} cannot be exported; should be one of "
                f"{', '.join(OPERATIONS)}"
            )
    return _pruned(steps, sorted(results))


def _name(code: int) -> str:
    names = (name for name in dir(ca) if name.startswith("OP_") and getattr(ca, name) == code)
    return next(names, f"number {code}").removeprefix("OP_").lower()


def _pruned(steps: list[Step], results: list[tuple[int, int, int]]) -> Program:
    """The program without steps that no result needs."""
    needed = {step for _, _, step in results}
    for k in reversed(range(len(steps))):
        if k in needed:
            needed.update(steps[k].operands)
    kept = sorted(needed)
    renamed = {old: new for new, old in enumerate(kept)}
    new_steps = tuple(
        Step(steps[k].operation, tuple(renamed[i] for i in steps[k].operands), steps[k].number, steps[k].place)
        for k in kept
    )
    return Program(new_steps, tuple((row, column, renamed[step]) for row, column, step in results))
