"""Every motion with every objective and keep: `reports/motions/`, and one table, `reports/motions.md` and `.csv`.

    python -m tests.benchmarks.motions [OUT] [WORKERS]

The cases are those of `experiments/motions/*.toml`, each with eight objectives, and are run as `occ run` runs them:
what is stored is not solved again.  The table is made from the results on disk alone.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from occ.experiment.load import Experiment, load_experiment
from occ.experiment.pool import Engine
from occ.experiment.results import Results
from occ.experiment.run import run
from occ.objectives import OBJECTIVES

FOLDER = Path(__file__).parents[2] / "experiments" / "motions"
MOTIONS = ("ellipse", "figure_eight", "spline", "rest_to_rest")
KEEPS = ("path", "tube", "ends")
AIMS = (
    "work",
    "positive_work",
    "absolute_work",
    "bus_work",
    "torque_squared",
    "electric",
    "electric_drawn",
    "peak_torque",
)
NO_LESS_THAN = {
    "bus_work": "work",
    "positive_work": "bus_work",
    "absolute_work": "positive_work",
    "electric_drawn": "electric",
}
"""On every motion the first is at least the second, which is the other's bound."""
LAW = "servo law"


def matrix(motions: tuple[str, ...] = MOTIONS, aims: tuple[str, ...] = AIMS) -> Experiment:
    """One experiment with a case for each motion and objective.

    Args:
        motions: names of files.
        aims: names of objectives.

    Returns:
        What `occ.experiment.run.run` takes.
    """
    cases, tables = [], {}
    for motion in motions:
        for aim in aims:
            sets = [f"controller.{keep}.objective={aim}" for keep in KEEPS]
            one = load_experiment(FOLDER / f"{motion}.toml", sets)
            swept = {"motion.kind": motion, "objective": aim}
            cases.append(replace(one.cases[0], name=f"{motion}, {aim}", sweep=swept))
            tables[cases[-1].name] = one.tables
    return Experiment(
        title="Every motion with every objective and keep",
        question="Which optima are found, how exactly, and where does the servo-constraint law stand?",
        objectives=aims,
        swept=("motion.kind", "objective"),
        cases=tuple(cases),
        tables=tables,
    )


@dataclass(frozen=True)
class Cell:
    """One motion, objective and keep: what is in `results.csv`, and in `run.json` where that has no place for it.

    Args:
        row: of the results.
        settings: keys of the controller.
        statistics: of the solver.
        seconds: [s] of solving, by the clock.
        law: value of the servo law; None where it has none.
    """

    row: dict[str, Any]
    settings: dict[str, Any]
    statistics: dict[str, Any]
    seconds: float
    law: float | None

    @property
    def aim(self) -> str:
        """Name of the objective."""
        return str(self.row["objective"])

    @property
    def key(self) -> tuple[str, str, str]:
        """Motion, objective, keep."""
        return str(self.row["motion.kind"]), self.aim, str(self.row["controller"])

    @property
    def value(self) -> float | None:
        """The referee's; None where there is no solution."""
        return self.row[OBJECTIVES[self.aim].column] if self.row["status"] == "ok" else None

    def measure(self, aim: str) -> float:
        """Another objective of the same motion."""
        return float(self.row[OBJECTIVES[aim].column])

    @property
    def error(self) -> float | None:
        """Between the nodes and on the doubled mesh, relative to max(1, size)."""
        found = [self.statistics.get(name) for name in ("error", "doubled_mesh")]
        return max((x for x in found if x is not None), default=None)

    @property
    def smoothing(self) -> float | None:
        """By how much the added copper loss raises the objective, about."""
        return self.statistics.get("copper_loss_share")

    @property
    def minima(self) -> int:
        """Distinct ones that the starts found."""
        return len(self.statistics.get("minima", []))


def cells(folder: Path) -> list[Cell]:
    """The cells of stored results, in the order of the table.

    Args:
        folder: with `results.csv` and `run.json`.

    Returns:
        One for each motion, objective and keep.
    """
    results = Results.load(folder)
    found = []
    for row in results.rows:
        if row["controller"] == LAW:
            law = row[OBJECTIVES[row["objective"]].column] if row["status"] == "ok" else None
            continue
        case = results.record["cases"][row["case"]]
        (settings,) = (table for table in case["tables"]["controller"] if table["name"] == row["controller"])
        record = case["controllers"][row["controller"]]
        found.append(Cell(row, settings, record["statistics"], record["solve_time_s"], law))
    return found


