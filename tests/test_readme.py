"""The README's examples run as they stand."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from tests.test_reports import is_as_committed

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
FILES = {name: block for block in BLOCKS for name in re.findall(r"\A# (\w+\.py)\n", block)}
"""Python blocks that are files of the user's, by the name in their first line."""
PYTHON = [block for block in BLOCKS if block not in FILES.values()]
LINES = [
    line.split("#")[0].strip()
    for block in re.findall(r"```console\n(.*?)```", TEXT, re.DOTALL)
    for line in block.splitlines()
    if line.startswith("occ ")
]
MAIN = "occ run experiments/section5.toml"
"""What `make compare` runs."""
CONSOLE = [line for line in LINES if "--allow-code" not in line]


def test_python_examples_run_in_their_order(capsys: pytest.CaptureFixture[str]) -> None:
    assert len(PYTHON) >= 2
    names: dict[str, object] = {"__name__": "readme"}
    for block in PYTHON:
        exec(compile(block, "README.md", "exec"), names)
    table = names["table"]
    assert (table["status"] == "ok").all()
    assert "min work" in capsys.readouterr().out


@pytest.mark.parametrize("line", CONSOLE)
def test_commands_run(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from occ.cli import app

    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "experiments", tmp_path / "experiments")
    for folder in re.findall(r" (reports/\w+)", line):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    command = shlex.split(line)[1:]
    # The main job has a process of its own to solve in, as it has for users; the others are spared the start.
    here = ["--in-process"] * (line != MAIN and command[0] in ("run", "atlas"))
    result = CliRunner().invoke(app, [*command, *here])
    assert result.exit_code == 0, result.output
    if line == MAIN:
        is_as_committed(tmp_path / "reports" / "section5", "section5")


def test_the_main_job_is_one_of_them() -> None:
    assert MAIN in CONSOLE
    assert MAIN.removeprefix("occ ") in (ROOT / "Makefile").read_text()


def test_own_law_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from occ.cli import app
    from occ.experiment.results import Results

    monkeypatch.chdir(tmp_path)
    (line,) = [line for line in LINES if "--allow-code" in line]
    ((name, block),) = FILES.items()
    (tmp_path / name).write_text(block)
    (table,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    (experiment,) = re.findall(r"a copy of `(experiments/\w+\.toml)` named `mine\.toml`", TEXT)
    (tmp_path / "mine.toml").write_text((ROOT / experiment).read_text() + "\n" + table)
    command = [*shlex.split(line)[1:], "--set", "horizon.duration=0.5", "--in-process"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    rows = {row["controller"]: row for row in Results.load(tmp_path / "reports" / "mine").rows}
    assert rows["damped"]["status"] == "ok"
    assert rows["damped"]["work_J"] != rows["servo law"]["work_J"]
    assert not (tmp_path / "__pycache__").exists()
    # Not without permission, as the text says.
    refused = CliRunner().invoke(app, [item for item in command if item != "--allow-code"])
    assert refused.exit_code == 2
    assert "--allow-code" in refused.stderr


def test_files_that_it_names_exist() -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / link).exists(), link
    for room in re.findall(r"`(occ/[a-z_/.]+)`", TEXT):
        assert (ROOT / room).exists(), room
