"""An atlas as labelled arrays: one dimension for each swept key, with units, meanings and provenance."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.atlas.comparison import variables
from occ.atlas.grid import Grid
from occ.atlas.run import Found, coordinates_of, status_texts
from occ.atlas.variables import LEAST_WORK, LONG_RUN, REGIMES, Variable
from occ.errors import InputError
from occ.experiment.case import NUMERICS, code_fingerprint
from occ.experiment.naming import case_name
from occ.experiment.store import replacing, write_text
from occ.experiment.units import unit_of

if TYPE_CHECKING:
    import xarray as xr

FILE = "atlas.nc"
FAILURES = "failures.csv"
FAILURE_COLUMNS = ("point", "controller", "status", "message")
COMPRESSED: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
MOST_IN_CHUNK = 1 << 16
"""Values that are compressed, and held in memory, together."""


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
    path = folder / FAILURES
    if rows:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([FAILURE_COLUMNS, *rows])
        write_text(path, text.getvalue())
    else:
        path.unlink(missing_ok=True)
    return rows


def read_failures(folder: Path) -> list[tuple[str, ...]]:
    """The rows of ``failures.csv``.

    Args:
        folder: of the experiment.

    Returns:
        Place, controller, status and reason of each point or controller without a value.

    Raises:
        InputError: the file is there and is not what `write_failures` writes.
    """
    path = folder / FAILURES
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = [*map(tuple, csv.reader(file))] or [()]
    if head != FAILURE_COLUMNS or any(len(row) != len(FAILURE_COLUMNS) for row in rows):
        raise InputError(f"{path}: not a table of failures; its columns should be {', '.join(FAILURE_COLUMNS)}")
    return rows


def write_atlas(grid: Grid, found: Found, folder: Path) -> None:
    """Write ``atlas.nc``, compressed and without dates: the same atlas makes the same bytes.

    Variables go there slab by slab, so that memory does not grow with the number of points.

    Args:
        grid: dimensions and provenance.
        found: the values.
        folder: of the experiment.

    Raises:
        InputError: the folder cannot be written.
    """
    import h5netcdf

    with replacing(folder / FILE) as path, h5netcdf.File(path, "w") as file:
        file.attrs.update(_provenance(grid))
        file.dimensions = {key: len(values) for key, values in grid.values.items()}
        for key, labels in grid.coordinates.items():
            unit = unit_of(key, grid.experiment.tables)
            _Variable(file, key, (key,), np.array(labels), unit, key).fill(np.array(labels))
        size, words = math.prod(grid.shape[1:]), _encoded(np.array(REGIMES))
        for name in found.columns:
            item = {**LONG_RUN, **LEAST_WORK}[name]
            sample = words if item.text else np.zeros(1)
            variable = _Variable(file, name, tuple(grid.values), sample, item.unit, item.meaning)
            for first, last in variable.slabs():
                values = found.columns.part(name, first * size, last * size)
                variable.fill(words[values] if item.text else values, first, last)
        if found.rows:
            _write_rows(file, grid, found)


def _write_rows(file: Any, grid: Grid, found: Found) -> None:
    """The numbers of the controllers."""
    names = np.array(grid.experiment.cases[0].controllers)
    file.dimensions["controller"] = len(names)
    _Variable(file, "controller", ("controller",), names, "1", "controller").fill(names)
    texts = status_texts(found.rows["status"])
    columns = {name: (found.rows[name], item) for name, item in variables(grid.experiment.objectives).items()}
    for name, (values, item) in {**columns, "status": (texts, Variable("1", "status of the row"))}.items():
        _Variable(file, name, (*grid.values, "controller"), values, item.unit, item.meaning).fill(values)


class _Variable:
    """One variable of the file; texts are arrays of letters, as netCDF has them.

    Args:
        file: of h5netcdf.
        name: of the variable.
        dims: names of its dimensions.
        sample: values of its type; the longest text among them.
        unit: of the values.
        meaning: one line.
    """

    def __init__(
        self, file: Any, name: str, dims: tuple[str, ...], sample: np.ndarray, unit: str, meaning: str
    ) -> None:
        self.shape: tuple[int, ...] = tuple(file.dimensions[key].size for key in dims)
        sample = _encoded(sample)
        self.letters = sample.dtype.itemsize if sample.dtype.kind == "S" else 0
        chunks, attributes = _chunks(self.shape), {"units": unit, "long_name": meaning}
        self.rows = chunks[0]
        if self.letters:
            length = f"letters_{self.letters}"
            if length not in file.dimensions:
                file.dimensions[length] = self.letters
            dims, chunks = (*dims, length), (*chunks, self.letters)
            attributes["_Encoding"] = "utf-8"
        is_data = name not in dims and not self.letters
        self._variable = file.create_variable(
            name,
            dims,
            "S1" if self.letters else "f8",
            chunks=chunks,
            fillvalue=np.nan if is_data else None,
            **COMPRESSED,
        )
        self._variable.attrs.update(attributes)

    def slabs(self) -> Iterator[tuple[int, int]]:
        """First and last places along the first dimension, of parts that fit the chunks."""
        for first in range(0, self.shape[0], self.rows):
            yield first, min(first + self.rows, self.shape[0])

    def fill(self, values: np.ndarray, first: int = 0, last: int | None = None) -> None:
        """Write the values of a slab."""
        last = self.shape[0] if last is None else last
        shape = (last - first, *self.shape[1:])
        if self.letters:
            values = np.ascontiguousarray(_encoded(values).astype(f"S{self.letters}")).view("S1")
            shape = (*shape, self.letters)
        self._variable[first:last] = values.reshape(shape)


def _encoded(values: np.ndarray) -> np.ndarray:
    """Texts as bytes; anything else as it is."""
    return np.char.encode(values, "utf-8") if values.dtype.kind == "U" else values


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Numbers of values along each dimension that are compressed together."""
    left, chunks = MOST_IN_CHUNK, []
    for count in reversed(shape):
        chunks.append(max(1, min(count, left)))
        left //= chunks[-1]
    return tuple(reversed(chunks))


@contextmanager
def open_atlas(folder: Path) -> Iterator[xr.Dataset]:
    """An atlas whose values are read when they are asked for.

    Args:
        folder: of the experiment.

    Yields:
        Variables over the swept keys, and over ``controller`` where controllers were compared.

    Raises:
        InputError: no atlas there.
    """
    import xarray as xr

    path = folder / FILE
    try:
        dataset = xr.open_dataset(path, engine="h5netcdf", cache=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no atlas there ({error}); occ atlas makes one") from error
    with dataset:
        yield dataset


def read_atlas(folder: Path) -> xr.Dataset:
    """The same with all values in memory.

    Args:
        folder: of the experiment.

    Returns:
        The dataset.

    Raises:
        InputError: no atlas there.
    """
    with open_atlas(folder) as dataset:
        return dataset.load()


def slabs(data: xr.Dataset) -> Iterator[xr.Dataset]:
    """An atlas in parts along its first dimension.

    Args:
        data: the atlas.

    Yields:
        Parts of some ten thousand points.
    """
    first = next(key for key in data.sizes if key != "controller")
    points = math.prod(size for key, size in data.sizes.items() if key not in ("controller", first))
    step = max(1, MOST_IN_CHUNK // points)
    for k in range(0, data.sizes[first], step):
        yield data.isel({first: slice(k, k + step)})
