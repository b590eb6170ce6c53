"""An evaluator of the LaTeX that an export writes: it sees the formulas of the file and nothing else."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np

from occ.export.languages.latex import formulas
from occ.export.routine import Routine

FUNCTIONS: dict[str, Callable[..., float]] = {
    rf"\{name}": getattr(math, name) for name in ("exp", "sin", "cos", "tan", "sinh", "cosh", "tanh")
} | {
    r"\ln": math.log,
    r"\arcsin": math.asin,
    r"\arccos": math.acos,
    r"\arctan": math.atan,
    r"\min": min,
    r"\max": max,
    **{
        rf"\operatorname{{{name}}}": getattr(math, name)
        for name in ("log1p", "expm1", "asinh", "acosh", "atanh", "atan2", "hypot", "fmod", "copysign")
    },
    r"\operatorname{sign}": lambda x: float(np.sign(x)),
}
RELATIONS: dict[str, Callable[[float, float], bool]] = {
    "<": lambda x, y: x < y,
    r"\le": lambda x, y: x <= y,
    "=": lambda x, y: x == y,
    r"\ne": lambda x, y: x != y,
    r"\wedge": lambda x, y: x != 0 and y != 0,
    r"\vee": lambda x, y: x != 0 or y != 0,
}
NUMBER = re.compile(r"\d+(\.\d+)?")


class Reader:
    """Recursive descent over one formula."""

    def __init__(self, text: str, symbols: dict[str, float]) -> None:
        self.text, self.symbols = text, symbols
        self.names = sorted(symbols, key=len, reverse=True)

    def value(self) -> float:
        result = self.sum()
        assert not self.text, f"left over: {self.text}"
        return result

    def take(self, token: str) -> bool:
        text = self.text.lstrip()
        # A command ends where its letters end: \left is none of \le.
        if not text.startswith(token) or (token[-1:].isalpha() and text[len(token) : len(token) + 1].isalpha()):
            return False
        self.text = text[len(token) :].lstrip()
        return True

    def expect(self, token: str) -> None:
        assert self.take(token), f"{token} expected before {self.text}"

    def sum(self) -> float:
        total = -self.product() if self.take("-") else self.product()
        while True:
            if self.take("+"):
                total += self.product()
            elif self.take("-"):
                total -= self.product()
            else:
                return total

    def product(self) -> float:
        value = self.factor()
        while self.take(r"\,") or self.take(r"\cdot"):
            value *= self.factor()
        return value

    def factor(self) -> float:
        base = self.atom()
        if self.take("^{"):
            exponent = self.sum()
            self.expect("}")
            return base**exponent
        return base

    def braces(self) -> float:
        self.expect("{")
        value = self.sum()
        self.expect("}")
        return value

    def between(self, right: str) -> float:
        value = self.sum()
        self.expect(right)
        return value

    def atom(self) -> float:
        for name in self.names:
            if self.take(name):
                return self.symbols[name]
        for name, function in FUNCTIONS.items():
            if self.take(name):
                self.expect(r"\left(")
                arguments = [self.sum()]
                while self.take(","):
                    arguments.append(self.sum())
                self.expect(r"\right)")
                return float(function(*arguments))
        if self.take(r"\frac"):
            return self.braces() / self.braces()
        if self.take(r"\sqrt"):
            return math.sqrt(self.braces())
        if self.take(r"\left("):
            return self.between(r"\right)")
        if self.take(r"\left|"):
            return abs(self.between(r"\right|"))
        if self.take(r"\left\lfloor"):
            return float(math.floor(self.between(r"\right\rfloor")))
        if self.take(r"\left\lceil"):
            return float(math.ceil(self.between(r"\right\rceil")))
        if self.take(r"\left["):
            left = self.sum()
            relation = next(name for name in RELATIONS if self.take(name))
            holds = RELATIONS[relation](left, self.sum())
            self.expect(r"\right]")
            return float(holds)
        number = NUMBER.match(self.text)
        assert number, f"no value at {self.text}"
        self.text = self.text[number.end() :].lstrip()
        return float(number.group())


def evaluate_latex(routine: Routine, inputs: list[float]) -> np.ndarray:
    """The matrix that the formulas of a function's LaTeX define; inputs one after the other."""
    symbols = dict(zip((s for argument in routine.arguments for s in argument.symbols), inputs, strict=True))
    result = np.zeros(routine.shape)
    for line in formulas(routine):
        left, _, right = line.partition(" &= ")
        value = Reader(right, symbols).value()
        place = re.fullmatch(r"\\left\(.*\\right\)_\{(\d+)(?:,(\d+))?\}", left)
        if left.startswith("c_{"):
            symbols[left] = value
        elif place:
            result[int(place.group(1)) - 1, int(place.group(2) or 1) - 1] = value
        else:
            result[0, 0] = value
    return result
