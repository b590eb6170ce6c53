"""Maps of an atlas: where the law is near the optimum (blue) and where it is not (red)."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.atlas.dataset import read_atlas
from occ.figures.style import blank, legend_beside, place, style, write
from occ.figures.style import label as legend_label

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CLASSES = (0.2, 1.0, 3.0, 10.0, 30.0, 100.0)
"""[%] Borders between the colours."""
SHADES = ("#4575b4", "#91bfdb", "#e0f3f8", "#fee090", "#fc8d59", "#d73027", "#7a0177")
"""ColorBrewer's RdYlBu, which the colour-blind can read, and one more for what is off the scale."""
NO_VALUE = "#bdbdbd"
SMALLEST_REGION = 0.04
"""Part of a map below which a region has no name in it."""
VERBS = {"steady": "steady", "rotational": "rotates", "unstable": "unstable", "critical": "critical"}
MOST_SLICES = 6
"""Maps of one quantity at most; values of further keys are chosen evenly."""
PAPER = {"motion.radius": 0.7, "motion.rate": -0.4, "point.x": 0.4, "point.y": 0.05, "platform.friction_scale": 1.0}


@dataclass(frozen=True)
class Map:
    """One map.

    Args:
        name: of its file, without the folder.
        caption: a plain sentence.
        values: over two keys, or over one.
        data: everything else at the same points.
    """

    name: str
    caption: str
    values: xr.DataArray
    data: xr.Dataset


def plan_maps(data: xr.Dataset) -> list[Map]:
    """Which maps belong to an atlas.

    Args:
        data: the atlas.

    Returns:
        One for each gap, and for each choice of values of the keys beyond the first two that are numbers.
    """
    keys = [str(name) for name in data.dims if name != "controller"]
    axes = [key for key in keys if data[key].dtype.kind == "f" and data.sizes[key] > 1][:2]
    if not axes:
        return []
    others = [key for key in keys if key not in axes]
    planned = []
    for name, caption, values in _gaps(data):
        for chosen in _slices(data, others):
            where = ", ".join(f"{key} = {data[key].values[i]}" for key, i in chosen.items())
            slug = "".join(f"-{key}={data[key].values[i]}" for key, i in chosen.items())
            planned.append(
                Map(
                    f"{name}{slug}.svg",
                    caption + (f", {where}" if where else ""),
                    values.isel(chosen).transpose(*reversed(axes)),
                    data.isel(chosen).transpose(*reversed(axes), ...),
                )
            )
    return planned


def _gaps(data: xr.Dataset) -> Iterator[tuple[str, str, xr.DataArray]]:
    yield "long-run", "Long run: mean power of the law above the least mean power", data["long_run_gap_percent"]
    if "work_gap_percent" in data and "controller" not in data.dims:
        yield "work", "Finite horizon: work of the law above the least work", data["work_gap_percent"]
    if "controller" not in data.dims:
        return
    law = data["controller"].values[0]
    for name in data.data_vars:
        if str(name).endswith("_gap_percent") and "controller" in data[name].dims:
            objective = str(name).removesuffix("_gap_percent").replace("_", " ")
            yield (
                objective.replace(" ", "-"),
                f"Full comparison: {objective} of {law} above its bound",
                data[name].isel(controller=0),
            )


def _slices(data: xr.Dataset, keys: list[str]) -> Iterator[dict[str, int]]:
    """Places of the values of further keys."""
    each = max(1, int(MOST_SLICES ** (1 / max(len(keys), 1))))
    choices = [np.unique(np.linspace(0, data.sizes[key] - 1, each).round().astype(int)) for key in keys]
    for places in itertools.product(*choices):
        yield {key: int(place) for key, place in zip(keys, places, strict=True)}


def write_maps(folder: Path) -> list[tuple[str, str]]:
    """Draw all maps of a stored atlas.

    Args:
        folder: of the experiment; the files go to ``figures/`` in it.

    Returns:
        Path from the folder, and caption, of each.
    """
    drawn = []
    with style():
        for item in plan_maps(read_atlas(folder)):
            write(figure_of(item), folder / "figures" / item.name)
            drawn.append((f"figures/{item.name}", f"{item.caption}."))
    return drawn


def figure_of(item: Map) -> Figure:
    """One map: coloured classes of the gap over two keys, or a curve over one.

    Args:
        item: what to draw.

    Returns:
        The figure.
    """
    figure = blank(8.9, 5.1, item.caption, 0.75)
    panel = place(figure, (0.75, 0.6, 5.2, 3.9))
    if item.values.ndim == 1:
        handles = _curve(panel, item)
    else:
        handles = _map(panel, item)
    panel.set_xlabel(_axis(item.values, -1))
    legend_beside(panel, handles)
    return figure


def _axis(values: xr.DataArray, axis: int) -> str:
    key = values.dims[axis]
    unit = values[key].attrs.get("units", "1")
    return f"{key} [{unit}]" if unit != "1" else str(key)


def _curve(panel: Axes, item: Map) -> list[Artist]:
    (key,) = item.values.dims
    (line,) = panel.plot(item.values[key], item.values, color="black", marker="o", markersize=3, label="gap")
    if float(item.values.max()) > 5.0:
        panel.set_yscale("symlog", linthresh=0.1)
        panel.yaxis.set_major_formatter("{x:g}")
    panel.set_ylabel("gap [%]")
    return [line]


