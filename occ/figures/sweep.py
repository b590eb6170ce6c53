"""How the gaps change with a swept key."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from occ.experiment.units import unit_of
from occ.figures.style import GREY, controller_line, label, legend_beside, panels
from occ.objectives import Objective
from occ.report.contents import plain_name, plain_unit
from occ.report.stored import Stored

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

LINEAR_UP_TO = 0.1
"""[%] Gaps below this are drawn on a linear scale, larger ones on a logarithmic one."""
WIDE = 10.0
"""Swept values, or gaps, whose extremes have a larger ratio are drawn on a logarithmic axis."""
MOST_TICKS = 8
MARKERS = "os^Dv<>P"
"""One for each combination of the other swept keys; with more of them all have the first."""
WIDE_MARGIN = 0.95
"""[in] Room for labels of ticks such as 228.3304."""
CROWDED = (24.0, 11.0)
"""[pt] Across and up; a label needs so much."""
FAR = 3.0
"""Rows beyond this many times the largest value of a front are not drawn beside it."""


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
    figure, panel = _over_key(stored, rows, key, item.column, f"{plain_name(item).capitalize()} over {key}")
    panel.set_ylabel(f"{plain_name(item)} [{plain_unit(item.unit)}]")
    return figure


def _over_key(stored: Stored, rows: pd.DataFrame, key: str, column: str, title: str) -> tuple[Figure, Axes]:
    """A figure with the curves of a column over a key."""
    figure, (panel,) = panels(6.2, [3.4], title, WIDE_MARGIN)
    # Values that hardly differ have long labels of ticks.
    panel.yaxis.set_label_coords(-(WIDE_MARGIN - 0.25) / 6.2, 0.5)
    legend_beside(panel, _curves(panel, stored, rows, key, column))
    _key_axis(panel, stored, rows[key])
    return figure, panel


def _key_axis(panel: Axes, stored: Stored, values: pd.Series[float]) -> None:
    """The swept values along the axis; on a logarithmic one each of them has its tick."""
    unit = unit_of(str(values.name), stored.experiment)
    panel.set_xlabel(f"{values.name} [{plain_unit(unit)}]" if unit != "1" else str(values.name))
    if values.min() > 0 and values.max() > WIDE * values.min():
        panel.set_xscale("log")
        ticks = sorted(values.unique())
        panel.set_xticks(ticks[:: -(-len(ticks) // MOST_TICKS)])
        panel.set_xticks([], minor=True)
        panel.xaxis.set_major_formatter("{x:g}")


def _curves(panel: Axes, stored: Stored, rows: pd.DataFrame, key: str, column: str) -> list[Line2D]:
    """A line for each controller and each combination of the other swept keys.

    Returns:
        One handle a controller, and one a combination, which has a marker of its own.
    """
    from matplotlib.lines import Line2D

    others = [name for name in stored.swept if name != key]
    texts = (",".join(f"{k}={value}" for k, value in zip(others, row, strict=True)) for row in rows[others].to_numpy())
    combined = pd.Series(list(texts), index=rows.index, dtype=str)
    names = list(dict.fromkeys(combined)) if others else []
    told = 1 < len(names) <= len(MARKERS)
    markers = dict(zip(names, MARKERS, strict=False)) if told else {}
    handles = []
    for index, name in enumerate(stored.controllers):
        chosen = rows[rows["controller"] == name]
        groups = chosen.groupby(combined[chosen.index]) if others else [("", chosen)] if len(chosen) else []
        look = controller_line(index) | {"label": label(name), "markersize": 3 + told}
        lines = [
            panel.plot(*group.sort_values(key)[[key, column]].to_numpy().T, marker=markers.get(str(which), "o"), **look)
            for which, group in groups
        ]
        handles += [line for (line,) in lines[:1]]
    if not told:
        return handles
    return handles + [
        Line2D([], [], linestyle="none", marker=marker, color=GREY, label=label(name))
        for name, marker in markers.items()
    ]


def gap_figure(stored: Stored, item: Objective, key: str) -> Figure | None:
    """The gap of every controller against a swept key.

    Args:
        stored: the results.
        item: the compared objective.
        key: dotted name of a key of `numeric_keys`.

    Returns:
        The figure, or None where no row has a gap.
    """
    from matplotlib.ticker import LogLocator, SymmetricalLogLocator

    column = f"{item.name}_gap_percent"
    rows = stored.rows.assign(**{key: _numbers(stored, key)}).dropna(subset=[column])
    if rows.empty:
        return None
    title = f"{plain_name(item).capitalize()} above its bound, over {key}"
    figure, panel = _over_key(stored, rows, key, column, title)
    if rows[column].abs().max() > 50 * LINEAR_UP_TO:
        panel.set_yscale("symlog", linthresh=LINEAR_UP_TO)
        panel.yaxis.set_major_locator(SymmetricalLogLocator(base=10, linthresh=LINEAR_UP_TO, subs=(1.0, 2.0, 5.0)))
        panel.yaxis.set_major_formatter("{x:g}")
        if rows[column].min() > -0.2 * LINEAR_UP_TO:
            panel.set_ylim(bottom=-0.2 * LINEAR_UP_TO)
    elif 0 < WIDE * rows[column].min() < rows[column].max():
        # A power law, such as the approach to an infimum, is a straight line.
        panel.set_yscale("log", subs=[])
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.yaxis.set_major_formatter(lambda x, _: f"{x:.0e}".replace("e-0", "e-").replace("e+0", "e"))
    panel.set_ylabel("gap [%]")
    return figure


def weight_keys(stored: Stored) -> list[str]:
    """The swept keys that are a weight of one controller's sum: along them it goes from one objective to another."""
    return [key for key in numeric_keys(stored) if ".weights." in key]


