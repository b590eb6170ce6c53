"""The finite horizon at many points: the work of the law from the given start, and the least work that there is."""

from __future__ import annotations

import numpy as np

from occ.atlas.motion import law_motion
from occ.atlas.points import Points
from occ.errors import InputError
from occ.theory.coefficients import YawCoefficients
from occ.theory.dissipation import CircleEnergy, circle_energy
from occ.theory.extremals import NoExtremal
from occ.theory.minimum_work import least_work_free_end

TOLERANCE = 1e-12
"""Of the law's motions, relative and absolute, in the mean over the points of a block."""


def law_work(c: YawCoefficients, points: Points) -> tuple[np.ndarray, list[tuple[int, str]]]:
    """W = T(end) - T(start) + int D dt along the law's motion, eq. (4.3), all points in one integration.

    Args:
        c: of the points.
        points: any number of circles.

    Returns:
        (N,) [J], NaN where a motion cannot be followed to its end, and number and reason of those points.
    """
    ((angle, omega, dissipated),), reasons = law_motion(c, points, points.duration, (1.0,), TOLERANCE)
    energy = circle_energy(c, points.radius, points.rate)
    first = energy.kinetic_energy(points.psi_tilde, points.heading_rate)
    return np.asarray(energy.kinetic_energy(angle, omega) - first + dissipated), reasons


def least_work_columns(points: Points) -> tuple[dict[str, np.ndarray], list[tuple[int, str]]]:
    """Every variable of `occ.atlas.variables.LEAST_WORK` at each point.

    Args:
        points: any number of circles.

    Returns:
        (N,) each, and number and reason of the points without a value.
    """
    c = points.coefficients
    law, reasons = law_work(c, points)
    energy = circle_energy(c, points.radius, points.rate)
    least = np.full(len(points), np.nan)
    for i, (angle, yaw_rate, duration) in enumerate(
        zip(points.psi_tilde, points.heading_rate, points.duration, strict=True)
    ):
        one = CircleEnergy(*(values[..., i] for values in energy))
        first = float(one.kinetic_energy(angle, yaw_rate))
        try:
            least[i] = least_work_free_end(one, float(angle), first, float(duration)).work
        except (InputError, NoExtremal) as error:
            reasons.append((i, str(error)))
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = 100 * (law - least) / np.abs(least)
    return {"law_work_J": law, "least_work_J": least, "work_gap_percent": gap}, reasons
