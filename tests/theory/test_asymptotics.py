"""Degenerate solutions on every branch; orders of the approximations, derived and observed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from occ.model.presets import youbot
from occ.theory.asymptotics import (
    asymptotic_amplitude,
    asymptotic_mean_yaw_rate,
    asymptotic_period,
    degenerate_motion,
    slow_slope,
)
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import yaw_coefficients
from occ.theory.degenerate import degenerate_flow
from occ.theory.equation import ScaledEquation, scaled_equation
from occ.theory.orbits import rotating_orbits
from tests.strategies import reals
from tests.tasks import POINT
from tests.theory.orders import halved, motion_errors, observed_orders, rotation_table

RATIOS = st.one_of(
    st.sampled_from((0.0, 1e-9, 0.999999, 1.0, 1.000001)), reals(0.0, 1.0), reals(1.0, 4.0), reals(4.0, 30.0)
)


def equation(ratio: float, sign: float = 1.0, epsilon: float = 0.08) -> ScaledEquation:
    """K and delta of size one, so that no coefficient of the expansions is small by chance."""
    return ScaledEquation(*map(np.asarray, (0.5 * sign, epsilon * sign, ratio, 0.8, 0.4, 0.9)))


class TestDegenerate:
    """Eqs. (4.16)-(4.19) in closed form: any start, both directions, any number of turns."""

    @settings(max_examples=80)
    @given(ratio=RATIOS, start=reals(-20.0, 20.0), u=reals(-20.0, 20.0))
    def test_against_integration(self, ratio: float, start: float, u: float) -> None:
        def right_side(_: float, y: np.ndarray) -> list[float]:
            return [ratio * np.cos(y[0]) - 1, np.sin(y[0]), np.cos(y[0])]

        flow = degenerate_flow(ratio, start, u)
        expected = solve_ivp(right_side, (0.0, u), [start, 0, 0], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        # Near the repelling equilibrium a rounding of the start grows like this.
        growth = min(np.exp(np.sqrt(max(ratio**2 - 1, 0.0)) * abs(u)), 1e7)
        tolerance = 1e-8 + 1e-14 * growth
        assert float(flow.angle) == pytest.approx(expected[0], abs=tolerance)
        assert float(flow.slope) == pytest.approx(ratio * np.cos(expected[0]) - 1, abs=tolerance * (1 + ratio))
        assert float(flow.sine) == pytest.approx(expected[1], abs=10 * tolerance)
        assert float(flow.cosine) == pytest.approx(expected[2], abs=10 * tolerance)

    @given(ratio=RATIOS, start=reals(-20.0, 20.0), one=reals(-9.0, 9.0), other=reals(-9.0, 9.0))
    def test_is_a_flow(self, ratio: float, start: float, one: float, other: float) -> None:
        middle = degenerate_flow(ratio, start, one)
        there = degenerate_flow(ratio, float(middle.angle), other)
        direct = degenerate_flow(ratio, start, one + other)
        away = 1e-13 * np.exp(np.sqrt(max(ratio**2 - 1, 0.0)) * (abs(one) + abs(other)))
        assert float(there.angle) == pytest.approx(float(direct.angle), abs=min(1e-11 + away, 7.0))

    def test_closed_forms_of_the_paper(self) -> None:
        u, start = np.linspace(-6.0, 6.0, 41), 0.7
        below = degenerate_flow(0.6, start, u)
        phase = 2 * np.arctan(np.sqrt(1.6 / 0.4) * np.tan(start / 2))
        cosine = np.cos(np.sqrt(1 - 0.36) * u - phase)
        np.testing.assert_allclose(np.cos(below.angle), (0.6 + cosine) / (1 + 0.6 * cosine), atol=1e-14)  # (4.17)
        np.testing.assert_allclose(below.slope, (0.36 - 1) / (1 + 0.6 * cosine), rtol=1e-13)  # (4.18)
        for start, sign in ((0.7, 1.0), (2.5, -1.0)):  # errata 10: inside and outside of the equilibria
            above = degenerate_flow(1.5, start, u)
            argument = np.sqrt(2.5 / 0.5) * np.tan(start / 2)
            constant = 2 * np.arctanh(argument if sign > 0 else 1 / argument)
            expected = 1.25 / (1 + sign * 1.5 * np.cosh(np.sqrt(1.25) * u + constant))
            np.testing.assert_allclose(above.slope, expected, rtol=1e-12)

    @pytest.mark.parametrize("turn", [-1, 0, 2])
    def test_critical_case_of_the_errata(self, turn: int) -> None:
        u = np.linspace(-30.0, 30.0, 61)
        start = 1.2 + 2 * np.pi * turn
        argument = u + 1 / np.tan(1.2 / 2)
        expected = 2 * (np.pi / 2 - np.arctan(argument)) + 2 * np.pi * turn  # arccot in (0, pi)
        np.testing.assert_allclose(degenerate_flow(1.0, start, u).angle, expected, atol=1e-13)

    def test_sides_of_the_critical_rotation(self) -> None:
        # From both sides of psi~_s, for both directions: the sentence after the critical closed form.
        for rate, below, above in ((-0.4, 0.0, 2 * np.pi), (0.4, -2 * np.pi, 0.0)):
            eq = ScaledEquation(*map(np.asarray, (rate, 0.01 * np.sign(rate), 1.0, 0.2, 0.3, 0.1)))
            for start, end in ((-1e-3, below), (1e-3, above)):
                psi, yaw_rate = degenerate_motion(eq, start - 0.3, 1e9)
                assert float(psi) + 0.3 == pytest.approx(end, abs=1e-6)
                assert float(yaw_rate) == pytest.approx(rate, abs=1e-6)

    def test_equilibria_stay_and_nothing_overflows(self) -> None:
        for ratio in (1.0, 1.3, 20.0):
            rest = np.arccos(1 / ratio)
            flow = degenerate_flow(ratio, np.array([rest, -rest, rest + 4 * np.pi]), np.array([[-1e4], [1e4]]))
            np.testing.assert_allclose(flow.angle, np.tile([rest, -rest, rest + 4 * np.pi], (2, 1)), atol=1e-12)
            assert np.abs(flow.slope).max() < 1e-12


class TestOrders:
    """Leading order 1, corrected order 2, second-order period 3: over four halvings of epsilon."""

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    @pytest.mark.parametrize("ratio", [0.0, 0.6, 1.0, 1.4])
    def test_motion_off_the_slow_manifold(self, ratio: float, sign: float) -> None:
        eq = equation(ratio, sign, epsilon=0.02)
        errors = motion_errors(eq, (0.7, 0.9), np.linspace(0.0, 4.0, 200), halvings=4)
        assert observed_orders(errors.degenerate)[-1] == pytest.approx(1.0, abs=0.06)
        # With its layer the corrected motion is right to second order everywhere, psi~ and Omega alike.
        assert observed_orders(errors.corrected)[-1] == pytest.approx(2.0, abs=0.06)
        assert observed_orders(errors.corrected_rate)[-1] == pytest.approx(2.0, abs=0.06)
        assert observed_orders(errors.outside_layer)[-1] == pytest.approx(2.0, abs=0.06)
        assert np.all(observed_orders(errors.corrected) > 1.6)

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_slow_manifold_is_invariant_to_its_order(self, sign: float) -> None:
        angle = 2 * np.pi * np.arange(64) / 64
        wave = 1j * np.fft.fftfreq(64, 1 / 64)
        for order in (0, 1, 2):
            defects = []
            for epsilon in 0.02 * 0.5 ** np.arange(5):
                eq = equation(0.7, sign, epsilon)
                slope = slow_slope(eq, angle, order)
                derivative = np.fft.ifft(wave * np.fft.fft(slope)).real
                damping = 1 + eq.epsilon * eq.k * np.sin(angle + eq.delta)
                defects.append(np.abs((eq.epsilon * derivative + damping) * slope + 1 - 0.7 * np.cos(angle)).max())
            assert observed_orders(np.array(defects))[-1] == pytest.approx(order + 1, abs=0.1)

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    @pytest.mark.parametrize("ratio", [0.2, 0.6, 0.9])
    def test_period_mean_and_amplitude(self, ratio: float, sign: float) -> None:
        family = halved(equation(ratio, sign, epsilon=0.02), 4)
        full = rotating_orbits(family, 1e-13)
        for order in (0, 1, 2):
            periods = observed_orders(asymptotic_period(family, order) - full.period)
            means = observed_orders(asymptotic_mean_yaw_rate(family, order) - full.mean_yaw_rate)
            assert periods[-1] == pytest.approx(order + 1, abs=0.15)
            assert means[-1] == pytest.approx(order + 1, abs=0.15)
        for order in (0, 1):
            amplitudes = observed_orders(asymptotic_amplitude(family, order) - full.amplitude)
            assert amplitudes[-1] == pytest.approx(order + 1, abs=0.15)

    def test_period_is_the_integral_over_the_slow_manifold(self) -> None:
        eq = equation(0.5, 1.0, 1e-3)
        integral, _ = quad(lambda x: -1 / float(slow_slope(eq, x, 2)), 0, 2 * np.pi, epsabs=1e-13)
        assert float(asymptotic_period(eq, 2)) == pytest.approx(integral / 0.5, rel=1e-8)


class TestYoubot:
    """The table of ten radii below the critical one, at the paper's rate."""

    def test_ten_radii(self) -> None:
        c = yaw_coefficients(youbot(), POINT)
        critical = float(circle_quantities(c, 1.0, -0.4).critical_radius)
        radii = critical * np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99])
        table = rotation_table(c, -0.4, radii)
        epsilon = float(scaled_equation(c, 0.6, -0.4).epsilon)
        # For this platform K sin(delta) is 0.002 to 0.008: even the leading period is right to about epsilon squared.
        assert np.abs(table["period_asymptotic_error"]).max() < epsilon**2
        assert np.all(np.abs(table["period_second_order_error"]) < 2e-6)
        assert np.abs(table["amplitude_asymptotic_error"]).max() < 0.02
        assert np.all(np.diff(table["period_s"]) > 0)
        assert np.all(np.diff(table["amplitude_rad_s"]) > 0)

    def test_limits_of_the_period(self) -> None:
        eq = ScaledEquation(*map(np.asarray, (-0.4, -0.05, np.array([0.0, 1.0, 1.5]), 0.0, 0.0, 0.0)))
        for order in (0, 1, 2):
            period = asymptotic_period(eq, order)
            assert period[0] == pytest.approx(2 * np.pi / 0.4, rel=1e-15)
            assert np.all(period[1:] == np.inf)
