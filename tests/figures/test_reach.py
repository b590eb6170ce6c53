"""The figure of reachable wrenches: shadows of the zonotope, trajectories in them, and the panel that decides."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.patches import Polygon

from occ.figures.reach import reach_figure, torque_box
from occ.figures.style import style
from occ.report.stored import Motion
from tests.allocation.wrenches import law_wrenches, youbot_map

TABLES: dict[str, Any] = {"platform": {"preset": "youbot"}, "limits": {"torque": 0.9}}


def motion() -> Motion:
    wrench = law_wrenches(201)
    names = ("force_x", "force_y", "yaw_moment")
    data = dict(zip(names, wrench, strict=True))
    return Motion(data | {"time": np.linspace(0, 15.7, 201), "torque": youbot_map().min_norm @ wrench}, {})


def test_cases_without_a_torque_limit_have_none() -> None:
    assert torque_box(TABLES | {"limits": {"wheel_power": 5.0}}) is None
    assert torque_box({}) is None


def test_shadows_and_least_torque() -> None:
    box = torque_box(TABLES)
    assert box is not None
    with style():
        figure = reach_figure(box, {"law": (0, motion())})
    *shadows, time = figure.axes
    assert len(shadows) == 3
    for panel in shadows:
        (patch,) = panel.patches
        assert isinstance(patch, Polygon)
        (line,) = panel.lines
        x, y = line.get_data()
        inside = patch.get_path().contains_points(np.column_stack([x, y]), radius=1e-6)
        # The law begins within reach.
        assert inside[:20].all()
    needs, limit = time.lines
    # mathematics, section 7: 0.971 N m, which 0.9 N m cannot do.
    assert max(needs.get_ydata()) > limit.get_ydata()[0] == 0.9
    assert abs(max(needs.get_ydata()) - 0.971) < 5e-4
