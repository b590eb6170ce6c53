"""The table of an experiment and the record of its run: rows with bounds, written and read back."""

from __future__ import annotations

import csv
import io
import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from occ.errors import InputError, Status
from occ.experiment.assessment import Rows, assessed
from occ.experiment.bounds import BOUND_COLUMNS
from occ.experiment.case import Case
from occ.experiment.load import Experiment
from occ.experiment.naming import slug
from occ.experiment.pool import Engine
from occ.experiment.store import write_text
from occ.referee import LABELS, MEASURES

if TYPE_CHECKING:
    import pandas as pd

TABLE = "results.csv"
RECORD = "run.json"
LIBRARIES = (
    *("occ", "casadi", "numpy", "scipy", "pandas", "xarray", "h5netcdf", "matplotlib"),
    *("cvxpy", "clarabel", "python-flint"),
)
"""Whose versions are recorded."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Results:
    """The rows of an experiment.

    Args:
        columns: names in the order of the table.
        rows: by column; None where there is no value.
        record: experiment, versions, cases with solver statistics and times: what ``run.json`` holds.
    """

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    record: dict[str, Any]

    @property
    def all_ok(self) -> bool:
        """Whether every row is ``ok``."""
        return all(row["status"] == Status.OK for row in self.rows)

    @property
    def table(self) -> pd.DataFrame:
        """The rows as a pandas table, one column for each name; a missing number is NaN."""
        import pandas as pd

        return pd.DataFrame(list(self.rows), columns=list(self.columns))

    def save(self, folder: Path) -> None:
        """Write ``results.csv`` and ``run.json``.

        Args:
            folder: of the experiment.

        Raises:
            InputError: the folder cannot be written.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_cell(row[name]) for name in self.columns] for row in self.rows)
        write_text(folder / TABLE, text.getvalue())
        write_text(folder / RECORD, json.dumps(self.record, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, folder: Path) -> Results:
        """Read back what `save` has written.

        Args:
            folder: of the experiment.

        Returns:
            The same results.

        Raises:
            InputError: no results there, or files that are not results.
        """
        try:
            with (folder / TABLE).open(encoding="utf-8", newline="") as file:
                columns, *cells = csv.reader(file, strict=True)
            record = json.loads((folder / RECORD).read_bytes())
            rows = [dict(zip(columns, map(_value, columns, line), strict=True)) for line in cells]
        except FileNotFoundError as error:
            raise InputError(
                f"{folder}: no results there ({Path(error.filename).name} is missing); occ run makes them"
            ) from error
        except OSError as error:
            raise InputError(f"{folder}: cannot be read ({error.strerror}); should be a folder of results") from error
        except (ValueError, csv.Error) as error:
            raise InputError(f"{folder}: not results of occ ({error}); occ run makes them again") from error
        missing = [name for name in (*LABELS, *MEASURES) if name not in columns]
        if missing:
            raise InputError(f"{folder / TABLE}: not results of occ (no column {missing[0]}); occ run makes them again")
        return cls(tuple(columns), tuple(rows), record)


def assemble(experiment: Experiment, outcomes: Sequence[Sequence[Row]], started: str, engine: Engine) -> Results:
    """The table of all cases, with the tightest bound of each row's class.

    Args:
        experiment: whose cases were solved.
        outcomes: for each case the rows that `occ.experiment.run.solve_case` makes.
        started: date and time, for the record only.
        engine: where bounds are looked for.

    Returns:
        Rows in the order of cases and controllers.

    Raises:
        BoundViolation: a feasible row below a certified bound of its class.
        InputError: there is no such cluster.
    """
    certify = bool(experiment.tables.get("compare", {}).get("certified", False))
    named = list(zip(experiment.cases, outcomes, strict=True))
    own = [tuple({"case": case.name} | case.swept | dict(row) for row in rows) for case, rows in named]
    asked = [Rows(case, rows, experiment.objectives, certify) for case, rows in zip(experiment.cases, own, strict=True)]
    found = assessed(asked, engine)
    bound_names = [f"{x}_{part}" for x in experiment.objectives for part in BOUND_COLUMNS]
    columns = (*LABELS, *experiment.swept, *MEASURES, *bound_names)
    record = {
        "experiment": experiment.tables,
        "started": started,
        "versions": {"python": platform.python_version()} | {name: version(name) for name in LIBRARIES},
        "cases": {
            case.name: _case_record(case, rows, one.for_ever) for (case, rows), one in zip(named, found, strict=True)
        },
    }
    return Results(columns, tuple({name: row[name] for name in columns} for one in found for row in one.rows), record)


def _case_record(case: Case, outcome: Sequence[Row], for_ever: dict[str, Any]) -> dict[str, Any]:
    return {
        "slug": slug(case.name),
        "key": case.key,
        "swept": case.swept,
        "tables": dict(case.tables),
        "for_ever": plain(for_ever),
        **({"own_code": case.own_code} if case.own_code else {}),
        "controllers": {
            row["controller"]: {name: row[name] for name in ("statistics", "solve_time_s", "judge_time_s")}
            | {"trajectory": row["trajectory"]["path"] if row["trajectory"] else None}
            for row in outcome
        },
    }


def plain(value: Any) -> Any:
    """The value as JSON can hold it: NumPy's numbers and arrays as Python's, None for what is not finite.

    Args:
        value: of any kind; what is unknown becomes its text.

    Returns:
        Dictionaries, lists, text, numbers, None.
    """
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def _cell(value: Any) -> str:
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


def _value(column: str, cell: str) -> Any:
    """The value of a cell: labels and kinds are text, everything else is a number where it can be one."""
    if column in LABELS or column.endswith("_bound_kind"):
        return cell
    if not cell:
        return None
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return cell
