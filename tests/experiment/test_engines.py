"""One function over many items: what goes wrong costs its own item only, and is said in words."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress
from pathlib import Path

import psutil
import pytest
from threadpoolctl import threadpool_limits

from occ.errors import InputError
from occ.experiment.pool import Engine, Lost
from tests.experiment import HERE
from tests.experiment.jobs import matrix_sums, noted, process, slowly, touch_and_wait, with_offspring, work, works

ROOT = Path(__file__).parents[2]
POOL = Engine(workers=2)
ENDED = ("ended with the exit code 3", "was ended by the signal SIGKILL")


@pytest.fixture(autouse=True)
def _nothing_is_left_running() -> object:
    before = set(psutil.Process().children(recursive=True))
    threads = threading.active_count()
    yield
    assert set(psutil.Process().children(recursive=True)) <= before
    assert threading.active_count() <= threads


def outcomes(engine: Engine, items: list[object]) -> dict[object, object]:
    return {items[number]: outcome for number, outcome in engine.each(work, items)}


def test_each_way_to_go_wrong_costs_its_own_item_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    engine = Engine(workers=2, time_limit=1.0, memory_limit=4.0)
    found = outcomes(engine, [1, "exit", "sleeps", 2, "killed", "hangs", "memory", "prints", 3, "threads"])
    reasons = {key: value.reason for key, value in found.items() if isinstance(value, Lost)}
    assert {key: value for key, value in found.items() if key not in reasons} == {
        1: 2,
        2: 4,
        3: 6,
        "prints": "printed",
        "threads": "1",
    }
    assert "exit code 3" in reasons["exit"]
    assert "SIGKILL" in reasons["killed"]
    assert "not finished after 1 s" in reasons["sleeps"]
    assert "not finished after 1 s" in reasons["hangs"]
    assert "MemoryError" in reasons["memory"]


def test_what_is_lost_is_made_again_in_parts() -> None:
    items = [[1, 2], [3, "exit", 4], ["exit"], ["hangs", 5, "raises"]]

    def parts(number: int) -> list[list[object]]:
        return [[item] for item in items[number]] if len(items[number]) > 1 else []

    found = dict(Engine(workers=2, time_limit=1.0).each_or_parts(works, items, parts))
    exits = Lost("the process that solved it ended with the exit code 3")
    hangs = Lost("not finished after 1 s, the time limit")
    assert found == {
        0: [2, 4],
        1: [[6], exits, [8]],
        2: exits,
        3: [hangs, [10], Lost("ArithmeticError: of mine")],
    }
    assert dict(HERE.each_or_parts(works, [["raises", 1]], lambda _: [["raises"], [1]])) == {
        0: [Lost("ArithmeticError: of mine"), [2]]
    }


@pytest.mark.parametrize("engine", [Engine(patience=2.0), POOL], ids=["default", "pool"])
def test_what_was_told_is_heard_once_and_not_made_again(engine: Engine, tmp_path: Path) -> None:
    lists = [[1, 2], [3, "exit", 4, 5], [6, 7, "killed"]]
    items = [(tmp_path / str(number), list(some)) for number, some in enumerate(lists)]
    told: dict[tuple[int, int], object] = {}

    def heard(number: int, place: int, outcome: object) -> None:
        assert (number, place) not in told
        told[number, place] = outcome

    found = dict(
        engine.each_or_parts(noted, items, lambda number: [(items[number][0], [one]) for one in lists[number]], heard)
    )
    ended = [Lost(f"the process that solved it {words}") for words in ENDED]
    assert found[1] == [[6], ended[0], [8], [10]]
    assert found[2][:2] == [[12], [14]]
    assert found[2][2].reason.startswith(ended[1].reason)
    assert found[0] == [2, 4]
    told_of_the_first = {(0, 0): [2], (0, 1): [4]}
    assert told == told_of_the_first | {(n, place): part for n in (1, 2) for place, part in enumerate(found[n])}
    begun = [(tmp_path / str(number)).read_text().split() for number in range(3)]
    # Only what was in work when the process ended is begun again.
    assert [sorted(names) for names in begun] == [
        ["1", "2"],
        ["3", "4", "5", "exit", "exit"],
        ["6", "7", "killed", "killed"],
    ]


def test_who_hangs_is_given_up_once_and_alone(tmp_path: Path) -> None:
    assert Engine().limits.patience == 3600.0
    assert not Engine().in_process
    items = [(tmp_path / "begun", [1, "hangs", 2])]
    found = dict(
        Engine(patience=2.0).each_or_parts(noted, items, lambda _: [(items[0][0], [one]) for one in items[0][1]])
    )
    first, hung, last = found[0]
    assert (first, last) == ([2], [4])
    assert "nothing was heard of it for 2 s" in hung.reason
    assert "--patience" in hung.reason
    # It has had its time, and is not given it again.
    assert (tmp_path / "begun").read_text().split() == ["1", "hangs", "2"]


def test_patience_begins_again_with_each_word() -> None:
    assert dict(Engine(patience=2.0).each(slowly, [5])) == {0: 5}


def test_what_a_call_has_started_ends_with_it(tmp_path: Path) -> None:
    ((_, outcome),) = Engine(time_limit=0.5).each(with_offspring, [tmp_path])
    assert isinstance(outcome, Lost)
    ends(int((tmp_path / "begun").read_text()))


def ends(pid: int) -> None:
    """Wait until a process is gone."""
    deadline = time.monotonic() + 10
    with suppress(psutil.NoSuchProcess):
        while psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
            assert time.monotonic() < deadline
            time.sleep(0.02)


CALLER = """
import sys
from pathlib import Path
from occ.experiment.pool import Engine
from tests.experiment.jobs import with_offspring

