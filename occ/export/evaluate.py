"""The operations of a program in NumPy: as text for exported files, and to run a program without printing it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from occ.export.notation import Notation
from occ.export.program import BINARY, CONSTANT, INPUT, Program

_SAME = (
    *("sqrt", "exp", "log", "log1p", "expm1", "fabs", "sign", "floor", "ceil", "sin", "cos", "tan"),
    *("sinh", "cosh", "tanh"),
)
_INVERSE = ("asin", "acos", "atan", "asinh", "acosh", "atanh")
FORMS = (
    {name: f"np.{name}({{0}})" for name in _SAME}
    | {name: f"np.arc{name[1:]}({{0}})" for name in _INVERSE}
    | {name: f"np.{name}({{0}}, {{1}})" for name in ("hypot", "fmod", "fmin", "fmax", "copysign")}
    | {name: f"1.0 * ({{0}} {sign} {{1}})" for name, sign in (("lt", "<"), ("le", "<="), ("eq", "=="), ("ne", "!="))}
    | {
        "add": "{0} + {1}",
        "sub": "{0} - {1}",
        "mul": "{0} * {1}",
        "div": "{0} / {1}",
        "neg": "-{0}",
        "inv": "1.0 / {0}",
        "sq": "{0} * {0}",
        "twice": "2.0 * {0}",
        "pow": "np.power({0}, {1})",
        "atan2": "np.arctan2({0}, {1})",
        "not": "1.0 * ({0} == 0.0)",
        "and": "1.0 * (({0} != 0.0) & ({1} != 0.0))",
        "or": "1.0 * (({0} != 0.0) | ({1} != 0.0))",
        "if_else_zero": "np.where({0} != 0.0, {1}, 0.0)",
    }
)
NOTATION = Notation(FORMS)
SMALL = 1e-6
"""Relative change of an operand that shows how much an operation passes on of it."""


@cache
def function_of(operation: str) -> Callable[..., np.ndarray]:
    """An operation as a function of arrays."""
    operands = "a, b" if operation in BINARY else "a"
    return eval(f"lambda {operands}: {FORMS[operation].format('a', 'b')}", {"np": np})


def _values(program: Program, inputs: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    """The value of each step at N points."""
    values: list[np.ndarray] = []
    for step in program.steps:
        if step.operation == CONSTANT:
            values.append(np.full(count, step.number))
        elif step.operation == INPUT:
            values.append(inputs[step.place[0]][step.place[1]])
        else:
            values.append(function_of(step.operation)(*(values[i] for i in step.operands)))
    return values


def _results(program: Program, shape: tuple[int, int], values: Sequence[np.ndarray], count: int) -> np.ndarray:
    results = np.zeros((shape[0] * shape[1], count))
    for row, column, step in program.results:
        results[row * shape[1] + column] = values[step]
    return results


def evaluate(program: Program, shape: tuple[int, int], inputs: Sequence[np.ndarray]) -> np.ndarray:
    """Run a program.

    Args:
        program: of any origin.
        shape: rows and columns of its value.
        inputs: of each argument, (size, N).

    Returns:
        (rows times columns, N), row by row.
    """
    count = inputs[0].shape[1] if inputs else 1
    with np.errstate(all="ignore"):
        return _results(program, shape, _values(program, inputs, count), count)


def rounding(program: Program, shape: tuple[int, int], inputs: Sequence[np.ndarray]) -> np.ndarray:
    """e = |v| + sum |dv/dv_i| e_i: the rounding error that a program can gather, in units of the machine's roundoff.

    An entry that is zero by cancellation has no relative accuracy; this is what its error is small against.

    Args:
        program: of any origin.
        shape: rows and columns of its value.
        inputs: of each argument, (size, N), taken as exact.

    Returns:
        (rows times columns, N), row by row.

    Source: Higham, Accuracy and Stability of Numerical Algorithms, section 3.3 (running error analysis).
    """
    count = inputs[0].shape[1] if inputs else 1
    with np.errstate(all="ignore"):
        values = _values(program, inputs, count)
        errors: list[np.ndarray] = []
        for step, value in zip(program.steps, values, strict=True):
            error = np.zeros(count) if step.operation == INPUT else np.abs(value)
            operands = [values[i] for i in step.operands]
            for k, i in enumerate(step.operands):
                moved = SMALL * np.abs(operands[k]) + 1e-30
                shifted = [operand + moved if j == k else operand for j, operand in enumerate(operands)]
                slope = np.abs(function_of(step.operation)(*shifted) - value) / moved
                # Where a step of the operand crosses a jump there is no slope to speak of.
                error = error + np.where(np.isfinite(slope) & (slope < 1.0 / SMALL), slope, 0.0) * errors[i]
            errors.append(error)
        return _results(program, shape, errors, count)
