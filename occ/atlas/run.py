"""Make an atlas: blocks of points and full comparisons on an engine, each stored as soon as it is there."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from occ.atlas.columns import Columns
from occ.atlas.comparison import STATUSES, Comparison, alone, compare, joined, numbers, status_place
from occ.atlas.grid import Grid
from occ.atlas.least_work import least_work_columns
from occ.atlas.long_run import long_run_columns
from occ.atlas.points import Points
from occ.atlas.variables import LEAST_WORK, LONG_RUN
from occ.errors import InputError, Status
from occ.experiment.case import Alone, code_fingerprint
from occ.experiment.child import Lost, Tell, unheard
from occ.experiment.journal import Journal
from occ.experiment.load import load_experiment
from occ.experiment.pool import Engine
from occ.experiment.run import Progress, silent

SIZES = {"long_run": 8192, "least_work": 64}
"""Points of a block: a second's work, so that little is lost with it; the same for every engine."""


@dataclass(frozen=True)
class Block:
    """Points that are worked on together, plain data."""

    points: Points
    least_work: bool


@dataclass(frozen=True)
class Failure:
    """Why a point, or a controller there, has no value."""

    point: int
    controller: str
    status: str
    message: str


@dataclass(frozen=True)
class Found:
    """All values of an atlas.

    Args:
        columns: (N,) of each variable of the points, on disk.
        rows: (N, K) of each number of the K controllers, and their ``status``; empty unless they were compared.
        failures: in the order of the points.
    """

    columns: Columns
    rows: dict[str, np.ndarray]
    failures: list[Failure]


@dataclass(frozen=True)
class _Job:
    """A block (first and last point) or a comparison (last is None), and the key of its content."""

    key: str
    first: int
    last: int | None = None


def make_atlas(path: Path, grid: Grid, out: Path, engine: Engine, progress: Progress = silent) -> Found:
    """Work out what is not stored yet, and read all of it.

    Args:
        path: of the experiment file.
        grid: of the same file.
        out: folder; made if need be.
        engine: where the work is done; only this process writes.
        progress: told about points that are done.

    Returns:
        All values, the same for every engine.

    Raises:
        InputError: the folder cannot be written, or there is no such cluster.
        BoundViolation: a feasible row below a proven bound of its class.
    """
    work = _Work(path, grid)
    with Journal(out / ".store") as journal:
        journal.open()
        lost: dict[int, bytes] = {}
        missing = []
        for number, job in enumerate(work.jobs):
            if journal.read(job.key) is None:
                missing.append(number)
            else:
                progress("stored", work.rows(job), 0, True)
        with engine.kept() as kept, closing(_results(work, missing, kept)) as finished:
            for number, content, whole in finished:
                job = work.jobs[number]
                if whole:
                    journal.write(job.key, content)
                else:
                    # Nothing of this is stored: another run tries again.
                    lost[number] = content
                failed = len(work.failures(job, content))
                progress(work.name(job), work.rows(job), failed)
        return work.assembled(lambda number: lost.get(number) or journal.read(work.jobs[number].key))


def _results(work: _Work, missing: list[int], engine: Engine) -> Generator[tuple[int, bytes, bool], None, None]:
    """Number of each job, its result, and whether nothing of it is lost."""
    items = (work.item(work.jobs[number]) for number in missing)
    divided: dict[int, list[bytes | Lost]] = {}
    doing = engine.each_or_parts(solve, items, lambda position: work.apart(work.jobs[missing[position]]))
    with closing(doing) as finished:
        for position, outcome in finished:
            number = missing[position]
            job = work.jobs[number]
            if isinstance(outcome, bytes):
                yield number, outcome, True
            elif job.last is None:
                controllers = work.cases[job.first].controllers
                divided[number] = [outcome for _ in controllers] if isinstance(outcome, Lost) else outcome
            else:
                assert isinstance(outcome, Lost)
                yield number, work.replaced(job, outcome), False
    for number, (content, whole) in zip(divided, work.joined(divided, engine), strict=True):
        yield number, content, whole


def solve(item: Block | Comparison | Alone, tell: Tell = unheard) -> bytes:
    """The result of one block or comparison, as it is stored, or of one controller the row; a comparison tells each."""
    if isinstance(item, Comparison):
        return json.dumps(compare(item, lambda row: tell(json.dumps(row).encode()))).encode()
    if isinstance(item, Alone):
        return json.dumps(alone(item)).encode()
    columns, reasons = long_run_columns(item.points)
    if item.least_work:
        more, others = least_work_columns(item.points)
        columns |= more
        reasons += others
    return _packed(columns, reasons)


def _packed(columns: dict[str, np.ndarray], reasons: list[tuple[int, str]]) -> bytes:
    file = io.BytesIO()
    np.savez(file, reasons=np.array(json.dumps(reasons)), **columns)  # type: ignore[arg-type]  # no column is called allow_pickle
    return file.getvalue()


