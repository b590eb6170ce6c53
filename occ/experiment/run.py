"""Solve all cases of an experiment, judge them, and write what there is to know into one folder."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, redirect_stdout
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from occ.errors import Status
from occ.experiment.case import Case
from occ.experiment.dataset import motion_dataset
from occ.experiment.load import Experiment
from occ.experiment.naming import slug
from occ.experiment.netcdf import write_netcdf
from occ.experiment.pool import Died, in_processes
from occ.experiment.results import Results, Row, assemble, plain
from occ.experiment.store import Store, file_stamp, replacing
from occ.referee import Record, examine
from occ.task import Player, Task

Progress = Callable[[str, int], None]
"""Called with what was done (case and controller) and how many rows that makes."""


def run(experiment: Experiment, out: Path, workers: int = 1, progress: Progress | None = None) -> Results:
    """Solve what is not stored yet, and write table, record and trajectories.

    Args:
        experiment: validated.
        out: folder; made if need be.
        workers: processes; 1 is this one.
        progress: told about each row.

    Returns:
        The results, the same whatever the workers and the order in which cases finish.

    Raises:
        InputError: the folder cannot be written.
        BoundViolation: a feasible row below a certified bound of its class.
    """
    store = Store(out)
    store.prepare()
    started = datetime.now(UTC).isoformat(timespec="seconds")
    tell = progress or _silent
    outcomes: dict[int, Sequence[Row]] = {}
    for number, case in enumerate(experiment.cases):
        stored = store.read(case.key)
        if stored is not None and all(
            row["trajectory"] is None or row["trajectory"] == _stamped(row, case) for row in stored
        ):
            outcomes[number] = stored
            tell(f"{case.name}: stored", len(stored))
    missing = [number for number in range(len(experiment.cases)) if number not in outcomes]
    cases = [experiment.cases[number] for number in missing]
    with closing(_solved(cases, out, workers, tell)) as solved:
        for position, rows in solved:
            outcomes[missing[position]] = rows
    results = assemble(experiment, [outcomes[number] for number in range(len(experiment.cases))], started)
    results.save(out)
    return results


def solve_case(case: Case, out: Path, progress: Progress | None = None) -> list[Row]:
    """Solve, judge and store one case.

    Args:
        case: plain data.
        out: folder of the experiment.
        progress: told about each row.

    Returns:
        One row for each controller: labels and measures, and beside them ``local_objective``, ``statistics``,
        ``solve_time_s``, ``judge_time_s`` and ``trajectory``.

    Raises:
        InputError: the folder cannot be written.
    """
    task = case.task()
    rows = []
    for name, player in case.players().items():
        rows.append(_row(case, task, name, player, out))
        if progress:
            progress(f"{case.name}: {name}", 1)
    # A case in which something crashed is tried again by the next run.
    if all(row["status"] != Status.CRASHED for row in rows):
        Store(out).write(case.key, rows)
    return rows


def _solved(
    cases: Sequence[Case], out: Path, workers: int, tell: Progress
) -> Generator[tuple[int, Sequence[Row]], None, None]:
    """Position and rows of each case as it is finished."""
    if workers == 1 or len(cases) < 2:
        for position, case in enumerate(cases):
            yield position, solve_case(case, out, tell)
        return
    with closing(in_processes(partial(solve_case, out=out), cases, workers)) as finished:
        for position, outcome in finished:
            case = cases[position]
            rows = _rows_of_dead_worker(case) if isinstance(outcome, Died) else outcome
            tell(case.name, len(rows))
            yield position, rows


def _row(case: Case, task: Task, name: str, player: Player, out: Path) -> Row:
    """One controller's row; its trajectory is written, or removed where there is none any more."""
    path = out / _trajectory(case, name)
    begin = time.perf_counter()
    solved = None
    dataset = None
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
        if verdict.replay is not None:
            dataset = motion_dataset(task, verdict, _attributes(case, name))
    except (Exception, SystemExit) as error:  # whatever a player does, its row stays in the table
        record = _crashed(f"{type(error).__name__}: {error}")
        solved = solved or time.perf_counter()
    judged = time.perf_counter()
    if dataset is None:
        path.unlink(missing_ok=True)
    else:
        with replacing(path) as temporary:
            write_netcdf(dataset, temporary)
    return {
        "controller": name,
        **plain(record.row),
        "local_objective": record.local_objective,
        "statistics": plain(statistics),
        "solve_time_s": solved - begin,
        "judge_time_s": judged - solved,
        "trajectory": {"path": _trajectory(case, name), **file_stamp(path)} if dataset is not None else None,
    }


def _rows_of_dead_worker(case: Case) -> list[Row]:
    reason = "the process that solved this case ended without an answer, twice"
    return [
        {
            "controller": name,
            **_crashed(reason).row,
            "local_objective": None,
            "statistics": {},
            "solve_time_s": None,
            "judge_time_s": None,
            "trajectory": None,
        }
        for name in case.controllers
    ]


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
    return f"trajectories/{case.slug}/{slug(name)}.nc"


def _stamped(row: Row, case: Case) -> dict[str, Any]:
    """The row's trajectory as it would be recorded for this case: other cases may have had the same content."""
    return row["trajectory"] | {"path": _trajectory(case, row["controller"])}


def _silent(what: str, rows: int) -> None:
    """Progress that nobody wants to see."""
