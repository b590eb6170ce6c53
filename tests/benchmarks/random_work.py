"""Random tasks: exact least work, certified bound and collocation side by side; `reports/random_work.csv` and `.md`.

    python -m tests.benchmarks.random_work [OUT] [COUNT]

The tasks are those of `tests.theory.test_minimum_work.random_task`: radius, rate, point, friction, start and horizon at
random.  A task whose row is in the file already is not solved again; the page is made from the rows alone.
"""

from __future__ import annotations

import csv
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from occ.certify import certify_work
from occ.optimal.collocation import Collocation
from occ.referee import judge
from occ.task import Task
from occ.theory.minimum_work import minimum_work
from tests.theory.test_minimum_work import random_task

COUNT = 240
WITHIN = (("0.0001", 1e-6), ("0.01", 1e-4), ("0.1", 1e-3), ("1", 1e-2))
"""Gaps that are counted, in per cent and as a share."""
ROUNDING = 1e-9
"""Relative: how far below the exact value the referee's may be."""


def row_of(seed: int, task: Task) -> dict[str, Any]:
    """Solve one task three times; all times are the processor's."""
    minimum_work(task)
    clock = time.process_time()
    least = minimum_work(task)
    exact_seconds = time.process_time() - clock
    certificate = certify_work(task)
    clock = time.process_time()
    record = judge(task, Collocation(objective="work", seconds=20.0).solve(task))
    assert least.extremal is not None
    places = least.extremal.places
    return {
        "task": seed,
        "radius_m": task.motion.radius,
        "rate_rad_s": task.motion.rate,
        "point_x_m": task.point[0],
        "point_y_m": task.point[1],
        "wheel_friction": task.platform.wheels[0].friction,
        "heading_rad": task.start.heading,
        "heading_rate_rad_s": task.start.heading_rate,
        "duration_s": task.duration,
        "turning_points": len(places) - 2,
        "turned_rad": places[-1] - places[0],
        "exact_J": least.work,
        "exact_s": exact_seconds,
        "certified_J": certificate.lower,
        "word": certificate.word,
        "certificate_s": certificate.seconds,
        "collocation_status": record.status.value,
        "collocation_J": record.measures.get("work_J", ""),
        "collocation_s": time.process_time() - clock,
    }


def page(rows: list[dict[str, str]]) -> str:
    """The table of the rows on disk."""
    exact, certified = (np.array([float(row[name]) for row in rows]) for name in ("exact_J", "certified_J"))
    gap = (exact - certified) / np.abs(exact)
    solved = np.array([row["collocation_status"] == "ok" for row in rows])
    reached = np.array([float(row["collocation_J"]) if ok else np.nan for row, ok in zip(rows, solved, strict=True)])
    excess = ((reached - exact) / np.abs(exact))[solved]
    lines = [
        "# Random tasks: exact, certified and collocation",
        "",
        f"{len(rows)} circles with radius, rate, point B, friction, start and horizon at random, the end free "
        "(`random_work.csv`; made again by `make random`). Times are of one core that other work shared.",
        "",
        "| certified bound below the exact least work by at most | tasks |",
        "| :--- | ---: |",
        *(f"| {percent} % | {int((gap <= share).sum())} |" for percent, share in WITHIN),
        f"| unresolved (more than {WITHIN[0][0]} %) | {int((gap > WITHIN[0][1]).sum())} |",
        f"| bound above the exact value | {int((gap < -ROUNDING).sum())} |",
        "",
        "| collocation, judged by the referee | tasks |",
        "| :--- | ---: |",
        f"| solved | {int(solved.sum())} |",
        f"| below the exact least work | {int((excess < -ROUNDING).sum())} |",
        f"| above it by at most 0.01 % | {int((excess <= 1e-4).sum())} |",
        f"| above it by more than 1 % (a local optimum, or the price of the jumps) | {int((excess > 1e-2).sum())} |",
        f"| above the certified bound | {int((reached[solved] >= certified[solved]).sum())} |",
        "",
        "| processor's time per task | median | nine in ten | longest |",
        "| :--- | ---: | ---: | ---: |",
    ]
    for name, unit, column in (
        ("exact least work", 1e3, "exact_s"),
        ("certificate", 1.0, "certificate_s"),
        ("collocation", 1.0, "collocation_s"),
    ):
        times = unit * np.array([float(row[column]) for row in rows])
        values = (np.median(times), np.quantile(times, 0.9), times.max())
        lines.append(f"| {name} | " + " | ".join(f"{x:.3g} {'ms' if unit > 1 else 's'}" for x in values) + " |")
    unresolved = [row for row, g in zip(rows, gap, strict=True) if g > WITHIN[0][1]]
    if unresolved:
        lines += ["", "Unresolved, as intervals:", ""]
        lines += [f"- task {row['task']}: {row['certified_J']} to {row['exact_J']} J" for row in unresolved]
    return "\n".join(lines) + "\n"


def rows_in(path: Path) -> dict[int, dict[str, str]]:
    """The rows on disk, by task."""
    if not path.exists():
        return {}
    with path.open() as file:
        return {int(row["task"]): row for row in csv.DictReader(file)}


def main(out: Path, count: int) -> None:
    """Solve what is missing, and print the page."""
    path = out / "random_work.csv"
    for seed in range(count):
        # Read again each time: another process may be at work on the same file.
        if seed not in rows_in(path):
            row = row_of(seed, random_task(seed))
            with path.open("a", newline="") as file:
                writer = csv.DictWriter(file, row)
                if not file.tell():
                    writer.writeheader()
                writer.writerow(row)
    rows = rows_in(path)
    (out / "random_work.md").write_text(page([rows[seed] for seed in sorted(rows)]))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports"), int(sys.argv[2]) if len(sys.argv) > 2 else COUNT)
