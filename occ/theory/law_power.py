"""The mean power that the servo law needs in the long run, beside the least that any rotation strategy can need.

Kinetic energy returns, so that the mean of the power is that of the dissipation D.  At a steady rotation that is
U(psi~_s).  Over one turn of a rotational motion, psi~' = omega_B p(theta) with psi~ + alpha = theta,

    D = Z omega_B^2 p^2 + 2 (Z omega_B + d_2) omega_B p + U,  int p^2 |du| = 2 pi |mean p|,  int p du = +-2 pi,

and d_2 p is the rate of a function of psi~: with the mean of p over theta, and those of cos m psi~ and sin m psi~ over
time, m = 1, 2, the mean of D is a closed form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from occ.integration import IntegrationError
from occ.theory.attractors import Attractor, find_attractors
from occ.theory.dissipation import CircleEnergy, circle_of, energy_of
from occ.theory.equation import ScaledEquation, reduced_motion
from occ.theory.long_run import long_run, switch_radius
from occ.theory.orbits import rotating_means
from occ.theory.shooting import Moments
from occ.theory.trigonometric import recentred

if TYPE_CHECKING:
    from occ.theory.summary import Setting

PATIENCE = 60.0
"""Time constants 1/xi_3, or laps if they are longer, after which a motion is taken to have reached its attractor."""


def long_run_section(s: Setting) -> dict[str, Any]:
    """Mean power of the law from the task's start, the least mean power, and the gap.

    Args:
        s: the task on a circle.

    Returns:
        ``law_mean_power_W``, ``least_mean_power_W``, ``least_mean_power_regime``, ``optimal_switch_radius_m`` and
        ``long_run_gap_percent``; None where the law has no attractor that a mean could be taken of, and where no motion
        costs anything, so that there is neither a gap nor a radius to switch at.
    """
    energy = energy_of(s.task.platform, s.task.point, circle_of(s.task))
    best = long_run(energy)
    least, law, switch = float(best.mean_power), law_mean_power(s), float(switch_radius(s.c))
    return {
        "law_mean_power_W": law,
        "least_mean_power_W": least,
        "least_mean_power_regime": "steady" if best.steady else "rotational",
        "optimal_switch_radius_m": None if np.isnan(switch) else switch,
        "long_run_gap_percent": 100 * (law - least) / least if law is not None and least > 0 else None,
    }


def law_mean_power(s: Setting) -> float | None:
    """Mean of D over the law's attractor: at a steady rotation, or over the exact period of a rotational motion.

    Kinetic energy returns, so that the mean of the power is the mean of the dissipation.

    Args:
        s: the task on a circle.

    Returns:
        [W]; None where neither was found.
    """
    energy = energy_of(s.task.platform, s.task.point, circle_of(s.task))
    reached = _reached(s, find_attractors(s.c, s.radius, s.rate))
    if reached is None:
        return None
    if reached.psi_tilde is not None:
        return float(energy.dissipation(reached.psi_tilde, s.rate))
    if reached.orbit is None:
        return None
    return float(_mean_power(energy, s.eq, reached.orbit.means))


class Rotations(NamedTuple):
    """Rotational motions, each entry (N,); NaN where none was found."""

    mean_power: np.ndarray  # [W]
    period: np.ndarray  # [s] in which psi~ makes one turn
    mean_yaw_rate: np.ndarray  # [rad/s]


def rotations(energy: CircleEnergy, eq: ScaledEquation) -> Rotations:
    """The rotational motions, and the mean of D over them: inside the critical radius, and beyond it where there are.

    Args:
        energy: of the circles, entries (N,).
        eq: of the same circles.

    Returns:
        Arrays.
    """
    means = rotating_means(eq)
    mean_yaw_rate = eq.rate * (1 + np.sign(means.slope) * 2 * np.pi / means.duration)
    return Rotations(_mean_power(energy, eq, means), means.duration / np.abs(eq.rate), mean_yaw_rate)


def _mean_power(energy: CircleEnergy, eq: ScaledEquation, means: Moments) -> np.ndarray:
    """Mean of D over a turn (N,) [W]."""
    # Means over time of p^2 and p.
    per_time = 2 * np.pi / means.duration
    square, slope = np.abs(means.slope) * per_time, np.sign(means.slope) * per_time
    power = np.sum(recentred(energy.power, -eq.alpha) * means.waves, axis=0)
    return np.asarray(energy.friction * eq.rate**2 * (square + 2 * slope) + power)


def _reached(s: Setting, found: tuple[Attractor, ...]) -> Attractor | None:
    """The attractor of the task's start: where there are several, the motion itself says which; None if it cannot."""
    if len(found) < 2:
        return found[0] if found else None
    xi_3 = float(s.c.xi_3)
    slow = abs(2 * np.pi / s.rate)
    duration = PATIENCE * max(slow, 1 / xi_3 if xi_3 > 0 else slow)
    start = s.task.start.heading - circle_of(s.task).phase, s.task.start.heading_rate
    t = np.array([0.0, 0.9 * duration, duration])
    try:
        psi_tilde, _ = reduced_motion(s.c, s.radius, s.rate, start, t)
    except IntegrationError:
        return None
    turns = abs(psi_tilde[2] - psi_tilde[1]) > np.pi
    return next((item for item in found if (item.orbit is not None) == turns), None)
