"""From file to folder: columns, statuses, reproducibility, workers that die, interrupts."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import xarray as xr

from occ.errors import InputError
from occ.experiment.assessment import Assessment
from occ.experiment.bounds import BOUND_COLUMNS
from occ.experiment.case import Case
from occ.experiment.load import load_experiment
from occ.experiment.pool import Engine, Lost
from occ.experiment.results import Results, plain
from occ.experiment.run import run
from occ.laws import PrescribedRotation, ServoLaw
from occ.referee import MEASURES, judge
from occ.task import Solution, Start, Task
from tests.experiment import HERE, tiny
from tests.experiment.conftest import Occ, Write

SWEEP = '[compare]\nobjectives = ["work", "torque_squared"]\n[sweep]\nhorizon = [{ duration = 0.5 }, { laps = 0.05 }]\n'
FIRST = ["case", "controller", "status", "message", "keep", "start", "end"]
ENERGIES = ["work", "kinetic_change", "dissipation", "energy_residual", "positive_work", "absolute_work", "bus_work"]
REQUIRED = [
    *(f"{name}_J" for name in (*ENERGIES, "copper_loss", "electric")),
    *("torque_squared_N2m2s", "peak_torque_Nm", "peak_wheel_speed_rad_s", "peak_power_W", "velocity_error_m_s"),
    *("position_error_m", "position_error_end_m", "defect", "replay_error_m", "limit_excess"),
]
"""Measures that scripts outside this repository rely on."""


def read(out: Path) -> list[dict[str, str]]:
    with (out / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_from_file_to_folder(write: Write, occ: Occ, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = occ("run", write(tiny(more=SWEEP)))
    assert result.exit_code == 0, result.stderr
    out = tmp_path / "reports" / "tiny"
    rows = read(out)
    bounds = [f"{x}_{part}" for x in ("work", "torque_squared") for part in BOUND_COLUMNS]
    assert list(rows[0]) == [*FIRST, "horizon", *MEASURES, *bounds]
    assert set(REQUIRED) <= set(rows[0])
    cases = ["horizon.duration=0.5", "horizon.laps=0.05"]
    assert [(row["case"], row["controller"]) for row in rows] == [
        (case, name) for case in cases for name in ("servo law", "translation")
    ]
    assert [row["horizon"] for row in rows] == ["duration=0.5"] * 2 + ["laps=0.05"] * 2
    assert [(row["status"], row["keep"], row["start"], row["end"]) for row in rows[:2]] == [
        ("ok", "path", "given", "free"),
        ("ok", "path", "own", "free"),
    ]
    assert [row["work_bound_kind"] for row in rows[1::2]] == ["none", "none"]
    assert {row["torque_squared_bound_kind"] for row in rows} == {"none"}
    content = (out / "results.csv").read_bytes()
    assert b"\r" not in content
    record = json.loads((out / "run.json").read_text())
    assert record["experiment"]["title"] == "Tiny"
    entry = record["cases"][cases[0]]["controllers"]["servo law"]
    assert entry["solve_time_s"] > 0
    assert len(list(out.glob("trajectories/*.nc"))) == len(rows)
    with xr.open_dataset(out / entry["trajectory"], engine="h5netcdf") as motion:
        assert motion.attrs["controller"] == "servo law"
        assert float(motion["work"][-1]) == pytest.approx(float(rows[0]["work_J"]), rel=1e-6)
        assert motion["torque"].attrs["units"] == "N m"
        assert motion["torque"].dims == ("wheel", "time")
    for name in ("report.md", "figures"):
        assert (out / name).exists()
    assert "Tiny" in result.stdout
    assert "servo law" in result.stdout
    assert "\x1b" not in result.stdout
    assert result.stderr == ""
    # From the stored results alone, the same report.
    report = (out / "report.md").read_bytes()
    (out / "report.md").unlink()
    again = occ("report", out)
    assert again.exit_code == 0
    assert (out / "report.md").read_bytes() == report
    assert (out / "results.csv").read_bytes() == content


def test_every_number_is_the_referees(write: Write, tmp_path: Path) -> None:
    experiment = load_experiment(write())
    results = run(experiment, tmp_path / "out", HERE)
    (case,) = experiment.cases
    for row, player in zip(results.rows, case.players().values(), strict=True):
        task = case.task()
        assert {name: row[name] for name in MEASURES} == judge(task, player.solve(task)).measures


def test_results_do_not_depend_on_run_or_process(write: Write, tmp_path: Path) -> None:
    experiment = load_experiment(write(tiny(more=SWEEP)))
    run(experiment, tmp_path / "first", HERE)
    run(experiment, tmp_path / "second")
    for file in ["results.csv", *(f"trajectories/{case.slug}@servo_law.nc" for case in experiment.cases)]:
        assert (tmp_path / "first" / file).read_bytes() == (tmp_path / "second" / file).read_bytes()


def test_results_are_read_back_as_they_were(write: Write, tmp_path: Path) -> None:
    more = '[sweep]\n"controller.translation.rate" = [1, "program"]\n"motion.radius" = [0.6, 1]\n'
    results = run(load_experiment(write(tiny(more=more))), tmp_path / "out", HERE)
    loaded = Results.load(tmp_path / "out")
    assert loaded == results
    assert [row["motion.radius"] for row in loaded.rows[::2]] == [0.6, 1.0, 0.6, 1.0]
    table = loaded.table
    assert list(table.columns) == list(results.columns)
    assert table["work_J"].dtype == np.float64
    # The law has a bound by theory, a start of its own has none.
    assert list(table["work_bound"].isna()) == [False, True] * 4


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("error", [ZeroDivisionError("of\n  mine"), InputError("of mine"), SystemExit("of mine")])
def test_player_that_raises_is_a_crashed_row(
    write: Write, occ: Occ, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    def broken(*_: Any) -> None:
        raise error

    monkeypatch.setattr(ServoLaw, "solve", broken)
    result = occ("run", write(), "--out", tmp_path / "out")
    assert result.exit_code == 1
    crashed, fine = read(tmp_path / "out")
    assert (crashed["status"], crashed["message"]) == ("crashed", f"{type(error).__name__}: of mine")
    assert (crashed["work_J"], crashed["work_bound"], crashed["work_bound_kind"]) == ("", "", "none")
    assert fine["status"] == "ok"
    assert "of mine" in result.stdout
    # The next run tries again.
    monkeypatch.undo()
    monkeypatch.setattr("occ.cli._write_outputs", lambda *_: None)
    assert occ("run", tmp_path / "tiny.toml", "--out", tmp_path / "out").exit_code == 0


class Losing(Engine):
    """Loses cases of several controllers, and controllers by name, wherever they are solved."""

    lost: tuple[str, ...] = ()

    def each(self, function: Any, items: Any, heard: Any = None) -> Any:
        items = list(items)
        for number, outcome in super().each(function, items):
            gone = isinstance(items[number], Case) or getattr(items[number], "controller", None) in self.lost
            yield number, Lost("ended by a test") if gone else outcome


def test_controller_that_takes_its_process_with_it_costs_its_own_row(write: Write, tmp_path: Path) -> None:
    """The rows of the others are those of an undisturbed run, bounds and files included."""
    least = '[[controller]]\nname = "least"\nkind = "collocation"\nobjective = "torque_squared"\nintervals = 4\n'
    experiment = load_experiment(write(tiny(more=least + SWEEP)))
    whole = run(experiment, tmp_path / "whole", HERE)

    class LosingOne(Losing):
        lost = ("translation",)

    told: list[tuple[int, int]] = []
    cut = run(
        experiment,
        tmp_path / "cut",
        LosingOne(in_process=True),
        lambda _, rows, failed=0, stored=False: told.append((rows, failed)),
    )
    assert told == [(1, 0), (1, 1), (1, 0)] * 2
    for row, other in zip(cut.rows, whole.rows, strict=True):
        if row["controller"] == "translation":
            assert (row["status"], row["message"], row["work_J"]) == ("crashed", "ended by a test", None)
        else:
            assert row == other
            assert row["torque_squared_bound_kind"] == "local"
    files = sorted(path.name for path in (tmp_path / "whole" / "trajectories").iterdir())
    kept = sorted(path.name for path in (tmp_path / "cut" / "trajectories").iterdir())
    assert kept == [name for name in files if "translation" not in name]
    # Such a case is tried again, and one whose controllers have all finished alone is not.
    again = run(experiment, tmp_path / "cut", Losing(in_process=True))
    assert again.rows == whole.rows
    for name in ("results.csv", *(f"trajectories/{name}" for name in files)):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    stored = {path.name for path in (tmp_path / "whole" / ".store").iterdir()}
    assert {path.name for path in (tmp_path / "cut" / ".store").iterdir()} == stored
    assert list(again.record["cases"]) == list(whole.record["cases"])
    for mine, other in zip(again.record["cases"].values(), whole.record["cases"].values(), strict=True):
        assert list(mine["controllers"]) == list(other["controllers"])
        assert [r["trajectory"] for r in mine["controllers"].values()] == [
            r["trajectory"] for r in other["controllers"].values()
        ]


def test_search_for_a_bound_that_takes_its_process_with_it_costs_the_bound(write: Write, tmp_path: Path) -> None:
    class LosingBounds(Engine):
        def each(self, function: Any, items: Any, heard: Any = None) -> Any:
            for number, outcome in super().each(function, items):
                yield number, Lost("ended by a test") if isinstance(outcome, Assessment) else outcome

    least = '[[controller]]\nname = "least"\nkind = "collocation"\nobjective = "torque_squared"\nintervals = 4\n'
    experiment = load_experiment(write(tiny(("rate = 0.0", "rate = 1e9"), more=least + SWEEP)))
    whole = run(experiment, tmp_path / "out", HERE)
    cut = run(experiment, tmp_path / "out", LosingBounds(in_process=True))
    proven = ("work_bound", "work_bound_kind", "work_gap_percent", "work_gap_uncertainty_percent")
    said = "no proven bound: ended by a test"
    for row, other in zip(cut.rows, whole.rows, strict=True):
        # Local bounds need nothing but the rows.
        assert row == other | dict(zip(proven, (None, "none", None, None), strict=True)) | {"message": row["message"]}
        assert row["message"] == "; ".join(filter(None, [other["message"], said if row["status"] == "ok" else ""]))
        assert other["work_bound_kind"] == ("exact" if row["status"] == "ok" else "none")
    assert {row["status"] for row in cut.rows} != {"ok"}


def test_control_that_cannot_be_judged_is_a_crashed_row(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PrescribedRotation, "solve", lambda *_: "not a solution")
    _, row = run(load_experiment(write()), tmp_path / "out", HERE).rows
    assert row["status"] == "crashed"
    assert row["message"] == "the player returned a str, not a Solution"


@pytest.mark.usefixtures("no_figures")
def test_limit_too_tight_is_infeasible_in_words(write: Write, occ: Occ, tmp_path: Path) -> None:
    result = occ("run", write(), "--out", tmp_path / "out", "--set", "limits.torque=0.3")
    assert result.exit_code == 1
    row = read(tmp_path / "out")[0]
    assert row["status"] == "infeasible"
    for words in ("wheel ", "N m at t = ", " s; limit 0.3 N m"):
        assert words in row["message"]
    assert float(row["limit_excess"]) == pytest.approx(float(row["peak_torque_Nm"]) / 0.3 - 1)
    assert row["message"] in result.stdout


def test_optimum_bounds_the_law(write: Write, tmp_path: Path) -> None:
    more = '[[controller]]\nname = "min torque"\nkind = "collocation"\nobjective = "torque_squared"\nintervals = 4\n'
    text = tiny(more=more + '[compare]\nobjectives = ["work", "torque_squared"]\n')
    law, translation, optimum = run(load_experiment(write(text)), tmp_path / "out", HERE).rows
    value = optimum["torque_squared_N2m2s"]
    assert (optimum["torque_squared_bound"], optimum["torque_squared_gap_percent"]) == (value, 0.0)
    assert (law["torque_squared_bound"], law["torque_squared_bound_kind"]) == (value, "local")
    assert law["torque_squared_gap_percent"] == pytest.approx(100 * (law["torque_squared_N2m2s"] / value - 1))
    assert law["torque_squared_gap_percent"] > 0
    assert translation["torque_squared_bound_kind"] == translation["work_bound_kind"] == "none"
    assert law["work_bound_kind"] in ("exact", "certified")
    assert law["work_gap_percent"] > law["work_gap_uncertainty_percent"] > 0


@pytest.fixture
def heeding() -> Iterator[None]:
    """Interrupts are heeded, as they are not in what is started in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeding")
