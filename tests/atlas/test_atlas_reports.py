"""The committed atlases are what the code produces."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from occ.atlas.dataset import FILE, read_atlas
from occ.atlas.grid import load_grid
from occ.experiment.load import read_toml
from tests.atlas import made
from tests.experiment import HERE

ROOT = Path(__file__).parents[2]
ATLASES = sorted((ROOT / "experiments").glob("atlas_*.toml"))
LARGEST = 1_500_000
"""[byte] of a committed file."""


@pytest.mark.parametrize("path", ATLASES, ids=lambda path: path.stem)
def test_every_shipped_atlas_has_its_report(path: Path) -> None:
    folder = ROOT / "reports" / path.stem
    data = read_atlas(folder)
    assert (folder / FILE).stat().st_size < LARGEST
    assert json.loads(data.attrs["experiment"]) == load_grid(path).experiment.tables
    text = (folder / "report.md").read_text()
    figures = re.findall(r"!\[.*?\]\((.*?)\)", text)
    assert figures
    assert all((folder / figure).is_file() for figure in figures)
    assert not re.search(r"\b20\d\d-\d\d-\d\d\b|\d\d:\d\d:\d\d", text), "a report holds no dates or times of run"


@pytest.mark.parametrize("path", ATLASES, ids=lambda path: path.stem)
def test_committed_values_are_those_of_the_code(path: Path, tmp_path: Path) -> None:
    """At some of the points; each of them is worked out alone."""
    committed = read_atlas(ROOT / "reports" / path.stem)
    sweep = read_toml(path)["sweep"]
    chosen = {key: [float(committed[key][i]) for i in (3, -4)] for key in sweep}
    overrides = [f'sweep."{key}"={values}' for key, values in chosen.items()]
    overrides = [text.replace('"', "") for text in overrides]
    if committed.attrs["depth"] == "comparison":
        overrides.append("atlas.depth=long_run")
    data = made(path, tmp_path, HERE, *overrides)
    for name in data.data_vars:
        old, new = committed[name].sel(chosen), data[name]
        if old.dtype.kind == "f":
            # Another processor rounds in another way.
            xr.testing.assert_allclose(old, new, rtol=1e-8, atol=1e-10)
        else:
            assert np.array_equal(old.values, new.values), name


def test_published_gaps_are_in_the_committed_atlas() -> None:
    data = read_atlas(ROOT / "reports" / "atlas_circle")["long_run_gap_percent"]
    at = {"motion.radius": 0.7}
    assert float(data.sel({**at, "motion.rate": -0.4})) == pytest.approx(0.161, abs=5e-4)
    assert float(data.sel({**at, "motion.rate": 0.4})) == pytest.approx(13.3, abs=0.05)
    assert np.isfinite(data).all()


def test_what_the_readme_says_of_the_other_direction_is_in_the_committed_atlas() -> None:
    text = " ".join((ROOT / "README.md").read_text().split())
    (sentence,) = re.findall(r"Driven the other way round .* wastes mostly (\d+) to (\d+) %", text)
    low, high = map(float, sentence)
    data = read_atlas(ROOT / "reports" / "atlas_circle")
    other_way = (data["motion.rate"] > 0) & (data["law_regime"] == "steady")
    gaps = data["long_run_gap_percent"].values[other_way.values]
    assert gaps.max() <= high
    # "Mostly": all but one in twenty, and neither end is far from where they are.
    assert np.quantile(gaps, 0.05) >= low
    assert gaps.max() > high - 1
    assert np.quantile(gaps, 0.05) < low + 5


def test_the_comparison_has_four_hundred_cases_and_says_why_rows_are_missing() -> None:
    folder = ROOT / "reports" / "atlas_comparison"
    data = read_atlas(folder)
    status = data["status"]
    assert status.isel(controller=0).size >= 400
    missing = int((status != "ok").sum())
    lines = (folder / "failures.csv").read_text().splitlines()[1:] if missing else []
    assert len(lines) == missing
    assert np.all(np.isnan(data["work_gap_percent"].values[status.values != "ok"]))
    law = data.sel(controller="servo law")
    assert float(np.nanmin(law["work_gap_percent"])) > -1e-6
