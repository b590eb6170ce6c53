"""Mean power of the law in the long run: published value, and the law's own work over long horizons."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import integrate
from scipy.integrate import solve_ivp

from occ.integration import IntegrationError
from occ.laws import ServoLaw
from occ.laws.base import yaw_motion
from occ.model.presets import youbot
from occ.theory.attractors import find_attractors
from occ.theory.coefficients import yaw_coefficients
from occ.theory.dissipation import circle_energy, energy_of
from occ.theory.equation import reduced_motion, scaled_equation, yaw_acceleration
from occ.theory.law_power import law_mean_power, rotations
from occ.theory.orbits import one_turn, rotating_orbit
from occ.theory.summary import circle_setting, circle_summary
from tests.tasks import POINT, paper_task


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


@pytest.mark.parametrize(("friction", "distance"), [(1.0, 0.5), (1.0, 1e-5), (0.1, 0.2), (0.02, 0.6), (0.3, 1e-3)])
@pytest.mark.parametrize("rate", [-0.4, 1.1])
def test_mean_power_of_a_rotation_is_the_mean_over_samples_of_its_turn(
    friction: float, distance: float, rate: float
) -> None:
    c = yaw_coefficients(youbot(friction_scale=friction), POINT)
    radius = float(scaled_equation(c, 1.0, rate).ratio) ** -1 * (1 - distance)
    eq, energy = scaled_equation(c, radius, rate), circle_energy(c, radius, rate)
    orbit = rotating_orbit(eq)
    assert orbit is not None
    turn = one_turn(eq, orbit)
    sampled = float(np.sum(turn.share * energy.dissipation(turn.psi_tilde, turn.yaw_rate)))
    one = type(energy)(*(np.asarray(value)[..., None] for value in energy))
    found = rotations(one, type(eq)(*(np.reshape(value, 1) for value in eq)))
    assert float(found.mean_power[0]) == pytest.approx(sampled, rel=1e-9)
    assert float(found.period[0]) == pytest.approx(float(orbit.orbit.period), rel=1e-12)
    assert float(found.mean_yaw_rate[0]) == pytest.approx(float(np.sum(turn.share * turn.yaw_rate)), abs=1e-8)


def test_mean_power_of_a_motion_with_a_corner_that_is_shot() -> None:
    """Integrated over its period, with the dissipation as a third state."""
    rate = 1.2
    c = yaw_coefficients(youbot(friction_scale=0.25), POINT)
    radius = float(scaled_equation(c, 1.0, rate).ratio) ** -1 * (1 - 1e-6)
    eq, energy = scaled_equation(c, radius, rate), circle_energy(c, radius, rate)
    orbit = rotating_orbit(eq)
    assert orbit is not None
    assert orbit.orbit.harmonics == 0
    one = type(energy)(*(np.asarray(value)[..., None] for value in energy))
    found = rotations(one, type(eq)(*(np.reshape(value, 1) for value in eq)))

    def change(_: float, y: np.ndarray) -> list[float]:
        acceleration = float(yaw_acceleration(c, radius, rate, y[0], y[1]))
        return [y[1] - rate, acceleration, float(energy.dissipation(y[0], y[1]))]

    period, half = float(found.period[0]), len(orbit.psi_tilde) // 2
    start = [float(orbit.psi_tilde[half]), float(orbit.yaw_rate[half]), 0.0]
    end = solve_ivp(change, (0.0, period), start, "LSODA", rtol=1e-10, atol=1e-12).y[:, -1]
    # One turn, to a millionth of the long time that it takes.
    assert end[0] - start[0] == pytest.approx(-2 * np.pi, abs=1e-6 * rate * period)
    assert float(found.mean_power[0]) == pytest.approx(end[2] / period, rel=1e-6)


def test_no_mean_where_the_motion_that_would_tell_cannot_be_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    # With weak friction the start decides between a steady rotation and a rotating motion.
    setting = circle_setting(paper_task(platform=youbot(friction_scale=0.01), radius=0.3))
    attractors = find_attractors(setting.c, setting.radius, setting.rate)
    assert len(attractors) == 2
    monkeypatch.setattr("occ.theory.law_power.find_attractors", lambda *_: attractors)
    assert law_mean_power(setting) is not None

    def given_up(function: Callable[..., object], span: tuple[float, float], *arguments: object, **more: object):
        outcome = solve_ivp(function, (0.0, span[1] / 1e3), *arguments)
        outcome.success = False
        return outcome

    monkeypatch.setattr(integrate, "solve_ivp", given_up)
    with pytest.raises(IntegrationError, match=r"cannot be followed any further at t = 0\.001 s"):
        reduced_motion(setting.c, setting.radius, setting.rate, (0.0, 0.0), np.array([0.0, 1.0]))
    assert law_mean_power(setting) is None
