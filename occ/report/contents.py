"""Which tables a report has, and which columns each of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, cast

from occ.experiment.bounds import PROVEN
from occ.objectives import Objective
from occ.report.stored import Row, Stored
from occ.report.tables import MISSING, Column, Table, amount, gap, is_missing, peak, residual

MOST_CASES_APART = 6
"""Up to so many cases have a table each; more share one."""

ROUNDING = 1e-9
"""An energy below this share of the dissipation is rounding."""


@dataclass(frozen=True)
class Field:
    """A column and how its cells are made from a row of the results."""

    column: Column
    cell: Callable[[Row], str]


def text_field(heading: str, name: str | None = None) -> Field:
    """A column of words.

    Args:
        heading: plain words.
        name: of the results' column; the heading itself where it is the same.

    Returns:
        Column and cells; a dash where there is no word.
    """
    source = name or heading
    return Field(Column(heading), lambda row: MISSING if is_missing(row[source]) else str(row[source]))


def number_field(heading: str, unit: str, name: str, form: Callable[[Any], str]) -> Field:
    """A column of numbers.

    Args:
        heading: plain words.
        unit: plain text.
        name: of the results' column.
        form: from number to text.

    Returns:
        Column and cells.
    """
    return Field(Column(heading, unit, numeric=True), lambda row: form(row[name]))


def plain_unit(unit: str) -> str:
    """N^2 m^2 s as N² m² s."""
    return unit.replace("^2", "²").replace("^3", "³")


def plain_name(item: Objective) -> str:
    """The objective's name in words."""
    return item.name.replace("_", " ")


def gap_text(row: Row, item: Objective) -> str:
    """The gap and, in brackets, the kind of bound: ``0.5305 (local)``; in words where it is below its uncertainty."""
    kind = row[f"{item.name}_bound_kind"]
    value = "not resolved" if is_unresolved(row, item) else gap(row[f"{item.name}_gap_percent"])
    return value if is_missing(kind) else f"{value} ({kind})"


def is_unresolved(row: Row, item: Objective) -> bool:
    """Whether a gap to a proven bound is below its own uncertainty."""
    percent, uncertainty = row[f"{item.name}_gap_percent"], row.get(f"{item.name}_gap_uncertainty_percent")
    if is_missing(percent) or is_missing(uncertainty) or row[f"{item.name}_bound_kind"] not in PROVEN:
        return False
    return bool(abs(float(percent)) <= float(cast("float", uncertainty)))


def _gap_field(item: Objective) -> Field:
    return Field(Column(f"{plain_name(item)} above bound", "%", numeric=True), lambda row: gap_text(row, item))


def _ledger_text(row: Row, name: str) -> str:
    """An energy; what is only rounding beside the dissipation does not pretend to six digits."""
    form = residual if abs(row[name]) < ROUNDING * abs(row["dissipation_J"]) else amount
    return form(row[name])


CLASS = [text_field("start"), text_field("end")]
ENERGY = [
    number_field("work", "J", "work_J", amount),
    Field(Column("kinetic change", "J", numeric=True), lambda row: _ledger_text(row, "kinetic_change_J")),
    number_field("dissipation", "J", "dissipation_J", amount),
    number_field("positive work", "J", "positive_work_J", amount),
    number_field("electric", "J", "electric_J", amount),
    number_field("copper loss", "J", "copper_loss_J", amount),
]
WHEELS = [
    number_field("peak torque", "N m", "peak_torque_Nm", peak),
    number_field("peak speed", "rad/s", "peak_wheel_speed_rad_s", peak),
    number_field("peak power", "W", "peak_power_W", peak),
    number_field("limit excess", "", "limit_excess", residual),
]
ACCURACY = [
    number_field("velocity error", "m/s", "velocity_error_m_s", residual),
    number_field("position error", "m", "position_error_m", residual),
    number_field("defect", "", "defect", residual),
    number_field("replay error", "m", "replay_error_m", residual),
    number_field("energy residual", "J", "energy_residual_J", residual),
]
OFF_PROGRAM = [
    number_field("B off its program, at most", "m", "position_error_m", residual),
    number_field("at the end", "m", "position_error_end_m", residual),
]
MESSAGES = [text_field("status"), text_field("message")]


def answer_tables(stored: Stored) -> list[Table]:
    """Who needs how much: value, gap and kind of bound of each compared objective.

    Args:
        stored: the results.

    Returns:
        One table for each case, after one that sets all cases side by side; a single one where there are many cases.
    """
    fields = [text_field("status"), *CLASS]
    for item in stored.objectives:
        fields += [number_field(plain_name(item), plain_unit(item.unit), item.column, amount), _gap_field(item)]
    if not any(item.column == "peak_torque_Nm" for item in stored.objectives):
        fields.append(WHEELS[0])
    if any(row["keep"] == "none" for row in stored.records()):
        fields += OFF_PROGRAM
    if len(stored.cases) > MOST_CASES_APART:
        return [_table(stored.title, fields, stored.records(), with_case=True)]
    each = [_table(case, fields, stored.records(case), with_case=False) for case in stored.cases]
    if len(stored.cases) > 1 and len(stored.controllers) > 1:
        return [*(_side_by_side(stored, item) for item in stored.objectives), *each]
    return each


def _side_by_side(stored: Stored, item: Objective) -> Table:
    """One objective: a row for each controller, a column for each case, gaps in brackets."""
    cells: dict[str, dict[str, str]] = {name: {} for name in stored.controllers}
    for row in stored.records():
        cells[row["controller"]][row["case"]] = _value_and_gap(row, item)
    columns = [Column("controller"), *(Column(case, numeric=True) for case in stored.cases)]
    rows = tuple((name, *(found.get(case, MISSING) for case in stored.cases)) for name, found in cells.items())
    caption = f"All cases: {plain_name(item)} [{plain_unit(item.unit)}], and in brackets how far above its bound"
    return Table(caption, tuple(columns), rows)


def _value_and_gap(row: Row, item: Objective) -> str:
    if row["status"] != "ok":
        return str(row["status"])
    value = amount(row[item.column])
    if is_unresolved(row, item):
        return f"{value} (not resolved)"
    percent = row[f"{item.name}_gap_percent"]
    return value if is_missing(percent) else f"{value} ({gap(percent)} %)"


def detail_table(stored: Stored, caption: str, fields: Iterable[Field]) -> Table:
    """All rows with other columns.

    Args:
        stored: the results.
        caption: plain words.
        fields: the columns after case and controller.

    Returns:
        One table of all cases.
    """
    return _table(caption, fields, stored.records(), with_case=len(stored.cases) > 1)


def not_ok_table(stored: Stored) -> Table:
    """The rows that are not ok, with the reason of each.

    Args:
        stored: the results.

    Returns:
        A table that may be without rows.
    """
    rows = [row for row in stored.records() if row["status"] != "ok"]
    return _table("Rows that are not ok", MESSAGES, rows, with_case=len(stored.cases) > 1)


def notes_table(stored: Stored) -> Table:
    """The rows that are ok and yet have something to say.

    Args:
        stored: the results.

    Returns:
        A table that may be without rows.
    """
    rows = [row for row in stored.records() if row["status"] == "ok" and row["message"]]
    return _table("Notes", [text_field("note", "message")], rows, with_case=len(stored.cases) > 1)


def _table(caption: str, fields: Iterable[Field], rows: Iterable[Row], *, with_case: bool) -> Table:
    chosen = [*([text_field("case")] if with_case else []), text_field("controller"), *fields]
    cells = tuple(tuple(field.cell(row) for field in chosen) for row in rows)
    return Table(caption, tuple(field.column for field in chosen), cells)
