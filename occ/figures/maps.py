"""Maps of an atlas: where the law is near the optimum (blue) and where it is not (yellow to red)."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.figures.map_plan import NEAR, Map, plan_maps
from occ.figures.style import blank, legend_beside, place, style, write
from occ.figures.style import label as legend_label

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CLASSES = (0.2, 1.0, 3.0, 10.0, 30.0, 100.0)
"""[%] Borders between the colours."""
SHADES = ("#2166ac", "#92c5de", "#fff2b3", "#fdc05f", "#f46d43", "#b2182b", "#5c0a5c")
"""After ColorBrewer's RdYlBu, which the colour-blind can read, and one more for what is off the scale."""
NO_VALUE = "#bdbdbd"
SMALLEST_REGION = 0.04
"""Part of a map below which a region has no name in it."""
VERBS = {"steady": "steady", "rotational": "rotates", "unstable": "unstable", "critical": "critical"}
BOTH = {"steady": "steady", "rotational": "rotate"}
FEW = 40
"""With fewer values of a key each point is drawn as a cell: nothing is said of what lies between."""
WORDS = {
    "motion.radius": "radius R_B of the circle",
    "motion.rate": "rate omega_B",
    "point.x": "point of attachment b_X",
    "point.y": "point of attachment b_Y",
    "platform.friction_scale": "friction, relative to the platform's own",
}
"""Names of frequent keys on the axes."""


def write_maps(data: xr.Dataset, folder: Path) -> list[tuple[str, str]]:
    """Draw all maps of an atlas.

    Args:
        data: the atlas.
        folder: of the experiment; the files go to ``figures/`` in it.

    Returns:
        Path from the folder, and caption, of each.
    """
    drawn = []
    with style():
        for item in plan_maps(data):
            write(figure_of(item), folder / "figures" / item.name)
            drawn.append((f"figures/{item.name}", f"{item.caption}; {_near(item)}."))
    return drawn


def _near(item: Map) -> str:
    return f"gap up to {NEAR:g} % at {100 * item.near:.0f} % of the points"


def figure_of(item: Map) -> Figure:
    """One map: coloured classes of the gap over two keys, or a curve over one.

    Args:
        item: what to draw.

    Returns:
        The figure.
    """
    figure = blank(8.9, 5.1, item.caption, 0.75)
    panel = place(figure, (0.75, 0.6, 5.2, 3.8))
    # A mark at the edge of the map lies half outside.
    panel.set_title(f"Blue: {_near(item)}", pad=9)
    handles = _curve(panel, item) if item.values.ndim == 1 else _map(panel, item)
    panel.set_xlabel(_axis(item.values, -1))
    legend_beside(panel, handles, gap=0.035)
    return figure


def _axis(values: xr.DataArray, axis: int) -> str:
    key = str(values.dims[axis])
    unit = values[key].attrs.get("units", "1")
    return WORDS.get(key, key) + (f" [{unit}]" if unit != "1" else "")


def _curve(panel: Axes, item: Map) -> list[Artist]:
    (key,) = item.values.dims
    (line,) = panel.plot(item.values[key], item.values, color="black", marker="o", markersize=3, label="gap")
    panel.axhspan(0.0, NEAR, color=SHADES[1], alpha=0.4, linewidth=0)
    if float(item.values.max()) > 5.0:
        panel.set_yscale("symlog", linthresh=0.1)
        panel.yaxis.set_major_formatter("{x:g}")
    panel.set_ylabel("gap [%]")
    return [line]


def _map(panel: Axes, item: Map) -> list[Artist]:
    from matplotlib.patches import Patch

    panel.set_facecolor(NO_VALUE)
    panel.grid(False)
    panel.set_ylabel(_axis(item.values, 0))
    gaps = item.values.values
    classes = np.digitize(gaps, CLASSES, right=True)
    handles: list[Artist] = [
        Patch(color=shade, label=text)
        for k, (shade, text) in enumerate(zip(SHADES, _class_names(), strict=True))
        if np.any((classes == k) & np.isfinite(gaps))
    ]
    if not np.isfinite(gaps).all():
        handles.append(Patch(color=NO_VALUE, label="no value (law unstable or failed)"))
    cells = min(gaps.shape) < FEW
    for part in [item.values] if cells else _sides(item):
        _colours(panel, part, cells)
    x, y = (item.values[key].values for key in reversed(item.values.dims))
    _name_regions(panel, item, x, y)
    handles += _borders(panel, item, x, y)
    for mark in item.marks:
        handles += panel.plot(
            [mark.place[1]], [mark.place[0]], marker=mark.symbol, markersize=mark.size, linestyle="none",
            label=legend_label(mark.text), markerfacecolor="white", markeredgecolor="black", markeredgewidth=1.2,
            clip_on=False, zorder=5,
        )  # fmt: skip
    panel.set_xlim(*_range(x, cells))
    panel.set_ylim(*_range(y, cells))
    return handles


