"""The platform on the floor: paths of B and of O, and the platform drawn at intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from occ.figures.over_time import Motions
from occ.figures.style import COLOURS, GREY, blank, label, place
from occ.report.stored import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PANELS = 8
SNAPSHOTS = 9


def path_figure(motions: Motions, where: str = "") -> Figure:
    """Paths of B and of O with the platform drawn at intervals, a panel for each controller.

    Args:
        motions: of one case; the first eight are drawn.
        where: added to the title.

    Returns:
        The figure; all panels share one scale, the same in both directions.
    """
    drawn = dict(list(motions.items())[:MOST_PANELS])
    columns = min(4, len(drawn))
    rows = -(-len(drawn) // columns)
    low, high = _extent(drawn)
    width = 2.5 if columns > 1 else 5.5
    height = width * float((high[1] - low[1]) / (high[0] - low[0]))
    # The legend has two rows, or three where it is narrow.
    left, bottom, top, across, up = 0.65, 1.15 if columns > 2 else 1.3, 0.8, 0.2, 0.5
    size = left + columns * (width + across), bottom + top + rows * height + (rows - 1) * up
    more = f", first {len(drawn)} of {len(motions)} controllers" if len(drawn) < len(motions) else ""
    figure = blank(*size, f"Paths on the floor{where}{more}", left)
    for k, (name, (_, motion)) in enumerate(drawn.items()):
        row, column = divmod(k, columns)
        box = left + column * (width + across), size[1] - top - height - row * (height + up), width, height
        panel = place(figure, box, xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        _draw_motion(panel, motion)
        panel.set_title(label(name), pad=4, fontsize=8.5)
        # A panel whose neighbour below or on the left is missing carries the labels itself.
        outer = k + columns >= len(drawn)
        panel.xaxis.set_visible(outer)
        panel.yaxis.set_visible(column == 0)
        panel.set_xlabel("x [m]")
        panel.set_ylabel("y [m]")
        panel.locator_params(nbins=5)
        panel.grid(visible=False)
    figure.legend(
        handles=_legend_handles(), loc="lower left", bbox_to_anchor=(left / size[0], 0.06 / size[1]),
        ncols=3 if columns > 2 else 2, borderaxespad=0.0,
    )  # fmt: skip
    return figure


def _extent(motions: Motions) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner [m] of all that is drawn."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for _, motion in motions.values():
        reach = float(np.hypot(*_wheels(motion).T).max()) + float(motion.attributes["wheel_radii"].max())
        center = np.array([motion["x"], motion["y"]])
        low = np.minimum(low, np.minimum(center.min(axis=1) - reach, motion["point"].min(axis=1)))
        high = np.maximum(high, np.maximum(center.max(axis=1) + reach, motion["point"].max(axis=1)))
    pad = 0.03 * (high - low).max()
    return low - pad, high + pad


def _wheels(motion: Motion) -> np.ndarray:
    """(n, 2) [m] Positions of the wheels in the body frame."""
    return np.reshape(motion.attributes["wheel_positions"], (-1, 2))


def _draw_motion(panel: Axes, motion: Motion) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    panel.set_aspect("equal")
    panel.plot(*motion["program"], color="#cfcfcf", linewidth=4.5, solid_capstyle="round", zorder=1.5)
    panel.plot(motion["x"], motion["y"], color=COLOURS[2], linestyle=(0, (4, 1.5)), linewidth=1.2, zorder=3)
    panel.plot(*motion["point"], color=COLOURS[1], linewidth=1.2, zorder=3)
    t = np.linspace(motion["time"][0], motion["time"][-1], SNAPSHOTS)
    pose = np.array([np.interp(t, motion["time"], motion[name]) for name in ("x", "y", "heading")])
    shades = [str(round(0.75 - 0.75 * k / (SNAPSHOTS - 1), 3)) for k in range(SNAPSHOTS)]
    body, wheels, arrow = _outline(motion)
    panel.add_collection(
        PolyCollection(_moved(body[None], pose), facecolors="none", edgecolors=shades, linewidths=0.9, zorder=2)
    )
    per_wheel = [shade for shade in shades for _ in wheels]
    panel.add_collection(PolyCollection(_moved(wheels, pose), facecolors=per_wheel, edgecolors="none", zorder=2))
    panel.add_collection(
        LineCollection(_moved(arrow, pose), colors=[s for s in shades for _ in arrow], linewidths=0.9, zorder=2)
    )
    point = _moved(np.asarray(motion.attributes["point_body"], dtype=float).reshape(1, 1, 2), pose)
    panel.plot(
        *np.array(point).reshape(-1, 2).T, linestyle="none", marker="o", color=COLOURS[1], markersize=3, zorder=4
    )


def _outline(motion: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Body (k, 2), wheels (n, 4, 2) and heading arrow (2, 3, 2) in the body frame [m]."""
    positions = _wheels(motion)
    around = positions - positions.mean(axis=0)
    body = positions[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]
    radius = np.asarray(motion.attributes["wheel_radii"], dtype=float)[:, None, None]
    angle = np.asarray(motion.attributes["wheel_mounting_angles"], dtype=float)
    # Seen from above a wheel is as long as its diameter; its width is not stored and drawn as its radius.
    corners = np.array([[1.0, 0.5], [-1.0, 0.5], [-1.0, -0.5], [1.0, -0.5]])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    wheels = positions[:, None, :] + radius * np.einsum("nij,kj->nki", turn, corners)
    tip = 0.8 * float(positions[:, 0].max())
    shaft = np.array([[0.0, 0.0], [tip, 0.0], [tip, 0.0]])
    head = np.array([[0.7 * tip, 0.15 * tip], [tip, 0.0], [0.7 * tip, -0.15 * tip]])
    return body, wheels, np.stack([shaft, head])


def _moved(shapes: np.ndarray, pose: np.ndarray) -> list[np.ndarray]:
    """Shapes (m, k, 2) of the body frame on the floor, at every pose (3, s)."""
    moved = []
    for x, y, heading in pose.T:
        c, s = np.cos(heading), np.sin(heading)
        moved += list(shapes @ np.array([[c, s], [-s, c]]) + np.array([x, y]))
    return moved


def _legend_handles() -> list[object]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Line2D([], [], color="#cfcfcf", linewidth=4.5, label="program of B"),
        Line2D([], [], color=COLOURS[1], linewidth=1.2, marker="o", markersize=3, label="path of B"),
        Line2D(
            [], [], color=COLOURS[2], linestyle=(0, (4, 1.5)), linewidth=1.2, label="path of O, the platform's centre"
        ),
        Patch(
            facecolor="none", edgecolor=GREY, label="platform with its wheels,\nlight at the start, black at the end"
        ),
        Line2D([], [], color=GREY, marker=">", markersize=5, linewidth=0.9, label="heading: the OX axis from O"),
    ]
