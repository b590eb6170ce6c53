"""The table of all motions, objectives and keeps: complete, from results on disk alone, and made again by the code."""

from __future__ import annotations

import csv
import hashlib
import random
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

from occ.errors import Status
from occ.experiment.run import run
from occ.motion import MOTIONS as KINDS
from occ.objectives import OBJECTIVES
from occ.referee import judge
from tests.benchmarks.motions import AIMS, KEEPS, LAW, MOTIONS, NO_LESS_THAN, Cell, cells, columns, matrix, page, write
from tests.experiment import HERE

REPORTS = Path(__file__).parents[2] / "reports"
TOLERANCE = {"path": 1e-5, "tube": 1e-3, "ends": 1e-3}
"""What the files ask for."""


@cache
def committed() -> Sequence[Cell]:
    return cells(REPORTS / "motions")


def error_of(cell: Cell) -> float:
    """How uncertain a value is, in its unit: twice the tolerance, and what the added copper loss costs."""
    assert cell.value is not None
    return 2 * TOLERANCE[cell.key[2]] * max(1.0, abs(cell.value)) + (cell.smoothing or 0.0)


def test_every_motion_objective_and_keep_is_there() -> None:
    assert set(MOTIONS) == {motion.kind for motion in KINDS} - {"circle", "line"}
    # A copper loss is a factor times the squared torques.
    assert set(AIMS) == set(OBJECTIVES) - {"copper_loss"}
    cases = matrix(("rest_to_rest",)).cases
    assert [case.sweep["objective"] for case in cases] == list(AIMS)
    for case in cases:
        law, *rest = case.tables["controller"]
        assert law["name"] == LAW
        assert [table["name"] for table in rest] == [table["keep"] for table in rest] == list(KEEPS)
        assert {table["objective"] for table in rest} == {case.sweep["objective"]}
        assert {table["keep"]: table["tolerance"] for table in rest} == TOLERANCE


def test_the_table_is_made_from_results_on_disk_and_nothing_is_solved_twice(tmp_path: Path) -> None:
    few = matrix(("rest_to_rest",), ("torque_squared",))
    for table in few.cases[0].tables["controller"][1:]:
        table["starts"] = 1
    results = run(few, tmp_path / "motions", HERE)
    told: list[bool] = []
    again = run(few, tmp_path / "motions", HERE, lambda what, rows, failed=0, stored=False: told.append(stored))
    assert told == [True]
    assert again.rows == results.rows
    write(tmp_path)
    with (tmp_path / "motions.csv").open() as file:
        lines = list(csv.DictReader(file))
    rows = {row["controller"]: row for row in results.rows}
    assert [line["keep"] for line in lines] == list(KEEPS)
    law = rows[LAW]["torque_squared_N2m2s"]
    text = (tmp_path / "motions.md").read_text()
    for line in lines:
        row = rows[line["keep"]]
        assert line["status"] == row["status"] == Status.OK, row["message"]
        assert float(line["value"]) == row["torque_squared_N2m2s"]
        assert f"| {float(line['value']):.7g} N^2 m^2 s |" in text
        assert float(line["law"]) == law
        assert float(line["error"]) <= TOLERANCE[line["keep"]]
    assert float(lines[0]["law_gap_percent"]) == pytest.approx(100 * (law / float(lines[0]["value"]) - 1))


def test_the_committed_table_is_complete_and_says_what_its_results_say() -> None:
    found = committed()
    assert [cell.key for cell in found] == [(m, aim, keep) for m in MOTIONS for aim in AIMS for keep in KEEPS]
    assert page(list(found)) == (REPORTS / "motions.md").read_text()
    with (REPORTS / "motions.csv").open() as file:
        lines = list(csv.DictReader(file))
    expected = [{name: "" if x is None else str(x) for name, x in line.items()} for line in columns(list(found))]
    assert lines == expected
    failed = [cell for cell in found if cell.row["status"] != Status.OK]
    text = page(list(found))
    assert all(f"- {', '.join(cell.key)}: {cell.row['message']}" in text for cell in failed)
    assert not failed


@pytest.mark.parametrize("motion", MOTIONS)
def test_who_keeps_less_pays_no_more_and_a_larger_objective_costs_no_less(motion: str) -> None:
    found = {cell.key[1:]: cell for cell in committed() if cell.key[0] == motion}
    for aim in AIMS:
        path = found[aim, "path"]
        for keep in ("tube", "ends"):
            cell = found[aim, keep]
            if cell.value is not None and path.value is not None:
                assert cell.value <= path.value + error_of(cell) + error_of(path), cell.key
        if aim in NO_LESS_THAN:
            for keep in KEEPS:
                cell, below = found[aim, keep], found[NO_LESS_THAN[aim], keep]
                if cell.value is not None and below.value is not None:
                    assert cell.value >= below.value - error_of(below), cell.key


@pytest.mark.parametrize("motion", MOTIONS)
def test_no_cell_is_beaten_by_the_solution_of_another_objective(motion: str) -> None:
    found = [cell for cell in committed() if cell.key[0] == motion and cell.value is not None]
    for cell in found:
        for other in found:
            if other.key[2] == cell.key[2]:
                assert cell.value is not None  # for the types
                assert cell.value <= other.measure(cell.aim) + error_of(cell), (cell.key, other.key)


@pytest.mark.slow
def test_a_few_cells_made_again_are_those_of_the_table() -> None:
    # Others with every table that is made anew, and the same ones for as long as it stays.
    table = hashlib.sha256((REPORTS / "motions.csv").read_bytes()).hexdigest()
    found = [cell for cell in committed() if cell.value is not None and cell.seconds < 10.0]
    for cell in random.Random(table).sample(found, 4):
        motion, aim, keep = cell.key
        (case,) = matrix((motion,), (aim,)).cases
        task = case.task()
        record = judge(task, case.players()[keep].solve(task))
        assert record.status is Status.OK, (cell.key, record.message)
        value = record.measures[OBJECTIVES[aim].column]
        assert abs(value - (cell.value or 0.0)) <= error_of(cell), (cell.key, value, cell.value)
