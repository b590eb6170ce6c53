"""How far B is off its program over time, where some controller leaves it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from occ.figures.over_time import Motions
from occ.figures.style import controller_line, label, legend_beside, panels, power_of_ten

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from occ.report.stored import Motion

ON_PROGRAM = 1e-6
"""[m] Where no controller errs by more than this there is nothing to draw."""
LOWEST = 1e-8
"""[m] What is below this is rounding or might as well be."""


def distance(motion: Motion) -> np.ndarray:
    """|r_B - r_B*| (N,) [m] at the times of a motion."""
    return np.asarray(np.linalg.norm(motion["point"] - motion["program"], axis=0))


def off_program_figure(motions: Motions, where: str = "") -> Figure | None:
    """Distance of B from its program over time, on a logarithmic scale.

    Args:
        motions: of one case.
        where: added to the title.

    Returns:
        The figure: one panel; None where all keep the program.
    """
    errors = {name: distance(motion) for name, (_, motion) in motions.items()}
    if max(float(error.max()) for error in errors.values()) <= ON_PROGRAM:
        return None
    figure, (panel,) = panels(6.2, [3.2], f"Distance of B from its program{where}")
    lines = [
        panel.semilogy(motion["time"], errors[name].clip(LOWEST / 10), label=label(name), **controller_line(index))[0]
        for name, (index, motion) in motions.items()
    ]
    legend_beside(panel, lines)
    hidden = sum(float(error.max()) < LOWEST for error in errors.values())
    if hidden:
        panel.set_title(f"{hidden} of {len(errors)} curves stay below this scale", pad=4)
    panel.set_ylim(bottom=LOWEST)
    panel.yaxis.set_major_formatter(power_of_ten)
    panel.set_xlim(0.0, max(float(motion["time"][-1]) for _, motion in motions.values()))
    panel.set_xlabel("time [s]")
    panel.set_ylabel("distance [m]")
    return figure
