"""Stored results of one experiment, read back: the only place that knows what lies where in their folder."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
import pandas as pd

from occ.errors import InputError, Status
from occ.experiment import naming
from occ.experiment.bounds import BOUND_COLUMNS
from occ.objectives import Objective, objective
from occ.referee import LABELS, MEASURES

Row: TypeAlias = dict[str, Any]


@dataclass(frozen=True)
class Motion:
    """One stored trajectory.

    Args:
        data: arrays by variable name; time (N,) [s], the others as their file says.
        attributes: of the file: ``point_body``, ``wheel_positions``, ...
    """

    data: dict[str, np.ndarray]
    attributes: dict[str, Any]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.data[name]


@dataclass(frozen=True)
class Stored:
    """The folder of one experiment.

    Args:
        folder: with ``results.csv`` and, unless it is a fresh clone, ``run.json`` and ``trajectories/``.
        rows: ``results.csv``.
        experiment: tables of the experiment file; empty where ``run.json`` is missing.
        runs: by case name, what ``run.json`` says of it; empty where it is missing.
    """

    folder: Path
    rows: pd.DataFrame
    experiment: dict[str, Any] = field(default_factory=dict)
    runs: dict[str, Any] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The experiment's title, or its folder's name."""
        return str(self.experiment.get("title") or self.folder.resolve().name)

    @property
    def question(self) -> str:
        """The experiment's question; empty where it is not stored."""
        return str(self.experiment.get("question") or "")

    @cached_property
    def cases(self) -> list[str]:
        """Names of the cases in the order of the table."""
        return list(dict.fromkeys(self.rows["case"]))

    @cached_property
    def controllers(self) -> list[str]:
        """Names of the controllers in the order of the table; the first one is the law in question."""
        return list(dict.fromkeys(self.rows["controller"]))

    @cached_property
    def objectives(self) -> list[Objective]:
        """What is compared."""
        suffix = "_bound_kind"
        return [objective(name.removesuffix(suffix)) for name in self.rows.columns if name.endswith(suffix)]

    @cached_property
    def swept(self) -> list[str]:
        """Dotted names of the swept keys."""
        bounds = {f"{item.name}_{column}" for item in self.objectives for column in BOUND_COLUMNS}
        return [name for name in self.rows.columns if name not in {*LABELS, *MEASURES, *bounds}]

    def records(self, case: str | None = None) -> list[Row]:
        """The rows of one case, or all of them, in the order of the table; a missing number is NaN."""
        rows = self.rows if case is None else self.rows[self.rows["case"] == case]
        return cast("list[Row]", rows.to_dict("records"))

    def slug(self, case: str) -> str:
        """The case's name in the names of files."""
        known = self.runs.get(case, {}).get("slug")
        return str(known or naming.slug(case))

    def motion(self, case: str, controller: str) -> Motion | None:
        """The stored trajectory of one row.

        Args:
            case: its name.
            controller: its name.

        Returns:
            The motion, or None where none is stored.

        Raises:
            InputError: the file is not a trajectory of a run.
        """
        entry = self.runs.get(case, {}).get("controllers", {}).get(controller) or {}
        place = entry.get("trajectory")
        if not place or not (self.folder / place).is_file():
            return None
        import h5py

        try:
            with h5py.File(self.folder / place, "r") as file:
                data = {name: np.asarray(variable) for name, variable in file.items()}
                attributes = {name: np.asarray(value) for name, value in file.attrs.items()}
        except OSError as error:
            raise InputError(
                f"{self.folder / place}: not a stored trajectory ({error}); occ run makes it again"
            ) from error
        return Motion(data, attributes)


def load(folder: Path) -> Stored:
    """Read the stored results of an experiment.

    Args:
        folder: of the experiment.

    Returns:
        Its rows and, where ``run.json`` is there, its tables and cases.

    Raises:
        InputError: no ``results.csv``, one without the columns that every result has, or a broken ``run.json``.
    """
    table = folder / "results.csv"
    if not table.is_file():
        raise InputError(f"{folder}: no results.csv there; make it with occ run")
    try:
        # Names such as "NA" or "007" are names: only numbers may be missing.
        rows = pd.read_csv(table, dtype=str, keep_default_na=False)
        with table.open(newline="", encoding="utf-8") as file:
            cut = next((n for n, line in enumerate(csv.reader(file)) if len(line) != len(rows.columns)), None)
        if cut is not None:
            raise ValueError(f"row {cut} is not as long as that of the columns' names; occ run makes it again")
        for name in rows.columns:
            if name in MEASURES or name.endswith(("_bound", "_percent")):
                rows[name] = rows[name].replace("", "nan").astype(float)
    except (ValueError, csv.Error) as error:  # pandas' own errors are among them
        raise InputError(f"{table}: not a table of results ({' '.join(str(error).split())})") from error
    missing = [name for name in (*LABELS, *MEASURES) if name not in rows.columns]
    if missing:
        raise InputError(f"{table}: not a table of results: it lacks {', '.join(missing)}")
    if rows.empty:
        raise InputError(f"{table}: no results in it, only the names of their columns")
    states = [status.value for status in Status]
    unknown = rows.loc[~rows["status"].isin(states), "status"]
    if not unknown.empty:
        raise InputError(f'{table}: status "{unknown.iloc[0]}" is none; should be one of {", ".join(states)}')
    run = folder / "run.json"
    if not run.is_file():
        return Stored(folder, rows)
    try:
        content = json.loads(run.read_text(encoding="utf-8"))
        return Stored(folder, rows, dict(content["experiment"]), dict(content["cases"]))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{run}: not the record of a run ({error!r})") from error
