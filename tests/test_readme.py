"""The README's examples run as they stand."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
CONSOLE = [
    line.split("#")[0].strip()
    for block in re.findall(r"```console\n(.*?)```", TEXT, re.DOTALL)
    for line in block.splitlines()
    if line.startswith("occ ")
]


def test_python_examples_run_in_their_order(capsys: pytest.CaptureFixture[str]) -> None:
    assert len(PYTHON) >= 2
    names: dict[str, object] = {"__name__": "readme"}
    for block in PYTHON:
        exec(compile(block, "README.md", "exec"), names)
    table = names["table"]
    assert (table["status"] == "ok").all()  # type: ignore[index,attr-defined]
    assert "min work" in capsys.readouterr().out


@pytest.mark.parametrize("line", CONSOLE)
def test_commands_run(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from occ.cli import app

    monkeypatch.chdir(tmp_path)
    for name in ("experiments", "reports"):
        (tmp_path / name).mkdir()
        for path in (ROOT / name).glob("*"):
            target = tmp_path / name / path.name
            if path.is_dir():
                import shutil

                shutil.copytree(path, target)
            else:
                target.write_bytes(path.read_bytes())
    result = CliRunner().invoke(app, shlex.split(line)[1:])
    assert result.exit_code == 0, result.output


def test_files_that_it_names_exist() -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / link).exists(), link
    for room in re.findall(r"`(occ/[a-z_/.]+)`", TEXT):
        assert (ROOT / room).exists(), room
