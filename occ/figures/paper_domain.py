"""The paper's Figs. 3 and 5: where steady rotations are stable, and how the yaw motion gets there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from occ.figures.paper_layout import caption
from occ.figures.style import COLOURS, GREY, blank, look, place

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DOMAIN = "#dcdcdc"
SUFFICIENT = "#a6a6a6"
MARKERS: dict[str, dict[str, Any]] = {
    "stable node": {"marker": "o", "markerfacecolor": "black"},
    "stable focus": {"marker": "o", "markerfacecolor": "black"},
    "unstable node": {"marker": "o", "markerfacecolor": "white"},
    "unstable focus": {"marker": "o", "markerfacecolor": "white"},
    "saddle": {"marker": "X", "markerfacecolor": "white"},
    "saddle-node": {"marker": "D", "markerfacecolor": "#b0b0b0"},
}


def stability_figure(table: pd.DataFrame) -> Figure:
    """Fig. 3: domains of existence and stability in the plane (omega_B, R_B), at two scales.

    Args:
        table: ``fig03.csv``.

    Returns:
        The figure.
    """
    figure = blank(10.6, 5.2, "Fig. 3  Steady rotations: existence, stability, sufficient conditions", 0.75)
    caption(figure, 0.75, ["Point B at (0.40, 0.05) m; all boundaries are computed from (2.17) in closed form."])
    wide = place(figure, (0.75, 1.35, 5.2, 3.0), xlim=(-600, 600), ylim=(0.01, 100), yscale="log")
    near = place(figure, (6.75, 1.35, 3.6, 3.0), xlim=(-60, 60), ylim=(0, 1.4))
    for panel, name in ((wide, "a  all rates"), (near, "b  rates near the example")):
        _domains(panel, table)
        panel.set_title(name, pad=4)
        panel.set_xlabel("rate of the circle ω_B [rad/s]")
        panel.set_ylabel("radius R_B [m]")
        panel.grid(visible=False)
    wide.yaxis.set_major_formatter("{x:g}")
    limit = float(table.loc[table["part"].str.startswith("omega_c"), "rate_rad_s"].iloc[0])
    wide.axvline(limit, color=GREY, linewidth=0.8, linestyle=(0, (1, 2)))
    wide.text(limit + 10, 60, f"ω_c =\n{limit:.1f} 1/s", fontsize=8, va="top")
    example = table[table["part"] == "example of section 4.1"].iloc[0]
    near.plot(example["rate_rad_s"], example["radius_m"], "k*", markersize=10)
    near.annotate(
        "Fig. 4", (example["rate_rad_s"], example["radius_m"]), xytext=(7, 7), textcoords="offset points", fontsize=8
    )
    handles, labels = wide.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.06, 0.015), ncols=3, borderaxespad=0.0)
    return figure


def _domains(panel: Axes, table: pd.DataFrame) -> None:
    rows = table[(table["part"] == "boundaries") & (table["rate_rad_s"].abs() <= panel.get_xlim()[1])]
    rate, ceiling = rows["rate_rad_s"].to_numpy(), panel.get_ylim()[1]
    exists, sufficient = rows["critical_radius_m"].to_numpy(), rows["sufficient_to_m"].to_numpy()
    low, high = rows["stable_from_m"].to_numpy(), rows["stable_to_m"].to_numpy()
    top = np.minimum(high, ceiling)
    empty: dict[str, Any] = {"facecolor": "none", "edgecolor": GREY, "linewidth": 0.0}
    panel.fill_between(rate, panel.get_ylim()[0], exists, hatch="\\\\\\\\", label="no steady rotation", **empty)
    panel.fill_between(rate, low, top, color=DOMAIN, linewidth=0, label="a stable family (exact)")
    panel.fill_between(
        rate, low, np.clip(sufficient, low, ceiling), color=SUFFICIENT, linewidth=0, label="conditions (4.8) hold"
    )
    unstable = high < ceiling
    panel.fill_between(rate, top, ceiling, where=unstable, hatch="////", label="both families unstable", **empty)
    panel.plot(rate, exists, label="critical radius R̃_B", **look(0))
    bounded = np.where(np.isfinite(high), high, np.nan)
    panel.plot(rate, bounded, label="R_c: the damping changes its sign", **look(1) | {"linewidth": 2.0})
    for side in (rate < 0, rate > 0):
        panel.plot(
            rate[side],
            sufficient[side],
            label="critical speed: R_B |ω_B| = Ṽ_B" if side[0] else None,
            **look(2),
        )


def portrait_figure(table: pd.DataFrame) -> Figure:
    """Fig. 5: phase portraits for three radii.

    Args:
        table: ``fig05.csv``.

    Returns:
        The figure.
    """
    panels = list(table.groupby("panel"))
    width, height, gap = 3.3, 3.3, 0.35
    figure = blank(0.75 + len(panels) * (width + gap), 5.45, "Fig. 5  Phase portraits of the yaw motion", 0.75)
    caption(
        figure,
        0.75,
        [
            "ω_B = -0.4 1/s, B at (0.40, 0.05) m.  The radii are not printed in the copy at hand: a and c are chosen, "
            "b is the computed critical radius."
        ],
    )
    first: Axes | None = None
    for k, (name, rows) in enumerate(panels):
        panel = place(figure, (0.75 + k * (width + gap), 1.2, width, height), first)
        first = first or panel
        _portrait(panel, rows)
        panel.set(xlim=(-np.pi, np.pi), ylim=(-1.8, 1.8))
        panel.set_title(f"{name}  R_B = {rows['radius_m'].iloc[0]:.4g} m", pad=4)
        panel.set_xlabel("ψ̃ [rad]")
        panel.set_xticks([-np.pi, -np.pi / 2, 0, np.pi / 2, np.pi], ["-π", "-π/2", "0", "π/2", "π"])
        if k:
            panel.tick_params(labelleft=False)
    assert first is not None
    first.set_ylabel("Ω - ω_B [rad/s]")
    figure.legend(handles=_portrait_legend(table), loc="lower left", bbox_to_anchor=(0.065, 0.02), ncols=6)
    return figure


def _portrait(panel: Axes, rows: pd.DataFrame) -> None:
    for _, motion in rows[rows["part"] == "motion"].groupby("curve"):
        psi = motion["psi_tilde_rad"].to_numpy()
        deviation = motion["deviation_rad_s"].to_numpy()
        # Drawn on the circle: a line that leaves at the right comes back at the left.
        wrapped = (psi + np.pi) % (2 * np.pi) - np.pi
        broken = np.insert(deviation, np.flatnonzero(np.abs(np.diff(wrapped)) > np.pi) + 1, np.nan)
        places = np.insert(wrapped, np.flatnonzero(np.abs(np.diff(wrapped)) > np.pi) + 1, np.nan)
        panel.plot(places, broken, color=COLOURS[2], linewidth=0.9)
        # Where it is a tenth of a second after the start, and to where it goes.
        k = int(np.argmin(np.abs(motion["time_s"].to_numpy() - 0.1)))
        panel.annotate(
            "", (wrapped[k + 1], deviation[k + 1]), (wrapped[k], deviation[k]),
            arrowprops={"arrowstyle": "-|>", "color": COLOURS[2], "linewidth": 0.9},
        )  # fmt: skip
    slow = rows[rows["part"] == "degenerate"]
    panel.plot(slow["psi_tilde_rad"], slow["deviation_rad_s"], color=COLOURS[1], linestyle=(0, (5, 1.6)), linewidth=2.0)
    panel.axhline(0, color=GREY, linewidth=0.8)
    for _, row in rows[rows["part"] == "steady"].iterrows():
        panel.plot(
            row["psi_tilde_rad"], row["deviation_rad_s"], markeredgecolor="black", markersize=8, linestyle="none",
            zorder=5, **MARKERS[row["type"]],
        )  # fmt: skip


def _portrait_legend(table: pd.DataFrame) -> list[object]:
    from matplotlib.lines import Line2D

    kinds = table.loc[table["part"] == "steady", "type"].unique()
    return [
        Line2D([], [], color=COLOURS[2], linewidth=0.9, label="motion of the full model"),
        Line2D([], [], color=COLOURS[1], linestyle=(0, (5, 1.6)), linewidth=2.0, label="degenerate system (4.11)"),
        *(
            Line2D([], [], linestyle="none", markeredgecolor="black", markersize=8, label=kind, **MARKERS[kind])
            for kind in kinds
        ),
    ]
