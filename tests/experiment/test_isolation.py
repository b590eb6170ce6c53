"""A controller that crashes, leaves or hangs, in the user's own file and with the options that a run has by itself."""

from __future__ import annotations

import csv
from pathlib import Path

import psutil
import pytest

from occ.atlas.dataset import read_atlas, read_failures
from tests.experiment import tiny
from tests.experiment.conftest import Occ, Write
from tests.experiment.jobs import law_that_crashes

OWN = """
import ctypes, os, time
import occ


class Own:
    def __init__(self, way):
        self.way = way

    def solve(self, task):
        if self.way == "segfault":
            ctypes.string_at(0)
        if self.way == "exit":
            os._exit(7)
        if self.way == "hang":
            time.sleep(1000)
        return occ.ServoLaw().solve(task)
"""
"""Ends as it is told."""


def own(way: str) -> str:
    """The small experiment with a controller of that way between its two, in a file beside it."""
    head, one, other = tiny().split("[[controller]]")
    table = f'\nname = "own"\nkind = "own.py:Own"\nway = "{way}"\n\n'
    return "[[controller]]".join([head, one, table, other])


def read(out: Path) -> dict[str, dict[str, str]]:
    with (out / "results.csv").open(newline="") as file:
        return {row["controller"]: row for row in csv.DictReader(file)}


WAYS = [
    pytest.param("segfault", [], "was ended by the signal SIGSEGV", id="segfault"),
    pytest.param("exit", [], "ended with the exit code 7", id="exit", marks=pytest.mark.slow),
    pytest.param("hang", ["--patience", "15"], "was heard of it for 15 s", id="hang", marks=pytest.mark.slow),
]


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(("way", "options", "words"), WAYS)
def test_it_costs_its_own_row(
    write: Write, occ: Occ, occ_as_it_is: Occ, tmp_path: Path, way: str, options: list[str], words: str
) -> None:
    (tmp_path / "own.py").write_text(OWN)
    assert occ("run", write(own("well")), "--out", tmp_path / "well", "--allow-code").exit_code == 0
    result = occ_as_it_is("run", write(own(way)), "--out", tmp_path / "out", "--allow-code", *options)
    assert result.exit_code == 1, result.output
    rows, well = read(tmp_path / "out"), read(tmp_path / "well")
    lost = rows.pop("own")
    assert (lost["status"], lost["work_J"]) == ("crashed", "")
    assert words in lost["message"]
    assert words.split()[0] in result.stdout
    # To the last digit those of a run in one process and of others beside them.
    assert list(rows) == ["servo law", "translation"]
    assert all(rows[name] == well[name] for name in rows)
    assert not psutil.Process().children()


@pytest.mark.slow
def test_a_crash_costs_its_own_value_of_an_atlas(
    write: Write, monkeypatch: pytest.MonkeyPatch, occ_as_it_is: Occ, tmp_path: Path
) -> None:
    """An atlas takes no controllers of the user's: one of occ's own is made to crash, in the process that works."""
    monkeypatch.setattr("occ.atlas.run.solve", law_that_crashes)
    text = tiny(more='[atlas]\ndepth = "comparison"\n[sweep]\n"motion.radius" = [0.6, 0.7, 0.8]\n')
    result = occ_as_it_is("atlas", write(text), "--out", tmp_path / "out")
    assert result.exit_code == 1, result.output
    ((point, controller, status, message),) = read_failures(tmp_path / "out")
    assert (point, controller, status) == ("motion.radius=0.7", "servo law", "crashed")
    assert "SIGSEGV" in message
    data = read_atlas(tmp_path / "out")
    assert data["status"].sel(controller="translation").values.tolist() == ["ok"] * 3
    assert data["status"].sel(controller="servo law").values.tolist() == ["ok", "crashed", "ok"]
    assert not psutil.Process().children()
