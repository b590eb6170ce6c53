"""Fig. 5: phase portraits of the yaw motion above, at and below the critical radius."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from occ.paper.motions import Run, platform_coefficients, simulate
from occ.paper.numbers import RADIUS, RATE
from occ.paper.tables import CHOSEN, COMPUTED, FigureData, frame
from occ.theory.asymptotics import slow_manifold
from occ.theory.circle import CircleQuantities, circle_quantities
from occ.theory.equation import scaled_equation
from occ.theory.stability import eigenvalues

BELOW = 0.55
"""[m] R_B of Fig. 5c."""
DURATION = 12.0
"""[s] Of each motion."""
SAMPLES = 50
STARTS = (-2.8, -1.6, -0.4, 0.8, 2.0)
"""[rad] psi~(0) of the motions from above and from below."""
LIFT = 1.6
"""[rad/s] Their Omega(0) - omega_B."""


def phase_portraits() -> FigureData:
    """Motions in the plane (psi~, Omega - omega_B), the degenerate curve (4.11), and the equilibria with their type.

    Returns:
        Panels a, b, c with the parts ``motion`` (full model), ``degenerate`` and ``steady``.
    """
    c = platform_coefficients()
    critical = float(circle_quantities(c, RADIUS, RATE).critical_radius)
    panels = (("a", RADIUS, CHOSEN), ("b", critical, COMPUTED), ("c", BELOW, CHOSEN))
    parts: list[dict[str, Any]] = []
    agreement = []
    # Most of the way is gone in the first moments.
    t = DURATION * np.linspace(0, 1, SAMPLES) ** 3
    for panel, radius, source in panels:
        common = {"panel": panel, "radius_m": radius, "radius_source": source}
        for curve, (start, lift) in enumerate((s, side * LIFT) for side in (1, -1) for s in STARTS):
            run = Run(radius=radius, duration=DURATION, psi_tilde=start, yaw_rate=RATE + lift)
            motion = simulate(run, t)
            agreement.append(motion.agreement(5, f"{panel}{curve + 1}"))
            deviation = motion.samples.state[5] - RATE
            parts.append(
                common
                | {"part": "motion", "curve": curve + 1, "time_s": t}
                | {"psi_tilde_rad": motion.psi_tilde, "deviation_rad_s": deviation}
            )
        psi = np.linspace(-np.pi, np.pi, 121)
        slow = slow_manifold(scaled_equation(c, radius, RATE), psi, order=0) - RATE
        parts.append(common | {"part": "degenerate", "psi_tilde_rad": psi, "deviation_rad_s": slow})
        parts += [common | row for row in _equilibria(circle_quantities(c, radius, RATE), radius)]
    return FigureData(frame(parts), agreement)


def _equilibria(q: CircleQuantities, radius: float) -> Iterator[dict[str, Any]]:
    if np.isclose(radius, q.critical_radius, rtol=1e-12):
        # Both roots are one, and one eigenvalue is zero.
        yield _equilibrium(float(-q.alpha), "saddle-node")
        return
    if radius < q.critical_radius:
        return
    for heading, damping, stiffness in (
        (q.stable_heading, q.stable_damping, q.stiffness),
        (q.unstable_heading, q.unstable_damping, -q.stiffness),
    ):
        yield _equilibrium(float(heading), equilibrium_type(eigenvalues(damping, stiffness)))


def _equilibrium(heading: float, kind: str) -> dict[str, Any]:
    return {"part": "steady", "psi_tilde_rad": heading, "deviation_rad_s": 0.0, "type": kind}


def equilibrium_type(roots: np.ndarray) -> str:
    """Node, focus or saddle.

    Args:
        roots: (2,) eigenvalues, neither of them zero.

    Returns:
        Such as "stable node".
    """
    real = roots.real
    if real[0] * real[1] < 0:
        return "saddle"
    shape = "focus" if np.any(roots.imag != 0) else "node"
    return f"{'stable' if real.max() < 0 else 'unstable'} {shape}"
