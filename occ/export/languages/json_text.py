"""JSON: names, shapes, units, sparsity, checksum, and the straight-line program itself, for any other language."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import occ
from occ.export.about import about
from occ.export.evaluate import evaluate
from occ.export.languages.base import Checked, Language
from occ.export.program import CONSTANT, INPUT, Program, Step
from occ.export.routine import Module, Routine
from occ.export.table import error_of, table_of


class Json(Language):
    """JSON."""

    name: ClassVar[str] = "json"

    def files(self, module: Module) -> dict[str, str]:
        """NAME.json."""
        export = module.export
        content = {
            "about": about(module, self.name),
            "name": module.name,
            "meaning": export.meaning,
            "equation": export.equation,
            "source": export.source,
            "version": occ.__version__,
            "functions": [_function(routine) for routine in module.routines],
        }
        return {f"{module.name}.json": _compact(content)}

    def check(self, folder: Path, modules: Sequence[Module]) -> Checked:
        """Read the programs back and run them."""
        errors: dict[str, float] = {}
        for module in modules:
            content = json.loads((folder / f"{module.name}.json").read_text())
            for routine, function in zip(module.routines, content["functions"], strict=True):
                if function["sha256"] != checksum(function["program"]):
                    return Checked("JSON read back", errors, f"{routine.name}: the checksum is that of another program")
                table = table_of(routine)
                results = evaluate(program_from(function["program"]), routine.shape, table.inputs)
                errors[routine.name] = error_of(table, results)
        return Checked("JSON read back", errors)


def _function(routine: Routine) -> dict[str, Any]:
    program = {
        "steps": [_step(step) for step in routine.program.steps],
        "results": [list(result) for result in routine.program.results],
    }
    return {
        "name": routine.name,
        "meaning": routine.meaning,
        "arguments": [
            {
                "name": argument.name,
                "meaning": argument.meaning,
                "shape": [argument.size],
                "entries": list(argument.entries),
                "units": list(argument.units),
            }
            for argument in routine.arguments
        ],
        "result": {
            "name": routine.result,
            "shape": list(routine.shape),
            "order": "row by row",
            "row_units": list(routine.row_units),
            "column_units": list(routine.column_units),
            "nonzeros": [list(place) for place in routine.nonzeros],
        },
        "program": program,
        "sha256": checksum(program),
    }


def checksum(program: Any) -> str:
    """SHA-256 of a program as compact JSON with sorted keys."""
    return hashlib.sha256(json.dumps(program, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _step(step: Step) -> list[Any]:
    if step.operation == INPUT:
        return [INPUT, *step.place]
    if step.operation == CONSTANT:
        return [CONSTANT, step.number]
    return [step.operation, *step.operands]


def program_from(content: Any) -> Program:
    """The program in an exported JSON file.

    Args:
        content: under ``program`` of one function.

    Returns:
        What was exported.
    """
    steps = []
    for name, *values in content["steps"]:
        if name == INPUT:
            steps.append(Step(INPUT, place=(values[0], values[1])))
        elif name == CONSTANT:
            steps.append(Step(CONSTANT, number=float(values[0])))
        else:
            steps.append(Step(name, tuple(values)))
    return Program(tuple(steps), tuple((row, column, step) for row, column, step in content["results"]))


def _compact(content: Any) -> str:
    """Indented JSON whose innermost lists stand on one line."""
    import re

    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    flat = re.sub(r"\[\n\s+([^\[\]{}]*?)\n\s+\]", lambda m: "[" + re.sub(r",\n\s+", ", ", m.group(1)) + "]", text)
    return flat + "\n"
