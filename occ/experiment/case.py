"""One case of an experiment as plain data, which crosses process borders."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import occ
from occ.experiment.naming import compact, slug
from occ.experiment.own_code import OwnClass
from occ.experiment.schema import ExperimentFile, experiment_model
from occ.task import Player, Task

NUMERICS = ("casadi", "numpy", "scipy")
"""Libraries whose version is part of what a stored case depends on."""
SOURCES = ("*.py", "*.c")
NOT_IN_RESULTS = (
    "cli.py",
    "commands.py",
    "progress.py",
    "report",
    "figures",
    "export",
    "experiment/results.py",
    "experiment/bounds.py",
    "experiment/units.py",
)
"""Parts of the package that no stored case depends on."""


@dataclass(frozen=True)
class Case:
    """The resolved tables of one case.

    Args:
        name: unique in its experiment, ``base`` where nothing is swept.
        sweep: value of each swept key, as in the file.
        tables: platform, point, motion, start, horizon, limits and controller with all defaults filled in.
        own_classes: of the user's own files, which may be loaded, here and in worker processes.
    """

    name: str
    sweep: Mapping[str, Any]
    tables: Mapping[str, Any]
    own_classes: tuple[OwnClass, ...] = ()

    @property
    def swept(self) -> dict[str, Any]:
        """Swept keys as columns of the results: numbers as numbers, everything else as text such as ``laps=1``."""
        return {key: value if isinstance(value, int | float) else compact(value) for key, value in self.sweep.items()}

    @property
    def slug(self) -> str:
        """The case's name in the names of files."""
        return slug(self.name)

    @property
    def controllers(self) -> list[str]:
        """Names of the controllers in the order of the file."""
        return [table["name"] for table in self.tables["controller"]]

    @property
    def apart(self) -> list[Alone]:
        """Each controller alone, in the order of the file; nothing where there is but one."""
        return [Alone(self, name) for name in self.controllers] if len(self.controllers) > 1 else []

    @property
    def key(self) -> str:
        """sha256 of the tables and of the code that turns them into numbers, the user's own files included."""
        content = {"tables": dict(self.tables), "code": code_fingerprint(), "own_code": self.own_code}
        return hashlib.sha256(json.dumps(content, sort_keys=True, allow_nan=False).encode()).hexdigest()

    @property
    def own_code(self) -> dict[str, str]:
        """sha256 of the user's own file behind each kind that names one."""
        return {item.kind: item.sha256 for item in self.own_classes}

    def task(self) -> Task:
        """The task of all controllers of this case."""
        return self._file().task()

    def players(self) -> dict[str, Player]:
        """The controllers by name, in the order of the file.

        Raises:
            InputError: a file of the user's own is not the one any more that was checked.
        """
        return self._file().players()

    def posed(self) -> tuple[Task, dict[str, Player]]:
        """`task` and `players`, for the price of one look at the tables."""
        file = self._file()
        return file.task(), file.players()

    def _file(self) -> ExperimentFile:
        return experiment_model(tuple(item.table() for item in self.own_classes)).model_validate(self.tables)


class Alone(NamedTuple):
    """One controller of a case, without the others.

    Args:
        case: plain data.
        controller: its name.
    """

    case: Case
    controller: str


@cache
def code_fingerprint() -> str:
    """sha256 of the package's version, of its sources that affect results and of the libraries that compute them."""
    root = Path(occ.__file__).parent
    digest = hashlib.sha256(" ".join(f"{name} {version(name)}" for name in ("occ", *NUMERICS)).encode())
    for place in result_sources(root):
        digest.update(f"\0{place}\0".encode() + (root / place).read_bytes())
    return digest.hexdigest()


def result_sources(root: Path) -> list[str]:
    """Places below the package's folder of the sources that affect results, in Python and in C."""
    places = sorted(file.relative_to(root).as_posix() for kind in SOURCES for file in root.rglob(kind))
    return [
        place for place in places if not any(place == part or place.startswith(part + "/") for part in NOT_IN_RESULTS)
    ]
