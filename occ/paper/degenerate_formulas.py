"""Eqs. (4.15)-(4.19) as printed: solutions of the degenerate equation (4.14), against its numerical integration."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from occ.integration import IntegrationError
from occ.paper.formula import Check, relative
from occ.paper.numbers import RATE

STEP = 1e-20
"""Of the complex-step derivative, which has no rounding error."""
TOLERANCE = 1e-12
ALPHA = 0.1
"""[rad] Any number: the equation knows only psi~ + alpha."""


def degenerate_checks() -> list[Check]:
    """The closed forms of the degenerate problem, for omega_B of both signs.

    Returns:
        In the order of the paper.
    """
    return [*_rotating(), *_critical(), *_settling()]


def _slope(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """The derivative by a complex step, without cancellation."""
    return function(at + 1j * STEP).imag / STEP


def _integrated(ratio: float, rate: float, start: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """psi~ and psi~' of eq. (4.14) from psi~(0), by an integrator of order 8.

    Raises:
        IntegrationError: the motion cannot be followed to the end.
    """
    from scipy.integrate import solve_ivp

    def right_side(_: float, psi: np.ndarray) -> np.ndarray:
        return rate * (ratio * np.cos(psi + ALPHA) - 1)

    result = solve_ivp(
        right_side, (0, t[-1]), [start], method="DOP853", t_eval=t, rtol=TOLERANCE, atol=TOLERANCE, max_step=0.5
    )
    if not result.success:
        reached = float(result.t[-1]) if len(result.t) else 0.0
        raise IntegrationError(reached, "the degenerate equation cannot be followed any further")
    return result.y[0], right_side(0.0, result.y[0])


def _rotating() -> Iterator[Check]:
    ratio, psi = 0.8, np.linspace(-2.5, 2.5, 21)
    root = np.sqrt(1 - ratio**2)
    integral = _slope(lambda x: -2 / root * np.arctan(root * np.tan((x + ALPHA) / 2) / (1 - ratio)), psi)
    yield Check("(4.16)", "the integral for rho < 1", relative(integral, 1 / (ratio * np.cos(psi + ALPHA) - 1)))
    start = 0.5
    constant = 2 * np.arctan(np.sqrt((1 + ratio) / (1 - ratio)) * np.tan((start + ALPHA) / 2))
    tangent, unwrapped, cosine, slope = [], [], [], []
    for rate in (RATE, -RATE):
        # A turn and a half.
        t = np.linspace(0, 3 * np.pi / (abs(rate) * root), 200)
        true, true_rate = _integrated(ratio, rate, start, t)
        phase = root * rate * t - constant
        half = -2 * np.arctan(np.sqrt((1 - ratio) / (1 + ratio)) * np.tan(phase / 2))
        # psi~ + alpha and -phase pass odd multiples of pi together.
        turns = 2 * np.pi * np.round(-phase / (2 * np.pi))
        tangent.append(relative(half - ALPHA, true))
        unwrapped.append(relative(half + turns - ALPHA, true))
        cosine.append(relative((ratio + np.cos(phase)) / (1 + ratio * np.cos(phase)), np.cos(true + ALPHA)))
        slope.append(relative((ratio**2 - 1) * rate / (1 + ratio * np.cos(phase)), true_rate))
    yield Check(
        "before (4.17)",
        "psi~(t) by the tangent of half the angle, on one branch of arctg only; right: add 2 pi at each odd multiple "
        "of pi (unwrapping)",
        max(tangent),
        max(unwrapped),
    )
    yield Check("(4.17)", "cos(psi~ + alpha) for rho < 1", max(cosine))
    yield Check("(4.18)", "psi~' for rho < 1", max(slope))
    # Trapezoidal rule over a whole turn: exact to rounding for a smooth periodic function.
    turn = np.arange(256) * 2 * np.pi / 256
    period = 2 * np.pi * np.mean(1 / (1 - ratio * np.cos(turn))) / abs(RATE)
    yaw_rate = RATE + RATE * (ratio * np.cos(turn) - 1)
    yield Check(
        "after (4.18)",
        "frequency |omega_B| sqrt(1 - rho^2) of Omega, and its amplitude, which tends to |omega_B|",
        max(relative(abs(RATE) * root, 2 * np.pi / float(period)), relative(ratio * abs(RATE), np.ptp(yaw_rate) / 2)),
    )


def _critical() -> Iterator[Check]:
    psi = np.linspace(0.3, 5.5, 21)
    slope = _slope(lambda x: 1 / np.tan((x + ALPHA) / 2), psi)
    yield Check(
        "after (4.18), critical case",
        "alpha cos(psi~ + alpha) in the denominator; right: rho cos(psi~ + alpha) with rho = 1 "
        "(as printed in the copy at hand)",
        relative(1 / (ALPHA * np.cos(psi + ALPHA) - 1), slope),
        relative(1 / (np.cos(psi + ALPHA) - 1), slope),
    )
    printed, shifted = [], []
    for rate in (RATE, -RATE):
        t = np.linspace(0, 20, 100)
        for start in (-0.2, 2.0, 7.0):
            true, _ = _integrated(1.0, rate, start, t)
            # arcctg in (0, pi).
            closed = 2 * (np.pi / 2 - np.arctan(rate * t + 1 / np.tan((start + ALPHA) / 2))) - ALPHA
            printed.append(relative(closed, true))
            shifted.append(relative(closed + 2 * np.pi * np.floor((start + ALPHA) / (2 * np.pi)), true))
    yield Check(
        "before Fig. 8, critical case",
        "psi~(t) by arcctg for every start; right: so for 0 < psi~(0) + alpha < 2 pi, otherwise shifted by the "
        "multiple of 2 pi that brings the start there",
        max(printed),
        max(shifted),
    )


def _settling() -> Iterator[Check]:
    ratio, t = 1.3, np.linspace(0, 12, 100)
    root = np.sqrt(ratio**2 - 1)
    inside: list[float] = []
    real: list[float] = []
    outside: list[float] = []
    for rate in (RATE, -RATE):
        for start in (0.1, 2.0):
            _, true_rate = _integrated(ratio, rate, start, t)
            argument = np.sqrt((ratio + 1) / (ratio - 1)) * np.tan((start + ALPHA) / 2)
            sign = 1 if abs(argument) < 1 else -1
            readings = [2 * np.arctanh(argument + 0j).real]
            if sign < 0:
                readings.append(2 * np.arctanh(1 / argument))
            slopes = [(ratio**2 - 1) * rate / (1 + sign * ratio * np.cosh(root * rate * t + c)) for c in readings]
            errors = [relative(slope, true_rate) for slope in slopes]
            (inside if sign > 0 else outside).append(errors[0])
            real += errors[1:]
    yield Check("(4.19)", "psi~' for rho > 1, the inverse hyperbolic tangent complex", max(inside + outside))
    yield Check(
        "(4.19)",
        "C_2 for |argument| > 1, where the inverse hyperbolic tangent has no real value; right in real numbers: "
        "Re C_2 = 2 arth(1/argument), with the minus sign in the fraction",
        np.inf,
        max(real),
    )
    steady = np.array([np.sign(RATE) * np.arccos(1 / ratio) - ALPHA])
    decay = _slope(lambda x: RATE * (ratio * np.cos(x + ALPHA) - 1), steady)
    yield Check("after (4.19)", "psi~' decays as exp(-sqrt(rho^2 - 1) |omega_B| t)", relative(-root * abs(RATE), decay))
