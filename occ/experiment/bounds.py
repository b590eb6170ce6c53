"""Bounds of a row, each of which belongs to a class of motions.

A class is (keep, start, end); the limits are the case's own, so that rows of one case share them.  A lower bound on an
objective holds for every motion of its class, so a row may be measured against it only if its own class lies inside:

* keep and start must be the same: a tube, or another start, reaches motions that the path and the given start do not;
* a free end contains every end: (path, given, free) contains (path, given, law), but not the other way round;
* a row of start class ``own`` begins with a heading and a rate of its own without a charge: nothing bounds it.

Of all bounds that hold for a row the largest is the tightest.  A ``local`` bound is the smallest value among the rows
of a class that claim a local optimum of the objective (KKT only): a row below it is possible and shows a negative gap.
A feasible row below a ``certified`` bound of its class is an error.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from occ.errors import BoundViolation, Status
from occ.objectives import objective

NO_BOUND = "none"
RELATIVE_TOLERANCE = 1e-9
"""A value below a certified bound by less than this is a rounding error."""


@dataclass(frozen=True)
class MotionClass:
    """What a row is: keep, start and end as the referee reports them."""

    keep: str
    start: str
    end: str

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> MotionClass:
        """The class of a row."""
        return cls(row["keep"], row["start"], row["end"])

    def contains(self, other: MotionClass) -> bool:
        """Whether every motion of the other class is one of this class, from the same start."""
        if "own" in (self.start, other.start):
            return False
        return (self.keep, self.start) == (other.keep, other.start) and self.end in ("free", other.end)


@dataclass(frozen=True)
class Bound:
    """A lower bound.

    Args:
        value: in the objective's unit.
        kind: ``local`` or ``certified``.
        motions: the class for which it holds.
    """

    value: float
    kind: str
    motions: MotionClass


def local_bounds(rows: Iterable[Mapping[str, Any]], name: str) -> list[Bound]:
    """For each class the smallest value among its local optima.

    Args:
        rows: of one case, each with ``local_objective`` beside its columns.
        name: of the objective.

    Returns:
        One bound for each class that has a local optimum.
    """
    column = objective(name).column
    smallest: dict[MotionClass, float] = {}
    for row in rows:
        if row["status"] == Status.OK and row["local_objective"] == name:
            motions = MotionClass.of(row)
            smallest[motions] = min(row[column], smallest.get(motions, row[column]))
    return [Bound(value, "local", motions) for motions, value in smallest.items()]


def bound_columns(row: Mapping[str, Any], name: str, bounds: Iterable[Bound]) -> dict[str, Any]:
    """The tightest bound of a row's class and the gap to it, 100 (value - bound) / |bound|.

    Args:
        row: of the results.
        name: of the objective.
        bounds: of the row's case, of any class.

    Returns:
        ``X_bound``, ``X_bound_kind`` and ``X_gap_percent`` [%]; None where there is none.

    Raises:
        BoundViolation: a feasible row below a certified bound of its class.
    """
    value, kind, gap = None, NO_BOUND, None
    holding = [bound for bound in bounds if bound.motions.contains(MotionClass.of(row))]
    if row["status"] == Status.OK and holding:
        tightest = max(holding, key=lambda bound: bound.value)
        value, kind, reached = tightest.value, tightest.kind, row[objective(name).column]
        gap = 100.0 * (reached - value) / abs(value) if value else None
        _check_certified(row, name, reached, holding)
    return {f"{name}_bound": value, f"{name}_bound_kind": kind, f"{name}_gap_percent": gap}


def _check_certified(row: Mapping[str, Any], name: str, reached: float, holding: Iterable[Bound]) -> None:
    for bound in holding:
        if bound.kind == "certified" and reached < bound.value - RELATIVE_TOLERANCE * abs(bound.value):
            unit = objective(name).unit
            raise BoundViolation(
                f"case {row['case']}, controller {row['controller']}: {name} {reached!r} {unit} is below the certified "
                f"bound {bound.value!r} {unit} of its class; one of the two is wrong"
            )