def front_figure(stored: Stored, pair: tuple[Objective, Objective], key: str) -> Figure | None:
    """One objective against another: the Pareto front of a swept weight, and where the other controllers stand.

    Rows whose second objective is more than `FAR` times that of the front are named at the edge and not drawn: an
    optimum whose torques are not bounded would leave the front a dot.

    Args:
        stored: the results.
        pair: the objectives along the axes.
        key: dotted name of a key of `weight_keys`.

    Returns:
        The figure, or None where fewer than two points of the front have both values.
    """
    x, y = (item.column for item in pair)
    rows = stored.rows.assign(**{key: _numbers(stored, key)})
    rows = rows[rows["status"] == "ok"].dropna(subset=[x, y])
    swept = key.split(".")[1]
    front = rows[rows["controller"] == swept].sort_values(key)
    if len(front) < 2:
        return None
    others = rows[rows["controller"] != swept].drop_duplicates("controller")
    shown = others[others[y] <= FAR * front[y].max()]
    names = [plain_name(item) for item in pair]
    figure, (panel,) = panels(6.2, [3.8], f"{names[0].capitalize()} against {names[1]}")
    handles = []
    for index, name in enumerate(stored.controllers):
        chosen = front if name == swept else shown[shown["controller"] == name]
        if chosen.empty:
            continue
        look = controller_line(index) | ({} if name == swept else {"linestyle": "none"})
        size = 3.5 if name == swept else 8.0
        handles += panel.plot(chosen[x], chosen[y], marker="o", markersize=size, label=label(name), **look)
    _weights(panel, front[key].to_numpy(), front[[x, y]].to_numpy())
    left_out = others[others[y] > FAR * front[y].max()]
    for row, (name, at_x, at_y) in enumerate(zip(left_out["controller"], left_out[x], left_out[y], strict=True)):
        text = f"beyond the top: {name}, {names[0]} {at_x:.6g}, {names[1]} {at_y:.3g}"
        panel.text(0.98, 0.95 - 0.07 * row, text, transform=panel.transAxes, ha="right", fontsize=7.5)
    panel.set_xlabel(f"{names[0]} [{plain_unit(pair[0].unit)}]; numbers at the front: {key.split('.', 2)[2]}")
    panel.set_ylabel(f"{names[1]} [{plain_unit(pair[1].unit)}]")
    legend_beside(panel, handles)
    return figure


def _weights(panel: Axes, weights: np.ndarray, places: np.ndarray) -> None:
    """The weight beside each point of a front; where points crowd, every other one on the left."""
    panel.autoscale_view()
    pixels = panel.transData.transform(places) * 72 / panel.figure.dpi
    left = False
    for k, weight in enumerate(weights):
        left = k > 0 and not left and bool(np.all(np.abs(pixels[k] - pixels[k - 1]) < CROWDED))
        panel.annotate(
            f"{weight:g}", places[k], (-5, -4) if left else (4, 4), textcoords="offset points", fontsize=7.5,
            ha="right" if left else "left",
        )  # fmt: skip
