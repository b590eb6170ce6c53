"""One function over many items: what goes wrong costs its own item only, and is said in words."""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import closing
from pathlib import Path

import psutil
import pytest
from threadpoolctl import threadpool_limits

from occ.errors import InputError
from occ.experiment.pool import Engine, Lost
from tests.experiment.jobs import matrix_sums, touch_and_wait, work, works

POOL = Engine(workers=2)


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
    assert dict(Engine().each_or_parts(works, [["raises", 1]], lambda _: [["raises"], [1]])) == {
        0: [Lost("ArithmeticError: of mine"), [2]]
    }


def test_parts_are_ended_in_the_middle() -> None:
    items = [["exit", 1], ["exit", "sleeps"]]
    with closing(POOL.each_or_parts(works, items, lambda number: [[item] for item in items[number]])) as finished:
        number, outcome = next(finished)
    assert (number, outcome[1]) == (0, [2])


@pytest.mark.parametrize("engine", [Engine(), POOL], ids=["here", "pool"])
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


def test_a_limit_means_a_process_that_can_be_ended() -> None:
    assert Engine().here
    assert not Engine(time_limit=1.0).here
    assert outcomes(Engine(time_limit=1.0), ["sleeps", 4])[4] == 8


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
        here, pool = (dict(engine.each(matrix_sums, seeds)) for engine in (Engine(), POOL))
    assert here == pool


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"workers": 0}, "workers should be at least 1"),
        ({"workers": 2, "dask": "tcp://127.0.0.1:1"}, "one of the two"),
        ({"time_limit": 0.0}, "time_limit should be greater than 0"),
        ({"memory_limit": float("nan")}, "memory_limit should be"),
    ],
)
def test_engine_that_cannot_be_meant(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Engine(**options)
