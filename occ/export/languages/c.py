"""C99: header, source, a program that checks them, and a snippet for CMake; no heap, no static data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from occ.compiler import COMPILERS
from occ.export.about import about
from occ.export.languages.base import Checked, Language, first_tool, printed_errors, run
from occ.export.languages.templates import render
from occ.export.notation import Notation, lines_of, names_of
from occ.export.program import CONSTANT, INPUT
from occ.export.routine import Module, Routine
from occ.export.table import SINGLE_TOLERANCE, TOLERANCE

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
FEW_STEPS = 10_000
"""Up to which a check is compiled with optimisation: a compiler's time for it grows faster than the program."""
_FUNCTIONS = (
    *("sqrt", "exp", "log", "log1p", "expm1", "fabs", "floor", "ceil", "sin", "cos", "tan", "asin", "acos", "atan"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "pow", "atan2", "hypot", "fmod", "fmin", "fmax", "copysign"),
)
TWO = ("pow", "atan2", "hypot", "fmod", "fmin", "fmax", "copysign")
MANY_ZEROS = 8
"""From this many zeros on a loop writes them."""


def _forms(real: str, suffix: str, literal: str) -> dict[str, str]:
    zero, one, two = (f"{number}.0{literal}" for number in (0, 1, 2))
    calls = {name: f"{name}{suffix}({{0}}, {{1}})" if name in TWO else f"{name}{suffix}({{0}})" for name in _FUNCTIONS}
    compared = {name: f"({real})({{0}} {sign} {{1}})" for name, sign in (("lt", "<"), ("le", "<="), ("eq", "=="))}
    return (
        calls
        | compared
        | {
            "add": "{0} + {1}",
            "sub": "{0} - {1}",
            "mul": "{0} * {1}",
            "div": "{0} / {1}",
            "neg": "-{0}",
            "inv": f"{one} / {{0}}",
            "sq": "{0} * {0}",
            "twice": f"{two} * {{0}}",
            "ne": f"({real})({{0}} != {{1}})",
            "not": f"({real})({{0}} == {zero})",
            "and": f"({real})({{0}} != {zero} && {{1}} != {zero})",
            "or": f"({real})({{0}} != {zero} || {{1}} != {zero})",
            "if_else_zero": f"{{0}} != {zero} ? {{1}} : {zero}",
            "sign": f"({real})(({{0}} > {zero}) - ({{0}} < {zero}))",
        }
    )


@dataclass(frozen=True)
class C(Language):
    """C99.

    Args:
        single: whether numbers are ``float``.
    """

    name: ClassVar[str] = "c"
    single: bool = False

    @property
    def real(self) -> str:
        """Type of all numbers."""
        return "float" if self.single else "double"

    @property
    def tolerance(self) -> float:
        """Largest relative difference from CasADi."""
        return SINGLE_TOLERANCE if self.single else TOLERANCE

    def files(self, module: Module) -> dict[str, str]:
        """NAME.h, NAME.c, NAME_check.c and NAME.cmake."""
        lines = [
            line.replace("*/", "* /").replace("/*", "/ *")
            for line in about(module, self.name, *(["--single"] if self.single else []))
        ]
        functions = [self._function(routine) for routine in module.routines]
        values = {
            "about": lines,
            "name": module.name,
            "guard": f"{module.name.upper()}_H",
            "real": self.real,
            "tolerance": self.tolerance,
            "functions": functions,
            # An array of no entries is none.
            "most_inputs": max(1, *(function["inputs"] for function in functions)),
            "most_results": max(1, *(function["size"] for function in functions)),
        }
        return {
            f"{module.name}.h": render("c_header", values),
            f"{module.name}.c": render("c_source", values),
            f"{module.name}_check.c": render("c_check", values),
            f"{module.name}.cmake": render("c_cmake", values),
        }

    def _number(self, value: float) -> str:
        text = repr(value) + ("f" if self.single else "")
        return f"({text})" if value < 0 or text.startswith("-") else text

    def _function(self, routine: Routine) -> dict[str, Any]:
        notation = Notation(_forms(self.real, "f" if self.single else "", "f" if self.single else ""))
        program = routine.program
        atoms = {}
        for k, step in enumerate(program.steps):
            if step.operation == CONSTANT:
                atoms[k] = self._number(step.number)
            elif step.operation == INPUT:
                argument = routine.arguments[step.place[0]]
                atoms[k] = argument.name if argument.size == 1 else f"{argument.name}[{step.place[1]}]"
        names = names_of(program, notation, atoms)
        rows, columns = routine.shape
        written = {row * columns + column: names[step] for row, column, step in program.results}
        zeros = [place for place in range(rows * columns) if place not in written]
        zero, loop = self._number(0.0), len(zeros) >= MANY_ZEROS
        used = {step.place[0] for step in program.steps if step.operation == INPUT}
        parameters = [
            f"{self.real} {argument.name}"
            if argument.size == 1
            else f"const {self.real} {argument.name}[{argument.size}]"
            for argument in routine.arguments
        ]
        return {
            "name": routine.name,
            "meaning": routine.meaning,
            "signature": ", ".join([*parameters, f"{self.real} {routine.result}[{rows * columns}]"]),
            "lines": lines_of(program, notation, atoms, f"const {self.real} {{0}} = {{1}};"),
            "unused": [a.name for i, a in enumerate(routine.arguments) if i not in used],
            "result": routine.result,
            "size": rows * columns,
            "loop": loop,
            "zero": zero,
            "stores": sorted((written if loop else dict.fromkeys(zeros, zero) | written).items()),
            "inputs": sum(argument.size for argument in routine.arguments),
            "call": ", ".join([*_passed(routine), "result"]),
        }

    def check(self, folder: Path, modules: Sequence[Module]) -> Checked:
        """Compile everything with all warnings as errors, and run the programs that check."""
        compiler = first_tool(COMPILERS)
        if compiler is None:
            return Checked("")
        tool = Path(compiler).name
        (folder / "all_checks.c").write_text(together(modules))
        steps = sum(len(routine.program.steps) for module in modules for routine in module.routines)
        level = "-O2" if steps <= FEW_STEPS else "-O0"
        code, _, complaint = run([compiler, *FLAGS, level, "-I.", "all_checks.c", "-lm", "-o", "all_checks"], folder)
        if code:
            return Checked(tool, {}, next((line for line in complaint.splitlines() if "error" in line), complaint))
        return printed_errors(tool, *run(["./all_checks"], folder))


def _passed(routine: Routine) -> list[str]:
    """The arguments of a call where one array ``inputs`` holds all of them."""
    passed, start = [], 0
    for argument in routine.arguments:
        passed.append(f"inputs[{start}]" if argument.size == 1 else f"inputs + {start}")
        start += argument.size
    return passed


def together(modules: Sequence[Module]) -> str:
    """One program of all sources and checks, so that one call of the compiler and one run do for all."""
    lines = [f'#include "{module.name}.c"' for module in modules]
    for module in modules:
        lines += [f"#define main main_{module.name}", f'#include "{module.name}_check.c"', "#undef main"]
    lines += ["int main(void)", "{", "    char *none[] = {0};", "    int wrong = 0;"]
    lines += [f"    wrong |= main_{module.name}(0, none);" for module in modules]
    return "\n".join([*lines, "    return wrong;", "}", ""])
