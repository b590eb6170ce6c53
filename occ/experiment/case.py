"""One case of an experiment as plain data, which crosses process borders."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import occ
from occ.experiment.naming import compact, slug
from occ.experiment.schema import ExperimentFile
from occ.task import Player, Task

NUMERICS = ("casadi", "numpy", "scipy")
"""Libraries whose version is part of what a stored case depends on."""
NOT_IN_RESULTS = ("cli.py", "report", "figures", "export", "experiment/results.py", "experiment/bounds.py")
"""Parts of the package that no stored case depends on."""


@dataclass(frozen=True)
class Case:
    """The resolved tables of one case.

    Args:
        name: unique in its experiment, ``base`` where nothing is swept.
        sweep: value of each swept key, as in the file.
        tables: platform, point, motion, start, horizon, limits and controller with all defaults filled in.
    """

    name: str
    sweep: Mapping[str, Any]
    tables: Mapping[str, Any]

    @property
    def swept(self) -> dict[str, Any]:
        """Swept keys as columns of the results: numbers as numbers, everything else as text such as ``laps=1``."""
        return {key: value if isinstance(value, int | float) else compact(value) for key, value in self.sweep.items()}

    @property
    def slug(self) -> str:
        """The case's name as a folder's name."""
        return slug(self.name)

    @property
    def controllers(self) -> list[str]:
        """Names of the controllers in the order of the file."""
        return [table["name"] for table in self.tables["controller"]]

    @property
    def key(self) -> str:
        """sha256 of the tables and of the code that turns them into numbers."""
        content = {"tables": dict(self.tables), "code": code_fingerprint()}
        return hashlib.sha256(json.dumps(content, sort_keys=True, allow_nan=False).encode()).hexdigest()

    def task(self) -> Task:
        """The task of all controllers of this case."""
        return ExperimentFile.model_validate(self.tables).task()

    def players(self) -> dict[str, Player]:
        """The controllers by name, in the order of the file."""
        return ExperimentFile.model_validate(self.tables).players()


@cache
def code_fingerprint() -> str:
    """sha256 of the package's version, of its sources that affect results and of the libraries that compute them."""
    root = Path(occ.__file__).parent
    digest = hashlib.sha256(" ".join(f"{name} {version(name)}" for name in ("occ", *NUMERICS)).encode())
    for file in sorted(root.rglob("*.py")):
        place = file.relative_to(root).as_posix()
        if not any(place == part or place.startswith(part + "/") for part in NOT_IN_RESULTS):
            digest.update(f"\0{place}\0".encode() + file.read_bytes())
    return digest.hexdigest()