def columns(found: list[Cell]) -> Iterator[dict[str, Any]]:
    """The lines of the table.

    Args:
        found: all cells.

    Yields:
        Values by column; None where there is none.
    """
    values = {cell.key: cell.value for cell in found}
    for cell in found:
        motion, aim, keep = cell.key
        below = values.get((motion, NO_LESS_THAN.get(aim, ""), keep))
        value, smoothing = cell.value, cell.smoothing
        has_percent = value is not None and smoothing is not None
        yield {
            "motion": motion,
            "objective": aim,
            "keep": keep,
            "status": cell.row["status"],
            "value": value,
            "unit": OBJECTIVES[aim].unit,
            "error": cell.error,
            "copper_loss_factor": cell.statistics.get("copper_loss_factor"),
            "raised_by": smoothing,
            "raised_by_percent": 100 * smoothing / abs(value) if has_percent else None,
            "minima": cell.minima,
            "bound": below,
            "bound_kind": "local" if below is not None else "none",
            "law": cell.law,
            "law_gap_percent": law_gap(cell),
            "solve_s": cell.seconds,
            "message": cell.row["message"],
        }


def law_gap(cell: Cell) -> float | None:
    """[%] How much more the servo law costs, where both keep the path."""
    if cell.row["keep"] != "path" or cell.value is None or cell.law is None or not cell.value:
        return None
    return 100 * (cell.law / cell.value - 1)


def shown(value: Any, digits: int) -> str:
    """A number for people; a dash where there is none."""
    return "—" if value is None else f"{value:.{digits}g}"


def page(found: list[Cell]) -> str:
    """The table for people.

    Args:
        found: all cells.

    Returns:
        Markdown.
    """
    table = list(columns(found))
    solved = [line for line in table if line["status"] == "ok"]
    seconds = sum(line["solve_s"] or 0.0 for line in table)
    asked = {cell.key[2]: cell.settings for cell in found}
    tolerances = ", ".join(f"{table['tolerance']:g} ({keep})" for keep, table in asked.items())
    lines = [
        "# Every motion with every objective and keep",
        "",
        f"{len(solved)} of {len(table)} cells are ok ({len(MOTIONS)} motions, {len(AIMS)} objectives, "
        f"{len(KEEPS)} keeps; `motions.csv`, from `motions/results.csv` and `motions/run.json`; made again by "
        "`make matrix`).  The tasks are `experiments/motions/*.toml`.",
        "",
        f"* **value**: the referee's; a *local* optimum, the least of the minima found from {asked['path']['starts']} "
        f"starts.  The tube's radius is {asked['tube']['radius']:g} m.",
        f"* **error**: between the nodes and on a doubled mesh, relative to max(1, size); at most {tolerances} was "
        "asked for.",
        "* **raised**: non-smooth objectives have a little copper loss added (its factor beside it), which raises the "
        "value by about so much, as it follows from two such factors.",
        "* **bound**: the local optimum of an objective that is nowhere larger (work ≤ bus work ≤ positive work ≤ "
        "absolute work; electric ≤ electric drawn), same motion and keep.  Nothing is proven off the circle.",
        "* **law**: how much more the servo-constraint law costs, which keeps the path.  From rest to rest it may end "
        "in rotation, and is no rival of the optima that end at rest.",
        f"* **time**: of solving, by the clock, on a machine that other work shared; {seconds / 60:.0f} min in all.",
        "",
        "| motion | objective | keep | status | value | error | raised | factor | minima | bound | law | time |",
        "| :--- | :--- | :--- | :--- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for line in table:
        raised = "—" if line["raised_by"] is None else f"{line['raised_by']:.1g} ({line['raised_by_percent']:.1g} %)"
        value = "—" if line["value"] is None else f"{line['value']:.7g} {line['unit']}"
        law = "—" if line["law_gap_percent"] is None else f"{line['law_gap_percent']:+.3g} %"
        parts = [
            *(line[name] for name in ("motion", "objective", "keep", "status")),
            value,
            shown(line["error"], 1),
            raised,
            shown(line["copper_loss_factor"], 2),
            str(line["minima"]),
            shown(line["bound"], 7),
            law,
            f"{line['solve_s']:.1f} s" if line["solve_s"] is not None else "—",
        ]
        lines.append("| " + " | ".join(parts) + " |")
    failed = [line for line in table if line["status"] != "ok"]
    if failed:
        lines += ["", "Not solved:", ""]
        lines += [f"- {x['motion']}, {x['objective']}, {x['keep']}: {x['message']}" for x in failed]
    return "\n".join(lines) + "\n"


def write(out: Path) -> None:
    """`motions.csv` and `motions.md` from the results in `motions/`.

    Args:
        out: folder of the reports.
    """
    found = cells(out / "motions")
    table = list(columns(found))
    with (out / "motions.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    (out / "motions.md").write_text(page(found))


def main(out: Path, workers: int) -> None:
    """Solve what is missing, and write the table."""
    run(matrix(), out / "motions", Engine(workers=workers), tell)
    write(out)


def tell(what: str, rows: int, failed: int = 0, stored: bool = False) -> None:
    """A line for each case."""
    print(f"{what}: {rows - failed} of {rows} rows ok{' (stored)' if stored else ''}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports"), int(sys.argv[2]) if len(sys.argv) > 2 else 2)
