"""Python with NumPy only: one function for one point or for many at once, real or complex."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from occ.export.about import about
from occ.export.evaluate import NOTATION
from occ.export.languages.base import Checked, Language, printed_errors, run
from occ.export.languages.templates import render
from occ.export.notation import lines_of, names_of
from occ.export.program import CONSTANT, INPUT
from occ.export.routine import Module, Routine
from occ.export.table import TOLERANCE


class NumPy(Language):
    """Python with NumPy."""

    name: ClassVar[str] = "python"

    def files(self, module: Module) -> dict[str, str]:
        """NAME.py, which checks itself where it is run."""
        values = {
            "about": about(module, self.name),
            "tolerance": TOLERANCE,
            "functions": [function_values(routine) for routine in module.routines],
        }
        return {f"{module.name}.py": render("numpy_module", values)}

    def check(self, folder: Path, modules: Sequence[Module]) -> Checked:
        """Run every module in one Python without access to anything but its standard packages and the folder."""
        names = ", ".join(repr(module.name) for module in modules)
        code = (
            "import importlib, sys; sys.path.insert(0, '.'); sys.dont_write_bytecode = True; "
            f"sys.exit(max([importlib.import_module(name).check() for name in ({names},)]))"
        )
        version = ".".join(map(str, sys.version_info[:3]))
        return printed_errors(f"Python {version}", *run([sys.executable, "-I", "-c", code], folder))


def function_values(routine: Routine) -> dict[str, object]:
    """What the frame of a module takes of one function."""
    atoms = {}
    for k, step in enumerate(routine.program.steps):
        if step.operation == CONSTANT:
            atoms[k] = repr(step.number) if step.number >= 0 else f"({step.number!r})"
        elif step.operation == INPUT:
            atoms[k] = f"{routine.arguments[step.place[0]].name}[{step.place[1]}]"
    names = names_of(routine.program, NOTATION, atoms)
    rows, columns = routine.shape
    vector = columns == 1
    return {
        "name": routine.name,
        "meaning": routine.meaning,
        "arguments": [(argument.name, argument.size) for argument in routine.arguments],
        "names": [argument.name for argument in routine.arguments],
        "rows": rows,
        "columns": columns,
        "shape": "()" if (rows, columns) == (1, 1) else f"({rows},)" if vector else f"({rows}, {columns})",
        "result": routine.result,
        "lines": lines_of(routine.program, NOTATION, atoms, "{0} = {1}"),
        "stores": [
            ("..." if (rows, columns) == (1, 1) else f"{row}" if vector else f"{row}, {column}", names[step])
            for row, column, step in routine.program.results
        ],
    }
