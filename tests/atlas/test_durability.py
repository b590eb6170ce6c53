"""The same atlas by every engine, after any interruption, and whatever happens to single cases."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import xarray as xr

from occ.atlas.dataset import read_atlas
from occ.atlas.grid import load_grid
from occ.atlas.run import make_atlas
from occ.experiment.pool import Engine
from tests.atlas import SWEEP, atlas_text, made
from tests.experiment import HERE
from tests.experiment.conftest import Write, write
from tests.experiment.test_engines_cluster import cluster

__all__ = ["cluster", "write"]
LEAST = '[[controller]]\nname = "least"\nkind = "collocation"\nobjective = "torque_squared"\nintervals = 4\n'


@pytest.mark.slow
@pytest.mark.parametrize("depth", ["least_work", "comparison"])
def test_every_engine_makes_the_same_atlas(cluster: str, write: Write, tmp_path: Path, depth: str) -> None:
    sweep = SWEEP if depth != "comparison" else '"motion.radius" = [0.6, 0.7, 0.8]\n'
    path = write(atlas_text(sweep, depth) + (LEAST if depth == "comparison" else ""))
    engines = {"here": HERE, "pool": Engine(workers=2), "cluster": Engine(dask=cluster)}
    here, *others = [made(path, tmp_path / name, engine) for name, engine in engines.items()]
    for other in others:
        # All values, with NaN where there is none, and all attributes; an atlas holds no times.
        xr.testing.assert_identical(here, other)


def records(folder: Path) -> list[str]:
    """Keys of all records that were ever written, by all runs."""
    keys = []
    for path in folder.glob(".store/*.journal"):
        with path.open("rb") as file:
            while head := file.readline():
                try:
                    record = json.loads(head)
                except ValueError:
                    break
                if len(file.read(record["size"])) == record["size"]:
                    keys.append(record["key"])
    return keys


@pytest.mark.slow
def test_killed_twenty_times_and_resumed(write: Write, tmp_path: Path) -> None:
    sweep = '"motion.radius" = { from = 0.3, to = 1.0, count = 80 }\n'
    path, out = write(atlas_text(sweep)), tmp_path / "out"
    chance = random.Random(20)
    command = [sys.executable, "-c", STARTER, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as starter:

        def start(wait: float, folder: Path) -> int:
            starter.stdin.write(f"{wait} {folder}\n")
            starter.stdin.flush()
            return int(starter.stdout.readline())

        for _ in range(20):
            pid = start(0.1, out)
            time.sleep(chance.uniform(0.0, 0.4))
            os.kill(pid, signal.SIGKILL)
            assert starter.stdout.readline() == "killed\n"
        assert 0 < len(records(out)) < 80, "the kills fall on the work itself"
        for folder in (out, tmp_path / "whole"):
            start(0.0, folder)
            assert starter.stdout.readline() == "done\n"
        starter.stdin.close()
    keys = records(out)
    assert len(keys) == len(set(keys)) == 80, "nothing that was stored was worked out twice"
    assert (out / "atlas.nc").read_bytes() == (tmp_path / "whole" / "atlas.nc").read_bytes()


STARTER = """
import os, sys, time
from pathlib import Path
import scipy.linalg, xarray, h5netcdf
from occ.atlas import run
from occ.atlas.dataset import write_atlas
from occ.atlas.grid import load_grid
from tests.experiment import HERE

run.SIZES = {"long_run": 1, "least_work": 1}
path = Path(sys.argv[1])
grid = load_grid(path)
run.code_fingerprint()
run.long_run_columns(grid.points(0, 1))  # so that what is killed is the work and not its preparation
while line := sys.stdin.readline():
    wait, out = float(line.split()[0]), Path(line.split()[1])
    pid = os.fork()
    if pid == 0:
        found = run.make_atlas(path, grid, out, HERE, lambda *told: time.sleep(0.0 if told[3:] else wait))
        write_atlas(grid, found, out)
        os._exit(0)
    print(pid, flush=True)
    code = os.waitpid(pid, 0)[1]
    print("killed" if code else "done", flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "end"), [(1, signal.SIGTERM), (2, signal.SIGKILL)])
