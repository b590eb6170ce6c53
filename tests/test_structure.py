"""The house: imports go downwards only, modules stay small, start-up stays light."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import occ

ROOT = Path(occ.__file__).parent
LAYERS = (
    ("compiler",),
    ("native",),
    ("errors", "checks", "numeric", "templates"),
    ("model", "motion", "trajectory", "integration"),
    ("control", "plant", "task"),
    ("objectives", "allocation"),
    ("laws", "optimal", "referee", "theory"),
    ("certify", "open_loop"),
    ("players",),
    ("experiment", "paper"),
    ("atlas",),
    ("report",),
    ("figures",),
    ("export",),
    ("commands", "progress"),
    ("cli",),
)
LAYER = {room: i for i, rooms in enumerate(LAYERS) for room in rooms}
# Rooms of one layer that may look into a neighbour of the same layer.
NEIGHBOURS = {
    ("optimal", "laws"),
    ("theory", "laws"),
    ("paper", "experiment"),
    ("task", "control"),
    ("task", "plant"),
    ("allocation", "objectives"),
    ("motion", "model"),
    ("model", "motion"),
    ("checks", "errors"),
}
MODULES = sorted(path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py")


def room_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imported_rooms(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module)
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {name.split(".")[1] for name in names if name.startswith("occ.")}


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_go_downwards(path: Path) -> None:
    here = room_of(path)
    assert here in LAYER, f"room {here!r} has no layer: add it to LAYERS"
    for there in imported_rooms(path):
        below = LAYER[there] < LAYER[here] or there == here or (here, there) in NEIGHBOURS
        assert below, f"{path.relative_to(ROOT)} imports occ.{there}, which is not below occ.{here}"


def test_the_referee_sees_no_player() -> None:
    for path in (ROOT / "referee").glob("*.py"):
        assert not imported_rooms(path) & {"laws", "optimal", "players"}, path.name


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_module_is_longer_than_400_lines(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 400


def loaded_by(code: str) -> set[str]:
    script = f"{code}\nimport sys; print(' '.join(sys.modules))"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in result.stdout.splitlines()[-1].split()}


def test_start_up_loads_nothing_heavy() -> None:
    heavy = {"casadi", "numpy", "scipy", "pandas", "xarray", "matplotlib", "cvxpy", "pydantic", "sympy"}
    assert not loaded_by("import occ") & heavy
    assert not loaded_by("import occ.cli") & heavy


def test_public_names_are_there() -> None:
    for name in occ.__all__:
        assert getattr(occ, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        occ.nothing  # noqa: B018 - looking it up is what is tested
