"""What every exported file says first: equation, source, arguments, shapes, units, sparsity, version and command."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Sequence

import occ
from occ.export.routine import Module, Routine

WIDEST = 110
"""Characters of a line."""
WIDEST_PATTERN = 100
"""Columns up to which the zeros of a matrix are drawn."""


def command(module: Module, *language: str) -> str:
    """The command that writes the files of one name and language again."""
    return shlex.join(["occ", "export", *module.options, "--language", *language]) + " --out DIR"


def about(module: Module, *language: str) -> list[str]:
    """Lines that stand at the beginning of a module's files.

    Args:
        module: what is exported.
        language: as after `--language`, and its options.

    Returns:
        Lines without line breaks inside and without a comment's sign.
    """
    export = module.export
    lines = [
        f"{module.name}: {export.meaning}",
        f"Equation: {export.equation}",
        f"Source: {export.source}",
        "SI units and radians. Matrices are stored row by row.",
        f"Platform: {module.platform.source}, {module.platform.platform.wheel_count} wheels",
        *_numbers(module),
        *([f"Program motion of B: {module.motion.kind}"] if _moves(module) else []),
        *(line for routine in module.routines for line in ["", *describe(routine)]),
        "",
        f"Made by occ {occ.__version__}; the same bytes again by",
        f"  {command(module, *language)}",
    ]
    return [part for line in lines for part in _folded(" ".join(line.splitlines()))]


def _folded(line: str) -> list[str]:
    """A long line as several; the command stays whole, so that it can be copied."""
    if line.startswith("  occ export") or not line.strip():
        return [line.rstrip()]
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.wrap(line, WIDEST, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def _moves(module: Module) -> bool:
    return any(argument.name in ("motion", "program_velocity") for argument in module.routines[0].arguments)


def _numbers(module: Module) -> list[str]:
    symbolic = [f"{number.name} ({number.value!r})" for number in module.symbolic]
    lines = [f"Symbolic, with values of the platform: {', '.join(symbolic)}"] if symbolic else []
    if len(module.symbolic) < 4 + 10 * module.platform.platform.wheel_count:
        lines.append(f"Frozen numbers{' (all others)' * bool(symbolic)}: {_frozen(module)}")
    return lines


def _frozen(module: Module) -> str:
    symbolic = {place for number in module.symbolic for place, _ in number.places}
    names = [name for name in module.platform.names() if name not in {number.name for number in module.symbolic}]
    shown: dict[str, float] = {}
    done = set(symbolic)
    # A preset's key comes first and stands for all numbers that it decides.
    for name in names:
        (number,) = module.platform.find([name])
        places = {place for place, _ in number.places}
        if not places & done:
            done |= places
            shown[name] = number.value
    return ", ".join(f"{name} = {value!r}" for name, value in shown.items())


def describe(routine: Routine) -> list[str]:
    """Signature, arguments with units, and the pattern of zeros of one function."""
    rows, columns = routine.shape
    names = ", ".join(argument.name for argument in routine.arguments)
    lines = [f"{routine.name}({names}) -> {routine.result} ({rows}, {columns})", f"  {routine.meaning}"]
    for argument in routine.arguments:
        entries = ", ".join(f"{e} [{u}]" for e, u in zip(argument.entries, argument.units, strict=True))
        lines.append(f"  {argument.name} ({argument.size},): {argument.meaning}: {entries}")
    lines.append(f"  {routine.result} ({rows}, {columns}): {_units(routine)}")
    nonzero = routine.nonzeros
    lines.append(f"  {len(nonzero)} of {rows * columns} entries are not zero by structure")
    if len(nonzero) < rows * columns and columns <= WIDEST_PATTERN:
        pattern = [["."] * columns for _ in range(rows)]
        for row, column in nonzero:
            pattern[row][column] = "*"
        lines += [f"    {''.join(row)}" for row in pattern]
    return lines


def _units(routine: Routine) -> str:
    rows = " | ".join(_short(routine.row_units))
    if not routine.column_units:
        return f"[{rows}]"
    return f"rows [{rows}] per columns [{' | '.join(_short(routine.column_units))}]"


def _short(units: Sequence[str]) -> Sequence[str]:
    return units[:1] if len(set(units)) == 1 else units
