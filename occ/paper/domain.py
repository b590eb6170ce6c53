"""Fig. 3: where steady rotations exist, where they are stable, and where the sufficient conditions (4.8) hold."""

from __future__ import annotations

import numpy as np

from occ.paper.motions import platform_coefficients
from occ.paper.numbers import RADIUS, RATE
from occ.paper.tables import COMPUTED, PRINTED, FigureData, frame
from occ.theory.circle import circle_quantities
from occ.theory.stability import damping_rate, stable_radii

FASTEST = 600.0
"""[rad/s] The figure ends there."""
DENSER = 0.02
"""Steps beside omega_c, where the boundary comes from infinity, relative to it."""


def stability_domain() -> FigureData:
    """R~_B(omega_B), the exact stable radii in closed form, and V~_B/|omega_B|, eqs. (4.5), (4.7), (4.8).

    Returns:
        A row for each rate; an infinite radius where there is no boundary.
    """
    c = platform_coefficients()
    turn = float(damping_rate(c))
    beside = turn * (1 + DENSER * np.linspace(0.2, 4, 30) ** 2)
    near = np.linspace(0.2, 60, 50)
    rate = np.unique(np.concatenate([np.linspace(-FASTEST, FASTEST, 80), beside, near, -near]))
    q, stable = circle_quantities(c, 1.0, rate), stable_radii(c, rate)
    curves = {
        "part": "boundaries",
        "rate_rad_s": rate,
        "critical_radius_m": q.critical_radius,
        "stable_from_m": stable.lower,
        "stable_to_m": stable.upper,
        "sufficient_to_m": q.critical_speed / np.abs(rate),
        "source": COMPUTED,
    }
    example = {"part": "example of section 4.1", "rate_rad_s": RATE, "radius_m": RADIUS, "source": PRINTED}
    limit = {"part": "omega_c, where the stable family loses radii", "rate_rad_s": turn, "source": COMPUTED}
    return FigureData(frame([curves, example, limit]))
