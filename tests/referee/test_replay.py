"""The independent integrator: closed forms, quadrature, and failures."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from occ.control import PythonControl
from occ.integration import IntegrationError
from occ.model.presets import youbot
from occ.referee.replay import Replay, ReplaySettings, gauss_lobatto


@pytest.mark.parametrize("count", [2, 3, 5, 8, 12])
def test_gauss_lobatto_is_exact_to_its_degree(count: int) -> None:
    x, w = gauss_lobatto(count)
    assert x[0] == 0.0
    assert x[-1] == pytest.approx(1.0, abs=1e-15)
    for power in range(2 * count - 2):
        assert w @ x**power == pytest.approx(1 / (power + 1), rel=1e-12)
    if count < 8:
        assert abs(w @ x ** (2 * count - 2) - 1 / (2 * count - 1)) > 1e-10


def coasting(speed: float, duration: float, settings: ReplaySettings | None = None) -> Replay:
    """Straight ahead without torques: V_X = V_0 exp(-zeta_X t / m_a) when the centre of mass is at O."""
    platform = youbot(mass_center=(0.0, 0.0))
    return Replay(
        platform, PythonControl(lambda t, x: np.zeros(4)), np.array([0, 0, 0, speed, 0, 0.0]), duration, settings
    )


class TestCoasting:
    """A platform that coasts to rest has a closed form."""

    tau = (29.94 + 4 * 1.40 + 4 * 5.87e-3 / 0.0475**2) / (4 * 0.110 / 0.0475**2)

    def test_motion(self) -> None:
        replay = coasting(0.5, 2.0)
        t = np.linspace(0, 2.0, 33)
        state = replay.at(t)
        np.testing.assert_allclose(state[3], 0.5 * np.exp(-t / self.tau), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(state[0], 0.5 * self.tau * (1 - np.exp(-t / self.tau)), rtol=1e-10, atol=1e-12)

    def test_dissipation_is_the_kinetic_energy_lost(self) -> None:
        samples = coasting(0.5, 2.0).samples()
        lost = samples.kinetic_energy[0] - samples.kinetic_energy[-1]
        assert samples.dissipation @ samples.weight == pytest.approx(lost, rel=1e-12)
        assert samples.integrands @ samples.weight == pytest.approx(np.zeros(len(samples.integrands)), abs=1e-15)

    def test_accumulated_integrals(self) -> None:
        # Braking at constant torque on a frictionless platform: power -F (V_0 - F t / m), work -F V_0 t + F^2 t^2 / 2m.
        platform = youbot(mass_center=(0.0, 0.0), wheel_friction=0.0, roller_friction=0.0)
        mass = 29.94 + 4 * 1.40 + 4 * 5.87e-3 / 0.0475**2
        force = 4 * 0.3 / 0.0475
        start = np.array([0, 0, 0, 0.7, 0, 0.0])
        samples = Replay(platform, PythonControl(lambda t, x: np.full(4, -0.3)), start, 1.0).samples()
        t = np.linspace(0, 1.0, 37)
        found = samples.accumulated(t)
        np.testing.assert_allclose(found[0], -force * 0.7 * t + force**2 * t**2 / (2 * mass), atol=1e-11)
        np.testing.assert_allclose(found[:, -1], samples.integrands @ samples.weight, atol=1e-11)


class TestKnots:
    """Torques that jump are integrated piece by piece."""

    def test_a_step_of_torque(self) -> None:
        platform = youbot(mass_center=(0.0, 0.0), wheel_friction=0.0, roller_friction=0.0)
        mass = 29.94 + 4 * 1.40 + 4 * 5.87e-3 / 0.0475**2
        control = PythonControl(lambda t, x: np.full(4, 0.5 if t < 0.3 else -0.2), knots=np.array([0.3]))
        replay = Replay(platform, control, np.zeros(6), 1.0)
        force = 4 / 0.0475
        speed = force / mass * (0.5 * 0.3 - 0.2 * 0.7)
        assert replay.end_state[3] == pytest.approx(speed, rel=2e-3)

    def test_a_kink_of_the_power_splits_the_quadrature(self) -> None:
        # Force that changes its sign at t = 1/3 on a frictionless platform: power is quadratic around the kink.
        platform = youbot(mass_center=(0.0, 0.0), wheel_friction=0.0, roller_friction=0.0)
        mass = 29.94 + 4 * 1.40 + 4 * 5.87e-3 / 0.0475**2
        control = PythonControl(lambda t, x: np.full(4, 1.0 - 3.0 * t))
        samples = Replay(platform, control, np.zeros(6), 0.6).samples()
        speed = Polynomial([0.0, 4 / 0.0475 / mass, -1.5 * 4 / 0.0475 / mass])
        power = speed * Polynomial([4 / 0.0475, -3 * 4 / 0.0475])
        integral = power.integ()
        positive = integral(1 / 3) - integral(0.0)
        found = samples.integrands[1] @ samples.weight
        assert found == pytest.approx(positive, rel=1e-11)


class TestFailure:
    """A motion that cannot be followed is said so, with the time."""

    def test_a_torque_that_blows_up(self) -> None:
        with pytest.raises(IntegrationError, match=r"t = 0\.[5-9]\d* s"):
            Replay(youbot(), PythonControl(lambda t, x: np.full(4, 1.0 if t < 0.5 else np.inf)), np.zeros(6), 1.0)

    def test_an_unstable_feedback(self) -> None:
        with pytest.raises(IntegrationError, match="physical range"):
            Replay(youbot(), PythonControl(lambda t, x: np.full(4, 1e3 * x[3] + 1.0)), np.zeros(6), 50.0)
