"""The paper's Figs. 4, 8, 9 and 10: the platform on its circle, and the work of its wheels."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from occ.figures.paper_layout import EXAMPLE, caption, circle_line, floor_panel, paths
from occ.figures.style import GREY, blank, look, place

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORCES = {"force_x_N": "F_X [N]", "force_y_N": "F_Y [N]", "yaw_moment_Nm": "M_Ω [N m]"}
TORQUES = {f"torque_{i}_Nm": f"M_{i}" for i in (1, 2, 3, 4)}
WORKS = {
    "law_J": "1  the law (4.4), (3.11)-(3.13)",
    "translation_J": "2  ψ = 0 (translation)",
    "turning_J": "3  ψ = ω_B t",
    "turning_backwards_J": "4  ψ = ω_B t + 180°",
}

CURVE_2 = 2
TOP = 1.1
"""[in] Above the panels of Figs. 4 and 9."""
SMALL = -2
"""Powers of ten below this become a part of the unit."""


def steady_figure(table: pd.DataFrame) -> Figure:
    """Fig. 4: paths, yaw rate, Delta psi, forces, torques.

    Args:
        table: ``fig04.csv``.

    Returns:
        The figure.
    """
    return _time_histories(
        table,
        "Fig. 4  Program motion into a stable steady rotation",
        "B at (0.40, 0.05) m",
        ("heading_deviation_rad", "Δψ = ψ̃ - ψ̃_s"),
    )


def translation_figure(table: pd.DataFrame) -> Figure:
    """Fig. 9: the same at the point (4.20), with the heading in place of Delta psi.

    Args:
        table: ``fig09.csv``.

    Returns:
        The figure.
    """
    x, y = (100 * float(table[f"point_{name}_m"].iloc[0]) for name in "xy")
    return _time_histories(
        table,
        "Fig. 9  Motion close to translation: B at the point (4.20)",
        f"B at ({x:.4f}, {y:.4f}) cm, eq. (4.20) computed; printed: (0.09, 0.1) cm",
        ("heading_rad", "ψ"),
    )


def _time_histories(table: pd.DataFrame, title: str, point: str, angle: tuple[str, str]) -> Figure:
    """Paths on the left, four panels over time on the right."""
    left, side, width, height, gap = 0.75, 3.9, 4.3, 1.15, 0.28
    total = TOP + 4 * height + 3 * gap + 0.55
    figure = blank(left + side + 0.95 + width + 1.35, total, title, left)
    caption(figure, left, [f"{EXAMPLE}.  {point}.", "The copy at hand does not print the horizon: 30 s is chosen."])
    floor = place(figure, (left, total - TOP - side, side, side))
    paths(floor, table)
    floor.set_title("a  paths on the floor", pad=4)
    floor.legend(loc="upper left", bbox_to_anchor=(0.0, -0.13), ncols=2, borderaxespad=0.0)
    start = left + side + 0.95
    boxes = [(start, total - TOP - height - k * (height + gap), width, height) for k in range(4)]
    first = place(figure, boxes[0])
    panels = [first, *(place(figure, box, first) for box in boxes[1:])]
    t = table["time_s"]
    units = [
        _scaled(panel, t, table[column].to_numpy())
        for panel, column in zip(panels, ("yaw_rate_rad_s", angle[0]), strict=False)
    ]
    for panel, curves in ((panels[2], FORCES), (panels[3], TORQUES)):
        for k, (column, name) in enumerate(curves.items()):
            panel.plot(t, table[column], label=name, **look(k) | {"linewidth": 1.3})
        panel.legend(loc="upper left", bbox_to_anchor=(1.01, 1.05), borderaxespad=0.0, labelspacing=0.3)
    labels = (f"Ω [{units[0]}rad/s]", f"{angle[1]} [{units[1]}rad]", "forces [N], [N m]", "torque [N m]")
    moment = f"|M_Ω| at most {table['yaw_moment_Nm'].abs().max():.3g} N m"
    names = ("b  yaw rate", "c  angle", f"d  control forces ({moment})", "e  wheel torques")
    for panel, axis_label, name in zip(panels, labels, names, strict=True):
        panel.set_ylabel(axis_label)
        panel.set_title(name, pad=3)
        panel.locator_params(axis="y", nbins=4)
        panel.tick_params(labelbottom=panel is panels[-1])
    panels[-1].set_xlabel("time [s]")
    first.set_xlim(0.0, float(t.max()))
    return figure


def _scaled(panel: Axes, t: pd.Series[float], values: np.ndarray) -> str:
    """Draw a curve, a very small one by a power of ten that is returned as a part of its unit."""
    power = math.floor(math.log10(np.abs(values).max()))
    small = power < SMALL
    panel.plot(t, values / 10.0**power if small else values, **look(0))
    return f"1e{power} " if small else ""


def critical_figure(table: pd.DataFrame) -> Figure:
    """Fig. 8: two starts beside the stable-unstable rotation.

    Args:
        table: ``fig08.csv``.

    Returns:
        The figure: paths on the left, psi~(t) on the right.
    """
    figure = blank(9.9, 6.1, "Fig. 8  Critical case R_B = R̃_B: one of two near starts makes an extra turn", 0.75)
    radius = float(table["radius_m"].iloc[0])
    lines = [
        f"ω_B = -0.4 1/s, φ_B = 90°, B at (0.40, 0.05) m, R_B = {radius:.6g} m as computed (printed: 0.6485 m).",
        "The copy at hand does not print the horizon and Ω(0): six laps and Ω(0) = 0 are chosen.",
    ]
    caption(figure, 0.75, lines)
    floor, angle = place(figure, (0.75, 0.9, 4.1, 4.1)), place(figure, (5.8, 0.9, 3.9, 4.1))
    circle_line(floor, radius, color=GREY, linewidth=3.0, label="1  B")
    reach = radius
    for (number, start), rows in table.groupby(["curve", "psi_tilde_0_rad"], sort=False):
        options = (look(0) if number == CURVE_2 else look(1)) | {"label": f"{number}  O, ψ̃(0) = {start:g}"}
        floor.plot(rows["centre_x_m"], rows["centre_y_m"], **options)
        angle.plot(rows["time_s"], rows["psi_tilde_rad"], **options)
        floor.plot(*rows[["centre_x_m", "centre_y_m"]].iloc[0], "o", color=options["color"], markersize=5)
        reach = max(reach, float(rows[["centre_x_m", "centre_y_m"]].abs().max().max()))
    floor_panel(floor, 1.12 * reach)
    floor.set_title("a  paths on the floor", pad=4)
    floor.legend(loc="upper left", bbox_to_anchor=(0.0, -0.12), ncols=3, borderaxespad=0.0, columnspacing=1.0)
    angle.set_title("b  angle ψ̃ = ψ - ω_B t - φ_B", pad=4)
    angle.set(xlabel="time [s]", ylabel="ψ̃ [rad]", xlim=(0, float(table["time_s"].max())))
    angle.legend(loc="upper left")
    return figure


def work_figure(table: pd.DataFrame) -> Figure:
    """Fig. 10: work of the control torques.

    Args:
        table: ``fig10.csv``.

    Returns:
        The figure.
    """
    figure = blank(9.6, 4.9, "Fig. 10  Work of the control torques", 0.75)
    best = float(table["best_heading_rad"].iloc[0])
    lines = [
        f"{EXAMPLE}; 2 to 5 start on their own heading and yaw rate.  B at (0.40, 0.05) m.",
        "The copy at hand does not print the horizon: 30 s is chosen.  Curve 5 is not in the paper.",
    ]
    caption(figure, 0.75, lines)
    panel = place(figure, (0.75, 0.6, 5.4, 3.35))
    for k, (column, name) in enumerate((WORKS | {"turning_best_J": f"5  ψ = ω_B t + {best:.4f} rad"}).items()):
        panel.plot(table["time_s"], table[column], label=name, **look(k))
        panel.annotate(
            f"{table[column].iloc[-1]:.1f} J", (table["time_s"].iloc[-1], table[column].iloc[-1]),
            xytext=(3, {0: 4, 4: -7}.get(k, 0)), textcoords="offset points", fontsize=8, va="center",
        )  # fmt: skip
    panel.set(xlabel="time [s]", ylabel="work A [J]", xlim=(0, float(table["time_s"].max())))
    panel.set_ylim(bottom=min(0.0, float(np.min(table[list(WORKS)].to_numpy()))))
    panel.legend(loc="upper left", bbox_to_anchor=(1.12, 1.02), borderaxespad=0.0, labelspacing=0.8)
    return figure
