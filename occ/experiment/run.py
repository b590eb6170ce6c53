"""Solve all cases of an experiment, judge them, and write what there is to know into one folder."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import closing, redirect_stdout
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from occ.errors import Status
from occ.experiment.case import Alone, Case
from occ.experiment.child import Lost, Tell, unheard
from occ.experiment.dataset import motion_dataset
from occ.experiment.interrupt import lasting_interrupts
from occ.experiment.load import Experiment
from occ.experiment.naming import slug
from occ.experiment.netcdf import netcdf_bytes
from occ.experiment.pool import Engine
from occ.experiment.results import Results, Row, assemble, plain
from occ.experiment.store import Store, stamp, write_bytes
from occ.referee import Record, examine
from occ.task import Player, Task

if TYPE_CHECKING:
    import xarray as xr

SAFE = Engine()
"""A process beside this one."""


class Progress(Protocol):
    """Told what was done, how many rows that makes, how many of them are not ok, and whether they were stored."""

    def __call__(self, what: str, rows: int, failed: int = 0, stored: bool = False) -> None: ...


class Solved(NamedTuple):
    """The rows of a case, and its trajectories as files by their path in the experiment's folder."""

    rows: list[Row]
    motions: dict[str, bytes]


def run(experiment: Experiment, out: Path, engine: Engine = SAFE, progress: Progress | None = None) -> Results:
    """Solve what is not stored yet, and write table, record and trajectories.

    Args:
        experiment: validated.
        out: folder; made if need be.
        engine: where the cases are solved; only this process writes.
        progress: told about each row.

    Returns:
        The results, the same whatever the engine and the order in which cases finish.

    Raises:
        InputError: the folder cannot be written, or there is no such cluster.
        BoundViolation: a feasible row below a certified bound of its class.
    """
    store = Store(out)
    store.prepare()
    started = datetime.now(UTC).isoformat(timespec="seconds")
    tell = progress or silent
    outcomes: dict[int, Sequence[Row]] = {}
    for number, case in enumerate(experiment.cases):
        stored = store.read(case.key)
        if stored is not None and all(
            row["trajectory"] is None or row["trajectory"] == _stamped(row, case) for row in stored
        ):
            outcomes[number] = stored
            tell(case.name, len(stored), not_ok(stored), True)
    missing = [number for number in range(len(experiment.cases)) if number not in outcomes]
    cases = [experiment.cases[number] for number in missing]
    told = _Told(cases, tell)
    with engine.kept() as kept:
        # A controller that takes its process with it should cost its own row only.
        doing = closing(kept.each_or_parts(solve_case, cases, lambda number: cases[number].apart, told.row))
        with store.tidied(), lasting_interrupts() as stop_if_interrupted, doing as finished:
            for position, outcome in finished:
                stop_if_interrupted()
                case = cases[position]
                solved = _joined(case, outcome)
                _keep(store, case, solved)
                outcomes[missing[position]] = solved.rows
                told.case(position, solved.rows)
        rows = [outcomes[number] for number in range(len(experiment.cases))]
        results = assemble(experiment, rows, started, kept)
    results.save(out)
    return results


Outcome = Solved | Lost | list[Solved | Lost]
"""Of a case: its rows, or of each of its controllers the row, or why there is none."""


class _Told:
    """Tells about each row once: as soon as it is heard of, and at the latest with its case."""

    def __init__(self, cases: Sequence[Case], tell: Progress) -> None:
        self._cases, self._tell = cases, tell
        self._rows: Counter[int] = Counter()
        self._failed: Counter[int] = Counter()

    def row(self, number: int, place: int, part: Solved | Lost) -> None:
        failed = 1 if isinstance(part, Lost) else not_ok(part.rows)
        self._rows[number] += 1
        self._failed[number] += failed
        case = self._cases[number]
        self._tell(f"{case.name}: {case.controllers[place]}", 1, failed)

    def case(self, number: int, rows: Sequence[Row]) -> None:
        left = len(rows) - self._rows.pop(number, 0)
        failed = not_ok(rows) - self._failed.pop(number, 0)
        if left:
            self._tell(self._cases[number].name, left, failed)


def _joined(case: Case, outcome: Outcome) -> Solved:
    """The rows of a case, whatever came out."""
    if isinstance(outcome, Solved):
        return outcome
    parts = [outcome] * len(case.controllers) if isinstance(outcome, Lost) else outcome
    joined = Solved([], {})
    for name, part in zip(case.controllers, parts, strict=True):
        joined.rows.extend([lost_row(name, part.reason)] if isinstance(part, Lost) else part.rows)
        joined.motions.update({} if isinstance(part, Lost) else part.motions)
    return joined


