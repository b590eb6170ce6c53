"""The least mean cost of going round the circle for ever: a certified bound from below, a cycle from above.

From below: V without time and a constant c with L - c + V_psi~ u + V_Omega Omega' >= 0 everywhere, which a proof by
sums of squares shows; then the mean of L over an endless motion of bounded yaw rate is at least c.  From above: the
best steady rotation, psi~ constant, and the best rotation that turns psi~ for ever, u = psi~' a function of psi~ that
keeps its sign, over one turn

    mean of L = (oint L / u dpsi~) / (oint 1 / u dpsi~),    Omega' = u du/dpsi~.

Source: Finlay, Gaitsgory, Lebedev, Linear programming solutions of periodic optimization problems (2008).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import flint
import numpy as np

from occ.certify.balls import Refused
from occ.certify.bellman import Inequality
from occ.certify.long_run import least_mean_power
from occ.certify.running import Cost, inequality
from occ.certify.series import Series
from occ.certify.sos import Degree
from occ.certify.squares import BITS, SquaresCertificate, escalate
from occ.task import Task

DEGREES = tuple(Degree(0, angle) for angle in (2, 4, 8, 12, 16, 24, 32))
EFFORT = 2_000_000
"""Of the programs of one cost together: all degrees are tried unless some need several margins."""
POINTS = 256
"""Angles at which a cycle's mean is summed up."""
WAVES = 16
"""Harmonics of the logarithm of a cycle's rate."""


UNITS: dict[Cost, str] = {"work": "W", "torque_squared": "N^2 m^2", "electric": "W"}
"""Of the mean costs."""


@dataclass(frozen=True)
class Cycle:
    """The best endless motion known.

    Args:
        mean: of the cost, per second.
        turns: whether psi~ turns for ever; otherwise the rotation is steady.
        angle: [rad] psi~ of the best steady rotation.
    """

    mean: float
    turns: bool
    angle: float


@dataclass(frozen=True)
class EndlessBound:
    """Least mean cost over all endless motions from any start.

    Args:
        certificate: of the lower bound.
        cycle: from above.
    """

    certificate: SquaresCertificate
    cycle: Cycle

    def __str__(self) -> str:
        return f"{self.certificate} ({'turning' if self.cycle.turns else 'steady rotation'})"


def certify_endless(task: Task, cost: Cost, *, effort: int = EFFORT) -> EndlessBound:
    """The least mean of a cost for ever, enclosed.

    Args:
        task: on a circle; its start and horizon do not matter.
        cost: work (mean power [W]), squares of the torques [N^2 m^2] or electric energy [W].
        effort: as in `occ.certify.squares`, beyond which no further degree is begun.

    Returns:
        A certified bound and a motion that comes close to it.

    Raises:
        InputError: the motion is not a circle.
    """
    with flint.ctx.workprec(BITS):
        problem = inequality(task, cost, for_ever=True)
        cycle = best_cycle(problem)
        found = escalate(problem, DEGREES, cycle.mean, effort)
        return EndlessBound(_in_one_angle(task, found) if cost == "work" else found, cycle)


def _in_one_angle(task: Task, found: SquaresCertificate) -> SquaresCertificate:
    """Work has no curvature in the torques: a bound in psi~ alone is closer than the squares' where it is proven."""
    try:
        value = least_mean_power(task)
    except Refused:
        return found
    return found if value <= found.lower else replace(found, lower=value, proof=None, degree=None)


def endless_section(task: Task) -> dict[str, Any]:
    """The least means of all costs for ever, as plain data.

    Args:
        task: on a circle.

    Returns:
        ``long_run_bounds``: for each cost ``unit``, ``lower`` (certified), ``upper`` (a motion), ``word`` and whether
        that motion ``turns`` psi~ for ever.

    Raises:
        InputError: the motion is not a circle.
    """
    found = {cost: certify_endless(task, cost) for cost in UNITS}
    return {
        "long_run_bounds": {
            cost: {
                "unit": UNITS[cost],
                "lower": bound.certificate.lower,
                "upper": bound.cycle.mean,
                "word": bound.certificate.word,
                "turns": bound.cycle.turns,
            }
            for cost, bound in found.items()
        }
    }


def best_cycle(problem: Inequality) -> Cycle:
    """The best steady rotation, or the best cycle that turns psi~, whichever costs less.

    Args:
        problem: for ever.

    Returns:
        Its mean cost, up to rounding and a quadrature of spectral accuracy.
    """
    cost = Series({key: float(c) for key, c in problem.cost.terms.items()})
    angles = np.arange(POINTS) * (2 * np.pi / POINTS)
    fine = np.linspace(0, 2 * np.pi, 20_001)
    steady = _values(cost, fine, np.zeros_like(fine), np.zeros_like(fine))
    best = int(np.argmin(steady))
    turning = min(_turning(problem, cost, angles, sign) for sign in (1.0, -1.0))
    return Cycle(min(float(steady[best]), turning), bool(turning < steady[best]), float(fine[best]))


def _values(cost: Series, angles: np.ndarray, rate: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    waves = {h: np.cos(h * angles) if h >= 0 else np.sin(-h * angles) for h in range(-cost.degree, cost.degree + 1)}
    return np.zeros_like(angles) + cost.at(waves, rate, acceleration)


def _turning(problem: Inequality, cost: Series, angles: np.ndarray, sign: float) -> float:
    """The least mean over all u = sign exp(Fourier series)."""
    from scipy.optimize import minimize

    h = np.arange(1, WAVES + 1)[:, None]
    waves = np.vstack([np.ones_like(angles), np.cos(h * angles), np.sin(h * angles)])
    slopes = np.vstack([np.zeros_like(angles), -h * np.sin(h * angles), h * np.cos(h * angles)])
    rate, acceleration = problem.scales
    by_rate, by_acceleration = cost.by_rate(), cost.by_acceleration()

    def mean(p: np.ndarray) -> tuple[float, np.ndarray]:
        u, slope = sign * np.exp(np.clip(p @ waves, -30, 30)), p @ slopes
        place = angles, u / rate, problem.regular * u * u * slope / acceleration
        values, total = _values(cost, *place), np.sum(1 / u)
        result = np.sum(values / u) / total
        # d(L / u - mean / u) by the logarithm of |u| and by its slope.
        push = _values(by_acceleration, *place) * problem.regular * u / acceleration
        by_log = _values(by_rate, *place) / rate + 2 * push * slope - (values - result) / u
        return float(result), (waves @ by_log + slopes @ push) / total

    start = np.zeros(2 * WAVES + 1)
    start[0] = np.log(rate)
    return float(minimize(mean, start, jac=True, method="BFGS", options={"maxiter": 400}).fun)
