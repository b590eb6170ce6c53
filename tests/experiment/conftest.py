"""Fixtures of the experiment tests."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from occ.cli import app
from tests.experiment import TINY

Write = Callable[..., Path]
Occ = Callable[..., Any]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write an experiment file into the test's folder."""

    def _write(text: str = TINY, name: str = "tiny.toml") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return _write


@pytest.fixture
def occ_as_it_is(monkeypatch: pytest.MonkeyPatch) -> Occ:
    """Run a command in this process: ``occ_as_it_is("check", path)`` has exit_code, stdout and stderr."""
    # On a slow machine the error stream would tell how far a run has come.
    monkeypatch.setattr("occ.progress.EVERY", math.inf)
    return lambda *arguments: CliRunner().invoke(app, [str(item) for item in arguments])


@pytest.fixture
def occ(occ_as_it_is: Occ) -> Occ:
    """The same with all that is solved in this process, where patches hold and nothing has to be started."""

    def _occ(*arguments: object) -> Any:
        here = arguments[:1] in (("run",), ("atlas",)) and "--dask" not in arguments
        return occ_as_it_is(*arguments, *["--in-process"] * here)

    return _occ


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave figures and report out, which have tests of their own."""
    monkeypatch.setattr("occ.cli._write_outputs", lambda *_: None)
