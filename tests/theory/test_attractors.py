"""Attractors and shares of starts, against long simulations of single starts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from occ.model.platform import Platform
from occ.model.presets import youbot
from occ.theory.attractors import find_attractors
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import yaw_coefficients
from occ.theory.equation import ScaledEquation, reduced_motion, scaled_right_side
from tests.tasks import POINT


def slippery(factor: float) -> Platform:
    return youbot(wheel_friction=0.110 * factor, roller_friction=5.78e-3 * factor)


def test_one_steady_rotation_takes_all() -> None:
    (found,) = find_attractors(yaw_coefficients(youbot(), POINT), 0.7, -0.4)
    assert (found.kind, found.share) == ("steady", 1.0)
    assert found.psi_tilde == pytest.approx(-0.478863232355, abs=1e-11)


def test_one_rotating_motion_takes_all() -> None:
    (found,) = find_attractors(yaw_coefficients(youbot(), POINT), 0.6, -0.4)
    assert (found.kind, found.share) == ("rotating", 1.0)
    assert found.orbit is not None


@pytest.mark.parametrize("rate", [-0.4, 0.4])
def test_critical(rate: float) -> None:
    c = yaw_coefficients(youbot(), POINT)
    radius = float(circle_quantities(c, 1.0, rate).critical_radius)
    (found,) = find_attractors(c, radius, rate)
    assert (found.kind, found.share) == ("critical", 1.0)
    (above,) = find_attractors(c, radius * (1 + 1e-4), rate)
    assert above.kind == "steady"


@pytest.mark.parametrize("rate", [-0.4, 0.4])
def test_weak_friction_lets_both_coexist(rate: float) -> None:
    c = yaw_coefficients(slippery(0.01), POINT)
    found = {item.kind: item for item in find_attractors(c, 0.3, rate)}
    assert set(found) == {"steady", "rotating"}
    assert sum(item.share for item in found.values()) == pytest.approx(1.0, abs=1e-12)
    assert 0.2 < found["steady"].share < 0.4
    orbit = found["rotating"].orbit
    assert orbit is not None
    # Single starts: at rest in the steady rotation's own angle, and turning fast against the circle.
    t = np.array([0.0, 300.0, 300.0 + float(orbit.orbit.period)])
    stable = float(circle_quantities(c, 0.3, rate).stable_heading)
    psi, yaw_rate = reduced_motion(c, 0.3, rate, (stable + 0.3, rate), t)
    assert psi[-1] == pytest.approx(stable, abs=1e-6)
    psi, yaw_rate = reduced_motion(c, 0.3, rate, (stable, -2 * rate), t)
    assert psi[-1] - psi[-2] == pytest.approx(-np.sign(rate) * 2 * np.pi, abs=1e-6)
    assert yaw_rate[-1] == pytest.approx(yaw_rate[-2], abs=1e-7)


def test_shares_of_weak_friction_against_single_integrations() -> None:
    # A coarse grid of its own, each start integrated by an adaptive method.
    c = yaw_coefficients(slippery(0.01), POINT)
    rate, radius = -0.4, 0.25
    stable = float(circle_quantities(c, radius, rate).stable_heading)
    steady = 0
    grid = [(x, y) for x in np.linspace(0, 2 * np.pi, 5, endpoint=False) for y in np.linspace(-0.8, 0.8, 5)]
    for start in grid:
        psi, _ = reduced_motion(c, radius, rate, start, np.array([0.0, 200.0]), tolerance=1e-7)
        steady += abs(np.angle(np.exp(1j * (psi[-1] - stable)))) < 0.05
    share = {item.kind: item.share for item in find_attractors(c, radius, rate)}["steady"]
    assert share == pytest.approx(steady / len(grid), abs=0.1)


def test_a_manifold_that_cannot_be_followed_is_not_taken_for_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """No theorem speaks then, and the starts are counted."""
    c = yaw_coefficients(slippery(0.01), POINT)
    followed = {item.kind: item.share for item in find_attractors(c, 0.3, 0.4)}

    def breaking(eq: ScaledEquation) -> Callable[[float, np.ndarray], tuple[float, float]]:
        right_side = scaled_right_side(eq)

        def rate(t: float, y: np.ndarray) -> tuple[float, float]:
            return right_side(t, y) if t < 1.0 else (np.nan, np.nan)

        return rate

    monkeypatch.setattr("occ.theory.attractors.scaled_right_side", breaking)
    found = {item.kind: item.share for item in find_attractors(c, 0.3, 0.4)}
    # The starts near the rotating motion are not said to be steady, nor is a motion claimed that was not found.
    assert found == {"steady": followed["steady"], "unsettled": followed["rotating"]}


@pytest.mark.slow
def test_beyond_the_stable_radii_it_oscillates() -> None:
    c = yaw_coefficients(youbot(), POINT)
    kinds = {item.kind for item in find_attractors(c, 7.0, -300.0)}
    assert "steady" not in kinds
    assert "oscillating" in kinds


@pytest.mark.parametrize("spin_inertia", [0.0, 5.87e-3])
def test_without_friction_nothing_settles(spin_inertia: float) -> None:
    platform = youbot(wheel_friction=0.0, roller_friction=0.0, wheel_spin_inertia=spin_inertia)
    found = find_attractors(yaw_coefficients(platform, POINT), 0.7, -0.4)
    assert sum(item.share for item in found) == pytest.approx(1.0, abs=1e-12)
    assert all(item.kind in ("unsettled", "oscillating") for item in found)
