"""A second derivation: Lagrange's equations with multipliers on all 11 coordinates of the youBot, by SymPy.

It shares nothing with the package: kinetic energy in the fixed frame, eight no-slip constraints from the velocity of
the contact points (2.2), bearing torques on the angles themselves, a linear system of 11 accelerations and 8
multipliers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from occ.model.dynamics import dynamics
from occ.model.presets import YouBot, youbot
from tests.strategies import states, vectors, youbot_overrides

# Section 2.1 of the paper: signs of delta_i = -45, 45, 45, -45 degrees and of the corners (rho_X, rho_Y) = (+-h, +-l).
CORNERS = [(-1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, -1, -1)]

Accelerations = Callable[[YouBot, float, np.ndarray, np.ndarray], np.ndarray]


@pytest.fixture(scope="module")
def accelerations() -> Accelerations:
    """(numbers, I_1, state (6,), torque (4,)) -> pi'' (3,)."""
    m, m_1, i_c, i_1, j_1 = sp.symbols("m m_1 I_C I_1 J_1")
    a_x, a_y, mu_1, mu_2, h, l, R, r = sp.symbols("a_X a_Y mu_1 mu_2 h l R r")
    parameters = [m, m_1, i_c, i_1, j_1, a_x, a_y, mu_1, mu_2, h, l, R, r]
    x, y, psi = sp.symbols("x y psi")
    phi, gamma = sp.symbols("phi1:5"), sp.symbols("gamma1:5")
    q = sp.Matrix([x, y, psi, *phi, *gamma])
    dq = sp.Matrix([sp.Symbol(f"d_{symbol}") for symbol in q])
    d_psi, d_phi, d_gamma = dq[2], dq[3:7], dq[7:11]
    torque = sp.symbols("M1:5")

    to_floor = sp.Matrix([[sp.cos(psi), -sp.sin(psi), 0], [sp.sin(psi), sp.cos(psi), 0], [0, 0, 1]])
    up = sp.Matrix([0, 0, 1])

    def velocity_of(body_point: sp.Matrix) -> sp.Matrix:
        place = sp.Matrix([x, y, 0]) + to_floor * body_point
        return place.jacobian(q) * dq

    center = velocity_of(sp.Matrix([a_x, a_y, 0]))
    energy = m * center.dot(center) / 2 + i_c * d_psi**2 / 2
    constraints = []
    for i, (sign, front, left) in enumerate(CORNERS):
        hub = sp.Matrix([front * h, left * l, 0])
        v_hub = velocity_of(hub)
        energy += m_1 * v_hub.dot(v_hub) / 2 + i_1 * d_psi**2 / 2 + j_1 * d_phi[i] ** 2 / 2
        axle = to_floor * sp.Matrix([0, 1, 0])
        roller_axis = to_floor * sp.Matrix([1, sign, 0]) / sp.sqrt(2)
        slip = v_hub + (d_phi[i] * axle).cross(-R * up) + (d_gamma[i] * roller_axis).cross(-r * up)
        assert slip[2] == 0
        constraints += [slip[0], slip[1]]
    slips = sp.Matrix(constraints)

    momentum = sp.Matrix([energy]).jacobian(dq).T
    mass_matrix = momentum.jacobian(dq)
    velocity_terms = momentum.jacobian(q) * dq - sp.Matrix([energy]).jacobian(q).T
    slip_matrix = slips.jacobian(dq)
    slip_terms = slips.jacobian(q) * dq
    forces = sp.zeros(11, 1)
    for i in range(4):
        forces[3 + i] = torque[i] - mu_1 * d_phi[i]
        forces[7 + i] = -mu_2 * d_gamma[i]
    numeric = sp.lambdify(
        [list(q), list(dq), list(torque), parameters],
        [mass_matrix, slip_matrix, forces - velocity_terms, slip_terms],
        "numpy",
        cse=True,
    )

    def solve(numbers: YouBot, wheel_yaw_inertia: float, state: np.ndarray, torque: np.ndarray) -> np.ndarray:
        n, (c_x, c_y) = numbers, numbers.mass_center
        # After (2.8) and (2.15): I_s = I_C + m (a_X^2 + a_Y^2) + 4 (I_1 + m_1 (h^2 + l^2)).
        central = n.yaw_inertia - n.platform_mass * (c_x**2 + c_y**2) - 4 * wheel_yaw_inertia
        central -= 4 * n.wheel_mass * (n.half_wheelbase**2 + n.half_track**2)
        values = [n.platform_mass, n.wheel_mass, central, wheel_yaw_inertia, n.wheel_spin_inertia, c_x, c_y]
        values += [n.wheel_friction, n.roller_friction, n.half_wheelbase, n.half_track, n.wheel_radius]
        values.append(n.roller_radius)

        heading, (v_x, v_y, omega) = state[2], state[3:]
        c, s = np.cos(heading), np.sin(heading)
        coordinates = np.concatenate([state[:3], np.linspace(-1.0, 2.0, 8)])
        rates = np.concatenate([[c * v_x - s * v_y, s * v_x + c * v_y, omega], np.zeros(8)])
        # Wheel and roller rates that the eight constraints ask for.
        slip_matrix = numeric(coordinates, rates, torque, values)[1]
        rates[3:] = np.linalg.solve(slip_matrix[:, 3:], -slip_matrix[:, :3] @ rates[:3])
        mass_matrix, slip_matrix, right, slip_terms = numeric(coordinates, rates, torque, values)
        system = np.block([[mass_matrix, slip_matrix.T], [slip_matrix, np.zeros((8, 8))]])
        a = np.linalg.solve(system, np.concatenate([right[:, 0], -slip_terms[:, 0]]))
        # (2.1) differentiated: the body frame turns with Omega.
        return np.array([c * a[0] + s * a[1] + omega * v_y, -s * a[0] + c * a[1] - omega * v_x, a[2]])

    return solve


@given(numbers=youbot_overrides(), share=st.floats(0.0, 1.0), state=states(), torque=vectors(4, 3.0))
def test_forward_dynamics_are_lagranges_equations_with_multipliers(
    accelerations: Accelerations, numbers: dict[str, Any], share: float, state: np.ndarray, torque: np.ndarray
) -> None:
    # At most what leaves I_C positive on these platforms.
    wheel_yaw_inertia = share * 0.3 / 4
    expected = accelerations(YouBot(**numbers), wheel_yaw_inertia, state, torque)
    found = np.array(dynamics(youbot(**numbers)).forward(state, torque))[3:, 0]
    # Frictions and torques may nearly cancel: relative to the accelerations that each of them gives alone.
    platform = dynamics(youbot(**numbers))
    alone = [platform.forward(np.zeros(6), torque), platform.forward(state, np.zeros(4))]
    scale = sum(np.abs(np.array(rate)[3:, 0]).max() for rate in alone) + 1e-6
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("wheel_yaw_inertia", [0.0, 0.01, 0.3])
def test_the_wheels_yaw_inertia_enters_only_through_the_total(
    accelerations: Accelerations, wheel_yaw_inertia: float
) -> None:
    state, torque = np.array([1.0, -2.0, 0.7, 0.5, -0.3, 1.1]), np.array([1.2, -0.7, 0.3, 0.2])
    found = np.array(dynamics(youbot()).forward(state, torque))[3:, 0]
    np.testing.assert_allclose(accelerations(YouBot(), wheel_yaw_inertia, state, torque), found, rtol=1e-12)
