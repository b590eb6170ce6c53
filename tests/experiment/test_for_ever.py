"""The long run of the law and of the best rotation, as a run records it."""

from __future__ import annotations

from pathlib import Path

import pytest

from occ.experiment.for_ever import for_ever
from occ.experiment.load import load_experiment

EXPERIMENTS = Path(__file__).parents[2] / "experiments"


@pytest.mark.parametrize(("rate", "percent"), [(-0.4, 0.161), (0.4, 13.3)])
def test_gap_of_either_direction(rate: float, percent: float) -> None:
    (case, *_) = load_experiment(EXPERIMENTS / "section5.toml", [f"motion.rate={rate}"]).cases
    found = for_ever(case, certify=False)
    assert found["least_mean_power_kind"] == "exact"
    assert found["long_run_gap_percent"] == pytest.approx(percent, rel=4e-3)
    proven = for_ever(case, certify=True)
    assert proven["least_mean_power_kind"] == "certified"
    # The known value of this circle, and a proof is never above it.
    assert 12.382782 < proven["least_mean_power_W"] <= found["least_mean_power_W"]
    assert proven["long_run_gap_percent"] >= found["long_run_gap_percent"]


@pytest.mark.parametrize("name", ["ellipse", "mismatch"])
def test_nothing_is_said_of_another_motion_or_another_plant(name: str) -> None:
    assert for_ever(load_experiment(EXPERIMENTS / f"{name}.toml").cases[0], certify=False) == {}
