"""The command line: help, lists, schema, machine-readable output, pipes."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from occ.commands import assignments_apart
from occ.errors import OccError
from occ.model.presets import YouBot
from occ.motion import MOTIONS
from occ.objectives import OBJECTIVES
from occ.players import PLAYERS
from tests.experiment import tiny
from tests.experiment.conftest import Occ, Write


def test_help_names_every_command(occ: Occ) -> None:
    result = occ("--help")
    assert result.exit_code == 0
    for command in (
        "run",
        "check",
        "schema",
        "list",
        "circle",
        "atlas",
        "paper",
        "audit",
        "export",
        "report",
        "--version",
    ):
        assert command in result.stdout


def test_start_loads_nothing_heavy() -> None:
    heavy = ("casadi", "pandas", "pydantic", "xarray", "scipy", "matplotlib", "numpy", "rich")
    code = f"import sys, occ.cli; print([name for name in {heavy} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout == "[]\n"


def test_version(occ: Occ) -> None:
    from importlib.metadata import version

    assert occ("--version").stdout == f"occ {version('occ')}\n"


@pytest.mark.parametrize("arguments", [[], ["run"], ["chekc"], ["list", "wheels"], ["run", "a.toml", "--workers", "0"]])
def test_wrong_usage_is_exit_code_2(occ: Occ, arguments: list[str]) -> None:
    assert occ(*arguments).exit_code == 2


def test_lists(occ: Occ) -> None:
    everything = occ("list").stdout
    for family in ("platforms", "motions", "controllers", "objectives"):
        alone = occ("list", family)
        assert alone.exit_code == 0
        assert alone.stdout.strip() in everything
    for cls in (*MOTIONS, *PLAYERS):
        assert f"  {cls.kind}: " in everything
    for name in OBJECTIVES:
        assert f"  {name} " in everything
    of_youbot = everything.split("  youbot")[1]
    line = next(line for line in of_youbot.splitlines() if line.split()[:1] == ["yaw_inertia"])
    for word in (str(YouBot().yaw_inertia), "[kg m^2]", "I_s", "(2.17)"):
        assert word in line


def test_check_counts(write: Write, occ: Occ) -> None:
    assert occ("check", write()).stdout == "ok: 1 case, 2 controllers\n"
    path = write(tiny(more='[sweep]\n"motion.radius" = [0.6, 0.7]\n'))
    assert occ("check", path).stdout == "ok: 2 cases, 2 controllers\n"
    assert occ("check", path, "--set", "motion.radius=0.5").stdout == "ok: 1 case, 2 controllers\n"


@pytest.mark.usefixtures("no_figures")
def test_json_is_all_there_is(write: Write, occ: Occ, tmp_path: Path) -> None:
    result = occ("run", write(), "--out", tmp_path / "out", "--json", "--set", "horizon.duration=0.25")
    assert result.exit_code == 0
    assert result.stderr == ""
    content = json.loads(result.stdout)
    assert [row["controller"] for row in content["rows"]] == ["servo law", "translation"]
    assert content["rows"][0]["work_bound"] > 0
    assert content["rows"][1]["work_bound"] is None
    assert isinstance(content["rows"][0]["work_J"], float)
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["experiment"]["horizon"] == {"duration": 0.25}


@pytest.mark.parametrize("content", [None, "not,a,table\n1,2\n", "case\nbase\n"])
def test_report_of_a_folder_without_results(occ: Occ, tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "results.csv").write_text(content)
        (tmp_path / "run.json").write_text("{}")
    result = occ("report", tmp_path)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert str(tmp_path) in line
    assert "results" in line


def test_output_may_be_cut_short(write: Write) -> None:
    command = f"{sys.executable} -m occ.cli schema | head -n 1"
    result = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert (result.stdout, result.stderr) == ("{\n", "")


@pytest.fixture
def schema(occ: Occ) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(occ("schema").stdout)
    return content


def test_schema_describes_every_key(schema: dict[str, Any]) -> None:
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    definitions = schema["$defs"]
    for cls in (*MOTIONS, *PLAYERS, YouBot):
        table = definitions[cls.__name__]
        assert table["additionalProperties"] is False
        assert table["description"]
        for key in table["properties"].values():
            assert key["description"]
    assert definitions["Circle"]["properties"]["radius"]["exclusiveMinimum"] == 0
    assert definitions["CompareTable"]["properties"]["objectives"]["items"]["enum"] == list(OBJECTIVES)

    def references(node: Any) -> Any:
        if isinstance(node, dict):
            yield from ([node["$ref"]] if "$ref" in node else [])
            for item in node.values():
                yield from references(item)
        elif isinstance(node, list):
            for item in node:
                yield from references(item)

    assert {name.removeprefix("#/$defs/") for name in references(schema)} <= set(definitions)


def test_schema_validates_files(schema: dict[str, Any]) -> None:
    import tomllib

    import jsonschema

    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    sweep = '[sweep]\n"motion.radius" = { from = 0.6, to = 0.7, count = 2 }\n'
    assert validator.is_valid(tomllib.loads(tiny(more=sweep)))
    for bad in (tiny(("0.70", "true")), tiny(("radius", "raduis")), tiny(("duration", "lap"))):
        assert not validator.is_valid(tomllib.loads(bad))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("run x.toml --set a=1", "run x.toml --set a=1"),
        ("run x.toml --set a.b=1 c=2 --json", "run x.toml --set a.b=1 --set c=2 --json"),
        ("--set a=1 b=2 c=3 x.toml", "--set a=1 --set b=2 --set c=3 x.toml"),
        ("--set a=1 --set b=2 c=-3", "--set a=1 --set b=2 --set c=-3"),
        ("--set a=1 runs/b=2.toml", "--set a=1 runs/b=2.toml"),
        (
            "--set 'controller.min work.intervals=4' 'sweep.a=[1, 2]'",
            "--set 'controller.min work.intervals=4' --set 'sweep.a=[1, 2]'",
        ),
        ("x.toml a=1", "x.toml a=1"),
    ],
)
def test_one_option_takes_several_assignments(words: str, expected: str) -> None:
    assert assignments_apart(shlex.split(words)) == shlex.split(expected)


def test_every_assignment_counts(occ: Occ, write: Write) -> None:
    path = write()
    assert occ("check", path, "--set", "motion.radius=0.6", "point.x=0.3").exit_code == 0
    result = occ("check", path, "--set", "motion.radius=0.6", "point.z=0.3")
    assert (result.exit_code, result.stderr.partition(";")[0]) == (2, "--set point.z: unknown key")
    assert occ("check", path, "point.x=0.3").exit_code == 2


def test_a_failure_that_occ_states_is_one_line_and_exit_code_1(
    occ: Occ, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(*_: object) -> None:
        raise OccError("no rotational motion was found at R_B = 0.3 m")

    monkeypatch.setattr("occ.paper.data.write_data", lost)
    result = occ("paper", "--figure", "3", "--out", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (1, "no rotational motion was found at R_B = 0.3 m\n")
