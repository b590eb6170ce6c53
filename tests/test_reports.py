"""The committed reports are what the code produces, within stated tolerances."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from occ.cli import app
from occ.figures.comparison import drawn
from occ.report.report import write_report

ROOT = Path(__file__).parents[1]
# Atlases have reports of another form, which tests/atlas compares.
EXPERIMENTS = sorted(path for path in (ROOT / "experiments").glob("*.toml") if not path.stem.startswith("atlas_"))
RELATIVE = 1e-6
"""Of measures: solver and compiler may differ on another machine."""
SOLVER = ("peak_torque_Nm", "peak_power_W")
"""Of a min-work row these measure how steep the solver made its end layers: 1 per cent."""
ROUNDING = re.compile(r"residual|error|defect|excess|gap_percent|kinetic_change")
"""Columns that are zero up to errors: absolute, 2e-4 of their unit at most."""


def words(text: object) -> str:
    """A message without its numbers."""
    return re.sub(r"[-+\d.e]+", "#", str(text))


@pytest.mark.parametrize("path", EXPERIMENTS, ids=lambda path: path.stem)
def test_every_shipped_experiment_has_its_report(path: Path) -> None:
    folder = ROOT / "reports" / path.stem
    text = (folder / "report.md").read_text()
    assert (folder / "results.csv").is_file()
    for figure in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (folder / figure).is_file(), figure
    assert not re.search(r"\b20\d\d-\d\d-\d\d\b|\d\d:\d\d:\d\d", text), "a report holds no dates or times of run"


# That of section5 is compared in the default tests, too: tests/test_readme.py runs it as the README has it.
@pytest.mark.slow
@pytest.mark.parametrize("path", EXPERIMENTS, ids=lambda path: path.stem)
def test_the_code_produces_the_committed_results(path: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["run", str(path), "--out", str(tmp_path)])
    assert result.exit_code in (0, 1), result.output
    is_as_committed(tmp_path, path.stem)


def is_as_committed(made: Path, name: str) -> None:
    """The results in a folder are those of the committed report of that name; they are overwritten."""
    committed = ROOT / "reports" / name
    old, new = (pd.read_csv(folder / "results.csv") for folder in (committed, made))
    assert list(old.columns) == list(new.columns)
    assert len(old) == len(new)
    for column in old.columns:
        for before, after, row in zip(old[column], new[column], old.to_dict("records"), strict=True):
            where = f"{row['case']}, {row['controller']}, {column}: {before!r} became {after!r}"
            if column == "message":
                assert words(before) == words(after), where
            elif isinstance(before, str) or isinstance(after, str) or pd.isna(before) or pd.isna(after):
                assert (pd.isna(before) and pd.isna(after)) or before == after, where
            elif ROUNDING.search(column):
                assert math.isclose(before, after, rel_tol=1e-4, abs_tol=2e-4), where
            else:
                assert math.isclose(before, after, rel_tol=1e-2 if column in SOLVER else RELATIVE), where
    # The report is a function of what is stored: made from the committed results it is the committed report.
    shutil.copy(committed / "results.csv", made / "results.csv")
    write_report(made, drawn(made))
    assert (made / "report.md").read_text() == (committed / "report.md").read_text()
