"""The wrenches that a torque limit lets the wheels reach, with the wrenches of each motion among them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.figures.over_time import Motions
from occ.figures.style import GREY, blank, controller_line, label, place

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from occ.allocation import InputMap

FORCES = (("force_x", "F_X [N]"), ("force_y", "F_Y [N]"), ("yaw_moment", "M_Ω [N m]"))


@dataclass(frozen=True, eq=False)
class TorqueBox:
    """|M_i| <= limit on every wheel of a wheel set.

    Args:
        wheels: the input map.
        limit: [N m].
    """

    wheels: InputMap
    limit: float


def torque_box(tables: Mapping[str, Any]) -> TorqueBox | None:
    """The torque limit of a case.

    Args:
        tables: of the case, as `run.json` holds them.

    Returns:
        Wheels and limit; None where there is no limit, or where there are too many wheels for a drawing.
    """
    from pydantic import TypeAdapter

    from occ.allocation import platform_input_map
    from occ.allocation.reach import MOST_CORNERS
    from occ.experiment.schema import PlatformTable

    limit = tables.get("limits", {}).get("torque")
    if limit is None:
        return None
    table: Any = TypeAdapter(PlatformTable).validate_python(tables["platform"])
    wheels = platform_input_map(table.build())
    return TorqueBox(wheels, float(limit)) if wheels.wheel_count <= MOST_CORNERS else None


def reach_figure(box: TorqueBox, motions: Motions, where: str = "") -> Figure:
    """Three shadows of the zonotope of reachable wrenches, and over time how much torque each wrench needs at least.

    A wrench inside of all three shadows can still be out of reach; the panel below them decides.

    Args:
        box: wheels and limit.
        motions: of one case.
        where: added to the title.

    Returns:
        The figure: four panels.
    """
    from matplotlib.patches import Polygon
    from scipy.spatial import ConvexHull

    from occ.allocation.ranges import box as symmetric
    from occ.allocation.reach import corners

    points = corners(box.wheels, symmetric(box.limit, box.wheels.wheel_count))
    width, height, left, bottom, gap = 2.55, 2.3, 0.75, 3.35, 0.75
    size = left + 3 * width + 2 * gap + 0.25, 6.3
    figure = blank(*size, f"Wrenches within reach of {box.limit:g} N m on every wheel{where}", left)
    for k, (i, j) in enumerate(combinations(range(3), 2)):
        panel = place(figure, (left + k * (width + gap), bottom, width, height))
        shadow = points[[i, j]].T
        outline = shadow[ConvexHull(shadow / np.abs(shadow).max(axis=0)).vertices]
        panel.add_patch(Polygon(outline, closed=True, facecolor="#eeeeee", edgecolor=GREY, linewidth=1.0, zorder=1))
        for index, motion in motions.values():
            panel.plot(motion[FORCES[i][0]], motion[FORCES[j][0]], **controller_line(index) | {"linewidth": 1.2})
        panel.set_xlabel(FORCES[i][1])
        panel.set_ylabel(FORCES[j][1])
        panel.margins(0.06)
        panel.locator_params(nbins=5)
    panel = place(figure, (left, 0.6, 2 * width + gap, 1.9))
    for name, (index, motion) in motions.items():
        needs = box.wheels.least_peak(motion["torque"])
        panel.plot(motion["time"], needs, label=label(name), **controller_line(index) | {"linewidth": 1.2})
    panel.axhline(box.limit, color=GREY, linewidth=1.0, linestyle=(0, (4, 2)), label="limit")
    panel.set_title("Least possible largest torque for the wrench: above the limit it is out of reach", pad=4)
    panel.set_xlabel("time [s]")
    panel.set_ylabel("torque [N m]")
    panel.set_xlim(0.0, max(float(motion["time"][-1]) for _, motion in motions.values()))
    # A cost without curvature in the torque ends in a spike that tells nothing of the reach.
    panel.set_ylim(0.0, 1.3 * box.limit)
    panel.legend(loc="upper left", bbox_to_anchor=(1.02, 1.05), borderaxespad=0.0, labelspacing=0.5, fontsize=7.5)
    return figure