def _map(panel: Axes, item: Map) -> list[Artist]:
    from matplotlib.patches import Patch

    y, x = (item.values[key].values for key in item.values.dims)
    gaps = np.ma.masked_invalid(item.values.values)
    panel.set_facecolor(NO_VALUE)
    panel.grid(False)
    # A gap of zero, or below it by rounding, is in the first class.
    shown = np.ma.maximum(gaps, 1e-12)
    largest = max(float(shown.max()) * 2, 1e3) if shown.count() else 1e3
    levels = [0.0, *CLASSES, largest]
    panel.contourf(x, y, shown, levels=levels, colors=SHADES)
    panel.set_ylabel(_axis(item.values, 0))
    handles: list[Artist] = [
        Patch(color=shade, label=text)
        for shade, text, low, high in zip(SHADES, _class_names(), [0.0, *CLASSES], levels[1:], strict=True)
        if np.any((gaps > low) & (gaps <= high)) or (low == 0.0 and np.any(gaps <= CLASSES[0]))
    ]
    if np.ma.is_masked(gaps):
        handles.append(Patch(color=NO_VALUE, label="no value (law unstable or failed)"))
    _name_regions(panel, item, x, y)
    return [*handles, *_borders(panel, item, x, y), *_marks(panel, item, x, y)]


def _name_regions(panel: Axes, item: Map, x: np.ndarray, y: np.ndarray) -> None:
    """Say in each large region what becomes of the law there, at the place that is furthest from its border."""
    from matplotlib.patheffects import withStroke
    from scipy.ndimage import distance_transform_edt, label

    regimes = item.data["law_regime"].values
    for regime in np.unique(regimes):
        regions, count = label(regimes == regime)
        for number in range(1, count + 1):
            mask = regions == number
            if mask.mean() < SMALLEST_REGION:
                continue
            depth = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
            i, j = np.unravel_index(np.argmax(depth), depth.shape)
            text = panel.text(x[j], y[i], f"law {VERBS[str(regime)]}", ha="center", va="center", fontsize=9.5)
            text.set_path_effects([withStroke(linewidth=3, foreground="white")])


def _class_names() -> list[str]:
    steps = [f"{low:g} to {high:g} %" for low, high in itertools.pairwise(CLASSES)]
    return [f"gap up to {CLASSES[0]:g} %", *steps, f"over {CLASSES[-1]:g} %"]


def _borders(panel: Axes, item: Map, x: np.ndarray, y: np.ndarray) -> Iterator[Artist]:
    """Lines where the regimes change, and of speed and torque."""
    from matplotlib.lines import Line2D

    data = item.data
    options = json.loads(data.attrs["experiment"]).get("atlas", {})
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = data["radius_ratio"] * data["critical_radius_m"]
        to_optimum = (radius / data["optimal_switch_radius_m"]).values
    fields: list[tuple[np.ndarray, float, str, str, tuple[float, ...] | None]] = [
        (data["radius_ratio"].values, 1.0, "border: law steady / law rotates", "black", None),
        (to_optimum, 1.0, "border: optimum steady / optimum rotates", "black", (4, 2)),
    ]
    for value in options.get("speed_lines", [0.8]):
        fields.append((data["platform_speed_m_s"].values, value, f"speed of B {value:g} m/s", "#5e3c99", (1, 1)))
    for value in options.get("torque_lines", [2.1]):
        fields.append(
            (data["law_torque_Nm"].values, value, f"steady torque {value:g} N m", "#5e3c99", (6, 1.5, 1, 1.5))
        )
    for values, level, text, colour, dashes in fields:
        whole = np.ma.masked_invalid(values)
        if whole.count() and whole.min() < level < whole.max():
            style_of: Any = "solid" if dashes is None else (0, dashes)
            panel.contour(x, y, whole, levels=[level], colors=colour, linewidths=1.6, linestyles=[style_of])
            yield Line2D([], [], color=colour, linewidth=1.6, linestyle=style_of, label=legend_label(text))


def _marks(panel: Axes, item: Map, x: np.ndarray, y: np.ndarray) -> Iterator[Artist]:
    """The experiment's own point, and the best and the worst of the map."""
    down, across = (str(key) for key in item.values.dims)
    marks: list[tuple[float, float, str, float, str]] = []
    own_x, own_y = (_own_value(item.data, key) for key in (across, down))
    if own_x is not None and own_y is not None and x.min() <= own_x <= x.max() and y.min() <= own_y <= y.max():
        near = item.values.sel({across: own_x, down: own_y}, method="nearest")
        paper = all(_own_value(item.data, key) in (value, None) for key, value in PAPER.items())
        called = "the paper's point" if paper else "the file's point"
        marks.append((own_x, own_y, "*", 16.0, f"{called}: gap {float(near):.3g} %"))
    values = item.values.values
    if np.isfinite(values).any():
        for which, marker, word in ((np.nanargmin, "^", "least"), (np.nanargmax, "v", "largest")):
            i, j = np.unravel_index(which(values), values.shape)
            text = f"{word} gap {values[i, j]:.3g} % at ({x[j]:.3g}, {y[i]:.3g})"
            marks.append((float(x[j]), float(y[i]), marker, 9.0, text))
    for place_x, place_y, marker, size, text in marks:
        yield from panel.plot(
            [place_x], [place_y], marker=marker, markersize=size, linestyle="none", label=legend_label(text),
            markerfacecolor="white", markeredgecolor="black", markeredgewidth=1.2, clip_on=False, zorder=5,
        )  # fmt: skip


def _own_value(data: xr.Dataset, key: str) -> float | None:
    """What the file says of a swept key beside its sweep."""
    table: Any = json.loads(data.attrs["experiment"])
    for step in key.split("."):
        table = table.get(step) if isinstance(table, dict) else None
    return float(table) if isinstance(table, int | float) else None
