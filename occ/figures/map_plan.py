"""Which maps an atlas has, and what is marked on them."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

NEAR = 1.0
"""[%] Gap up to which the law is called near the optimum."""
MOST_SLICES = 6
"""Maps of one quantity at most; values of further keys are chosen evenly."""
MOST_SHOWN = 400
"""Values of each key that are drawn."""
PAPER = {"motion.radius": 0.7, "motion.rate": -0.4, "point.x": 0.4, "point.y": 0.05, "platform.friction_scale": 1.0}
SMALLEST = 1e-3
"""[%] Smaller gaps are not told apart."""
SHOWN = (
    "law_regime",
    "least_mean_power_regime",
    "radius_ratio",
    "critical_radius_m",
    "optimal_switch_radius_m",
    "platform_speed_m_s",
    "law_torque_Nm",
)
"""Variables that the lines and names on a map need."""


class Mark(NamedTuple):
    """A place on a map."""

    place: tuple[float, ...]  # values of the keys, in the order of the map's dimensions
    symbol: str
    size: float
    text: str


@dataclass(frozen=True)
class Map:
    """One map.

    Args:
        name: of its file, without the folder.
        caption: a plain sentence.
        values: over two keys, or over one; some of them, if there are many.
        data: everything else at the same points.
        near: part of all points that has a gap up to `NEAR`.
        marks: the file's own point, and the best and the worst of all points.
    """

    name: str
    caption: str
    values: xr.DataArray
    data: xr.Dataset
    near: float
    marks: tuple[Mark, ...]


def plan_maps(data: xr.Dataset) -> Iterator[Map]:
    """Which maps belong to an atlas.

    Args:
        data: the atlas; values are read when they are needed.

    Yields:
        One for each gap, and for each choice of values of the keys beyond the first two that are numbers.
    """
    keys = [str(name) for name in data.dims if name != "controller"]
    axes = [key for key in keys if data[key].dtype.kind == "f" and data.sizes[key] > 1][:2]
    if not axes:
        return
    others = [key for key in keys if key not in axes]
    thin = {key: slice(None, None, -(-data.sizes[key] // MOST_SHOWN)) for key in axes}
    for name, caption, values in _gaps(data):
        for chosen in _slices(data, others):
            where = ", ".join(f"{key} = {data[key].values[i]}" for key, i in chosen.items())
            slug = "".join(f"-{key}={data[key].values[i]}" for key, i in chosen.items())
            gaps = values.isel(chosen).load().transpose(*reversed(axes))
            yield Map(
                f"{name}{slug}.svg",
                caption + (f", {where}" if where else ""),
                gaps.isel(thin),
                data[list(SHOWN)].isel({**chosen, **thin}).load().transpose(*reversed(axes), ...),
                float(np.mean(gaps.values <= NEAR)),
                tuple(_marks(data, gaps)),
            )


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


def _marks(data: xr.Dataset, gaps: xr.DataArray) -> Iterator[Mark]:
    """The experiment's own point, and the best and the worst of the map."""
    keys = [str(key) for key in gaps.dims]
    own = [own_value(data, key) for key in keys]
    known = [value for value in own if value is not None]
    inside = [gaps[key].min() <= value <= gaps[key].max() for key, value in zip(keys, known, strict=False)]
    if len(known) == len(keys) and all(inside):
        near = gaps.sel(dict(zip(keys, known, strict=True)), method="nearest")
        paper = all(own_value(data, key) in (value, None) for key, value in PAPER.items())
        called = "the paper's point" if paper else "the file's point"
        yield Mark(tuple(known), "*", 16.0, f"{called}: gap {_percent(float(near))}")
    if not np.isfinite(gaps).any():
        return
    for which, symbol, word in ((np.nanargmin, "^", "least"), (np.nanargmax, "v", "largest")):
        places = np.unravel_index(which(gaps.values), gaps.shape)
        place = tuple(float(gaps[key].values[i]) for key, i in zip(keys, places, strict=True))
        text = ", ".join(f"{value:.3g}" for value in reversed(place))
        yield Mark(place, symbol, 9.0, f"{word} gap {_percent(float(gaps.values[places]))} at ({text})")


def _percent(gap: float) -> str:
    return f"{gap:.3g} %" if gap >= SMALLEST or np.isnan(gap) else f"below {SMALLEST:g} %"


def own_value(data: xr.Dataset, key: str) -> float | None:
    """What the file says of a swept key beside its sweep."""
    table: Any = json.loads(data.attrs["experiment"])
    for step in key.split("."):
        table = table.get(step) if isinstance(table, dict) else None
    return float(table) if isinstance(table, int | float) else None
