"""MATLAB and Octave: one file for each function, for one point or for many at once, and a script that checks them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from occ.export.about import about
from occ.export.languages.base import Checked, Language, first_tool, printed_errors, run
from occ.export.languages.templates import render
from occ.export.notation import Notation, lines_of, names_of
from occ.export.program import CONSTANT, INPUT
from occ.export.routine import Module, Routine
from occ.export.table import TOLERANCE

TOOLS = ("octave-cli", "octave")
_SAME = (
    *("sqrt", "exp", "log", "log1p", "expm1", "sign", "floor", "ceil", "sin", "cos", "tan", "asin", "acos", "atan"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
)
FORMS = (
    {name: f"{name}({{0}})" for name in _SAME}
    | {name: f"{name}({{0}}, {{1}})" for name in ("hypot", "atan2")}
    | {name: f"double({{0}} {sign} {{1}})" for name, sign in (("lt", "<"), ("le", "<="), ("eq", "=="), ("ne", "~="))}
    | {
        "add": "{0} + {1}",
        "sub": "{0} - {1}",
        "mul": "{0} .* {1}",
        "div": "{0} ./ {1}",
        "neg": "-{0}",
        "inv": "1 ./ {0}",
        "sq": "{0} .* {0}",
        "twice": "2 * {0}",
        "pow": "{0} .^ {1}",
        "fabs": "abs({0})",
        "fmod": "rem({0}, {1})",
        "fmin": "min({0}, {1})",
        "fmax": "max({0}, {1})",
        # A negative zero is told from a positive one by its inverse.
        "copysign": "abs({0}) .* (1 - 2 * double({1} < 0 | 1 ./ {1} < 0))",
        "not": "double({0} == 0)",
        "and": "double({0} ~= 0 & {1} ~= 0)",
        "or": "double({0} ~= 0 | {1} ~= 0)",
        "if_else_zero": "occ_chosen({0}, {1})",
    }
)
NOTATION = Notation(FORMS)


class Matlab(Language):
    """MATLAB or Octave."""

    name: ClassVar[str] = "matlab"

    def files(self, module: Module) -> dict[str, str]:
        """NAME.m and one file for each derivative, and NAME_check.m."""
        lines = about(module, self.name)
        values = {"about": lines, "tolerance": TOLERANCE, "name": module.name}
        functions = [_function(routine) for routine in module.routines]
        files = {f"{function['name']}.m": render("matlab_function", values | {"f": function}) for function in functions}
        return files | {f"{module.name}_check.m": render("matlab_check", values | {"functions": functions})}

    def check(self, folder: Path, modules: Sequence[Module]) -> Checked:
        """Run every check in one Octave."""
        octave = first_tool(TOOLS)
        if octave is None:
            return Checked("")
        calls = " ".join(f"wrong = wrong | {module.name}_check('.');" for module in modules)
        command = [octave, "--norc", "--no-history", "--quiet", "--eval", f"wrong = 0; {calls} exit(double(wrong));"]
        return printed_errors("Octave", *run(command, folder))


def _function(routine: Routine) -> dict[str, object]:
    atoms = {}
    for k, step in enumerate(routine.program.steps):
        if step.operation == CONSTANT:
            atoms[k] = repr(step.number) if step.number >= 0 else f"({step.number!r})"
        elif step.operation == INPUT:
            argument = routine.arguments[step.place[0]]
            atoms[k] = argument.name if argument.size == 1 else f"{argument.name}({step.place[1] + 1}, :)"
    names = names_of(routine.program, NOTATION, atoms)
    rows, columns = routine.shape
    return {
        "name": routine.name,
        "meaning": routine.meaning,
        "names": [argument.name for argument in routine.arguments],
        "arguments": [(argument.name, argument.size) for argument in routine.arguments],
        "rows": rows,
        "columns": columns,
        "result": routine.result,
        "chooses": "if_else_zero" in routine.program.operations(),
        "lines": lines_of(routine.program, NOTATION, atoms, "{0} = {1};"),
        "stores": [
            (f"{row + 1}, :" if columns == 1 else f"{row + 1}, {column + 1}, :", names[step])
            for row, column, step in routine.program.results
        ],
    }