def _unpacked(content: bytes) -> tuple[dict[str, np.ndarray], list[tuple[int, str]]]:
    with np.load(io.BytesIO(content)) as arrays:
        columns = {name: arrays[name] for name in arrays.files if name != "reasons"}
        return columns, json.loads(str(arrays["reasons"]))


class _Work:
    """The jobs of a grid."""

    def __init__(self, path: Path, grid: Grid) -> None:
        self.grid = grid
        self.depth = grid.options.depth
        size = SIZES.get(self.depth, SIZES["long_run"])
        self.objectives = grid.experiment.objectives
        self.cases = load_experiment(path, grid.overrides).cases if self.depth == "comparison" else ()
        self.jobs = [_Job(self._block_key(points), first, first + len(points)) for first, points in grid.blocks(size)]
        self.jobs += [_Job(self._case_key(case.key), number) for number, case in enumerate(self.cases)]

    def _block_key(self, points: Points) -> str:
        return hashlib.sha256(f"{self.depth} {points.digest} {code_fingerprint()}".encode()).hexdigest()

    def _case_key(self, key: str) -> str:
        return hashlib.sha256(f"{key} {self.objectives}".encode()).hexdigest()

    def item(self, job: _Job) -> Block | Comparison:
        if job.last is None:
            return Comparison(self.cases[job.first], self.objectives)
        return Block(self.grid.points(job.first, job.last), self.depth == "least_work")

    def apart(self, job: _Job) -> list[Alone]:
        return self.cases[job.first].apart if job.last is None else []

    def replaced(self, job: _Job, outcome: Lost) -> bytes:
        """What stands for a block without an answer."""
        block = self.item(job)
        assert isinstance(block, Block)
        names = {**LONG_RUN, **(LEAST_WORK if block.least_work else {})}
        count = len(block.points)
        columns = {name: np.zeros(count, np.int8) if v.text else np.full(count, np.nan) for name, v in names.items()}
        return _packed(columns, [(i, outcome.reason) for i in range(count)])

    def joined(self, divided: dict[int, list[bytes | Lost]], engine: Engine) -> list[tuple[bytes, bool]]:
        """Comparisons from the rows of their controllers by the number of the job, and whether nothing is lost."""
        items = []
        for number, parts in divided.items():
            item = Comparison(self.cases[self.jobs[number].first], self.objectives)
            items.append((item, [part if isinstance(part, Lost) else json.loads(part) for part in parts]))
        return [(json.dumps(rows).encode(), whole) for rows, whole in joined(items, engine)]

    def rows(self, job: _Job) -> int:
        if job.last is None:
            return 1
        # Beside full comparisons closed forms take no time, and would only mislead the estimate of what is left.
        return 0 if self.cases else job.last - job.first

    def name(self, job: _Job) -> str:
        return self.cases[job.first].name if job.last is None else f"points from {job.first}"

    def failures(self, job: _Job, content: bytes) -> list[Failure]:
        if job.last is None:
            rows = json.loads(content)
            return [
                Failure(job.first, row["controller"], row["status"], row["message"])
                for row in rows
                if row["status"] != Status.OK
            ]
        return [Failure(job.first + i, "", Status.FAILED, reason) for i, reason in sorted(_unpacked(content)[1])]

    def assembled(self, content: Any) -> Found:
        columns = Columns(self.grid.size)
        rows: dict[str, np.ndarray] = {}
        controllers = self.cases[0].controllers if self.cases else []
        failures: list[Failure] = []
        for number, job in enumerate(self.jobs):
            stored = content(number)
            if stored is None:
                raise InputError("a stored result is damaged since it was read; another run makes it again")
            failures += self.failures(job, stored)
            if job.last is not None:
                columns.put(job.first, _unpacked(stored)[0])
                continue
            for k, row in enumerate(json.loads(stored)):
                for name in numbers(self.objectives):
                    values = rows.setdefault(name, np.full((self.grid.size, len(controllers)), np.nan))
                    values[job.first, k] = np.nan if row[name] is None else row[name]
                texts = rows.setdefault("status", np.zeros((self.grid.size, len(controllers)), np.int8))
                texts[job.first, k] = status_place(row)
        return Found(columns, rows, failures)


def status_texts(places: np.ndarray) -> np.ndarray:
    """The words for the statuses of a `Found`."""
    return np.array(STATUSES)[places]


def coordinates_of(grid: Grid, point: int) -> Iterator[tuple[str, Any]]:
    """Swept keys and their values at a point."""
    for (key, values), place in zip(grid.coordinates.items(), np.unravel_index(point, grid.shape), strict=True):
        yield key, values[int(place)]
