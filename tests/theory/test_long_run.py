"""The long-run optimum: published values, plain numerical integration, and the limit of long horizons."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.integrate import quad
from scipy.optimize import brentq

from occ.model.platform import Platform
from occ.model.presets import YouBot, youbot
from occ.theory.coefficients import yaw_coefficients
from occ.theory.dissipation import CircleEnergy, circle_energy
from occ.theory.long_run import long_run, switch_radius
from occ.theory.minimum_work import minimum_work
from occ.theory.trigonometric import TURN, least, value
from tests.strategies import platforms, points, reals
from tests.tasks import POINT, paper_task

PAPER = yaw_coefficients(youbot(), POINT)


@pytest.mark.parametrize(("radius", "expected", "steady"), [(0.3, "2.5640777", False), (0.7, "12.3827826", True)])
def test_published_least_mean_power(
    radius: float, expected: str, steady: bool, printed: Callable[[str], object]
) -> None:
    found = long_run(circle_energy(PAPER, radius, -0.4))
    # The table of check values has 12.3827824586: the last digit above is rounded up.
    assert found.mean_power == printed(expected if not steady else "12.3827824586")
    assert bool(found.steady) is steady


def test_published_switch_radius(printed: Callable[[str], object]) -> None:
    assert switch_radius(PAPER) == printed("0.532954910017")


def plain_answer(energy: CircleEnergy) -> float:
    """The same by adaptive quadrature and Brent's method."""
    grid = np.linspace(0, TURN, 20_001)
    lowest = grid[np.argmin(value(energy.power, grid))]
    bend = 1e-4
    points = value(energy.power, lowest + np.array([-bend, 0, bend]))
    lowest += bend / 2 * (points[0] - points[2]) / (points[0] - 2 * points[1] + points[2])
    bottom = float(value(energy.power, lowest))

    def excess(d: float) -> float:
        def root(s: float) -> float:
            return math.sqrt(max(float(value(energy.power, lowest + s)) - bottom + d, 0.0))

        area = quad(root, 0, TURN, epsabs=1e-11, epsrel=1e-11, limit=400)[0]
        return area / TURN - abs(float(energy.rate)) * math.sqrt(float(energy.friction))

    return bottom if excess(0.0) >= 0 else bottom - brentq(excess, 0.0, 1e3, xtol=1e-12, rtol=1e-12)


@pytest.mark.parametrize("radius", [0.05, 0.3, 0.52, 0.5329, 0.533, 0.9])
@pytest.mark.parametrize("point", [POINT, (-0.2, 0.3)])
def test_plain_integration_agrees(radius: float, point: tuple[float, float]) -> None:
    energy = circle_energy(yaw_coefficients(youbot(), point), radius, -0.4)
    assert long_run(energy).mean_power == pytest.approx(plain_answer(energy), rel=1e-8)


@pytest.mark.parametrize("radius", [0.3, 0.45, 0.7])
def test_limit_of_long_horizons(radius: float) -> None:
    # What the ends contribute stays bounded, so that the mean power comes out with an error like 1 / duration.
    energy = circle_energy(PAPER, radius, -0.4)
    mean = float(long_run(energy).mean_power)
    ends = 4 * float(np.hypot(energy.drag[1], energy.drag[2])) + 10.0
    for duration in (100.0, 400.0, 1600.0):
        work = minimum_work(paper_task(duration=duration, radius=radius)).work
        assert abs(work - mean * duration) < ends


@given(platforms(), points(), reals(0.05, 2.0), reals(-1.5, 1.5))
def test_no_cycle_of_any_kind_needs_less(
    platform: Platform, point: tuple[float, float], radius: float, rate: float
) -> None:
    energy = circle_energy(yaw_coefficients(platform, point), radius, rate or 0.4)
    found = long_run(energy)
    angle = np.linspace(0, TURN, 361)
    assert found.mean_power <= value(energy.power, angle).min() + 1e-9 * float(np.abs(energy.power).sum())
    # Rotations at any constant yaw rate, and turning as the first integral asks.
    for yaw_rate in np.linspace(-2, 2, 9):
        mean = float(energy.dissipation(angle[:-1], yaw_rate).mean())
        assert found.mean_power <= mean + 1e-9 * (1 + abs(mean))


@settings(max_examples=8)
@given(points(), reals(0.1, 3.0), reals(0.1, 10.0))
def test_switch_radius_depends_on_neither_rate_nor_scale_of_friction(
    point: tuple[float, float], rate: float, scale: float
) -> None:
    preset = YouBot()
    scaled = YouBot(
        wheel_friction=preset.wheel_friction * scale, roller_friction=preset.roller_friction * scale
    ).platform()
    radius = float(switch_radius(yaw_coefficients(youbot(), point)))
    assert float(switch_radius(yaw_coefficients(scaled, point))) == pytest.approx(radius, rel=1e-9)
    for factor, steady in ((0.999, False), (1.001, True)):
        for sign in (-1, 1):
            c = yaw_coefficients(scaled, point)
            assert bool(long_run(circle_energy(c, radius * factor, sign * rate)).steady) is steady


def test_least_value_of_many_polynomials() -> None:
    """One valley, two, the deeper one narrow, a flat bottom and a constant: not above the values on a fine grid."""
    rng = np.random.default_rng(5)
    flat, level, equal = [0.0, -4.0, 0.0, 1.0, 0.0], [2.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0]
    p = np.concatenate([rng.normal(size=(300, 5)) * [1, 0.3, 0.3, 1, 1], [flat, level, equal]]).T
    angle, lowest = least(p)
    grid = np.linspace(0, TURN, 20_001)
    sampled = value(p[:, :, None], grid).min(axis=1)
    np.testing.assert_allclose(value(p, angle), lowest, atol=1e-14)
    assert np.all(lowest <= sampled + 1e-13)
    assert np.all(lowest >= sampled - 1e-6)
    np.testing.assert_allclose(lowest[-3:], [-3.0, 2.0, -1.0], atol=1e-14)


def test_arrays_are_points() -> None:
    radii, rates = np.meshgrid(np.linspace(0.2, 1.0, 7), np.array([-0.4, 0.3]))
    found = long_run(circle_energy(PAPER, radii, rates))
    for index in np.ndindex(radii.shape):
        one = long_run(circle_energy(PAPER, radii[index], rates[index]))
        assert found.mean_power[index] == pytest.approx(float(one.mean_power), rel=1e-13)


@pytest.mark.slow
def test_a_million_points_in_ten_seconds() -> None:
    random = np.random.default_rng(1)
    energy = circle_energy(PAPER, random.uniform(0.1, 1.5, 1_000_000), random.uniform(-1.0, 1.0, 1_000_000))
    begin = time.process_time()
    long_run(energy)
    assert time.process_time() - begin < 10.0
