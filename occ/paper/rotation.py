"""Figs. 6 and 7: rotational motion below the critical radius, its period, and its resonances with the circle."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from occ.errors import OccError
from occ.paper.motions import Run, platform_coefficients, simulate
from occ.paper.numbers import RADIUS, RATE
from occ.paper.tables import CHOSEN, COMPUTED, FigureData, frame
from occ.theory.asymptotics import HIGHEST_ORDER, asymptotic_amplitude, asymptotic_mean_yaw_rate, asymptotic_period
from occ.theory.circle import circle_quantities
from occ.theory.equation import ScaledEquation, scaled_equation
from occ.theory.orbits import RotatingOrbit, rotating_orbit, rotating_orbits

DRAWN_RADII = (0.30, 0.50, 0.60, 0.64)
"""[m] Of the yaw rates in Fig. 6."""
TABLE_RADII = (0.10, 0.20, 0.30, 0.40, 0.50, 0.55, 0.60, 0.62, 0.63, 0.64)
"""[m] Of the periods in Fig. 6."""
DURATION = 120.0
"""[s] Of Fig. 6: more than the period at the largest radius."""
RATIOS = tuple(Fraction(*pair) for pair in ((1, 2), (1, 3), (2, 3), (1, 4), (3, 4), (3, 5)))
"""q of Fig. 7."""
PER_LAP = 64
LAP = 2 * math.pi / abs(RATE)


def yaw_rates() -> FigureData:
    """Fig. 6: Omega(t) for several radii; period, mean and amplitude of the rotational motion against the formulas.

    Means are over exact periods: the motion is a periodic orbit, found as a boundary value problem.

    Returns:
        Parts ``motion`` (full model), ``orbit`` (ten radii, full equation beside both formulas) and ``formula``.
    """
    c, t = platform_coefficients(), np.linspace(0, DURATION, 481)
    parts: list[dict[str, Any]] = []
    agreement = []
    for radius in DRAWN_RADII:
        motion = simulate(Run(radius=radius, duration=DURATION), t)
        agreement.append(motion.agreement(6, f"R_B = {radius} m"))
        parts.append(
            {"part": "motion", "radius_m": radius, "time_s": t, "yaw_rate_rad_s": motion.samples.state[5]}
            | {"radius_source": CHOSEN}
        )
    radii = np.array(TABLE_RADII)
    eq = scaled_equation(c, radii, RATE)
    orbits = rotating_orbits(eq)
    full = {
        "period_s": orbits.period,
        "mean_yaw_rate_rad_s": orbits.mean_yaw_rate,
        "amplitude_rad_s": orbits.amplitude,
    }
    parts.append({"part": "orbit", "radius_m": radii, "radius_source": CHOSEN, **full, **_formulas(eq)})
    critical = float(circle_quantities(c, RADIUS, RATE).critical_radius)
    fine = critical * np.sin(np.linspace(0.02, np.pi / 2, 81)[:-4])
    parts.append(
        {"part": "formula", "radius_m": fine, "radius_source": COMPUTED} | _formulas(scaled_equation(c, fine, RATE))
    )
    return FigureData(frame(parts), agreement)


def _formulas(eq: ScaledEquation) -> dict[str, np.ndarray]:
    """Period, mean and amplitude by eq. (4.18), and corrected to the highest known order in epsilon."""
    table = {}
    for suffix, order in (("asymptotic", 0), ("corrected", HIGHEST_ORDER)):
        table[f"period_{suffix}_s"] = asymptotic_period(eq, order)
        table[f"mean_yaw_rate_{suffix}_rad_s"] = asymptotic_mean_yaw_rate(eq, order)
        table[f"amplitude_{suffix}_rad_s"] = asymptotic_amplitude(eq, order)
    return table


def orbit_at(radius: float) -> RotatingOrbit:
    """The rotational motion of the full equation.

    Args:
        radius: [m] R_B, below the critical one.

    Returns:
        The motion over one turn, and its measures.

    Raises:
        OccError: it was not found.
    """
    orbit = rotating_orbit(scaled_equation(platform_coefficients(), radius, RATE))
    if orbit is None:
        raise OccError(f"no rotational motion was found at R_B = {radius} m")
    return orbit


def asymptotic_resonance(q: Fraction) -> float:
    """R_B = R~_B sqrt(1 - q^2), before Fig. 7.

    Args:
        q: ratio of the frequency of Omega and |omega_B|.

    Returns:
        [m].
    """
    critical = float(circle_quantities(platform_coefficients(), RADIUS, RATE).critical_radius)
    return critical * math.sqrt(1 - float(q) ** 2)


def full_resonance(q: Fraction) -> float:
    """The radius at which the rotational motion of the full equation has the period 2 pi/(q |omega_B|).

    Args:
        q: ratio of the frequency of Omega and |omega_B|.

    Returns:
        [m].
    """
    from scipy.optimize import brentq

    first = asymptotic_resonance(q)
    wanted = LAP / float(q)

    def excess(radius: float) -> float:
        return float(orbit_at(radius).orbit.period) / wanted - 1

    critical = asymptotic_resonance(Fraction(0))
    return float(brentq(excess, 0.9 * first, 0.5 * (first + critical), xtol=1e-14, rtol=1e-14))


def resonances() -> FigureData:
    """Fig. 7: paths of O at the asymptotic radius and at the one where the full equation is exactly resonant.

    Each path starts on its own periodic orbit and lasts for the laps after which the exact one closes; phi_B = 0.

    Returns:
        Parts ``path`` (full model) and ``summary`` (radius, laps, and how far the path is from closing).
    """
    parts: list[dict[str, Any]] = []
    agreement = []
    for q in RATIOS:
        laps = q.denominator
        t = np.linspace(0, laps * LAP, laps * PER_LAP + 1)
        for kind, radius in (("asymptotic", asymptotic_resonance(q)), ("full", full_resonance(q))):
            orbit = orbit_at(radius)
            start, rate = float(orbit.psi_tilde[0]), float(orbit.yaw_rate[0])
            run = Run(radius=radius, duration=float(t[-1]), psi_tilde=start, yaw_rate=rate, phase=0.0)
            motion = simulate(run, t)
            agreement.append(motion.agreement(7, f"q = {q}, {kind} radius"))
            x, y = motion.samples.state[:2]
            gap = math.hypot(x[-1] - x[0], y[-1] - y[0])
            # A path that closes within the accuracy of the integration is said to close.
            common = {"q": str(q), "kind": kind}
            parts.append(common | {"part": "path", "time_s": t, "centre_x_m": x, "centre_y_m": y})
            parts.append(
                common
                | {"part": "summary", "radius_m": radius, "laps": laps, "period_s": float(orbit.orbit.period)}
                | {"closing_gap_m": gap if gap > 1e-8 else 0.0, "radius_source": COMPUTED, "q_source": CHOSEN}
            )
    return FigureData(frame(parts), agreement)
