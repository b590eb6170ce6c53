"""Trajectories on disk: the referee's motion with names, units and long names, as netCDF."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from occ.objectives import INTEGRALS
from occ.referee.judge import Verdict
from occ.task import Task

if TYPE_CHECKING:
    import xarray as xr

SAMPLE_COUNT = 601


def motion_dataset(task: Task, verdict: Verdict, attributes: dict[str, Any]) -> xr.Dataset:
    """The true motion at even times and at the control's knots, with work accumulated over time.

    Args:
        task: platform, point and motion.
        verdict: with the true motion.
        attributes: of the whole file (experiment, case, controller, versions).

    Returns:
        Variables over ``time``, ``wheel``, ``wrench`` and ``objective``, each with ``units`` and ``long_name``.

    Raises:
        ValueError: the verdict has no motion.
    """
    import xarray as xr

    if verdict.replay is None or verdict.samples is None:
        raise ValueError("a verdict without a motion has no dataset")
    t = np.unique(np.concatenate([np.linspace(0.0, task.duration, SAMPLE_COUNT), verdict.replay.edges]))
    s = verdict.replay.sample(t)
    point, _ = task.point_motion(s.state)
    program, _, _ = task.motion.at(t)
    wrench = np.array(task.dynamics.coefficients.wheel_rates).T @ s.torque
    costs = verdict.samples.accumulated(t)
    names = (
        ("x", "m", "x_O"),
        ("y", "m", "y_O"),
        ("heading", "rad", "heading psi"),
        ("velocity_x", "m/s", "V_X"),
        ("velocity_y", "m/s", "V_Y"),
        ("yaw_rate", "rad/s", "yaw rate Omega"),
    )
    data: dict[str, Any] = {
        name: ("time", s.state[i], {"units": unit, "long_name": text}) for i, (name, unit, text) in enumerate(names)
    }
    axis = ("axis", "time")
    data |= {
        "point": (axis, point, {"units": "m", "long_name": "position of B on the floor"}),
        "program": (axis, program, {"units": "m", "long_name": "program position of B"}),
        "torque": (("wheel", "time"), s.torque, {"units": "N m", "long_name": "wheel torque M_i"}),
        "wheel_rate": (("wheel", "time"), s.wheel_rates, {"units": "rad/s", "long_name": "wheel rate"}),
        "power": (("wheel", "time"), s.power, {"units": "W", "long_name": "wheel power"}),
        "force_x": ("time", wrench[0], {"units": "N", "long_name": "generalised force F_X"}),
        "force_y": ("time", wrench[1], {"units": "N", "long_name": "generalised force F_Y"}),
        "yaw_moment": ("time", wrench[2], {"units": "N m", "long_name": "generalised moment M_Omega"}),
        "kinetic_energy": ("time", s.kinetic_energy, {"units": "J", "long_name": "kinetic energy"}),
        "dissipation": ("time", s.dissipation, {"units": "W", "long_name": "power lost to friction"}),
    }
    for i, item in enumerate(INTEGRALS.values()):
        data[item.name] = ("time", costs[i], {"units": item.unit, "long_name": f"integral of {item.equation}"})
    coordinates = {
        "time": ("time", t, {"units": "s", "long_name": "time"}),
        "wheel": np.arange(1, task.platform.wheel_count + 1),
        "axis": ["x", "y"],
    }
    platform = task.platform
    attributes = attributes | {
        "point_body": list(task.point),
        "wheel_positions": np.ravel([wheel.position for wheel in platform.wheels]),
        "wheel_mounting_angles": [wheel.mounting_angle for wheel in platform.wheels],
        "wheel_radii": [wheel.radius for wheel in platform.wheels],
    }
    return xr.Dataset(data, coordinates, attributes)
