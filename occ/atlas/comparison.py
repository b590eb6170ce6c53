"""A full comparison at one point: every controller solved and judged, with the bounds of its class."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from occ.atlas.variables import Variable
from occ.errors import Status
from occ.experiment.assessment import Rows, assessed
from occ.experiment.case import Alone, Case
from occ.experiment.child import Lost, Tell, unheard
from occ.experiment.pool import Engine
from occ.experiment.proven import with_bounds
from occ.experiment.results import Row
from occ.experiment.run import lost_row, solve_row
from occ.objectives import OBJECTIVES
from occ.referee import MEASURES

STATUSES = tuple(status.value for status in Status)
"""Texts of ``status`` are kept as their places in this list."""
UNITS = {
    "J": "J",
    "Nm": "N m",
    "N2m2s": "N^2 m^2 s",
    "rad_s": "rad/s",
    "m_s": "m/s",
    "W": "W",
    "m": "m",
    "percent": "%",
}
"""Endings of columns."""


@dataclass(frozen=True)
class Comparison:
    """One case and what is compared, plain data.

    Args:
        case: with its controllers.
        objectives: whose bounds and gaps are wanted.
    """

    case: Case
    objectives: tuple[str, ...]


def compare(item: Comparison, tell: Tell = unheard) -> list[Row]:
    """Solve and judge the controllers of a case; trajectories are not kept.

    Args:
        item: plain data.
        tell: takes what `alone` returns of each controller, as soon as it is there.

    Returns:
        One row for each controller: labels, measures, bounds and gaps.

    Raises:
        BoundViolation: a feasible row below a proven bound of its class.
    """
    task, players = item.case.posed()
    rows = []
    for name, player in players.items():
        row, _ = solve_row(item.case, task, name, player, with_motion=False)
        tell(row)
        rows.append(row)
    return _shown(item.objectives, with_bounds(item.case, _named(item, rows), item.objectives, task=task))


def alone(item: Alone) -> Row:
    """Solve and judge one controller of a case.

    Args:
        item: plain data.

    Returns:
        Its row without bounds, for `joined`.
    """
    task, players = item.case.posed()
    return solve_row(item.case, task, item.controller, players[item.controller], with_motion=False)[0]


def joined(items: Iterable[tuple[Comparison, Sequence[Row | Lost]]], engine: Engine) -> list[tuple[list[Row], bool]]:
    """Comparisons whose controllers were solved one by one.

    Args:
        items: each with the outcomes of `alone`, for each controller in the order of the file.
        engine: where bounds are looked for.

    Returns:
        For each item rows as of `compare`, ``crashed`` where there is no answer; and whether nothing of it is lost.

    Raises:
        BoundViolation: as in `compare`.
    """
    asked, whole = [], []
    for item, outcomes in items:
        named = zip(item.case.controllers, outcomes, strict=True)
        rows = [lost_row(name, row.reason) if isinstance(row, Lost) else row for name, row in named]
        asked.append(Rows(item.case, _named(item, rows), item.objectives, endless=False))
        whole.append(not any(isinstance(row, Lost) for row in outcomes))
    found = zip(asked, whole, assessed(asked, engine), strict=True)
    return [(_shown(one.objectives, said.rows), complete and said.complete) for one, complete, said in found]


def _named(item: Comparison, rows: Sequence[Row]) -> tuple[Row, ...]:
    return tuple({"case": item.case.name} | dict(row) for row in rows)


def _shown(objectives: Sequence[str], rows: Sequence[Row]) -> list[Row]:
    kept = ("controller", "status", "message", *numbers(objectives))
    return [{name: row.get(name) for name in kept} for row in rows]


def numbers(objectives: Sequence[str]) -> tuple[str, ...]:
    """Names of the numbers in each row."""
    return (*MEASURES, *(f"{name}_{part}" for name in objectives for part in ("bound", "gap_percent")))


def variables(objectives: Sequence[str]) -> dict[str, Variable]:
    """Unit and meaning of the same names."""
    return {name: Variable(_unit(name), _meaning(name)) for name in numbers(objectives)}


def _unit(name: str) -> str:
    for objective in OBJECTIVES.values():
        if name == f"{objective.name}_bound":
            return objective.unit
    return next((unit for ending, unit in UNITS.items() if name.endswith(f"_{ending}")), "1")


def _meaning(name: str) -> str:
    words = name
    for ending in UNITS:
        words = words.removesuffix(f"_{ending}")
    return words.replace("_", " ")


def status_place(row: dict[str, Any]) -> int:
    """Where a row's status is in the list."""
    return STATUSES.index(row["status"])
