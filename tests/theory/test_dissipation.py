"""Energies on the circle against the platform's own matrices, and the trigonometry and quadrature behind them."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from occ.errors import InputError
from occ.model.coefficients import coefficients, unpack
from occ.model.platform import Platform
from occ.model.presets import youbot
from occ.motion import Circle, Line
from occ.task import Task
from occ.theory.dissipation import circle_of, energy_of
from occ.theory.quadrature import FINE, Rule, Well
from occ.theory.trigonometric import TURN, basis, derivative, least, recentred, value, zeros
from tests.strategies import angles, circles, platforms, points, reals

polynomials = st.lists(reals(-3.0, 3.0), min_size=5, max_size=5).map(np.array)


@given(platforms(), points(), circles(), angles(), reals(-2.0, 2.0))
def test_energies_are_those_of_the_platform(
    platform: Platform, point: tuple[float, float], circle: Circle, angle: float, yaw_rate: float
) -> None:
    matrices = unpack(ca.DM(coefficients(platform)), platform.wheel_count)
    speed = circle.radius * circle.rate
    # Eq. (3.6) with V_B* of eq. (4.2).
    velocity = np.array(
        [
            point[1] * yaw_rate + speed * math.sin(angle),
            -point[0] * yaw_rate + speed * math.cos(angle),
            yaw_rate,
        ]
    )
    energy = energy_of(platform, point, circle)
    dissipation = float(velocity @ np.array(matrices.friction) @ velocity)
    kinetic = float(velocity @ np.array(matrices.inertia) @ velocity) / 2
    assert energy.dissipation(angle, yaw_rate) == pytest.approx(dissipation, rel=1e-9, abs=1e-9)
    assert energy.kinetic_energy(angle, yaw_rate) == pytest.approx(kinetic, rel=1e-9, abs=1e-9)
    least_kinetic = float(value(energy.rest_of_yaw, angle))
    best = -float(value(energy.coupling, angle) / energy.inertia)
    assert energy.kinetic_energy(angle, best) == pytest.approx(least_kinetic, rel=1e-9, abs=1e-9)
    assert kinetic >= least_kinetic - 1e-9
    step = 1e-4
    slope = (energy.of_end_points(angle + step) - energy.of_end_points(angle - step)) / (2 * step)
    assert slope == pytest.approx(2 * (energy.friction * energy.rate + value(energy.drag, angle)), rel=1e-6, abs=1e-5)


def test_only_a_circle_has_the_circles_theory() -> None:
    motion = Line(velocity=(0.1, 0.0), start=(0.0, 0.0))
    task = Task(platform=youbot(), point=(0.1, 0.0), motion=motion, duration=1.0)
    with pytest.raises(InputError, match=r'line; should be "circle"'):
        circle_of(task)


@given(polynomials, angles())
def test_trigonometric_polynomials(p: np.ndarray, x: float) -> None:
    assert value(p, x) == pytest.approx(float(p @ basis(np.array(x))), abs=1e-13)
    step = 1e-5
    slope = (value(p, x + step) - value(p, x - step)) / (2 * step)
    assert value(derivative(p), x) == pytest.approx(float(slope), abs=1e-7)
    assert value(recentred(p, np.array(x)), 0.3) == pytest.approx(float(value(p, x + 0.3)), abs=1e-13)


@given(polynomials)
@example(np.ones(5))  # One of its zeros is a point of the grid.
def test_least_value_and_zeros(p: np.ndarray) -> None:
    grid = np.linspace(0, TURN, 4001)
    values = value(p, grid)
    place, lowest = least(p[:, None])
    # Between grid points a value falls by no more than half the largest curvature times the half distance squared.
    assert values.min() - 15 * (TURN / 8000) ** 2 <= lowest[0] <= values.min() + 1e-12
    assert value(p, place[0]) == pytest.approx(lowest[0], abs=1e-13)
    assert np.all(np.abs(value(p, zeros(p))) < 1e-12)


@pytest.mark.parametrize("level", [1.0, 1e-2, 1e-6, 1e-12, 1e-20])
def test_full_turn_of_a_pendulum_is_an_elliptic_integral(level: float) -> None:
    # U = 1 - cos x: the time of a turn is 4 K(-2/h)/sqrt(h), its length 8 sqrt(h) E(-2/h), however slow the passage.
    well = Well(1.0, np.array([1.0, -1.0, 0.0, 0.0, 0.0]))
    h = np.array([level])
    time, length = well.integrals((np.array([-np.pi]), np.array([np.pi])), h, (2 + h, 2 + h), FINE)
    assert time[0] == pytest.approx(4 / math.sqrt(level) * ellipk(-2 / level), rel=1e-14)
    assert length[0] == pytest.approx(8 * math.sqrt(level) * ellipe(-2 / level), rel=1e-14)


def turning_point(well: Well, h: np.ndarray, start: np.ndarray, side: np.ndarray) -> np.ndarray:
    """[rad] The first zero of U + h on the way from `start` to one side."""
    return np.asarray(start + side * well.way_to_turning_point(h, well.places(start), side))


@pytest.mark.parametrize("turn", [2.0, 1.0, 0.1])
def test_way_to_a_turning_point_is_an_elliptic_integral(turn: float) -> None:
    well = Well(1.0, np.array([1.0, -1.0, 0.0, 0.0, 0.0]))
    h = np.array([math.cos(turn) - 1.0])
    found = turning_point(well, h, np.array([math.pi]), np.array([-1.0]))
    assert found[0] == pytest.approx(turn, abs=1e-13)
    time, _ = well.integrals((np.array([np.pi]), np.array([turn])), h, (2 + h, np.zeros(1)), FINE)
    assert time[0] == pytest.approx(math.sqrt(2) * ellipk(math.cos(turn / 2) ** 2), rel=1e-12)


def test_turning_points_lie_on_the_asked_side() -> None:
    well = Well(1.0, np.array([1.0, -1.0, 0.0, 0.0, 0.0]))
    start, side = np.array([2.0, 2.0 + TURN, 2.0]), np.array([-1.0, 1.0, 1.0])
    found = turning_point(well, np.array([-1.0, -1.0, 0.5]), start, side)
    assert found == pytest.approx([np.pi / 2, 2 * TURN - np.pi / 2, np.inf], abs=1e-13)


@pytest.mark.parametrize("distance", [1e-7, 1e-5, 1e-3, 0.1, 1.0, 1.5])
def test_turning_points_near_an_extremum_keep_their_digits(distance: float) -> None:
    # U = 1 - cos x and its mirror image, so that neither h nor the lowest or highest value of U is rounded.
    h = np.array([2 * math.sin(distance / 2) ** 2])
    valley, hill = (Well(1.0, np.array([sign, -sign, 0.0, 0.0, 0.0])) for sign in (1.0, -1.0))
    near_minimum = turning_point(valley, -h, np.array([3.0]), np.array([-1.0]))
    near_maximum = turning_point(hill, h, np.zeros(1), np.ones(1))
    assert near_minimum[0] == pytest.approx(distance, rel=1e-14)
    assert near_maximum[0] == pytest.approx(distance, rel=1e-14)


@given(polynomials, reals(-4.0, 1.0))
@example(np.array([0.0, -0.3, -0.8, -0.3, 0.1]), -2.9)
def test_fine_rule_has_converged_for_every_power(p: np.ndarray, decade: float) -> None:
    # Complex zeros of U' beside the real axis would spoil the rule, were they not cut at.
    assume(np.abs(p[1:]).sum() > 0.1)
    well, finer = Well(1.0, p), Rule.create(0.1, 66.0)
    h = np.array([10**decade - well.bottom])
    ends = np.array([0.3]), np.array([0.3 + TURN])
    levels = value(p, ends[0]) + h, value(p, ends[0]) + h
    found, expected = (np.array(well.integrals(ends, h, levels, rule)) for rule in (FINE, finer))
    assert found == pytest.approx(expected, rel=1e-13)


@given(polynomials, st.lists(reals(-9.0, 9.0), min_size=3, max_size=3), reals(1e-6, 1.0))
def test_legs_add_up_wherever_they_are_cut(p: np.ndarray, places: list[float], above: float) -> None:
    assume(np.abs(p[1:]).sum() > 0.1)
    a, b, c = (np.array([x]) for x in sorted(places))
    plain = Well(0.7, p)
    h = np.array([above - plain.bottom])

    def measured(well: Well, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        return np.array(well.integrals((high, low), h, (value(p, high) + h, value(p, low) + h), FINE))

    whole = measured(plain, a, c)
    # The sum of two legs, and the same leg with cuts of the tables at its ends and in between.
    assert measured(plain, a, b) + measured(plain, b, c) == pytest.approx(whole, rel=1e-10, abs=1e-12)
    assert measured(Well(0.7, p, (float(b[0]),)), a, c) == pytest.approx(whole, rel=1e-10, abs=1e-12)
    assert measured(Well(0.7, p, (float(c[0]), float(a[0]))), a, c) == pytest.approx(whole, rel=1e-10, abs=1e-12)
    assert measured(Well(0.7, p, (float(a[0]),)), a + TURN, c + TURN) == pytest.approx(whole, rel=1e-10, abs=1e-12)
