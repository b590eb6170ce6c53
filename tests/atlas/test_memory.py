"""Memory does not grow with the number of points, but for the few arrays that a report sorts."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from occ.atlas import dataset
from occ.atlas.columns import Columns
from occ.atlas.dataset import open_atlas, read_atlas, write_atlas
from occ.atlas.grid import load_grid
from occ.atlas.run import Found
from occ.atlas.variables import LONG_RUN, place
from occ.errors import InputError
from occ.figures import map_plan
from occ.figures.map_plan import plan_maps
from occ.report.atlas import atlas_tables
from tests.atlas import atlas_text
from tests.experiment.conftest import Write, write

__all__ = ["write"]
BLOCK = 8192
MOST = 60
"""[byte] for each further point: all values of one are 150."""


def sweep(count: int) -> str:
    return (
        f'"motion.radius" = {{ from = 0.7, to = 1.5, count = {count} }}\n'
        '"motion.rate" = { from = 0.1, to = 0.8, count = 20 }\n'
        '"start.heading" = { from = 0.0, to = 1.0, count = 25 }\n'
    )


def filled(size: int) -> Columns:
    columns = Columns(size)
    for first in range(0, size, BLOCK):
        part = np.arange(first, min(first + BLOCK, size)) % 997 / 100
        texts = np.full(len(part), place("steady"), np.int8)
        columns.put(first, {name: texts if item.text else part for name, item in LONG_RUN.items()})
    return columns


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "MOST_IN_CHUNK", 2048)
    monkeypatch.setattr(map_plan, "MOST_SHOWN", 10)


@pytest.mark.usefixtures("small_chunks")
def test_files_tables_and_maps_of_many_points(write: Write, tmp_path: Path) -> None:
    peaks = []
    for count in (2, 8, 24):  # the first one only imports what is needed
        grid = load_grid(write(atlas_text(sweep(count))))
        if count > 2:
            tracemalloc.start()
        write_atlas(grid, Found(filled(grid.size), {}, []), tmp_path / "out")
        with open_atlas(tmp_path / "out") as data:
            tables = atlas_tables(data)
            maps = list(plan_maps(data))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert "100.0" in tables[1].rows[0]
        assert max(max(item.values.shape) for item in maps) <= 10
    assert peaks[2] - peaks[1] < MOST * 8_000


@pytest.mark.usefixtures("small_chunks")
def test_slabs_are_put_together_in_the_right_order(write: Write, tmp_path: Path) -> None:
    grid = load_grid(write(atlas_text(sweep(15))))
    write_atlas(grid, Found(filled(grid.size), {}, []), tmp_path / "out")
    power = read_atlas(tmp_path / "out")["law_mean_power_W"].values
    assert power.shape == (15, 20, 25)
    np.testing.assert_array_equal(power.ravel(), np.arange(7_500) % 997 / 100)


def test_a_full_disk_of_scratch_files_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("occ.atlas.columns.TemporaryFile", full)
    with pytest.raises(InputError, match=r"cannot be written \(No space left on device\); TMPDIR should name"):
        filled(10)


@pytest.mark.slow
def test_peak_of_the_whole_command(write: Write, tmp_path: Path) -> None:
    peaks = []
    for count in (40, 400):
        command = [sys.executable, "-c", PEAK, str(write(atlas_text(sweep(count)))), str(tmp_path / str(count))]
        peaks.append(int(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1]))
    assert (peaks[1] - peaks[0]) * 1024 < 2 * MOST * 180_000


PEAK = """
import resource, sys
from occ.cli import app
app(["atlas", sys.argv[1], "--out", sys.argv[2]], standalone_mode=False)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
