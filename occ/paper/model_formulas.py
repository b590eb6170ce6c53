"""Sections 2 and 3 of the paper as printed, against the model that CasADi derives from the energy of accelerations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from types import SimpleNamespace

import numpy as np

from occ.model.coefficients import coefficients
from occ.model.constraint import path_functions
from occ.model.dynamics import Dynamics, dynamics
from occ.model.presets import YouBot
from occ.numeric import evaluate_many
from occ.paper.formula import Check, relative
from occ.paper.numbers import POINT
from occ.paper.symbols import SEED, TRIALS, OfPreset, Symbols, random_motions

WHEEL_INERTIA = 0.01
"""[kg m^2] A value of I_1, which (2.17) does not give: only I_C + 4 I_1 enters."""


class Truth(OfPreset):
    """Random motions of the platform, and what the derived model says of them."""

    @cached_property
    def model(self) -> Dynamics:
        """The derived model."""
        return dynamics(self.preset.platform())

    @cached_property
    def velocity(self) -> np.ndarray:
        """(3, N) pi'."""
        return random_motions()[0]

    @cached_property
    def acceleration(self) -> np.ndarray:
        """(3, N) pi''."""
        return random_motions()[1]

    def of_velocity(self, name: str, velocity: np.ndarray | None = None) -> np.ndarray:
        """A function of the state alone, at random velocities or given ones (3, N)."""
        chosen = self.velocity if velocity is None else velocity
        state = np.vstack([np.zeros_like(chosen), chosen])
        return evaluate_many(self.model.functions[name], state)[0]

    def inverse(self) -> np.ndarray:
        """(3, N) the wrench that the random accelerations need."""
        state = np.vstack([np.zeros_like(self.velocity), self.velocity])
        return evaluate_many(self.model.inverse, state, self.acceleration)[0]

    def matrix(self, name: str) -> np.ndarray:
        """The inertia matrix or the input map."""
        return np.array(self.model.functions[name](np.zeros(6)))


def model_checks(preset: YouBot) -> list[Check]:
    """The displayed formulas of sections 2 and 3.

    Args:
        preset: the platform's parameters.

    Returns:
        In the order of the paper.
    """
    truth = Truth(preset)
    return [*_kinematics(truth), *_forces(truth), *_equations_of_motion(truth), *_servo_constraint(truth)]


def _kinematics(truth: Truth) -> Iterator[Check]:
    s, (v_x, v_y, omega) = truth.symbols, truth.velocity
    delta = np.radians([-45.0, 45.0, 45.0, -45.0])[:, None]
    rho_x, rho_y = np.array([[s.h, s.h, -s.h, -s.h], [s.l, -s.l, s.l, -s.l]])[:, :, None]
    phi = (v_x + v_y * np.tan(delta) + (rho_x * np.tan(delta) - rho_y) * omega) / s.R
    gamma = -(v_y + omega * rho_x) / (s.r * np.cos(delta))
    wheels, rollers = truth.of_velocity("wheel_rates"), truth.of_velocity("roller_rates")
    yield Check(
        "(2.4)", "phi_i' and gamma_i' from the contact condition", max(relative(phi, wheels), relative(gamma, rollers))
    )
    c_phi, c_gamma = _printed_maps(s)
    yield Check("after (2.4)", "matrix C_phi", relative(c_phi @ truth.velocity, wheels))
    yield Check(
        "after (2.4)",
        "matrix C_gamma with the sign +; right: C_gamma = -(sqrt(2)/r) (0 1 h; 0 1 h; 0 1 -h; 0 1 -h) "
        "(as printed in the copy at hand)",
        relative(c_gamma @ truth.velocity, rollers),
        relative(-c_gamma @ truth.velocity, rollers),
    )


def _printed_maps(s: Symbols) -> tuple[np.ndarray, np.ndarray]:
    """C_phi and C_gamma as printed after eq. (2.4)."""
    arm = s.h + s.l
    c_phi = np.array([[1, -1, -arm], [1, 1, arm], [1, 1, -arm], [1, -1, arm]]) / s.R
    c_gamma = math.sqrt(2) / s.r * np.array([[0, 1, s.h], [0, 1, s.h], [0, 1, -s.h], [0, 1, -s.h]])
    return c_phi, c_gamma


