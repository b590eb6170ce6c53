"""What the drawings of the paper's figures share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from occ.figures.style import COLOURS, GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXAMPLE = "ω_B = -0.4 1/s, R_B = 0.7 m, φ_B = 90°, ψ(0) = 0, Ω(0) = 0, as printed"
ARMS = 16
"""Times at which the line from O to B is drawn."""


def caption(figure: Figure, margin: float, lines: Sequence[str]) -> None:
    """Lines below the title: parameters, and which of them were chosen.

    Args:
        figure: made by `occ.figures.style.blank`.
        margin: [in] where they begin.
        lines: plain text.
    """
    width, height = figure.get_size_inches()
    for k, line in enumerate(lines):
        figure.text(margin / width, 1 - (0.53 + 0.17 * k) / height, line, fontsize=8, va="center")


def circle_line(panel: Axes, radius: float, **options: Any) -> None:
    """The program circle of B about the origin of the floor.

    Args:
        panel: with equal axes.
        radius: [m].
        options: of `Axes.plot`.
    """
    turn = np.linspace(0, 2 * np.pi, 181)
    panel.plot(radius * np.cos(turn), radius * np.sin(turn), **options)


def floor_panel(panel: Axes, reach: float) -> None:
    """Equal scales in both directions, centred on the circle.

    Args:
        panel: square.
        reach: [m] half of its side.
    """
    panel.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    panel.locator_params(nbins=5)


def paths(panel: Axes, table: pd.DataFrame) -> None:
    """Paths of B and O, and the line from O to B at even intervals: how the platform is turned.

    Args:
        panel: square.
        table: of Fig. 4 or 9.
    """
    o = table[["centre_x_m", "centre_y_m"]].to_numpy()
    b = table[["point_x_floor_m", "point_y_floor_m"]].to_numpy()
    panel.plot(*b.T, color=GREY, linewidth=3.0, label="B")
    panel.plot(*o.T, color="black", linewidth=1.4, linestyle=(0, (5, 1.6)), label="O, the centre")
    if np.hypot(*(o - b).T).max() > 0.05:
        for k in np.linspace(0, len(table) - 1, ARMS).astype(int):
            panel.plot(*np.array([o[k], b[k]]).T, color=COLOURS[1], linewidth=0.8)
        panel.plot([], [], color=COLOURS[1], linewidth=0.8, label=f"line OB, {ARMS} times")
    panel.plot(*o[0], "ko", markersize=5, label="start of O")
    floor_panel(panel, 1.15 * float(np.abs(np.vstack([o, b])).max()))
