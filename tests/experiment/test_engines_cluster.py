"""A real scheduler and two real workers on loopback: the same outcomes as everywhere else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

from occ.errors import InputError
from occ.experiment.load import load_experiment
from occ.experiment.pool import Engine, Lost
from occ.experiment.run import run
from tests.experiment import HERE, tiny
from tests.experiment.conftest import Write
from tests.experiment.jobs import matrix_sums, touch_and_wait, work

ROOT = Path(__file__).parents[2]


def started(module: str, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments, "--no-dashboard"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    # What the processes of the workers would take, were they let.
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "2"}
    return subprocess.Popen(command, cwd=ROOT, start_new_session=True, env=environment, **quiet)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a scheduler with two workers."""
    from distributed import Client

    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    loopback = ("--host", "127.0.0.1")
    processes = [started("dask_scheduler", *loopback, "--port", "0", "--scheduler-file", str(file))]
    try:
        options = ("--scheduler-file", str(file), "--nthreads", "1", "--local-directory", str(folder), *loopback)
        processes += [started("dask_worker", *options) for _ in range(2)]
        with Client(scheduler_file=str(file), timeout=60, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
            address = client.scheduler.address
        yield address
    finally:
        for process in reversed(processes):
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.mark.slow
def test_outcomes_are_those_of_the_other_engines(cluster: str) -> None:
    engine = Engine(dask=cluster, time_limit=1.0, memory_limit=4.0)
    items = [1, "exit", "sleeps", 2, "killed", "memory", 3, "threads"]
    found = {items[number]: outcome for number, outcome in engine.each(work, items)}
    lost = {key for key, value in found.items() if isinstance(value, Lost)}
    assert lost == {"exit", "sleeps", "killed", "memory"}
    assert [found[key] for key in (1, 2, 3, "threads")] == [2, 4, 6, "1"]
    with threadpool_limits(2):
        assert dict(engine.each(matrix_sums, range(3))) == dict(HERE.each(matrix_sums, range(3)))
    with pytest.raises(InputError, match="of mine"):
        list(engine.each(work, ["input"]))


@pytest.mark.slow
def test_results_are_those_of_the_other_engines(cluster: str, write: Write, tmp_path: Path) -> None:
    sweep = '[[controller]]\nname = "least"\nkind = "collocation"\nobjective = "torque_squared"\nintervals = 4\n'
    experiment = load_experiment(write(tiny(more=sweep + '[sweep]\n"motion.radius" = [0.6, 0.7, 0.8]\n')))
    engines = {"here": HERE, "pool": Engine(workers=2), "cluster": Engine(dask=cluster)}
    for name, engine in engines.items():
        run(experiment, tmp_path / name, engine)
    for file in ("results.csv", *(f"trajectories/{case.slug}@least.nc" for case in experiment.cases)):
        first, *others = [(tmp_path / name / file).read_bytes() for name in engines]
        assert others == [first, first], file


@pytest.mark.slow
def test_worker_of_the_cluster_killed_in_the_middle(cluster: str, tmp_path: Path) -> None:
    """The nanny starts another worker; the call is made again there, and it is the test that ends it."""
    import psutil

    def kill() -> None:
        while not (begun := list(tmp_path.glob("begun-*"))):
            time.sleep(0.02)
        child = psutil.Process(int(begun[0].name.removeprefix("begun-")))
        child.parent().kill()
        while len(begun := list(tmp_path.glob("begun-*"))) < 2:
            time.sleep(0.02)
        (second,) = {int(path.name.removeprefix("begun-")) for path in begun} - {child.pid}
        os.kill(second, signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    found = dict(Engine(dask=cluster).each(touch_and_wait, [tmp_path]))
    thread.join()
    assert isinstance(found[0], Lost)
    # The processes beside the worker that was killed have ended with it.
    gone = [int(path.name.removeprefix("begun-")) for path in tmp_path.glob("begun-*")]
    deadline = time.monotonic() + 10
    while any(psutil.pid_exists(pid) for pid in gone) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(psutil.pid_exists(pid) for pid in gone)


def test_no_scheduler_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("occ.experiment.cluster.CONNECT", 0.5)
    with pytest.raises(InputError, match="no scheduler answers there") as caught:
        list(Engine(dask="tcp://127.0.0.1:9").each(work, [1]))
    assert "\n" not in str(caught.value)