@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_interrupt_keeps_what_is_finished(write: Write, tmp_path: Path, workers: int) -> None:
    path = write(tiny(more='[sweep]\n"motion.radius" = { from = 0.5, to = 0.9, count = 80 }\n'))
    out = tmp_path / "out"
    command = [sys.executable, "-m", "occ.cli", "run", str(path), "--out", str(out), "--workers", str(workers)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while len(list(out.glob(".store/*.json"))) < 1 and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.02)
    children = psutil.Process(process.pid).children()
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=60)
    assert len(children) == workers
    assert not any(child.is_running() for child in children)
    assert process.returncode == 130, stderr
    # A slow machine is told before how far it has come, and nothing else.
    *told, last = stderr.splitlines()
    assert (stdout, [line for line in told if "of 160 rows, 0 not ok" not in line]) == ("", [])
    assert last.startswith("interrupted")
    assert not (out / "results.csv").exists()
    assert 1 <= len(list(out.glob(".store/*.json"))) < 80


@pytest.mark.usefixtures("heeding")
def test_interrupt_that_a_solver_swallows_is_not_lost(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve = ServoLaw.solve

    def swallowing(law: ServoLaw, task: Task) -> Solution:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return solve(law, task)

    monkeypatch.setattr(ServoLaw, "solve", swallowing)
    with pytest.raises(KeyboardInterrupt):
        run(load_experiment(write(tiny())), tmp_path / "out", HERE)
    assert not list((tmp_path / "out").glob(".store/*.json"))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_plain_data_for_json() -> None:
    value = {"a": np.float64(1.5), 2: np.arange(3), "n": np.nan, "t": (1, None, True), "o": Start()}
    assert plain(value) == {
        "a": 1.5,
        "2": [0, 1, 2],
        "n": None,
        "t": [1, None, True],
        "o": "Start(heading=0.0, heading_rate=0.0)",
    }
