"""Mean power of the law in the long run: published value, and the law's own work over long horizons."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from occ.laws import ServoLaw
from occ.laws.base import yaw_motion
from occ.theory.dissipation import energy_of
from occ.theory.summary import circle_summary
from tests.tasks import paper_task


def test_steady_power_of_the_law_and_its_gap(printed: Callable[[str], object]) -> None:
    found = circle_summary(paper_task())
    assert found["law_mean_power_W"] == printed("12.4027335158")
    assert found["least_mean_power_W"] == printed("12.3827824586")
    assert found["least_mean_power_regime"] == "steady"
    assert found["optimal_switch_radius_m"] == printed("0.532954910017")
    assert found["long_run_gap_percent"] == pytest.approx(0.16, abs=5e-3)


@pytest.mark.parametrize(("radius", "rate", "percent"), [(0.7, 0.4, 13.3), (0.6, -0.4, 6.4)])
def test_published_gaps_elsewhere(radius: float, rate: float, percent: float) -> None:
    found = circle_summary(paper_task(radius=radius, rate=rate))
    assert found["long_run_gap_percent"] == pytest.approx(percent, abs=0.05)


def test_rotating_law_over_its_exact_period() -> None:
    # The law's own motion over fifteen whole periods, after the start has died away.
    task = paper_task(radius=0.3)
    found = circle_summary(task)
    assert found["least_mean_power_regime"] == "rotational"
    period = found["period_s"]
    motion, _ = yaw_motion(ServoLaw(), paper_task(20 * period, radius=0.3), 1e-11)
    assert motion is not None
    t = 5 * period + 15 * period * np.arange(6000) / 6000
    heading, yaw_rate, _ = motion(t)
    energy = energy_of(task.platform, task.point, task.motion)
    mean = float(energy.dissipation(heading - task.motion.phase - task.motion.rate * t, yaw_rate).mean())
    assert found["law_mean_power_W"] == pytest.approx(mean, rel=1e-7)
    assert found["law_mean_power_W"] >= found["least_mean_power_W"]
