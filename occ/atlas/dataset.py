"""An atlas as labelled arrays: one dimension for each swept key, with units, meanings and provenance."""

from __future__ import annotations

import csv
import io
import json
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.atlas.comparison import variables
from occ.atlas.grid import Grid
from occ.atlas.run import Found, coordinates_of, status_texts
from occ.atlas.variables import LEAST_WORK, LONG_RUN, REGIMES
from occ.errors import InputError
from occ.experiment.case import NUMERICS, code_fingerprint
from occ.experiment.naming import case_name
from occ.experiment.store import write_bytes, write_text

if TYPE_CHECKING:
    import xarray as xr

FILE = "atlas.nc"
COMPRESSED = {"zlib": True, "complevel": 6, "shuffle": True}


def atlas_dataset(grid: Grid, found: Found) -> xr.Dataset:
    """All values with their names.

    Args:
        grid: dimensions and provenance.
        found: the values.

    Returns:
        Variables over the swept keys, and over ``controller`` where controllers were compared.
    """
    import xarray as xr

    names = {**LONG_RUN, **LEAST_WORK}
    dims = tuple(grid.values)
    data: dict[str, Any] = {}
    for name, values in found.columns.items():
        item = names[name]
        texts = np.array(REGIMES)[values] if item.text else values
        data[name] = (dims, texts.reshape(grid.shape), {"units": item.unit, "long_name": item.meaning})
    coordinates: dict[str, Any] = {
        key: (key, np.array(values), {"long_name": key, "units": unit_of(key)})
        for key, values in grid.coordinates.items()
    }
    if found.rows:
        coordinates["controller"] = ("controller", grid.experiment.cases[0].controllers, {"long_name": "controller"})
        for name, item in variables(grid.experiment.objectives).items():
            values = found.rows[name].reshape(*grid.shape, -1)
            data[name] = ((*dims, "controller"), values, {"units": item.unit, "long_name": item.meaning})
        texts = status_texts(found.rows["status"]).reshape(*grid.shape, -1)
        data["status"] = ((*dims, "controller"), texts, {"units": "1", "long_name": "status of the row"})
    return xr.Dataset(data, coordinates, _provenance(grid))


def _provenance(grid: Grid) -> dict[str, str]:
    versions = {name: version(name) for name in ("occ", *NUMERICS)}
    return {
        "title": grid.experiment.title,
        "question": grid.experiment.question,
        "depth": grid.options.depth,
        "experiment": json.dumps(grid.experiment.tables, sort_keys=True),
        "versions": json.dumps(versions, sort_keys=True),
        "code": code_fingerprint(),
    }


def write_failures(grid: Grid, found: Found, folder: Path) -> list[tuple[str, ...]]:
    """Write ``failures.csv``: the place of each point or controller without a value, and why; none, no file.

    Args:
        grid: for the places.
        found: with the failures.
        folder: of the experiment.

    Returns:
        Place, controller, status and reason of each.

    Raises:
        InputError: the folder cannot be written.
    """
    rows: list[tuple[str, ...]] = [
        (case_name(dict(coordinates_of(grid, item.point))), item.controller, item.status, item.message)
        for item in found.failures
    ]
    path = folder / "failures.csv"
    if rows:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([("point", "controller", "status", "message"), *rows])
        write_text(path, text.getvalue())
    else:
        path.unlink(missing_ok=True)
    return rows


def unit_of(key: str) -> str:
    """The unit of a swept key, from the documentation of its table; ``1`` where it has none."""
    from occ.experiment.documentation import key_texts
    from occ.experiment.schema import Horizon, Point
    from occ.model.presets import PLATFORMS
    from occ.motion import MOTIONS
    from occ.task import Limits, Start

    table, _, name = key.partition(".")
    classes: dict[str, tuple[type, ...]] = {
        "platform": tuple(PLATFORMS.values()),
        "point": (Point,),
        "motion": tuple(MOTIONS),
        "start": (Start,),
        "horizon": (Horizon,),
        "limits": (Limits,),
    }
    for text in (text for cls in classes.get(table, ()) for text in key_texts(cls) if text.name == name):
        if text.unit or text.text.startswith("["):
            return text.unit or text.text[1 : text.text.index("]")]
    return "1"


def write_atlas(dataset: xr.Dataset, folder: Path) -> None:
    """Write ``atlas.nc``, compressed and without dates: the same atlas makes the same bytes.

    Args:
        dataset: of `atlas_dataset`.
        folder: of the experiment.

    Raises:
        InputError: the folder cannot be written.
    """
    encoding: dict[str, Any] = {}
    for name, variable in dataset.data_vars.items():
        encoding[str(name)] = dict(COMPRESSED)
        if variable.dtype.kind == "U":
            # Texts of another length have another dimension of letters.
            letters = max(map(len, np.unique(variable.values)), default=1)
            encoding[str(name)] |= {"dtype": "S1", "char_dim_name": f"letters_{letters}"}
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / FILE
        dataset.to_netcdf(path, engine="h5netcdf", encoding=encoding)
        write_bytes(folder / FILE, path.read_bytes())


def read_atlas(folder: Path) -> xr.Dataset:
    """Read back what `write_atlas` has written.

    Args:
        folder: of the experiment.

    Returns:
        The same dataset, in memory.

    Raises:
        InputError: no atlas there.
    """
    import xarray as xr

    path = folder / FILE
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return dataset.load()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no atlas there ({error}); occ atlas makes one") from error
