"""How the gaps change with a swept key."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from occ.figures.style import controller_line, label, legend_beside, panels
from occ.objectives import Objective
from occ.report.contents import plain_name, plain_unit
from occ.report.stored import Stored

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

LINEAR_UP_TO = 0.1
"""[%] Gaps below this are drawn on a linear scale, larger ones on a logarithmic one."""
WIDE = 20.0
"""Swept values whose extremes have a larger ratio are drawn on a logarithmic axis."""
MOST_TICKS = 8


def numeric_keys(stored: Stored) -> list[str]:
    """The swept keys along which a curve can be drawn: numbers, at least three of them."""
    return [key for key in stored.swept if _numbers(stored, key).notna().all() and stored.rows[key].nunique() > 2]


def _numbers(stored: Stored, key: str) -> pd.Series[float]:
    return pd.to_numeric(stored.rows[key], errors="coerce")


def value_figure(stored: Stored, item: Objective, key: str) -> Figure | None:
    """What an objective comes to for every controller against a swept key.

    Args:
        stored: the results.
        item: the compared objective.
        key: dotted name of a key of `numeric_keys`.

    Returns:
        The figure, or None where no row has a value.
    """
    rows = stored.rows.assign(**{key: _numbers(stored, key)})
    rows = rows[rows["status"] == "ok"].dropna(subset=[item.column])
    if rows.empty:
        return None
    figure, (panel,) = panels(6.2, [3.4], f"{plain_name(item).capitalize()} over {key}")
    handles = _curves(panel, stored, rows, key, item.column)
    _key_axis(panel, rows[key])
    panel.set_ylabel(f"{plain_name(item)} [{plain_unit(item.unit)}]")
    legend_beside(panel, handles)
    return figure


def _key_axis(panel: Axes, values: pd.Series[float]) -> None:
    """The swept values along the axis; on a logarithmic one each of them has its tick."""
    panel.set_xlabel(f"{values.name} [as in the experiment file]")
    if values.min() > 0 and values.max() > WIDE * values.min():
        panel.set_xscale("log")
        ticks = sorted(values.unique())
        panel.set_xticks(ticks[:: -(-len(ticks) // MOST_TICKS)])
        panel.set_xticks([], minor=True)
        panel.xaxis.set_major_formatter("{x:g}")


def _curves(panel: Axes, stored: Stored, rows: pd.DataFrame, key: str, column: str) -> list[Line2D]:
    """A line for each controller and each combination of the other swept keys; one handle a controller."""
    others = [name for name in stored.swept if name != key]
    handles = []
    for index, name in enumerate(stored.controllers):
        chosen = rows[rows["controller"] == name]
        groups = [group for _, group in chosen.groupby(others)] if others else [chosen] if len(chosen) else []
        lines = [
            panel.plot(
                group[key], group[column], marker="o", markersize=3, label=label(name), **controller_line(index)
            )[0]
            for group in (group.sort_values(key) for group in groups)
        ]
        handles += lines[:1]
    return handles


def gap_figure(stored: Stored, item: Objective, key: str) -> Figure | None:
    """The gap of every controller against a swept key.

    Args:
        stored: the results.
        item: the compared objective.
        key: dotted name of a key of `numeric_keys`.

    Returns:
        The figure, or None where no row has a gap.
    """
    column = f"{item.name}_gap_percent"
    rows = stored.rows.assign(**{key: _numbers(stored, key)}).dropna(subset=[column])
    if rows.empty:
        return None
    figure, (panel,) = panels(6.2, [3.4], f"{plain_name(item).capitalize()} above its bound, over {key}")
    handles = _curves(panel, stored, rows, key, column)
    if rows[column].abs().max() > 50 * LINEAR_UP_TO:
        panel.set_yscale("symlog", linthresh=LINEAR_UP_TO)
        panel.yaxis.set_major_formatter("{x:g}")
    _key_axis(panel, rows[key])
    panel.set_ylabel("gap [%]")
    legend_beside(panel, handles)
    return figure
