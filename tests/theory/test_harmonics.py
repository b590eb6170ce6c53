"""Rotational motions without matrices, and where there are none: against collocation and the equation itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.integrate import solve_ivp

from occ.model.presets import youbot
from occ.theory.attractors import friction_forbids_rotation
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import yaw_coefficients
from occ.theory.equation import ScaledEquation, scaled_equation
from occ.theory.harmonics import balanced
from occ.theory.periodic import _collocated, _guess, resampled
from tests.strategies import reals
from tests.tasks import POINT

TOLERANCE = 1e-11


def drawn(count: int, largest: float) -> ScaledEquation:
    """Circles inside the critical radius with |epsilon| up to a limit, of both directions."""
    rng = np.random.default_rng(3)
    epsilon = rng.uniform(0.01, largest, count) * rng.choice([-1.0, 1.0], count)
    spin = rng.uniform(0.0, 0.3, count) / np.abs(epsilon)
    return ScaledEquation(
        0.5 * np.sign(epsilon), epsilon, rng.uniform(0, 0.98, count), spin, 0 * spin, rng.uniform(-3, 3, count)
    )


def test_all_circles_of_the_paper_s_platform_are_found() -> None:
    c = yaw_coefficients(youbot(), POINT)
    rng = np.random.default_rng(1)
    rate = rng.uniform(0.02, 1.5, 500) * rng.choice([-1.0, 1.0], 500)
    radius = circle_quantities(c, 1.0, rate).critical_radius * rng.uniform(0.05, 0.98, 500)
    eq = scaled_equation(c, radius, rate)
    rows = np.concatenate([rows for rows, _ in balanced(eq, TOLERANCE)])
    assert np.array_equal(np.sort(rows), np.arange(500))


@pytest.mark.parametrize(("largest", "share"), [(0.1, 0.99), (3.0, 0.5)])
def test_what_is_found_is_what_collocation_finds(largest: float, share: float) -> None:
    eq = drawn(200, largest)
    dense = {row: p for rows, ps in _collocated(eq, _guess(eq), TOLERANCE) for row, p in zip(rows, ps, strict=True)}
    found = 0
    for rows, ps in balanced(eq, TOLERANCE):
        for row, p in zip(rows, ps, strict=True):
            count = max(len(p), len(dense[row]))
            np.testing.assert_allclose(resampled(p[None], count), resampled(dense[row][None], count), atol=3e-11)
            found += 1
    assert found >= share * 200


def test_the_equation_holds_between_the_angles_of_the_grid() -> None:
    eq = drawn(100, 0.3)
    for rows, p in balanced(eq, TOLERANCE):
        one, count = eq.of(rows), 8 * p.shape[1]
        spectrum = np.fft.rfft(resampled(p, count), axis=1)
        slope = np.fft.irfft(1j * np.arange(spectrum.shape[1]) * spectrum, count, axis=1)
        theta = 2 * np.pi * np.arange(count) / count
        damping = 1 + (one.epsilon * one.k)[:, None] * np.sin(theta + one.delta[:, None])
        residual = (
            (one.epsilon[:, None] * slope + damping) * resampled(p, count) + 1 - one.ratio[:, None] * np.cos(theta)
        )
        assert np.abs(residual).max() < 1e-8


def is_caught(eq: ScaledEquation) -> bool:
    """Whether the fastest motion that there can be, from the bottom of the push, does not get past its top."""
    _, e, rho, k, _, delta = (float(value) for value in eq)
    size, sign, spin = abs(e), np.sign(e), abs(e) * k

    def change(s: float, v: np.ndarray) -> np.ndarray:
        damping = 1 + sign * spin * np.sin(-sign * s + delta)
        return (1 - rho * np.cos(s) - damping * v) / (size * np.maximum(v, 1e-6))

    def caught(_: float, v: np.ndarray) -> float:
        return float(v[0] - 1e-4)

    caught.terminal = True
    end = np.arccos(1 / rho) + 1e-2
    start = [(1 + rho) / (1 - spin)]
    return solve_ivp(change, (-np.pi, end), start, "LSODA", events=caught, rtol=1e-8, atol=1e-10).status == 1


@settings(max_examples=12)
@given(size=reals(0.02, 3.0), excess=reals(1e-3, 2.0), spin=reals(0.0, 0.9), delta=reals(-3.1, 3.1), side=reals(-1, 1))
def test_where_friction_forbids_it_nothing_passes_the_saddle(
    size: float, excess: float, spin: float, delta: float, side: float
) -> None:
    sign = 1.0 if side > 0 else -1.0
    eq = ScaledEquation(*map(np.asarray, (0.5 * sign, size * sign, 1 + excess, spin / size, 0.0, delta)))
    assert is_caught(eq) or not friction_forbids_rotation(eq)


@pytest.mark.parametrize("rho", [1.001, 1.05, 1.3])
def test_nothing_is_forbidden_beyond_the_border(rho: float) -> None:
    """Without gyroscopic terms a motion passes the saddle from |epsilon| of about 0.7 on, at the critical radius."""
    sizes = (0.1, 0.3, 0.49, 0.8, 1.5, 3.0)
    eqs = [ScaledEquation(*map(np.asarray, (0.5, size, rho, 0.0, 0.0, 0.0))) for size in sizes]
    forbidden = [bool(friction_forbids_rotation(eq)) for eq in eqs]
    caught = [is_caught(eq) for eq in eqs]
    assert all(caught[k] for k in range(len(sizes)) if forbidden[k])
    # The bound is not idle, and there is something beyond it to be wrong about.
    assert forbidden[0]
    assert forbidden[1]
    assert not caught[-1]


def test_with_weak_friction_nothing_is_forbidden() -> None:
    c = yaw_coefficients(youbot(wheel_friction=0.0011, roller_friction=5.78e-5), POINT)
    assert not friction_forbids_rotation(scaled_equation(c, 0.3, -0.4))
