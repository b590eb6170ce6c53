"""Random tasks: certified bounds of the squares of the torques beside collocation; `reports/random_squares.*`.

    python -m tests.benchmarks.random_squares [OUT] [COUNT]

The tasks are those of `tests.theory.test_minimum_work.random_task`.  There is no formula for the least value: the gap
is between a proof and the best motion that collocation finds, so that either of them may be what is loose.  A task
whose row is in the file already is not solved again; the page is made from the rows alone.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Any

import numpy as np

from occ.certify.squares import certify_squares
from occ.optimal.collocation import Collocation
from occ.referee import judge
from occ.task import Task
from tests.theory.test_minimum_work import random_task

COUNT = 16
STARTS = 6
"""Starting guesses of collocation, against local optima."""
EFFORT = 150_000
"""Of the sums of squares, a quarter of what a comparison allows."""
WITHIN = (("0.001", 1e-5), ("0.01", 1e-4), ("0.1", 1e-3), ("1", 1e-2))
"""Gaps that are counted, in per cent and as a share."""


def row_of(seed: int, task: Task) -> dict[str, Any]:
    """Solve one task, and bound it."""
    once = _least(task, 1)
    reached = min(once, _least(task, STARTS))
    certificate = certify_squares(task, "torque_squared", upper=reached, effort=EFFORT)
    degree = certificate.degree
    return {
        "task": seed,
        "one_start_N2m2s": once,
        "collocation_N2m2s": reached,
        "certified_N2m2s": certificate.lower,
        "word": certificate.word,
        "degree_time": degree.time if degree else "",
        "degree_angle": degree.angle if degree else "",
        "certificate_s": certificate.seconds,
    }


def _least(task: Task, starts: int) -> float:
    """The referee's value of the best motion that collocation finds; infinite where there is none."""
    record = judge(task, Collocation(objective="torque_squared", starts=starts, seconds=20.0).solve(task))
    return float(record.measures["torque_squared_N2m2s"]) if record.status == "ok" else float(np.inf)


def page(rows: list[dict[str, str]]) -> str:
    """The table of the rows on disk."""
    once, reached, certified, seconds = (
        np.array([float(row[name]) for row in rows])
        for name in ("one_start_N2m2s", "collocation_N2m2s", "certified_N2m2s", "certificate_s")
    )
    solved = np.isfinite(reached)
    gap = (reached[solved] - certified[solved]) / reached[solved]
    lines = [
        "# Random tasks: least squares of the torques, certified by sums of squares",
        "",
        f"{len(rows)} circles with radius, rate, point B, friction, start and horizon at random, the end free "
        f"(`random_squares.csv`); an effort of {EFFORT} for each bound, {STARTS} starting guesses of "
        "collocation.",
        "",
        "| certified bound below the best motion of collocation by at most | tasks |",
        "| :--- | ---: |",
        *(f"| {percent} % | {int((gap <= share).sum())} |" for percent, share in WITHIN),
        f"| unresolved by more than {WITHIN[-1][0]} % | {int((gap > WITHIN[-1][1]).sum())} |",
        f"| one start ends in a worse local optimum (by more than 0.01 %) | {int((once > reached * 1.0001).sum())} |",
        f"| collocation without a motion | {int((~solved).sum())} |",
        f"| bound above a motion | {int((gap < 0).sum())} |",
        "",
        f"Processor time of a bound: median {np.median(seconds):.3g} s, longest {seconds.max():.3g} s.",
        "",
        "| task | certified [N² m² s] | collocation [N² m² s] | gap [%] | degree in time, angle | time [s] |",
        "| ---: | ---: | ---: | ---: | :---: | ---: |",
    ]
    for row, value, bound, time in zip(rows, reached, certified, seconds, strict=True):
        degree = f"{row['degree_time']}, {row['degree_angle']}"
        gap_percent = f"{100 * (value - bound) / value:.2g}" if np.isfinite(value) else "-"
        lines.append(f"| {row['task']} | {bound:.8g} | {value:.8g} | {gap_percent} | {degree} | {time:.1f} |")
    return "\n".join(lines) + "\n"


def main(out: Path, count: int) -> None:
    """Solve what is missing, and write the page."""
    path = out / "random_squares.csv"
    done = {int(row["task"]) for row in csv.DictReader(path.open())} if path.exists() else set()
    for seed in range(count):
        if seed not in done:
            row = row_of(seed, random_task(seed))
            with path.open("a", newline="") as file:
                writer = csv.DictWriter(file, row)
                if not file.tell():
                    writer.writeheader()
                writer.writerow(row)
        rows = sorted(csv.DictReader(path.open()), key=lambda row: int(row["task"]))
        (out / "random_squares.md").write_text(page(rows))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports"), int(sys.argv[2]) if len(sys.argv) > 2 else COUNT)
