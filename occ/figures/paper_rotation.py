"""The paper's Figs. 6 and 7: rotational motion below the critical radius."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from occ.figures.paper_layout import caption, circle_line, floor_panel
from occ.figures.style import COLOURS, GREY, blank, look, place

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEASURES = {
    "period": ("period [s]", "_s"),
    "mean_yaw_rate": ("mean Ω [rad/s]", "_rad_s"),
    "amplitude": ("amplitude of Ω [rad/s]", "_rad_s"),
}

LINES = {"full": {"color": "black", "linewidth": 2.2}, "asymptotic": look(1) | {"linewidth": 1.0}}
TOP = 1.3
"""[in] Above the panels of Fig. 7."""


def yaw_rate_figure(table: pd.DataFrame) -> Figure:
    """Fig. 6: yaw rate for several radii; below, period, mean and amplitude against the radius.

    Args:
        table: ``fig06.csv``.

    Returns:
        The figure.
    """
    figure = blank(10.4, 7.1, "Fig. 6  Yaw rate below the critical radius", 0.75)
    lines = [
        "ω_B = -0.4 1/s, φ_B = 90°, B at (0.40, 0.05) m; ψ(0) = 0, Ω(0) = 0.  The radii are not printed in the copy at "
        "hand: they are chosen.",
        "Below: periodic orbits of the full equation (4.3), means over exact periods, beside the formulas of (4.18).",
    ]
    caption(figure, 0.75, lines)
    motion = table[table["part"] == "motion"]
    over_time = place(figure, (0.75, 3.95, 7.6, 2.15))
    for k, (radius, rows) in enumerate(motion.groupby("radius_m")):
        over_time.plot(rows["time_s"], rows["yaw_rate_rad_s"], label=f"R_B = {radius:g} m", **look(k))
    over_time.set(xlabel="time [s]", ylabel="Ω [rad/s]", xlim=(0, float(motion["time_s"].max())))
    over_time.set_title("a  yaw rate", pad=4)
    over_time.legend(loc="upper left", bbox_to_anchor=(1.01, 1.03), borderaxespad=0.0)
    formula, orbit = table[table["part"] == "formula"], table[table["part"] == "orbit"]
    for k, (name, (axis_label, unit)) in enumerate(MEASURES.items()):
        panel = place(figure, (0.75 + k * 3.3, 1.1, 2.55, 2.0))
        column = f"{name}_asymptotic{unit}"
        panel.plot(formula["radius_m"], formula[column], label="formula of (4.18)", **look(0))
        full = orbit[f"{name}{unit}"]
        panel.plot(orbit["radius_m"], full, "o", color=COLOURS[1], markersize=4, label="full equation")
        panel.set(xlabel="radius R_B [m]", ylabel=axis_label)
        panel.set_title(f"{'bcd'[k]}  {axis_label.split(' [')[0]}", pad=4)
        if name == "period":
            panel.set_ylim(0, 1.3 * float(full.max()))
        error = (orbit[f"{name}_corrected{unit}"] / full - 1).abs().max()
        rough = (orbit[column] / full - 1).abs().max()
        panel.text(
            0.0, -0.36, f"largest error of the formula: {100 * rough:.2g} %\ncorrected in ε: {100 * error:.2g} %",
            transform=panel.transAxes, fontsize=8, va="top",
        )  # fmt: skip
        if k == 0:
            panel.legend(loc="upper left")
    return figure


def resonance_figure(table: pd.DataFrame) -> Figure:
    """Fig. 7: paths of O for several resonances.

    Args:
        table: ``fig07.csv``.

    Returns:
        The figure: a panel for each ratio q.
    """
    ratios = list(dict.fromkeys(table["q"]))
    columns, side, gap, up = 3, 2.9, 0.55, 0.95
    rows = -(-len(ratios) // columns)
    height = TOP + rows * (side + up) + 0.2
    figure = blank(0.75 + columns * (side + gap), height, "Fig. 7  Resonant paths of the centre O", 0.75)
    lines = [
        "ω_B = -0.4 1/s, φ_B = 0, B at (0.40, 0.05) m.  q = frequency of Ω / |ω_B|; the values of q are not printed in "
        "the copy at hand: they are chosen.",
        "Each path starts on its own rotational motion and is drawn over the laps after which the exact one closes.",
    ]
    caption(figure, 0.75, lines)
    reach = 1.06 * float(table[["centre_x_m", "centre_y_m"]].abs().max().max())
    for k, q in enumerate(ratios):
        row, column = divmod(k, columns)
        box = (0.75 + column * (side + gap), height - TOP - side - row * (side + up), side, side)
        panel = place(figure, box)
        chosen = table[table["q"] == q]
        summary = chosen[chosen["part"] == "summary"].set_index("kind")
        circle_line(panel, float(summary.loc["full", "radius_m"]), color=GREY, linewidth=2.4)
        for kind, options in LINES.items():
            path = chosen[(chosen["part"] == "path") & (chosen["kind"] == kind)]
            panel.plot(path["centre_x_m"], path["centre_y_m"], **options)
        floor_panel(panel, reach)
        if column:
            panel.set_ylabel("")
        exact, rough = (summary.loc[kind] for kind in ("full", "asymptotic"))
        panel.set_title(
            f"q = {q}: exact R_B = {exact['radius_m']:.5f} m, closes after {exact['laps']:.0f} laps\n"
            f"R̃_B √(1 - q²) = {rough['radius_m']:.5f} m misses by {1000 * rough['closing_gap_m']:.2f} mm",
            pad=4,
            fontsize=8,
        )
    figure.legend(handles=_resonance_legend(), loc="lower left", bbox_to_anchor=(0.065, 0.005), ncols=3)
    return figure


def _resonance_legend() -> list[object]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], color=GREY, linewidth=2.4, label="B"),
        Line2D([], [], label="O, radius of the full equation", **LINES["full"]),
        Line2D([], [], label="O, radius of the asymptotic formula", **LINES["asymptotic"]),
    ]
