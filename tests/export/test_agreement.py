"""Every export in every language agrees with CasADi at 1,000 random inputs."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from occ.export.catalogue import EXPORTS
from occ.export.evaluate import evaluate
from occ.export.languages import LANGUAGES, Language
from occ.export.languages.base import first_tool
from occ.export.languages.c import FLAGS, C, together
from occ.export.languages.casadi_function import CasadiFunction
from occ.export.languages.json_text import Json, program_from
from occ.export.languages.matlab import TOOLS
from occ.export.routine import Module, evaluate_function
from occ.export.symbols import PROGRAM
from occ.export.table import error_of, table_of
from tests.export.printing import ARGUMENTS, KEYS, SAMPLES, modules_of, write

FEW = ("state", "torque", "acceleration", "wrench", "limit", "point")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def run_in_c(folder: Path, modules: Sequence[Module], language: C) -> dict[str, float]:
    """Errors of the compiled C of all modules: one compiler call, all warnings as errors, under the sanitizers."""
    write(folder, modules, [language])
    (folder / "all.c").write_text(together(modules))
    subprocess.run(["cc", *FLAGS, *SANITIZERS, "-I.", "all.c", "-lm", "-o", "all"], cwd=folder, check=True)
    done = subprocess.run(["./all"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stderr
    return {line.split()[0]: float(line.split()[1]) for line in done.stdout.splitlines()}


def assert_agrees(folder: Path, modules: Sequence[Module], language: Language) -> None:
    """What the language's own check finds, or that it finds no tool on this machine."""
    runs = language.name == "python" or (language.name == "matlab" and first_tool(TOOLS))
    write(folder, modules, [language], SAMPLES if runs else 1)
    done = language.check(folder, modules)
    if not done.tool:
        # Only Octave and LaTeX may be missing where occ is developed.
        assert language.name in ("matlab", "latex")
        return
    assert not done.reason
    wanted = {routine.name for module in modules for routine in module.routines}
    assert set(done.errors) == (set() if language.name == "latex" else wanted)
    assert max(done.errors.values(), default=0.0) <= language.tolerance


@pytest.fixture(scope="module")
def first() -> list[Module]:
    """All exports with Jacobians, numbers of the platform frozen; the long tests have all arguments."""
    return modules_of(wrt=FEW)


def assert_agrees_in_c(folder: Path, modules: Sequence[Module], language: C) -> None:
    errors = run_in_c(folder, modules, language)
    assert set(errors) == {routine.name for module in modules for routine in module.routines}
    assert max(errors.values()) <= language.tolerance


def test_c(first: list[Module], tmp_path: Path) -> None:
    assert_agrees_in_c(tmp_path, first, C())


@pytest.mark.parametrize("language", ["python", "matlab"])
def test_other_languages(first: list[Module], tmp_path: Path, language: str) -> None:
    assert_agrees(tmp_path, first, LANGUAGES[language]())


def test_json(first: list[Module], tmp_path: Path) -> None:
    """The programs in the files, run by themselves; the file's own checksum and pattern belong to them."""
    import json

    write(tmp_path, first, [Json()], samples=2)
    assert not Json().check(tmp_path, first).reason
    for module in first:
        content = json.loads((tmp_path / f"{module.name}.json").read_text())
        for routine, function in zip(module.routines, content["functions"], strict=True):
            program = program_from(function["program"])
            table = table_of(routine, SAMPLES)
            assert error_of(table, evaluate(program, routine.shape, table.inputs)) <= 1e-12
            assert function["result"]["nonzeros"] == [[i, j] for i, j, _ in program.results]
            pattern = ca.DM(routine.function.sparsity_out(0), 1).sparsity()
            assert sorted(map(tuple, function["result"]["nonzeros"])) == sorted(
                zip(*pattern.get_triplet(), strict=True)
            )


def test_casadi(first: list[Module], tmp_path: Path) -> None:
    write(tmp_path, first, [CasadiFunction()], samples=2)
    assert not CasadiFunction().check(tmp_path, first).reason
    for module in first:
        for routine in module.routines:
            loaded = ca.Function.load(str(tmp_path / f"{routine.name}.casadi"))
            table = table_of(routine, SAMPLES)
            assert error_of(table, evaluate_function(loaded, table.inputs)) <= 1e-12


EVERYTHING: dict[str, dict[str, Any]] = {
    "second": {"wrt": ARGUMENTS, "second": True},
    "keys": {"wrt": ("parameters",), "symbolic": KEYS},
    "omni3": {"platform": "omni3", "wrt": ("state", "motion")},
}


@pytest.mark.slow
@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
@pytest.mark.parametrize("case", EVERYTHING)
def test_c_of_everything(case: str, single: bool, tmp_path: Path) -> None:
    assert_agrees_in_c(tmp_path, modules_of(**EVERYTHING[case]), C(single=single))


@pytest.mark.slow
@pytest.mark.parametrize("language", ["python", "matlab", "latex"])
@pytest.mark.parametrize("case", ["second", "keys"])
def test_other_languages_of_everything(case: str, language: str, tmp_path: Path) -> None:
    assert_agrees(tmp_path, modules_of(**EVERYTHING[case]), LANGUAGES[language]())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "options"),
    [
        (("forward", "power"), {"wrt": ("parameters",), "second": True}),
        (("servo_torque", "box_torque"), {"symbolic": ("parameters",), "wrt": ("parameters",)}),
        (("servo_torque", "constraint_rate"), {"motion": "given", "wrt": ("program_velocity", "point")}),
        (("servo_torque", "program_acceleration"), {"motion": "rest_to_rest", "wrt": ("t", "motion")}),
        (("servo_torque", "program_acceleration"), {"platform": "experiments/spline.toml", "wrt": ("t", "motion")}),
    ],
    ids=["frozen", "all-symbolic", "given", "rest_to_rest", "spline"],
)
def test_c_of_other_platforms_and_motions(names: tuple[str, ...], options: dict[str, Any], tmp_path: Path) -> None:
    assert_agrees_in_c(tmp_path, modules_of(*names, **options), C())


def test_first_derivatives_cover_every_argument(first: list[Module]) -> None:
    """No argument of an export is without its Jacobian, unless the expression does not depend on it."""
    for module in first:
        value, *jacobians = module.routines
        made = {routine.name.removeprefix(f"{module.name}_d_") for routine in jacobians}
        assert made == {argument.name for argument in value.arguments} & set(FEW)
    assert set(ARGUMENTS) == {name for export in EXPORTS.values() for name in export.arguments} - set(PROGRAM)


def test_a_table_holds_numbers_of_single_precision_and_the_same_in_every_run(first: list[Module]) -> None:
    one, other = (table_of(first[0].routines[0], 20) for _ in range(2))
    for inputs, same in zip(one.inputs, other.inputs, strict=True):
        assert np.array_equal(inputs, same)
        assert np.array_equal(inputs, inputs.astype(np.float32))
    assert np.ptp(one.results) > 0.1