def _forces(truth: Truth) -> Iterator[Check]:
    s, velocity = truth.symbols, truth.velocity
    c_phi, c_gamma = _printed_maps(s)
    friction = truth.of_velocity("friction")
    driven = truth.matrix("input_map") @ np.ones((4, TRIALS))
    yield Check(
        "(2.5)",
        "the symbols of the control forces and of the other forces; right: Pi_C are the control forces C_phi^T M, "
        "Pi_F the friction (as printed in the copy at hand)",
        relative(friction, driven),
        relative(c_phi.T @ np.ones((4, TRIALS)), driven),
    )
    platform, wheels = _inertial_forces(truth)
    yield Check(
        "(2.6)",
        "S_p named for the platform and the wheels alike; right: S_p of the platform and S_i of wheel i",
        relative(platform - friction, truth.inverse()),
        relative(platform + wheels - friction, truth.inverse()),
    )
    yield Check(
        "(2.8), (2.10)", "dS/d(pi'') of platform and wheels", relative(platform + wheels - friction, truth.inverse())
    )
    product = c_phi.T @ c_phi
    yield Check(
        "before (2.10)",
        "C_phi^T C_phi = (4/R^2) diag(1, 1, (l + h)^2)",
        relative(4 / s.R**2 * np.diag([1, 1, (s.l + s.h) ** 2]), product),
    )
    yield Check(
        "(2.11)",
        "mu_1 in front of C_gamma^T C_gamma, here and in the line before; right: mu_2 C_gamma^T C_gamma",
        relative(-(s.mu_1 * product + s.mu_1 * c_gamma.T @ c_gamma) @ velocity, friction),
        relative(-(s.mu_1 * product + s.mu_2 * c_gamma.T @ c_gamma) @ velocity, friction),
    )
    damping = np.array([s.zeta_X, s.zeta_Y, s.mu_Omega])[:, None]
    yield Check("after (2.11)", "zeta_X, zeta_Y, mu_Omega", relative(-damping * velocity, friction))
    arm = s.l + s.h
    printed = np.array([[1, 1, 1, 1], [-1, 1, 1, -1], [-arm, arm, -arm, arm]]) / s.R
    yield Check("(2.12)", "F_X, F_Y, M_Omega of the torques", relative(printed, truth.matrix("input_map")))