def _keep(store: Store, case: Case, solved: Solved) -> None:
    """Write a case's trajectories, remove those that there are none of any more, and store its rows."""
    for row in solved.rows:
        path = _trajectory(case, row["controller"])
        if path in solved.motions:
            write_bytes(store.folder / path, solved.motions[path])
        else:
            (store.folder / path).unlink(missing_ok=True)
    # A case in which something crashed is tried again by the next run.
    if all(row["status"] != Status.CRASHED for row in solved.rows):
        store.write(case.key, solved.rows)


def solve_case(item: Case | Alone, tell: Tell = unheard) -> Solved:
    """Solve and judge one case, or one controller of it.

    Args:
        item: plain data.
        tell: takes what `solve_case` of each controller alone would return, as soon as it is there.

    Returns:
        One row for each controller, labels and measures, and beside them ``local_objective``, ``statistics``,
        ``solve_time_s``, ``judge_time_s`` and ``trajectory``; and the trajectories.
    """
    case, names = (item, item.controllers) if isinstance(item, Case) else (item.case, [item.controller])
    task, players = case.posed()
    solved = Solved([], {})
    for name in names:
        one = Solved([], {})
        row, motion = solve_row(case, task, name, players[name])
        if motion is not None:
            path, content = _trajectory(case, name), netcdf_bytes(motion)
            row["trajectory"] = {"path": path, **stamp(content)}
            one.motions[path] = content
        one.rows.append(row)
        tell(one)
        solved.rows.extend(one.rows)
        solved.motions.update(one.motions)
    return solved


def not_ok(rows: Sequence[Row]) -> int:
    """How many rows are not ok."""
    return sum(row["status"] != Status.OK for row in rows)


def solve_row(
    case: Case, task: Task, name: str, player: Player, *, with_motion: bool = True
) -> tuple[Row, xr.Dataset | None]:
    """One controller's row, whatever it does, and the true motion behind it.

    Args:
        case: plain data.
        task: of the case.
        name: of the controller.
        player: the controller.
        with_motion: whether the motion is wanted, too.

    Returns:
        The row, whose ``trajectory`` is None, and the motion; None where there was none, or nobody wants it.
    """
    begin = time.perf_counter()
    solved = None
    motion = None
    statistics: dict[str, Any] = {}
    try:
        # What a player prints is not part of the answer, which may be read by a program.
        with redirect_stdout(sys.stderr):
            solution = player.solve(task)
            solved = time.perf_counter()
            verdict = examine(task, solution)
        # Anything may have been returned; the verdict tells.
        statistics = getattr(solution, "statistics", {})
        record = verdict.record
        if with_motion and verdict.replay is not None:
            motion = motion_dataset(task, verdict, _attributes(case, name))
    except (Exception, SystemExit) as error:  # whatever a player does, its row stays in the table
        record = _crashed(f"{type(error).__name__}: {error}")
        solved = solved or time.perf_counter()
    row = _labelled(name, record) | {
        "statistics": plain(statistics),
        "solve_time_s": solved - begin,
        "judge_time_s": time.perf_counter() - solved,
    }
    return row, motion


def lost_row(name: str, reason: str) -> Row:
    """The row of a controller whose process gave no answer.

    Args:
        name: of the controller.
        reason: in words.

    Returns:
        A row that is ``crashed``.
    """
    return _labelled(name, _crashed(reason))


def _labelled(name: str, record: Record) -> Row:
    row = {"controller": name, **plain(record.row), "local_objective": record.local_objective}
    return row | {"statistics": {}, "solve_time_s": None, "judge_time_s": None, "trajectory": None}


def _crashed(reason: str) -> Record:
    return Record(status=Status.CRASHED, message=" ".join(reason.split()), keep="", start="", end="")


def _attributes(case: Case, name: str) -> dict[str, Any]:
    return {
        "case": case.name,
        "controller": name,
        "tables": json.dumps(dict(case.tables), sort_keys=True),
        "occ_version": version("occ"),
    }


def _trajectory(case: Case, name: str) -> str:
    # No slug has an @, so that two rows never share a file.
    return f"trajectories/{case.slug}@{slug(name)}.nc"


def _stamped(row: Row, case: Case) -> dict[str, Any]:
    """The row's trajectory as it would be recorded for this case: other cases may have had the same content."""
    return row["trajectory"] | {"path": _trajectory(case, row["controller"])}


def silent(what: str, rows: int, failed: int = 0, stored: bool = False) -> None:
    """Progress that nobody wants to see.

    Args:
        what: was done.
        rows: how many that makes.
        failed: how many of them are not ok.
        stored: whether they were found and not made.
    """
