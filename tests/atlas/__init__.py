"""A small atlas that the tests of this folder change."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from occ.atlas.dataset import read_atlas, write_atlas
from occ.atlas.grid import load_grid
from occ.atlas.run import make_atlas
from occ.experiment.pool import Engine
from tests.experiment import HERE, tiny

SWEEP = '"motion.radius" = { from = 0.3, to = 1.0, count = 4 }\n"motion.rate" = [-0.4, 0.4, 1.2]\n'


def atlas_text(sweep: str, depth: str = "long_run") -> str:
    """The small experiment with a sweep, at a depth."""
    table = f"[sweep]\n{sweep}" if sweep else ""
    text = tiny(("duration = 0.5", "laps = 1"), more=f'[atlas]\ndepth = "{depth}"\n{table}')
    return text if depth != "comparison" else text.replace("laps = 1", "duration = 0.5")


def made(path: Path, out: Path, engine: Engine = HERE, *overrides: str) -> xr.Dataset:
    """The atlas of a file, as it is written."""
    grid = load_grid(path, overrides)
    write_atlas(grid, make_atlas(path, grid, out, engine), out)
    return read_atlas(out)
