"""What happens over time: costs, heading, forces and torques of all controllers of one case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.figures.style import blank, controller_line, label, legend_beside, look, panels, place
from occ.objectives import Objective
from occ.report.contents import plain_name, plain_unit
from occ.report.stored import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEAR = 0.15
"""A curve is near the law where it never is further away than this share of the law's total."""
FAR = 4.0
"""A cost that many times larger than the middle one leaves the scale, or the others could not be told apart."""

Motions = Mapping[str, tuple[int, Motion]]
"""By controller: its place in the experiment, and its motion."""


def cost_figure(item: Objective, motions: Motions, where: str = "") -> Figure:
    """An objective over time for all controllers and, below, its difference to the law (the paper's Fig. 10).

    Args:
        item: the objective.
        motions: of one case; the others are compared with the first one.
        where: added to the title.

    Returns:
        The figure: one panel, or two where there is something to compare.
    """
    unit, name = plain_unit(item.unit), plain_name(item)
    heights = [2.9, 2.3] if len(motions) > 1 else [2.9]
    figure, axes = panels(6.2, heights, f"{name.capitalize()} over time{where}")
    legend_beside(axes[0], _draw(axes[0], motions, item.name))
    totals = {who: float(motion[item.name].max()) for who, (_, motion) in motions.items()}
    middle = float(np.median(list(totals.values())))
    hidden = {who: total for who, total in totals.items() if total > FAR * middle > 0}
    if hidden:
        top = max(total for who, total in totals.items() if who not in hidden)
        low = min(float(motion[item.name].min()) for _, motion in motions.values())
        axes[0].set_ylim(low - 0.05 * top, 1.08 * top)
        beyond = (f"{who} goes up to {plain_number(total)} {unit}, off this scale" for who, total in hidden.items())
        _note(axes[0], "; ".join(beyond))
    axes[0].set_ylabel(f"{name} [{unit}]")
    _time_axis(axes[-1], motions)
    if len(motions) > 1:
        _differences(axes[1], item, motions, unit)
    return figure


def _draw(panel: Axes, motions: Motions, quantity: str) -> list[Any]:
    return [
        panel.plot(motion["time"], motion[quantity], label=label(name), **controller_line(index))[0]
        for name, (index, motion) in motions.items()
    ]


def _time_axis(panel: Axes, motions: Motions) -> None:
    panel.set_xlabel("time [s]")
    panel.set_xlim(0.0, max(float(motion["time"][-1]) for _, motion in motions.values()))


def _note(panel: Axes, text: str) -> None:
    panel.text(
        0.5, 0.97, text, transform=panel.transAxes, ha="center", va="top", fontsize=7.5, style="italic", zorder=5,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5, "alpha": 0.85},
    )  # fmt: skip


def _differences(panel: Axes, item: Objective, motions: Motions, unit: str) -> None:
    """Curves minus the first one, on a scale for those that are near it."""
    (reference, (_, first)), *_ = motions.items()
    near, total = [], abs(float(first[item.name][-1]))
    for name, (index, motion) in motions.items():
        difference = motion[item.name] - np.interp(motion["time"], first["time"], first[item.name])
        panel.plot(motion["time"], difference, label=label(name), **controller_line(index) | {"linewidth": 1.5})
        if name != reference and np.abs(difference).max() < NEAR * total:
            near.append((motion["time"], difference))
    far = len(motions) - 1 - len(near)
    heading = f"Difference to {reference}"
    if near:
        low, high = visible_range(near)
        pad = 0.08 * max(high - low, 1e-9 * total)
        panel.set_ylim(min(low, 0.0) - pad, max(high, 0.0) + pad)
        heading += f" (enlarged; {far} of {far + len(near)} curves leave this scale)" if far else ""
    panel.set_title(heading, pad=4)
    panel.set_ylabel(f"difference [{unit}]")


def heading_figure(motions: Motions, where: str = "") -> Figure:
    """Heading and yaw rate over time for all controllers.

    Args:
        motions: of one case.
        where: added to the title.

    Returns:
        The figure: two panels.
    """
    figure, (top, bottom) = panels(6.2, [2.6, 2.6], f"Heading and yaw rate over time{where}")
    legend_beside(top, _draw(top, motions, "heading"))
    _draw(bottom, motions, "yaw_rate")
    top.set_ylabel("heading ψ [rad]")
    bottom.set_ylabel("yaw rate Ω [rad/s]")
    _time_axis(bottom, motions)
    return figure


