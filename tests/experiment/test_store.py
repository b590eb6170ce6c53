"""Files are whole or not there; only what is whole is believed; finished cases are not solved again."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import occ
from occ.errors import InputError
from occ.experiment.case import result_sources
from occ.experiment.load import load_experiment
from occ.experiment.run import run
from occ.experiment.store import Store, replacing, stamp, write_text
from occ.laws import ServoLaw
from occ.task import Solution, Task
from tests.experiment import HERE, tiny
from tests.experiment.conftest import Occ, Write

ROWS = [{"controller": "a", "work_J": 0.1 + 0.2, "trajectory": None}]


def test_interrupted_writing_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    write_text(path, "old\n")

    def interrupted() -> None:
        with replacing(path) as temporary:
            assert temporary.name.endswith(".partial")
            assert temporary.parent == path.parent
            temporary.write_text("half of the n")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old\n"
    assert os.listdir(tmp_path) == ["file.txt"]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, step, full)
    with pytest.raises(InputError, match="No space left on device") as caught:
        Store(tmp_path).write("key", ROWS)
    assert "\n" not in str(caught.value)
    monkeypatch.undo()
    assert os.listdir(tmp_path / ".store") == []


def test_stored_rows_come_back_to_the_last_bit(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.write("key", ROWS)
    assert store.read("key") == ROWS
    assert store.read("other") is None


def _damages(good: bytes) -> Iterator[bytes]:
    yield b""
    yield good[: len(good) // 2]
    yield good.replace(b"0.3", b"0.4")
    yield b"\xff" + good
    yield b"[]"
    yield b'{"rows": [], "sha256": ""}'
    yield json.dumps({"rows": json.loads(good)["rows"]}).encode()


def test_damaged_store_is_not_believed(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.write("key", ROWS)
    good = store.path("key").read_bytes()
    for damaged in _damages(good):
        assert damaged != good
        store.path("key").write_bytes(damaged)
        assert store.read("key") is None


def test_trajectory_must_be_the_one_that_was_stored(tmp_path: Path) -> None:
    store, file = Store(tmp_path), tmp_path / "a.nc"
    file.write_bytes(b"motion")
    rows = [{"trajectory": {"path": "a.nc", **stamp(file.read_bytes())}}]
    store.write("key", rows)
    assert store.read("key") == rows
    file.write_bytes(b"Motion")
    assert store.read("key") is None
    file.unlink()
    assert store.read("key") is None


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> list[Task]:
    """The tasks that the servo law was asked to solve."""
    calls: list[Task] = []
    original = ServoLaw.solve

    def counted(self: ServoLaw, task: Task) -> Solution:
        calls.append(task)
        return original(self, task)

    monkeypatch.setattr(ServoLaw, "solve", counted)
    return calls


TWO_CASES = tiny(more='[sweep]\n"motion.radius" = [0.6, 0.7]\n')


def test_second_run_solves_nothing_and_writes_the_same(write: Write, tmp_path: Path, solves: list[Task]) -> None:
    experiment, out = load_experiment(write(TWO_CASES)), tmp_path / "out"
    run(experiment, out, HERE)
    table = (out / "results.csv").read_bytes()
    assert len(solves) == 2
    run(experiment, out, HERE)
    assert len(solves) == 2
    assert (out / "results.csv").read_bytes() == table


def test_a_row_without_a_trajectory_is_resumed_like_any_other(write: Write, tmp_path: Path, solves: list[Task]) -> None:
    # Out of reach of every allocation: the player itself says so, and there is no motion to store.
    box = ('kind = "servo"', 'kind = "servo"\nallocation = { kind = "box_qp" }')
    experiment, out = load_experiment(write(tiny(box, more="[limits]\ntorque = 0.01\n"))), tmp_path / "out"
    run(experiment, out, HERE)
    table = (out / "results.csv").read_bytes()
    assert b"infeasible" in table
    run(experiment, out, HERE)
    assert len(solves) == 1
    assert (out / "results.csv").read_bytes() == table


def test_only_what_is_damaged_is_solved_again(write: Write, tmp_path: Path, solves: list[Task]) -> None:
    experiment, out = load_experiment(write(TWO_CASES)), tmp_path / "out"
    run(experiment, out, HERE)
    table = (out / "results.csv").read_bytes()
    first, second = (Store(out).path(case.key) for case in experiment.cases)
    first.write_bytes(first.read_bytes()[:-20])
    run(experiment, out, HERE)
    assert [task.motion.values()[0] for task in solves[2:]] == [0.6]
    trajectory = out / "trajectories" / "motion.radius=0.7@servo_law.nc"
    content = trajectory.read_bytes()
    trajectory.unlink()
    run(experiment, out, HERE)
    assert [task.motion.values()[0] for task in solves[3:]] == [0.7]
    assert trajectory.read_bytes() == content
    second.unlink()
    run(experiment, out, HERE)
    assert len(solves) == 5
    assert (out / "results.csv").read_bytes() == table


def test_another_case_is_solved_although_its_neighbour_is_stored(
    write: Write, tmp_path: Path, solves: list[Task]
) -> None:
    path = write(TWO_CASES)
    run(load_experiment(path), tmp_path / "out", HERE)
    run(load_experiment(path, ["sweep.motion.radius=[0.7, 0.8]"]), tmp_path / "out", HERE)
    assert [task.motion.values()[0] for task in solves] == [0.6, 0.7, 0.8]
    run(load_experiment(path, ["limits.torque=9.0"]), tmp_path / "out", HERE)
    assert len(solves) == 5


def test_content_key_depends_on_every_number_and_on_the_code(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write()
    changes = [[], ["motion.radius=0.7000000000000001"], ["controller.translation.heading=1"], ["point.x=0.41"]]
    keys = [load_experiment(path, change).cases[0].key for change in changes]
    assert len(set(keys)) == len(keys)
    # A default that is written out, and a title, change nothing.
    same = load_experiment(path, ["platform.yaw_inertia=4.42", "title=Other", "start.heading=0"])
    assert same.cases[0].key == keys[0]
    monkeypatch.setattr("occ.experiment.case.code_fingerprint", lambda: "another version")
    assert load_experiment(path).cases[0].key != keys[0]


def test_the_code_of_a_key_is_all_that_affects_results() -> None:
    places = result_sources(Path(occ.__file__).parent)
    assert len(set(places)) == len(places)
    for place in (
        "optimal/direct.c",
        "optimal/collocation.py",
        "laws/base.py",
        "referee/judge.py",
        "experiment/run.py",
    ):
        assert place in places
    assert not [place for place in places if place.startswith(("report/", "figures/", "export/")) or place == "cli.py"]


@pytest.mark.parametrize("place", ["taken", "taken/out"])
def test_folder_that_cannot_be_made_is_one_line_and_nothing_is_solved(
    write: Write, tmp_path: Path, occ: Occ, solves: list[Task], place: str
) -> None:
    (tmp_path / "taken").write_text("a file")
    result = occ("run", write(), "--out", tmp_path / place)
    assert result.exit_code == 2
    assert len(result.stderr.splitlines()) == 1
    assert "cannot be written" in result.stderr
    assert solves == []
    assert sorted(os.listdir(tmp_path)) == ["taken", "tiny.toml"]