def _inertial_forces(truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Eqs. (2.8) and (2.10) as printed; I_C is what I_s and `WHEEL_INERTIA` leave for it."""
    s, (v_x, v_y, omega), (d_x, d_y, d_omega) = truth.symbols, truth.velocity, truth.acceleration
    wheel = WHEEL_INERTIA + s.m_1 * (s.h**2 + s.l**2)
    i_o = s.I_s - 4 * wheel
    w_x, w_y = d_x - omega * v_y, d_y + omega * v_x
    platform = np.array(
        [
            s.m * w_x - s.m * s.a_Y * d_omega - s.m * s.a_X * omega**2,
            s.m * w_y + s.m * s.a_X * d_omega - s.m * s.a_Y * omega**2,
            i_o * d_omega - s.m * s.a_Y * w_x + s.m * s.a_X * w_y,
        ]
    )
    wheels = np.array(
        [
            s.m_1 * s.R**2 * w_x + s.J_1 * d_x,
            s.m_1 * s.R**2 * w_y + s.J_1 * d_y,
            wheel * s.R**2 * d_omega + s.J_1 * (s.l + s.h) ** 2 * d_omega,
        ]
    )
    return platform, 4 / s.R**2 * wheels


def _equations_of_motion(truth: Truth) -> Iterator[Check]:
    s, (v_x, v_y, omega), (d_x, d_y, d_omega) = truth.symbols, truth.velocity, truth.acceleration
    m_x, m_y = s.m * s.a_X, s.m * s.a_Y
    wrench = [
        s.m_a * d_x - s.m_s * omega * v_y - m_y * d_omega - m_x * omega**2 + s.zeta_X * v_x,
        s.m_a * d_y + s.m_s * omega * v_x + m_x * d_omega - m_y * omega**2 + s.zeta_Y * v_y,
        s.I_a * d_omega - m_y * (d_x - omega * v_y) + m_x * (d_y + omega * v_x) + s.mu_Omega * omega,
    ]
    yield Check("(2.13)-(2.15)", "the equations of motion", relative(np.array(wrench), truth.inverse()))
    inertia = np.array([[s.m_a, 0, -m_y], [0, s.m_a, m_x], [-m_y, m_x, s.I_a]])
    quadratic = np.array(
        [
            -s.m_s * omega * v_y - m_x * omega**2,
            s.m_s * omega * v_x - m_y * omega**2,
            m_y * omega * v_y + m_x * omega * v_x,
        ]
    )
    errors = [
        relative(inertia, truth.matrix("inertia_matrix")),
        relative(quadratic, truth.of_velocity("gyroscopic")),
    ]
    yield Check("(2.16)", "A and f", max(errors))
    force_x, force_y, moment = truth.velocity
    share = moment / (s.h + s.l)
    torques = s.R / 4 * np.array(
        [force_x - force_y - share, force_x + force_y + share, force_x + force_y - share, force_x - force_y + share]
    )  # fmt: skip
    yield Check(
        "after (3.13)",
        "the torques of least norm",
        relative(torques, evaluate_many(truth.model.min_norm_torque, truth.velocity)[0]),
    )


def _program(truth: Truth) -> SimpleNamespace:
    """Random motions with B on its program: V*, dV*/dt, Omega, the law's Omega' and wrench, and pi', pi''."""
    rng = np.random.default_rng(SEED)
    heading, omega, *floor = rng.uniform(-1, 1, (6, TRIALS))
    floor_velocity, floor_acceleration = np.array(floor[:2]), np.array(floor[2:])
    functions, point = path_functions(4), np.array(POINT)
    packed = coefficients(truth.preset.platform())
    arguments = (packed, point, heading[None], omega[None], floor_velocity, floor_acceleration)
    (d_omega,) = evaluate_many(functions["servo"], *arguments, shared=(0, 1))
    (wrench,) = evaluate_many(functions["wrench"], *arguments, d_omega, shared=(0, 1))
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, s], [-s, c]])
    v_star = np.einsum("ijn,jn->in", turn, floor_velocity)
    a_star = np.einsum("ijn,jn->in", turn, floor_acceleration)
    # Components in the body frame, which turns with Omega.
    d_star = a_star + omega * np.array([v_star[1], -v_star[0]])
    direction = np.array([point[1], -point[0], 1.0])[:, None]
    velocity = direction * omega + np.vstack([v_star, np.zeros(TRIALS)])
    acceleration = direction * d_omega + np.vstack([d_star, np.zeros(TRIALS)])
    motion = {"omega": omega, "d_omega": d_omega[0], "velocity": velocity, "acceleration": acceleration}
    return SimpleNamespace(v=v_star, dv=d_star, wrench=wrench, **motion)


