"""Bounds of a row, each of which belongs to a class of motions.

A class is (keep, start, end); the limits are the case's own, so that rows of one case share them.  A lower bound on an
objective holds for every motion of its class, so a row may be measured against it only if its own class lies inside:

* start must be the same, and keep as well: a tube, or another start, reaches motions that the path and the given start
  do not; but a tube contains every narrower one and the path, and ends contain the path;
* a free end contains every end: (path, given, free) contains (path, given, law), but not the other way round;
* a row of start class ``own`` begins with a heading and a rate of its own without a charge: nothing bounds it.

Of all proven bounds that hold for a row the largest is the tightest; where several are as tight, the strongest word
counts: ``certified`` (a proof in ball arithmetic), then ``exact`` (the least value by a formula).  A ``local`` bound is
the smallest value among the rows of a class that claim a local optimum of the objective (KKT only): a row below it is
possible and shows a negative gap, and it counts only where nothing is proven.  A feasible row below a proven bound of
its class is an error.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from occ.errors import BoundViolation, Status
from occ.objectives import objective

NO_BOUND = "none"
PROVEN = ("certified", "exact")
"""Kinds that no feasible row of their class may be below, the strongest word first."""
BOUND_COLUMNS = ("bound", "bound_kind", "gap_percent", "gap_uncertainty_percent")
"""Columns of each compared objective, after its name."""
AS_TIGHT = 1e-6
"""Relative difference below which two proven bounds are called as tight as each other."""
RELATIVE_TOLERANCE = 1e-9
"""A value below a proven bound by less than this is a rounding error."""
SIGNED = ("work", "electric")
"""Objectives in which what flows back is counted against what flows out."""
SLOWEST = 0.1
"""[m/s] Speed of B to which its velocity error is related; a slower program makes the estimate too small only where the
error itself is far below what the referee lets pass."""


@dataclass(frozen=True)
class MotionClass:
    """What a row is: keep, start, end and, of a tube, its radius [m] as the referee reports them."""

    keep: str
    start: str
    end: str
    radius: float = 0.0

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> MotionClass:
        """The class of a row."""
        return cls(row["keep"], row["start"], row["end"], row.get("tube_radius_m") or 0.0)

    def contains(self, other: MotionClass) -> bool:
        """Whether every motion of the other class is one of this class, from the same start."""
        if "own" in (self.start, other.start):
            return False
        return self.start == other.start and self.end in ("free", other.end) and self._keeps_less(other)

    def _keeps_less(self, other: MotionClass) -> bool:
        # A tube's free end is anywhere inside it, so that ends contain no tube.
        if self.keep == other.keep:
            return self.radius >= other.radius
        return other.keep == "path"


@dataclass(frozen=True)
class Bound:
    """A lower bound.

    Args:
        value: in the objective's unit.
        kind: ``local``, ``exact`` or ``certified``.
        motions: the class for which it holds.
        uncertainty: by how much a value below it may be an error of rounding, or of what the referee lets pass.
        open: by how much the least value may be above it, as far as it is known; the gap is not resolved below this.
    """

    value: float
    kind: str
    motions: MotionClass
    uncertainty: float = 0.0
    open: float = 0.0


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
        ``X_bound``, ``X_bound_kind``, ``X_gap_percent`` [%] and ``X_gap_uncertainty_percent`` [%]; None where there is
        none.

    Raises:
        BoundViolation: a feasible row below a proven bound of its class.
    """
    columns: dict[str, Any] = dict.fromkeys((f"{name}_{part}" for part in BOUND_COLUMNS), None)
    columns[f"{name}_bound_kind"] = NO_BOUND
    holding = [bound for bound in bounds if bound.motions.contains(MotionClass.of(row))]
    if row["status"] != Status.OK or not holding:
        return columns
    reached, error = row[objective(name).column], _value_error(row, name)
    _check_proven(row, name, error, holding)
    tightest = _tightest(holding)
    size = abs(tightest.value)
    gap = 100.0 * (reached - tightest.value) / size if size else None
    uncertainty = 100.0 * (error + tightest.uncertainty + tightest.open) / size if size else None
    values = (tightest.value, tightest.kind, gap, uncertainty)
    return columns | {f"{name}_{part}": value for part, value in zip(BOUND_COLUMNS, values, strict=True)}


def _tightest(holding: Iterable[Bound]) -> Bound:
    proven = [bound for bound in holding if bound.kind in PROVEN]
    if not proven:
        return max(holding, key=lambda bound: bound.value)
    largest = max(bound.value for bound in proven)
    close = [bound for bound in proven if bound.value >= largest - AS_TIGHT * abs(largest)]
    return min(close, key=lambda bound: PROVEN.index(bound.kind))


def _value_error(row: Mapping[str, Any], name: str) -> float:
    """How uncertain the referee's value is: its ledger, and B's velocity error, which changes the friction's share."""
    reached = abs(row[objective(name).column])
    if name in SIGNED:
        # A difference of large works is as uncertain as they are.
        reached = max(reached, row.get("absolute_work_J") or 0.0)
    ledger = abs(row.get("energy_residual_J") or 0.0) if name == "work" else 0.0
    # Twice the relative error of the velocity: friction is quadratic in it.
    velocity = 2.0 * (row.get("velocity_error_m_s") or 0.0) / SLOWEST
    return ledger + (RELATIVE_TOLERANCE + velocity) * reached


def _check_proven(row: Mapping[str, Any], name: str, error: float, holding: Iterable[Bound]) -> None:
    reached = row[objective(name).column]
    for bound in holding:
        if bound.kind in PROVEN and reached < bound.value - bound.uncertainty - error:
            unit = objective(name).unit
            raise BoundViolation(
                f"case {row['case']}, controller {row['controller']}: {name} {reached!r} {unit} is below the "
                f"{bound.kind} bound {bound.value!r} {unit} of its class; one of the two is wrong"
            )