def force_figure(motions: Motions, where: str = "") -> Figure:
    """Generalised forces (the paper's Figs. 4 and 9) and wheel torques, a row for each controller.

    Args:
        motions: of one case.
        where: added to the title.

    Returns:
        The figure: two columns; in each of them all rows share one scale.
    """
    width, height, between, left, top, bottom = 4.1, 1.15, 0.36, 0.75, 1.2, 0.5
    count, step = len(motions), width + 0.75
    total = top + bottom + count * height + (count - 1) * between
    figure = blank(left + step + width + 0.2, total, f"Generalised forces and wheel torques{where}", left)
    wheels = max(len(motion["torque"]) for _, motion in motions.values())
    columns = (
        (("force_x", "force_y", "yaw_moment"), ["F_X [N]", "F_Y [N]", "M_Ω [N m]"], "[N], [N m]"),
        (("torque",), [f"M_{i + 1} [N m]" for i in range(wheels)], "torque [N m]"),
    )
    for column, (quantities, names, axis_label) in enumerate(columns):
        curves = {who: np.vstack([motion[q] for q in quantities]) for who, (_, motion) in motions.items()}
        low, high = visible_range([(motions[who][1]["time"], row) for who, rows in curves.items() for row in rows])
        pad = 0.06 * max(high - low, 1e-9)
        first: Axes | None = None
        for row, (who, (_, motion)) in enumerate(motions.items()):
            edge = total - top - height - row * (height + between)
            panel = place(figure, (left + column * step, edge, width, height), first)
            for i, values in enumerate(curves[who]):
                shown = names[i] if column == 0 else names[i].split(" ")[0]
                panel.plot(motion["time"], values, label=shown, linewidth=1.3, **look(i))
            panel.set_ylim(low - pad, high + pad)
            panel.set_title(who, pad=5)
            panel.set_ylabel(axis_label)
            # Ticks are most of what drawing costs; inner rows share those of the last one.
            panel.xaxis.set_visible(row == count - 1)
            panel.locator_params(axis="y", nbins=4)
            _note_peak(panel, motion["time"], dict(zip(names, curves[who], strict=False)))
            if first is None:
                first = panel
                above = (0.0, 1 + 0.28 / height)
                panel.legend(loc="lower left", bbox_to_anchor=above, ncols=len(names), borderaxespad=0.0)
        _time_axis(panel, motions)
    return figure


def _note_peak(panel: Axes, t: np.ndarray, curves: Mapping[str, np.ndarray]) -> None:
    """Say which curve leaves the axes most, and how far it goes; the names are as in a legend, with units."""
    values = np.array(list(curves.values()))
    low, high = panel.get_ylim()
    beyond = np.maximum(values - high, low - values)
    if beyond.max() <= 0:
        return
    row, column = np.unravel_index(np.argmax(beyond), beyond.shape)
    name, unit = list(curves)[row].rstrip("]").split(" [")
    _note(panel, f"{name} leaves this scale: {plain_number(values[row, column])} {unit} at t = {t[column]:.4g} s")


def plain_number(value: float) -> str:
    """Four significant digits, without an exponent up to a million."""
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"


def visible_range(curves: Sequence[tuple[np.ndarray, np.ndarray]], share: float = 0.01) -> tuple[float, float]:
    """Lowest and highest value that a reader should see: short peaks are left out where they would flatten the rest.

    Args:
        curves: pairs of times (N,) [s] and values (N,).
        share: of the time that may be left out at either end.

    Returns:
        The limits; the whole range where it is not much larger than the range without peaks.
    """
    low, high = np.inf, -np.inf
    for t, values in curves:
        order = np.argsort(values)
        # Knots crowd together where torques are steep: a value counts by the time for which it lasts.
        passed = np.cumsum(np.gradient(t)[order])
        inside = np.searchsorted(passed, np.array([share, 1.0 - share]) * passed[-1])
        low, high = min(low, values[order][inside[0]]), max(high, values[order][inside[1]])
    lowest, highest = (float(f([f(values) for _, values in curves])) for f in (np.min, np.max))
    if highest - lowest <= 2.0 * (high - low):
        return lowest, highest
    # Of two sides only the one with the peaks is cut.
    reach = 0.15 * (high - low)
    return max(lowest, float(low) - reach), min(highest, float(high) + reach)
