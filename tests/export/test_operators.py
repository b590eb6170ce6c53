"""Every operator that can occur in an expression, in every language; what cannot be printed is refused."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from occ.errors import InputError
from occ.export.arguments import Argument
from occ.export.catalogue import EXPORTS
from occ.export.languages import LANGUAGES
from occ.export.languages.c import C
from occ.export.numbers import PlatformNumbers
from occ.export.program import OPERATIONS, program_of
from occ.export.routine import Module, Routine
from occ.export.symbols import Program
from occ.model.presets import youbot
from tests.export.latex_reader import evaluate_latex
from tests.export.test_agreement import assert_agrees, assert_agrees_in_c

# Random values of both signs, and between -1 and 1 where an inverse function asks for that.
a, b = ca.SX.sym("a"), ca.SX.sym("b")
EXPRESSIONS: dict[str, ca.SX] = {
    "add": a + b,
    "sub": a - b,
    "mul": a * b,
    "div": a / b,
    "pow": ca.fabs(a) ** b,
    "atan2": ca.atan2(a, b),
    "hypot": ca.hypot(a, b),
    "fmod": ca.fmod(7 * a, b),
    "fmin": ca.fmin(a, b),
    "fmax": ca.fmax(a, b),
    "copysign": ca.copysign(a, b),
    "lt": a < b,
    "le": a <= b,
    "eq": ca.floor(2 * a) == ca.floor(2 * b),
    "ne": ca.floor(2 * a) != ca.floor(2 * b),
    "and": ca.logic_and(a < 0.5, b < 0.5),
    "or": ca.logic_or(a < -0.5, b < -0.5),
    "if_else_zero": ca.if_else(a < b, a * b, 0),
    "neg": -a,
    "inv": 1 / a,
    "sq": a**2,
    "twice": 2 * a,
    "sqrt": ca.sqrt(ca.fabs(a)),
    "exp": ca.exp(a),
    "log": ca.log(ca.fabs(a)),
    "log1p": ca.log1p(ca.fabs(a)),
    "expm1": ca.expm1(a),
    "fabs": ca.fabs(a),
    "sign": ca.sign(a),
    "floor": ca.floor(3 * a),
    "ceil": ca.ceil(3 * a),
    "not": ca.logic_not(ca.floor(2 * a)),
    "sin": ca.sin(a),
    "cos": ca.cos(a),
    "tan": ca.tan(a),
    "asin": ca.asin(a),
    "acos": ca.acos(a),
    "atan": ca.atan(a),
    "sinh": ca.sinh(a),
    "cosh": ca.cosh(a),
    "tanh": ca.tanh(a),
    "asinh": ca.asinh(a),
    "acosh": ca.acosh(1 + ca.fabs(a)),
    "atanh": ca.atanh(a),
}
# Powers with a constant exponent, constants of both signs and sizes, and a choice with two ends.
MIXED = {
    "power": ca.fabs(a) ** 1.5 - (-2.5e-7) * b,
    "constants": 1e-20 * (a + 3e20) - 2.0 * b**3 + 1e16,
    "signs": -(-a - (b - a)) * (-b) + (-1.5) * (a + -b) / -(a * b),
    "choice": ca.if_else(ca.logic_and(a > 0, b > a), a / b, -b * a),
}


def routine_of(name: str, expression: ca.SX) -> Routine:
    arguments = tuple(Argument(x, "test", (x,), ("1",), (x,), (0.0,), (0.98,)) for x in ("a", "b"))
    function = ca.Function(name, [a, b], [ca.densify(expression)])
    return Routine(name, "test", arguments, "result", ("1",), (), "z", function)


@pytest.fixture(scope="module")
def module() -> Module:
    routines = [routine_of(f"op_{name}", expression) for name, expression in (EXPRESSIONS | MIXED).items()]
    numbers = PlatformNumbers(youbot(), "none")
    return Module("op_all", EXPORTS["power"], tuple(routines), numbers, (), Program(None), ("power",))


def test_every_operation_occurs() -> None:
    assert tuple(sorted(EXPRESSIONS)) == tuple(sorted(OPERATIONS))
    for name, expression in EXPRESSIONS.items():
        assert name in routine_of(name, expression).program.operations()


@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
def test_c(module: Module, tmp_path: Path, single: bool) -> None:
    # Beyond a step of floor, of fmod and of a comparison single precision may decide otherwise.
    rough = {"op_fmod", "op_constants"}
    kept = [routine for routine in module.routines if not single or routine.name not in rough]
    part = Module("op_all", module.export, tuple(kept), module.platform, (), module.motion, ("power",))
    assert_agrees_in_c(tmp_path, [part], C(single=single))


@pytest.mark.parametrize("language", [name for name in LANGUAGES if name != "c"])
def test_other_languages(module: Module, tmp_path: Path, language: str) -> None:
    assert_agrees(tmp_path, [module], LANGUAGES[language]())


def test_latex_read_back(module: Module) -> None:
    random = np.random.default_rng(1)
    for routine in module.routines:
        for point in random.uniform(-0.98, 0.98, (20, 2)):
            value = float(routine.function(*point))
            assert evaluate_latex(routine, list(point))[0, 0] == pytest.approx(value, rel=1e-12, abs=1e-300)


def test_equal_values_are_computed_once() -> None:
    x = ca.SX.sym("x", 2)
    function = ca.Function("f", [x], [ca.vertcat(ca.sin(x[0] * x[1]), ca.sin(x[1] * x[0]) + x[1] * x[0])])
    program = program_of(function)
    names = [step.operation for step in program.steps]
    assert names.count("sin") == 1
    assert names.count("mul") == 1


@pytest.mark.parametrize(
    ("expression", "word"),
    [(ca.erf(a), "erf"), (ca.remainder(a, b), "remainder"), (a + ca.inf, "inf"), (ca.SX.nan() * a, "nan")],
)
def test_what_cannot_be_printed_is_refused(expression: ca.SX, word: str) -> None:
    with pytest.raises(InputError, match=word):
        program_of(ca.Function("f", [a, b], [expression]))
