"""LaTeX: a document with the symbols of the paper; what is long or occurs twice becomes a named subexpression."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple

from occ.export.about import about
from occ.export.languages.base import Checked, Language, first_tool, run
from occ.export.languages.templates import render
from occ.export.program import CONSTANT, INPUT, Step
from occ.export.routine import Module, Routine

TOOLS = ("pdflatex", "tectonic")
WIDEST = 80
"""Characters of a formula, about, beyond which a part of it becomes a subexpression."""
ROWS = 30
"""Formulas in one block."""
SUM, PRODUCT, FUNCTION, ATOM = 1, 2, 3, 4
"""How tight a formula holds together: what is looser than needed goes into parentheses."""

_NAMED = {name: rf"\{name}" for name in ("exp", "sin", "cos", "tan", "sinh", "cosh", "tanh")} | {
    "log": r"\ln",
    "asin": r"\arcsin",
    "acos": r"\arccos",
    "atan": r"\arctan",
    "fmin": r"\min",
    "fmax": r"\max",
    **{
        name: rf"\operatorname{{{name}}}"
        for name in ("log1p", "expm1", "sign", "asinh", "acosh", "atanh", "atan2", "hypot", "fmod", "copysign")
    },
}
_COMPARED = {"lt": "<", "le": r"\le", "eq": "=", "ne": r"\ne", "and": r"\wedge", "or": r"\vee"}


class Formula(NamedTuple):
    """A piece of LaTeX.

    Args:
        text: in mathematical mode.
        tight: one of SUM .. ATOM.
        width: in characters, about.
    """

    text: str
    tight: int
    width: int

    def within(self, tight: int) -> str:
        """The text, in parentheses where it does not hold together tightly enough."""
        return self.text if self.tight >= tight else rf"\left({self.text}\right)"


class Latex(Language):
    """LaTeX."""

    name: ClassVar[str] = "latex"

    def files(self, module: Module) -> dict[str, str]:
        """NAME.tex."""
        export = module.export
        values = {
            "about": about(module, self.name),
            "title": escaped(module.name),
            "meaning": escaped(export.meaning),
            "equation": escaped(export.equation),
            "source": escaped(export.source),
            "functions": [
                {
                    "name": escaped(routine.name),
                    "meaning": escaped(routine.meaning),
                    "arguments": [_argument(routine, i) for i in range(len(routine.arguments))],
                    "shape": rf"{routine.shape[0]} \times {routine.shape[1]}",
                    "zeros": len(routine.nonzeros) < routine.shape[0] * routine.shape[1],
                    "blocks": blocks(formulas(routine)),
                }
                for routine in module.routines
            ],
        }
        return {f"{module.name}.tex": render("latex_document", values)}

    def check(self, folder: Path, modules: Sequence[Module]) -> Checked:
        """Compile every document."""
        tool = first_tool(TOOLS)
        if tool is None:
            return Checked("")
        name = Path(tool).name
        options = ["-draftmode", "-interaction=nonstopmode", "-halt-on-error"] if name == "pdflatex" else []
        for module in modules:
            code, output, complaint = run([tool, *options, f"{module.name}.tex"], folder)
            if code:
                lines = (output + complaint).splitlines()
                return Checked(name, {}, next((line for line in lines if line.startswith("!")), f"exit code {code}"))
        return Checked(name)


def escaped(text: str) -> str:
    """A text in LaTeX."""
    special = {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
    special |= {sign: rf"\{sign}" for sign in "&%$#_{}"} | {sign: f"${sign}$" for sign in "<>|"}
    return "".join(special.get(sign, sign) for sign in text)


def _argument(routine: Routine, place: int) -> dict[str, str]:
    argument = routine.arguments[place]
    entries = zip(argument.symbols, argument.entries, argument.units, strict=True)
    listed = [rf"${symbol}$ {escaped(entry)} [{escaped(unit)}]" for symbol, entry, unit in entries]
    return {"name": escaped(argument.name), "meaning": escaped(argument.meaning), "entries": ", ".join(listed)}


def blocks(lines: Sequence[str]) -> list[list[str]]:
    """Formulas in groups that LaTeX takes at once."""
    return [list(lines[k : k + ROWS]) for k in range(0, len(lines), ROWS)]


def formulas(routine: Routine) -> list[str]:
    """``left &= right`` for each subexpression and each entry that is not zero.

    Args:
        routine: to print.

    Returns:
        Lines in the order of evaluation.
    """
    printer = _Printer(routine)
    rows, columns = routine.shape
    results = []
    for row, column, step in routine.program.results:
        place = "" if (rows, columns) == (1, 1) else f"{row + 1}" if columns == 1 else f"{row + 1},{column + 1}"
        left = rf"\left({routine.symbol}\right)_{{{place}}}" if place else routine.symbol
        results.append(f"{left} &= {printer.formulas[step].text}")
    return [*printer.defined, *results]


class _Printer:
    """Formulas of all steps of a program, and the subexpressions that got a name."""

    def __init__(self, routine: Routine) -> None:
        program = routine.program
        uses = Counter(i for step in program.steps for i in step.operands)
        uses.update(step for _, _, step in program.results)
        self.routine = routine
        self.defined: list[str] = []
        self.formulas: list[Formula] = []
        for k, step in enumerate(program.steps):
            formula = self._formula(step)
            if uses[k] > 1 and formula.tight < ATOM and step.operation not in (CONSTANT, INPUT):
                formula = self._named(formula)
            self.formulas.append(formula)

    def _named(self, formula: Formula) -> Formula:
        name = f"c_{{{len(self.defined) + 1}}}"
        self.defined.append(f"{name} &= {formula.text}")
        return Formula(name, ATOM, 2)

    def _formula(self, step: Step) -> Formula:
        if step.operation == CONSTANT:
            return _number(step.number)
        if step.operation == INPUT:
            symbol = self.routine.arguments[step.place[0]].symbols[step.place[1]]
            # What has a superscript cannot take another one.
            return Formula(symbol, FUNCTION if "^" in symbol else ATOM, 3)
        operands = [self.formulas[i] for i in step.operands]
        while sum(operand.width for operand in operands) > WIDEST:
            widest = max(range(len(operands)), key=lambda i: operands[i].width)
            operands[widest] = self._named(operands[widest])
        return _combined(step.operation, operands)


def _number(value: float) -> Formula:
    mantissa, _, exponent = repr(value).partition("e")
    mantissa = mantissa.removesuffix(".0")
    if exponent:
        return Formula(rf"{mantissa} \cdot 10^{{{int(exponent)}}}", SUM if value < 0 else PRODUCT, len(mantissa) + 3)
    return Formula(mantissa, SUM if value < 0 else ATOM, len(mantissa))


def _combined(operation: str, operands: list[Formula]) -> Formula:
    a, b = operands[0], operands[-1]
    width = sum(operand.width for operand in operands) + 1
    if operation == "add":
        # A sum may begin with a sign, but no sign may follow another one.
        right = b.text if not b.text.startswith("-") else b.within(PRODUCT)
        return Formula(f"{a.text} + {right}", SUM, width)
    if operation == "sub":
        return Formula(f"{a.text} - {b.within(PRODUCT)}", SUM, width)
    if operation in ("mul", "twice"):
        a = Formula("2", ATOM, 1) if operation == "twice" else a
        left, right = a.within(PRODUCT), b.within(PRODUCT)
        sign = r"\cdot" if right[0].isdigit() else r"\,"
        return Formula(f"{left} {sign} {right}", PRODUCT, width)
    if operation in ("div", "inv"):
        above = "1" if operation == "inv" else a.text
        return Formula(rf"\frac{{{above}}}{{{b.text}}}", FUNCTION, max(a.width, b.width) + 1)
    if operation == "neg":
        return Formula(f"-{a.within(PRODUCT)}", SUM, width)
    if operation in ("sq", "pow"):
        return Formula(f"{a.within(ATOM)}^{{{'2' if operation == 'sq' else b.text}}}", FUNCTION, width)
    if operation == "not":
        return Formula(rf"\left[{a.text} = 0\right]", ATOM, width + 3)
    if operation in _COMPARED:
        return Formula(rf"\left[{a.text} {_COMPARED[operation]} {b.text}\right]", ATOM, width + 3)
    if operation == "if_else_zero":
        return Formula(rf"\left[{a.text} \ne 0\right] \, {b.within(PRODUCT)}", PRODUCT, width + 3)
    if operation in ("sqrt", "fabs", "floor", "ceil"):
        left, right = {
            "sqrt": (r"\sqrt{", "}"),
            "fabs": (r"\left|", r"\right|"),
            "floor": (r"\left\lfloor ", r"\right\rfloor"),
            "ceil": (r"\left\lceil ", r"\right\rceil"),
        }[operation]
        return Formula(f"{left}{a.text}{right}", FUNCTION, width)
    inside = ", ".join(operand.text for operand in operands)
    return Formula(rf"{_NAMED[operation]}\left({inside}\right)", FUNCTION, width + 3)
