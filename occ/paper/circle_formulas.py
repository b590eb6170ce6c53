"""Section 4 of the paper as printed, against the derived model and against numerical integration."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property

import casadi as ca
import numpy as np

from occ.model.coefficients import coefficients
from occ.model.constraint import PathSymbols, path_functions
from occ.model.presets import YouBot
from occ.numeric import evaluate_many
from occ.paper.formula import Check, claim, relative
from occ.paper.numbers import POINT, RADIUS, RATE
from occ.paper.symbols import SEED, TRIALS, OfPreset
from occ.theory.stability import singular_point


class CircleTruth(OfPreset):
    """The yaw motion on a circle by the derived model, and the paper's symbols for it."""

    @cached_property
    def yaw(self) -> dict[str, float]:
        """Eq. (3.10) at the point of section 4."""
        return dict(self.symbols.yaw(*POINT))

    def acceleration(self, psi: np.ndarray, psi_rate: np.ndarray, radius: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """psi~'' of the servo-constraint law: (3, N) with its derivatives with respect to psi~ and psi~'."""
        zero = np.zeros_like(psi)
        # At t = 0 and phi_B = 0 the heading is psi~, and B moves along y.
        return evaluate_many(
            _servo_with_slopes(),
            coefficients(self.preset.platform()),
            np.array(POINT),
            psi[None],
            (psi_rate + rate)[None],
            np.array([zero, radius * rate]),
            np.array([-radius * rate**2, zero]),
            shared=(0, 1),
        )[0]

    def eigenvalues(self, psi: np.ndarray, radius: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """(2, N) of the derived yaw motion, linearised at steady rotations."""
        _, stiffness, damping = self.acceleration(psi, np.zeros_like(psi), radius, rate)
        root = np.sqrt((damping / 2) ** 2 + stiffness + 0j)
        return np.array([damping / 2 + root, damping / 2 - root])

    def angles(self, rate: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """R~_B and alpha, eq. (4.5)."""
        k = self.yaw
        cosine, sine = k["xi_1"] + k["kappa_22"] * rate, k["xi_2"] - k["kappa_21"] * rate
        return k["xi_3"] / np.hypot(cosine, sine), np.arctan2(sine, cosine)

    @property
    def spin(self) -> tuple[float, float]:
        """V~_B and beta, eq. (4.5)."""
        k = self.yaw
        cosine, sine = k["kappa_11"] - k["kappa_21"], k["kappa_12"] - k["kappa_22"]
        return k["xi_3"] / math.hypot(cosine, sine), math.atan2(sine, cosine)


def _servo_with_slopes() -> ca.Function:
    s = PathSymbols.create(4)
    value = path_functions(4)["servo"](*s)
    slopes = ca.vertcat(value, ca.jacobian(value, s.heading), ca.jacobian(value, s.yaw_rate))
    return ca.Function("servo_with_slopes", [*s], [ca.densify(slopes)])


def circle_checks(preset: YouBot) -> list[Check]:
    """The displayed formulas of section 4 and of the end of section 5.

    Args:
        preset: the platform's parameters.

    Returns:
        In the order of the paper.
    """
    truth = CircleTruth(preset)
    return [*_yaw_equation(truth), *_steady(truth), *_scaled(truth), *_singular(truth), *_turning(truth)]


def _random() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """psi~, psi~', R_B, omega_B of either sign."""
    rng = np.random.default_rng(SEED)
    return (
        rng.uniform(-4, 4, TRIALS),
        rng.uniform(-2, 2, TRIALS),
        rng.uniform(0.1, 2, TRIALS),
        rng.uniform(0.1, 2, TRIALS) * rng.choice([-1, 1], TRIALS),
    )


def _yaw_equation(truth: CircleTruth) -> Iterator[Check]:
    k = truth.yaw
    psi, d_psi, radius, rate = _random()
    wanted = truth.acceleration(psi, d_psi, radius, rate)[0]
    along = k["kappa_12"] * d_psi - k["xi_1"] - k["kappa_22"] * (d_psi + rate)
    across = k["kappa_11"] * d_psi + k["xi_2"] - k["kappa_21"] * (d_psi + rate)
    got = -k["xi_3"] * (d_psi + rate) - radius * rate * (along * np.cos(psi) + across * np.sin(psi))
    yield Check("(4.3)", "the yaw equation on the circle", relative(got, wanted))
    (critical, alpha), (speed, beta) = truth.angles(rate), truth.spin
    damping = k["xi_3"] * (1 + radius * rate / speed * np.sin(psi + beta))
    got = -damping * d_psi - rate * k["xi_3"] * (1 - radius / critical * np.cos(psi + alpha))
    yield Check("(4.4), (4.5)", "the same by R~_B, V~_B, alpha and beta", relative(got, wanted))


def _steady(truth: CircleTruth) -> Iterator[Check]:
    rng = np.random.default_rng(SEED)
    rate = rng.uniform(0.1, 2, TRIALS) * rng.choice([-1, 1], TRIALS)
    critical, alpha = truth.angles(rate)
    radius = critical * rng.uniform(1.05, 3, TRIALS)
    zero = np.zeros(TRIALS)
    roots = {sign: sign * np.arccos(critical / radius) - alpha for sign in (1, -1)}
    rest = np.abs([truth.acceleration(psi, zero, radius, rate)[0] for psi in roots.values()]).max()
    yield Check("(4.6)", "the two families of steady rotations", float(rest))
    # As printed psi~_s1 has the sign +, lies between -pi/2 and 0 when shifted by alpha, and is stable for omega_B < 0.
    stable = {sign: _are_stable(truth, psi, radius, rate) for sign, psi in roots.items()}
    first_is_stable = stable[1][rate < 0].all() and stable[-1][rate > 0].all()
    first_in_its_interval = bool(np.all(roots[1] + alpha < 0))
    right = _are_stable(truth, np.sign(rate) * np.arccos(critical / radius) - alpha, radius, rate)
    yield claim(
        "after (4.6), after (4.19)",
        "the labels s1 and s2 in the formulas and in the text below them; right: the stable root is "
        "psi~_s = -alpha + sign(omega_B) arccos(R~_B/R_B)",
        holds=bool(first_is_stable and first_in_its_interval),
        otherwise=bool(right.all()),
    )
    (speed, beta), k = truth.spin, truth.yaw
    errors = []
    for psi in roots.values():
        _, stiffness, damping = truth.acceleration(psi, zero, radius, rate)
        errors.append(relative(k["xi_3"] * (1 + radius * rate / speed * np.sin(psi + beta)), -damping))
        errors.append(relative(radius / critical * rate * k["xi_3"] * np.sin(psi + alpha), -stiffness))
    yield Check("(4.7)", "the yaw motion linearised at a steady rotation", max(errors))


def _are_stable(truth: CircleTruth, psi: np.ndarray, radius: np.ndarray, rate: np.ndarray) -> np.ndarray:
    return truth.eigenvalues(psi, radius, rate).real.max(axis=0) < 0


def _scaled(truth: CircleTruth) -> Iterator[Check]:
    k, (speed, beta) = truth.yaw, truth.spin
    psi, d_psi, radius, rate = _random()
    critical, alpha = truth.angles(rate)
    epsilon, sign = np.abs(rate) / k["xi_3"], np.sign(rate)
    strength = radius * k["xi_3"] / speed
    # In the time tau = |omega_B| t.
    slope = d_psi / np.abs(rate)

    def second(brace: np.ndarray) -> np.ndarray:
        return -(brace * slope + sign * (1 - radius / critical * np.cos(psi + alpha))) / epsilon

    wanted = truth.acceleration(psi, d_psi, radius, rate)[0] / rate**2
    yield Check(
        "(4.9), (4.10), (4.12)",
        "the braces {1 + eps K sin(psi~ + beta)}; right: {1 + sign(omega_B) eps K sin(psi~ + beta)}",
        relative(second(1 + epsilon * strength * np.sin(psi + beta)), wanted),
        relative(second(1 + sign * epsilon * strength * np.sin(psi + beta)), wanted),
    )


def _singular(truth: CircleTruth) -> Iterator[Check]:
    s = truth.symbols
    scale = s.zeta_X * s.zeta_Y + s.m_s**2 * RATE**2
    b_X = s.m * RATE * (s.m_s * RATE * s.a_X + s.zeta_X * s.a_Y) / scale
    b_Y = s.m * RATE * (s.m_s * RATE * s.a_Y - s.zeta_Y * s.a_X) / scale
    wanted = np.array(singular_point(truth.preset.platform(), RATE))
    yield Check("(4.20)", "the point at which both terms of R~_B vanish", relative(np.array([b_X, b_Y]), wanted))


def _turning(truth: CircleTruth) -> Iterator[Check]:
    b_X, b_Y = POINT
    psi = np.linspace(-3, 3, 13)
    velocity: Callable[..., ca.DM] = path_functions(4)["velocity"]
    packed = coefficients(truth.preset.platform())
    # psi(0) with B at (0, R_B), phi_B = 90 degrees, so that B moves along -x for omega_B > 0.
    speed, pull = np.array([-RADIUS * RATE, 0.0]), np.array([0.0, -RADIUS * RATE**2])
    wanted = np.array([np.array(velocity(packed, POINT, angle, RATE, speed, pull)).ravel() for angle in psi]).T
    got = RATE * np.array([b_Y - RADIUS * np.cos(psi), RADIUS * np.sin(psi) - b_X])
    yield Check("end of section 5", "V_X and V_Y for psi = omega_B t + psi(0)", relative(got, wanted[:2]))