def _sides(item: Map) -> Iterator[xr.DataArray]:
    """The gaps on either side of a standstill: against the direction of travel they are others, however slow it is."""
    down, across = (str(key) for key in item.values.dims)
    for key in (across, down):
        places = item.values[key].values
        if key == "motion.rate" and places.min() < 0 < places.max():
            for side in (places < 0, places > 0):
                part = item.values.isel({key: np.flatnonzero(side)})
                nearest = int(np.argmin(np.abs(part[key].values)))
                edge = part.isel({key: [nearest]}).assign_coords({key: [0.0]})
                yield _joined(part, edge, key)
            return
    yield item.values


def _joined(part: xr.DataArray, edge: xr.DataArray, key: str) -> xr.DataArray:
    import xarray as xr

    return xr.concat([part, edge], key).sortby(key)


def _colours(panel: Axes, gaps: xr.DataArray, cells: bool) -> None:
    """Classes of the gap: smooth borders between many points, cells about few."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    down, across = gaps.dims
    x, y = gaps[across].values, gaps[down].values
    # A gap of zero, or below it by rounding, is in the first class.
    shown = np.ma.masked_invalid(np.maximum(gaps.values, 1e-12))
    levels = [0.0, *CLASSES, 1e9]
    if cells:
        norm = BoundaryNorm(levels, len(SHADES))
        panel.pcolormesh(
            x, y, shown, shading="nearest", cmap=ListedColormap(SHADES), norm=norm, edgecolors="face", linewidth=0.4
        )
        return
    panel.contourf(x, y, shown, levels=levels, colors=SHADES)
    if shown.count() and shown.min() < NEAR < shown.max():
        panel.contour(x, y, shown, levels=[NEAR], colors="white", linewidths=2.2)


def _range(places: np.ndarray, cells: bool) -> tuple[float, float]:
    """Ends of an axis: of the cells, where each point has one."""
    first, last = (places[1] - places[0], places[-1] - places[-2]) if cells else (0.0, 0.0)
    return float(places[0] - first / 2), float(places[-1] + last / 2)


def _name_regions(panel: Axes, item: Map, x: np.ndarray, y: np.ndarray) -> None:
    """Say in each large region what becomes of law and optimum, where there is room."""
    from matplotlib.patheffects import withStroke
    from scipy.ndimage import distance_transform_edt, label

    law, best = (item.data[name].values.astype(str) for name in ("law_regime", "least_mean_power_regime"))
    for one, other in itertools.product(np.unique(law), np.unique(best)):
        regions, count = label((law == one) & (best == other))
        for number in range(1, count + 1):
            mask = regions == number
            if not one or mask.mean() < SMALLEST_REGION:
                continue
            depth = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
            i, j = _middle(depth, item.values.values)
            text = f"both {BOTH[one]}" if one == other else f"law {VERBS[one]}, optimum {VERBS[other]}"
            words = panel.text(x[j], y[i], text, ha="center", va="center", fontsize=9.0)
            words.set_path_effects([withStroke(linewidth=3, foreground="white")])


def _middle(depth: np.ndarray, gaps: np.ndarray) -> tuple[int, int]:
    """A place well inside a region; rather one that hides no blue, and rather near the middle of the map."""
    down, across = np.ogrid[-1 : 1 : depth.shape[0] * 1j, -1 : 1 : depth.shape[1] * 1j]
    score = depth / depth.max() - 0.5 * ~(gaps > NEAR) - 0.2 * np.hypot(down, across)
    i, j = np.unravel_index(np.argmax(np.where(depth > 0, score, -np.inf)), depth.shape)
    return int(i), int(j)


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