def _servo_constraint(truth: Truth) -> Iterator[Check]:
    s, p, (b_X, b_Y) = truth.symbols, _program(truth), POINT
    k, j_a = SimpleNamespace(**s.yaw(b_X, b_Y)), s.J_a(b_X, b_Y)
    c = np.array([b_Y, -b_X, 1.0])
    true_inertia = float(c @ truth.matrix("inertia_matrix") @ c)
    yield Check("after (3.8), J_a, first line", "J_a = C^T A C with I_a and m_a", relative(j_a, true_inertia))
    yield Check(
        "after (3.8), J_a, second line",
        "J_a with I_C and I_1: (2.17) gives neither, only I_s, so the first line is the one to use; with any I_C and "
        "I_1 that make up I_s the second line gives the same",
        max(relative(_second_line(s, b_X, b_Y, i_1), true_inertia) for i_1 in (0.0, WHEEL_INERTIA, 0.1)),
    )
    translation = np.vstack([p.dv, np.zeros(TRIALS)])
    products = (
        ((s.m_a * b_Y - s.m * s.a_Y) * p.dv[0] - (s.m_a * b_X - s.m * s.a_X) * p.dv[1],
         c @ truth.matrix("inertia_matrix") @ translation),
        (-(s.m_s * b_X - s.m * s.a_X) * p.omega * p.v[0] - (s.m_s * b_Y - s.m * s.a_Y) * p.omega * p.v[1],
         c @ truth.of_velocity("gyroscopic", p.velocity)),
        (-s.zeta_X * b_Y * p.v[0] + s.zeta_Y * b_X * p.v[1]
         - (s.mu_Omega + s.zeta_X * b_Y**2 + s.zeta_Y * b_X**2) * p.omega,
         c @ truth.of_velocity("friction", p.velocity)),
    )  # fmt: skip
    yield Check("after (3.8)", "C^T A dV*/dt, C^T f, C^T Pi_F", max(relative(value, true) for value, true in products))
    rest = j_a * (p.d_omega + k.kappa_12 * p.dv[0] - k.kappa_11 * p.dv[1])
    rest += j_a * (-k.kappa_21 * p.omega * p.v[0] - k.kappa_22 * p.omega * p.v[1] + k.xi_2 * p.v[0] + k.xi_3 * p.omega)
    yield Check(
        "before (3.9)",
        "gamma_B b_X V_BY* with a gamma_B that is nowhere defined; right: zeta_Y b_X V_BY* "
        "(as printed in the copy at hand)",
        math.inf,
        relative(rest / (b_X * p.v[1]), s.zeta_Y * np.ones(TRIALS)),
    )
    yaw = -k.kappa_12 * p.dv[0] + k.kappa_11 * p.dv[1] + p.omega * (k.kappa_21 * p.v[0] + k.kappa_22 * p.v[1])
    yaw += -k.xi_2 * p.v[0] + k.xi_1 * p.v[1] - k.xi_3 * p.omega
    yield Check("(3.9), (3.10)", "the yaw equation and its coefficients", relative(yaw, p.d_omega))
    yield from _multipliers(s, p)


def _second_line(s: Symbols, b_X: float, b_Y: float, i_1: float) -> float:
    """J_a by its second line, with the I_C that I_s and I_1 leave."""
    i_c = s.I_s - s.m * (s.a_X**2 + s.a_Y**2) - 4 * (i_1 + s.m_1 * (s.h**2 + s.l**2))
    square = b_X**2 + b_Y**2
    offset = s.m * ((s.a_X - b_X) ** 2 + (s.a_Y - b_Y) ** 2)
    spin = s.J_1 * ((s.l + s.h) ** 2 + square) / s.R**2
    return i_c + offset + 4 * (i_1 + s.m_1 * (s.h**2 + s.l**2 + square) + spin)


def _multipliers(s: Symbols, p: SimpleNamespace) -> Iterator[Check]:
    b_X, b_Y = POINT
    (v_x, v_y, omega), (d_x, d_y, d_omega) = p.velocity, p.acceleration
    m_x, m_y = s.m * s.a_X, s.m * s.a_Y
    first = s.m_a * d_x - m_y * d_omega - s.m_s * omega * v_y - m_x * omega**2 + s.zeta_X * v_x
    yield Check("(3.11)", "lambda_1 = F_X", relative(first, p.wrench[0]))
    # Printed into itself: lambda_2 = m_a V_Y' + m a_X Omega' + m_s Omega lambda_2 = ...
    into_itself = (s.m_a * d_y + m_x * d_omega) / (1 - s.m_s * omega)
    second = s.m_a * d_y + m_x * d_omega + s.m_s * omega * v_x - m_y * omega**2 + s.zeta_Y * v_y
    yield Check(
        "(3.12)",
        "lambda_2 printed into itself; right: lambda_2 = m_a V_Y' + m a_X Omega' + m_s Omega V_X - m a_Y Omega^2 "
        "+ zeta_Y V_Y (as printed in the copy at hand)",
        relative(into_itself, p.wrench[1]),
        relative(second, p.wrench[1]),
    )
    moment = -b_Y * p.wrench[0] + b_X * p.wrench[1]
    yield Check("(3.13)", "M_Omega = -b_Y lambda_1 + b_X lambda_2", relative(moment, p.wrench[2]))