def test_processes_of_a_killed_run_end_by_themselves(
    write: Write, tmp_path: Path, workers: int, end: signal.Signals
) -> None:
    sweep = '"motion.radius" = { from = 0.3, to = 1.0, count = 400 }\n'
    path = write(atlas_text(sweep, "least_work"))
    command = [sys.executable, "-m", "occ.cli", "atlas", str(path), "--out", str(tmp_path / "out")]
    command += ["--workers", str(workers)] * (workers > 1)
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 60
        while len(children := psutil.Process(process.pid).children()) < workers and time.monotonic() < deadline:
            time.sleep(0.05)
    finally:
        process.send_signal(end)
        assert process.wait() == -end
    _, alive = psutil.wait_procs(children, timeout=30)
    assert len(children) == workers
    assert not alive


@pytest.mark.slow
def test_two_runs_into_one_folder_at_once(write: Write, tmp_path: Path) -> None:
    path, out = write(atlas_text(SWEEP)), tmp_path / "out"
    command = [sys.executable, "-m", "occ.cli", "atlas", str(path), "--out", str(out)]
    runs = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    for process in runs:
        _, error = process.communicate(timeout=120)
        assert process.returncode == 0, error
    assert read_atlas(out).identical(made(path, tmp_path / "alone"))


@pytest.mark.slow
def test_cases_that_crash_hang_raise_or_return_nan_are_rows(tmp_path: Path, write: Write) -> None:
    """Through `occ run`, with a user's own controller in worker processes; all other rows are complete."""
    (tmp_path / "own.py").write_text(OWN)
    text = atlas_text("").replace("laps = 1", "duration = 0.5").replace('[atlas]\ndepth = "long_run"\n', "")
    text += '[[controller]]\nname = "own"\nkind = "own.py:Own"\n[sweep]\n"controller.own.way" = [0, 1, 2, 3, 4, 5]\n'
    out = tmp_path / "out"
    command = [sys.executable, "-m", "occ.cli", "run", str(write(text)), "--out", str(out), "--allow-code"]
    command += ["--workers", "2", "--time-limit", "15", "--memory-limit", "6"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    import pandas as pd

    rows = pd.read_csv(out / "results.csv")
    own = rows[rows["controller"] == "own"].set_index("controller.own.way")
    assert list(own["status"]) == ["ok", "crashed", "crashed", "crashed", "unstable", "crashed"]
    for way, words in ((1, "exit code 3"), (2, "not finished after 15 s"), (3, "of mine"), (5, "MemoryError")):
        assert words in own.loc[way, "message"]
    law = rows[rows["controller"] == "servo law"].set_index("controller.own.way")
    # Those beside a controller that takes its process with it are solved again without it.
    assert list(law["status"]) == ["ok"] * 6
    for name in ("work_J", "work_bound", "work_gap_percent", "replay_error_m"):
        assert set(law[name]) == {law[name][0]}


OWN = '''
import os, time
from dataclasses import dataclass
import numpy as np
from occ.control import PythonControl
from occ.laws import ServoLaw
from occ.task import Claim, Solution


@dataclass(frozen=True, kw_only=True)
class Own:
    """Goes wrong in the way that it is told.

    Args:
        way: which.
    """

    way: int = 0

    def check(self, task):
        pass

    def solve(self, task):
        if self.way == 1:
            os._exit(3)
        if self.way == 2:
            time.sleep(1000)
        if self.way == 3:
            raise ArithmeticError("of mine")
        if self.way == 4:
            control = PythonControl(lambda t, state: np.full(4, np.nan))
            return Solution(control=control, start_state=task.state_on_program(0.0, 0.0, 0.0))
        if self.way == 5:
            return bytearray(20 * 10**9)
        return ServoLaw().solve(task)
'''


def test_worker_killed_in_the_middle_costs_its_case_only(write: Write, tmp_path: Path) -> None:
    path = write(atlas_text('"motion.radius" = { from = 0.3, to = 1.0, count = 5 }\n', "least_work"))
    grid = load_grid(path)
    killed = []

    def kill_one(what: str, rows: int, failed: int = 0, stored: bool = False) -> None:
        if not killed:
            children = [p for p in psutil.Process().children() if "child import serve" in " ".join(p.cmdline())]
            killed.append(children[0].pid)
            os.kill(children[0].pid, signal.SIGKILL)

    from occ.atlas import run

    sizes, run.SIZES = run.SIZES, {"long_run": 1, "least_work": 1}
    try:
        found = make_atlas(path, grid, tmp_path / "out", Engine(workers=2), kill_one)
        again = make_atlas(path, grid, tmp_path / "out", HERE)
    finally:
        run.SIZES = sizes
    assert len(found.failures) <= 1
    assert all("SIGKILL" in item.message for item in found.failures)
    assert again.failures == []
    assert len(set(records(tmp_path / "out"))) == grid.size