list(Engine().each(with_offspring, [Path(sys.argv[1])]))
"""


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL])
def test_a_call_ends_with_whoever_has_made_it(tmp_path: Path, end: signal.Signals) -> None:
    caller = subprocess.Popen([sys.executable, "-c", CALLER, str(tmp_path)], cwd=ROOT)
    while not (tmp_path / "begun").exists() or not (tmp_path / "begun").read_text():
        time.sleep(0.02)
    (child,) = psutil.Process(caller.pid).children()
    caller.send_signal(end)
    assert caller.wait() == -end
    ends(child.pid)
    ends(int((tmp_path / "begun").read_text()))


def test_kept_processes_go_from_one_use_to_the_next() -> None:
    with Engine().kept("json") as engine:
        (early,) = psutil.Process().children()
        for _ in range(2):
            assert dict(engine.each(process, [None])) == {0: early.pid}
        with engine.kept() as same:
            assert same == engine
        # One that has died in the meantime is not asked.
        early.kill()
        early.wait()
        assert dict(engine.each(work, [1])) == {0: 2}
    with HERE.kept("json"), Engine(dask="tcp://127.0.0.1:9").kept("json"), Engine().kept():
        assert not psutil.Process().children()


def test_parts_are_ended_in_the_middle() -> None:
    items = [["exit", 1], ["exit", "sleeps"]]
    with closing(POOL.each_or_parts(works, items, lambda number: [[item] for item in items[number]])) as finished:
        number, outcome = next(finished)
    assert (number, outcome[1]) == (0, [2])


@pytest.mark.parametrize("engine", [HERE, POOL], ids=["here", "pool"])
def test_item_that_raises_is_lost_and_an_error_of_the_user_ends_the_run(engine: Engine) -> None:
    found = outcomes(engine, [1, "raises", "unpicklable", 2])
    assert found == {
        1: 2,
        "raises": Lost("ArithmeticError: of mine"),
        "unpicklable": Lost("_Unpicklable: of mine"),
        2: 4,
    }
    with pytest.raises(InputError, match="of mine"):
        outcomes(engine, [1, "input", 2])


def test_items_are_taken_as_there_is_room() -> None:
    taken: list[int] = []

    def items() -> object:
        for number in range(1000):
            taken.append(number)
            yield number

    with closing(POOL.each(work, items())) as finished:
        next(finished)
    assert len(taken) <= 4


def test_worker_killed_in_the_middle(tmp_path: Path) -> None:
    def kill() -> None:
        while not (begun := list(tmp_path.glob("begun-*"))):
            time.sleep(0.02)
        os.kill(int(begun[0].name.removeprefix("begun-")), signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    ((_, outcome),) = Engine(workers=2).each(touch_and_wait, [tmp_path])
    thread.join()
    assert isinstance(outcome, Lost)
    assert "SIGKILL" in outcome.reason


def test_last_bits_do_not_depend_on_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = list(range(3))
    # What this process and its children may take, were they let.
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    with threadpool_limits(2):
        here, pool = (dict(engine.each(matrix_sums, seeds)) for engine in (HERE, POOL))
    assert here == pool


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"workers": 0}, "workers should be at least 1"),
        ({"workers": 2, "dask": "tcp://127.0.0.1:1"}, "one of the two"),
        ({"time_limit": 0.0}, "time_limit should be greater than 0"),
        ({"memory_limit": float("nan")}, "memory_limit should be"),
        ({"patience": 0.0}, "patience should be greater than 0"),
        ({"in_process": True, "time_limit": 1.0}, "in_process should be without time_limit"),
        ({"in_process": True, "workers": 2}, "in_process should be without workers"),
    ],
)
def test_engine_that_cannot_be_meant(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Engine(**options)
