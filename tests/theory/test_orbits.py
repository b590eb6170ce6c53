"""Rotational motions: the boundary value problem against shooting, integration, the full platform and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.integrate import solve_ivp

from occ.laws import ServoLaw
from occ.model.presets import youbot
from occ.referee import examine
from occ.task import Start
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import yaw_coefficients
from occ.theory.equation import ScaledEquation, reduced_motion, scaled_equation, scaled_right_side
from occ.theory.orbits import Orbits, one_turn, rotating_orbit, rotating_orbits
from occ.theory.shooting import shoot
from tests.strategies import reals
from tests.tasks import POINT, paper_task


def equation(epsilon: float, ratio: float, spin: float, delta: float) -> ScaledEquation:
    """With spin = |epsilon| K."""
    numbers = (0.5 * np.sign(epsilon), epsilon, ratio, spin / abs(epsilon), 0.3, delta)
    return ScaledEquation(*map(np.asarray, numbers))


class TestOneOrbit:
    """Independent derivations of the same motion."""

    @settings(max_examples=15)
    @given(
        epsilon=reals(0.05, 2.0),
        ratio=reals(0.0, 0.97),
        spin=reals(0.0, 0.9),
        delta=reals(-3.0, 3.0),
        side=reals(-1, 1),
    )
    def test_against_shooting(self, epsilon: float, ratio: float, spin: float, delta: float, side: float) -> None:
        eq = equation(epsilon * (1 if side > 0 else -1), ratio, spin, delta)
        found, shot = rotating_orbits(eq), shoot(eq)
        assert shot is not None
        assert float(found.period) == pytest.approx(float(shot.moments.duration) / 0.5, rel=1e-7)
        assert float(found.amplitude) == pytest.approx((shot.extremes[1] - shot.extremes[0]) / 4, rel=1e-6, abs=1e-9)
        mean_damping = float(shot.moments.damping(eq)) * 0.5 / epsilon
        assert float(found.mean_damping) == pytest.approx(mean_damping, rel=1e-7)

    def test_multiplier_is_the_derivative_of_the_return_map(self) -> None:
        eq = equation(-0.9, 0.5, 0.4, 0.7)
        orbit = rotating_orbit(eq)
        assert orbit is not None
        slope = (orbit.yaw_rate - eq.rate) / eq.rate
        start = np.array([float(orbit.psi_tilde[0] + eq.alpha), float(slope[0])])

        def returned(offset: float) -> float:
            def turned(_: float, y: np.ndarray) -> float:
                return 2 * np.pi - abs(y[0] - start[0])

            turned.terminal = True
            result = solve_ivp(
                scaled_right_side(eq),
                (0, 1e3),
                (start[0], start[1] + offset),
                "DOP853",
                events=turned,
                rtol=1e-12,
                atol=1e-13,
            )
            return float(result.y_events[0][0][1])

        assert returned(0.0) == pytest.approx(start[1], abs=1e-10)
        step = 1e-4
        assert (returned(step) - returned(-step)) / (2 * step) == pytest.approx(float(orbit.orbit.multiplier), rel=1e-4)

    def test_is_what_every_start_goes_to(self) -> None:
        c = yaw_coefficients(youbot(), POINT)
        eq = scaled_equation(c, 0.5, 0.8)
        orbit = rotating_orbit(eq)
        assert orbit is not None
        period = float(orbit.orbit.period)
        for start in ((2.0, 3.0), (-1.0, -2.0)):
            t = np.array([0.0, 5 * period, 6 * period])
            psi, yaw_rate = reduced_motion(c, 0.5, 0.8, start, t)
            assert psi[2] - psi[1] == pytest.approx(-2 * np.pi, abs=1e-8)
            assert yaw_rate[2] == pytest.approx(yaw_rate[1], abs=1e-9)

    @pytest.mark.parametrize(("radius", "rate"), [(0.2, -0.4), (0.6, -0.4), (0.6, 0.9)])
    def test_full_platform_repeats_after_the_period(self, radius: float, rate: float) -> None:
        eq = scaled_equation(yaw_coefficients(youbot(), POINT), radius, rate)
        orbit = rotating_orbit(eq)
        assert orbit is not None
        period = float(orbit.orbit.period)
        start = Start(heading=float(orbit.psi_tilde[3]) + np.pi / 2, heading_rate=float(orbit.yaw_rate[3]))
        task = paper_task(period, rate=rate, radius=radius, start=start)
        samples = examine(task, ServoLaw().solve(task)).samples
        assert samples is not None
        end = samples.state[:, -1]
        # The program has turned by rate times the period, and psi~ by one turn against it.
        expected = start.heading + rate * period - np.sign(rate) * 2 * np.pi
        assert end[2] == pytest.approx(expected, abs=1e-8)
        assert end[5] == pytest.approx(start.heading_rate, abs=1e-8)
        mean = (end[2] - start.heading) / period
        assert float(orbit.orbit.mean_yaw_rate) == pytest.approx(mean, abs=1e-9)
        yaw_rate = samples.state[5]
        assert float(orbit.orbit.amplitude) == pytest.approx((yaw_rate.max() - yaw_rate.min()) / 2, rel=1e-4)

    def test_means_over_the_period(self) -> None:
        for ratio in (0.5, 0.99999):
            eq = equation(-0.05, ratio, 0.2, 0.9)
            orbit = rotating_orbit(eq)
            assert orbit is not None
            turn = one_turn(eq, orbit)
            assert float((turn.share * turn.yaw_rate).sum()) == pytest.approx(
                float(orbit.orbit.mean_yaw_rate), abs=1e-9
            )


class TestMany:
    """Batches, and the ends of the parameters."""

    def test_without_gyroscopic_terms_and_push_it_is_exact(self) -> None:
        # rho = 0, K = 0: Omega = 0 exactly.
        found = rotating_orbits(ScaledEquation(*map(np.asarray, (-0.4, -0.05, 0.0, 0.0, 0.0, 0.0))))
        assert float(found.period) == pytest.approx(2 * np.pi / 0.4, rel=1e-14)
        assert float(found.mean_yaw_rate) == pytest.approx(0.0, abs=1e-15)
        assert float(found.amplitude) == pytest.approx(0.0, abs=1e-15)
        assert float(found.mean_damping) == pytest.approx(8.0, rel=1e-13)

    def test_2000_circles_of_the_youbot_converge(self) -> None:
        rng = np.random.default_rng(1)
        c = yaw_coefficients(youbot(), POINT)
        rate = rng.uniform(0.05, 1.0, 2000) * rng.choice([-1.0, 1.0], 2000)
        radius = circle_quantities(c, 1.0, rate).critical_radius * (1 - 10 ** rng.uniform(-5, 0, 2000))
        fast = rotating_orbits(scaled_equation(c, radius, rate), 1e-8)
        assert fast.converged.all()
        assert np.all(fast.multiplier < 1)
        some = slice(0, 300)
        fine = rotating_orbits(scaled_equation(c, radius[some], rate[some]), 1e-13)
        assert np.abs(fast.period[some] / fine.period - 1).max() < 1e-7
        assert np.abs(fast.amplitude[some] - fine.amplitude).max() < 1e-8

    def test_shapes(self) -> None:
        c = yaw_coefficients(youbot(), POINT)
        found = rotating_orbits(scaled_equation(c, np.array([[0.3], [0.5]]), np.array([-0.4, 0.4, 0.8])))
        assert {value.shape for value in found} == {(2, 3)}

    def test_at_and_near_the_critical_radius(self) -> None:
        eq = equation(-0.05, 1.0, 0.01, 0.9)
        found = rotating_orbits(eq)
        assert found.converged
        assert found.period == np.inf
        assert float(found.mean_yaw_rate) == -0.5
        near = rotating_orbits(eq._replace(ratio=np.asarray(1 - 1e-12)))
        assert float(near.period) * np.sqrt(2e-12) * 0.5 == pytest.approx(2 * np.pi, rel=0.01)

    def test_corner_near_the_critical_radius_is_shot(self) -> None:
        found = rotating_orbits(equation(0.418, 1 - 1e-6, 0.257, 2.957))
        assert found.converged
        assert found.harmonics == 0

    def test_no_motion_is_nan_and_not_an_error(self) -> None:
        nothing = rotating_orbits(equation(0.05, 3.0, 0.01, 0.9))
        assert not nothing.converged
        assert np.isnan([float(value) for value in nothing[:5]]).all()
        c = yaw_coefficients(youbot(wheel_friction=0.0, roller_friction=0.0), POINT)
        assert isinstance(rotating_orbits(scaled_equation(c, 0.7, -0.4)), Orbits)
        assert rotating_orbit(scaled_equation(c, 0.7, -0.4)) is None
