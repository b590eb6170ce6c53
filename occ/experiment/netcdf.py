"""Datasets as netCDF-4 files, written by h5py alone.

A trajectory has some thirty small variables, and the general writers spend eight times as long on each of them.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr


def netcdf_bytes(dataset: xr.Dataset) -> bytes:
    """A file with a dataset whose dimensions all have a coordinate of their own name.

    Args:
        dataset: numbers and texts, with attributes that are texts, numbers or lists of numbers.

    Returns:
        The file's content.

    Source: netCDF user's guide, appendix B: dimensions are HDF5 dimension scales, variables attach them.
    """
    import h5py

    content = io.BytesIO()
    with h5py.File(content, "w", track_order=True) as file:
        file.attrs.update(dataset.attrs)
        stored = {}
        for name, variable in dataset.variables.items():
            values = variable.values
            text = values.dtype.kind == "U"
            stored[name] = file.create_dataset(str(name), data=values.astype(h5py.string_dtype()) if text else values)
            stored[name].attrs.update(variable.attrs)
        for name in dataset.dims:
            stored[name].make_scale(str(name))
        for name in dataset.data_vars:
            for axis, dimension in enumerate(dataset.variables[name].dims):
                stored[name].dims[axis].attach_scale(stored[dimension])
    return content.getvalue()
