"""Maps of an atlas: what is marked and named on them, and that they stay small whatever the number of points."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from occ.figures.map_plan import MOST_SHOWN, NEAR, plan_maps
from occ.figures.maps import _sides, figure_of, write_maps
from occ.figures.style import style

ROOT = Path(__file__).parents[2]
FILE = {"motion": {"radius": 0.7, "rate": -0.4}, "point": {"x": 0.4, "y": 0.05}, "platform": {"preset": "youbot"}}


def atlas(count: int) -> xr.Dataset:
    """Made up: the gap is 0.1 % for rates below zero and grows with the radius beyond; steady where it is large."""
    rate, radius = np.linspace(-1.05, 0.95, count), np.linspace(0.1, 1.1, count)
    across, along = np.meshgrid(rate, radius, indexing="ij")
    gap = np.where(across < 0, 0.1, 20 * along)
    words = np.where(along > 0.5, "steady", "rotational")
    columns = {
        "long_run_gap_percent": gap,
        "law_regime": words,
        "least_mean_power_regime": np.full(words.shape, "steady"),
        "radius_ratio": along / 0.5,
        "critical_radius_m": 0 * along + 0.5,
        "optimal_switch_radius_m": 0 * along + 1e-3,
        "platform_speed_m_s": along * np.abs(across),
        "law_torque_Nm": np.where(along > 0.5, 3 * along, np.nan),
    }
    dims = ("motion.rate", "motion.radius")
    data = {name: (dims, values) for name, values in columns.items()}
    coordinates = {"motion.rate": rate, "motion.radius": radius}
    return xr.Dataset(data, coordinates, {"experiment": json.dumps(FILE)})


def texts(data: xr.Dataset) -> list[str]:
    (item,) = plan_maps(data)
    with style():
        figure = figure_of(item)
        (panel,) = figure.axes
        legend = [text.get_text() for text in (figure.legends or [panel.get_legend()])[0].get_texts()]
        return [text.replace("\n", " ") for text in (*legend, *(t.get_text() for t in panel.texts))]


def test_what_a_reader_finds_on_a_map() -> None:
    found = texts(atlas(61))
    for words in (
        "gap up to 0.2 %",
        "3 to 10 %",
        "10 to 30 %",
        "border: law steady / law rotates",
        "speed of B 0.8 m/s",
        "steady torque 2.1 N m",
        "the paper's point: gap 0.1 %",
        "both steady",
        "law rotates, optimum steady",
    ):
        assert words in found, words
    assert "over 100 %" not in found
    assert not any("no value" in text for text in found)


def test_best_and_worst_are_those_of_all_points_and_not_only_of_those_that_are_drawn() -> None:
    data = atlas(2 * MOST_SHOWN + 1)
    gaps = data["long_run_gap_percent"].values
    gaps[3, 5], gaps[701, 3] = 1e-9, 150.0
    (item,) = plan_maps(data)
    assert max(item.values.shape) <= MOST_SHOWN
    marks = {mark.symbol: mark for mark in item.marks}
    assert "below 0.001 %" in marks["^"].text
    assert marks["^"].place == (float(data["motion.radius"][5]), float(data["motion.rate"][3]))
    assert "largest gap 150 %" in marks["v"].text
    assert item.near == np.mean(gaps <= NEAR)


def test_colours_do_not_run_from_one_direction_of_travel_into_the_other() -> None:
    (item,) = plan_maps(atlas(60))
    against, along = _sides(item)
    assert float(against["motion.rate"].max()) == float(along["motion.rate"].min()) == 0.0
    assert float(against.max()) == 0.1
    assert float(along.min()) > NEAR


@pytest.mark.parametrize("hole", [False, True])
def test_points_without_a_value_are_named(tmp_path: Path, hole: bool) -> None:
    data = atlas(30)
    if hole:
        data["long_run_gap_percent"].values[3, 3] = np.nan
    assert any("no value" in text for text in texts(data)) is hole
    ((path, caption),) = write_maps(data, tmp_path)
    assert (tmp_path / path).stat().st_size < 1_000_000
    assert "% of the points" in caption
