"""Folders of stored results with made-up numbers, for reports and figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from occ.objectives import OBJECTIVES
from occ.referee import LABELS, MEASURES

WHEELS = np.array([[0.2, 0.15], [0.2, -0.15], [-0.2, 0.15], [-0.2, -0.15]])
COMPARED = ("work", "torque_squared")


def row(controller: str, work: float | None = 100.0, case: str = "base", **more: Any) -> dict[str, Any]:
    """A row that is ok, with a local bound of 80 J unless its start is its own."""
    measures: dict[str, Any] = dict.fromkeys(MEASURES, 1e-12)
    measures |= {item.column: 2.0 for item in OBJECTIVES.values()}
    measures |= {"work_J": work, "kinetic_change_J": -1.0, "dissipation_J": (work or 0.0) + 1.0, "peak_torque_Nm": 1.25}
    labels = {"status": "ok", "message": "", "keep": "path", "start": "given", "end": "free"}
    filled = {"case": case, "controller": controller} | labels | measures | more
    covered = filled["status"] == "ok" and filled["start"] == "given"
    for name in COMPARED:
        value, bound = filled[OBJECTIVES[name].column], 80.0 if name == "work" else 1.0
        gap = 100.0 * (value / bound - 1.0) if covered and value is not None else None
        bounds = bound if covered else None, "local" if covered else "none", gap
        for column, number in zip(("bound", "bound_kind", "gap_percent"), bounds, strict=True):
            filled.setdefault(f"{name}_{column}", number)
    return filled


def motion(duration: float = 4.0, spin: float = 0.5, spike: float = 0.0) -> dict[str, Any]:
    """Variables of a motion on a circle, as the experiment stores them; `spike` [N m] lasts for a thousandth of it."""
    t = np.unique(np.concatenate([np.linspace(0.0, duration, 81), [0.0005 * duration, 0.001 * duration]]))
    heading = spin * t
    point = np.array([0.7 * np.cos(t), 0.7 * np.sin(t)])
    torque = np.array([1.0 + 0.1 * i + 0.2 * np.sin(t) for i in range(4)])
    torque[0, t < 0.001 * duration] = spike or torque[0, 0]
    body = np.array([0.4, 0.05])
    c, s = np.cos(heading), np.sin(heading)
    center = point - np.array([c * body[0] - s * body[1], s * body[0] + c * body[1]])
    data: dict[str, Any] = {
        "x": center[0],
        "y": center[1],
        "heading": heading,
        "yaw_rate": np.full_like(t, spin),
        "force_x": 20 * np.cos(t),
        "force_y": 30 * np.sin(t),
        "yaw_moment": 5 * np.cos(2 * t),
    }
    data |= {name: (k + 1.0) * t * (1 + 0.1 * spin) for k, name in enumerate(OBJECTIVES)}
    return {"time": t, "point": point, "program": point, "torque": torque} | data


def store_motion(path: Path, data: dict[str, Any]) -> None:
    """Write a motion as netCDF."""
    import xarray as xr

    dimensions = {"point": ("axis", "time"), "program": ("axis", "time"), "torque": ("wheel", "time")}
    variables = {name: (dimensions.get(name, "time"), values) for name, values in data.items() if name != "time"}
    attributes = {
        "point_body": [0.4, 0.05],
        "wheel_positions": WHEELS.ravel(),
        "wheel_mounting_angles": [0.0] * 4,
        "wheel_radii": [0.05] * 4,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    xr.Dataset(variables, {"time": data["time"]}, attributes).to_netcdf(path, engine="h5netcdf")


def store(
    folder: Path, rows: list[dict[str, Any]], motions: dict[tuple[str, str], dict[str, Any]] | None = None
) -> Path:
    """Write results.csv, run.json and the trajectories of the given (case, controller) pairs."""
    folder.mkdir(parents=True, exist_ok=True)
    table = pd.DataFrame(rows)
    bounds = [name for name in table.columns if name.endswith(("_bound", "_bound_kind", "_gap_percent"))]
    swept = [name for name in table.columns if name not in {*LABELS, *MEASURES, *bounds}]
    labels = list(LABELS)
    table[[*labels, *swept, *MEASURES, *bounds]].to_csv(folder / "results.csv", index=False)
    cases: dict[str, Any] = {}
    for entry in rows:
        case = cases.setdefault(
            entry["case"], {"swept": {}, "slug": entry["case"].replace(" ", "_"), "controllers": {}}
        )
        case["controllers"][entry["controller"]] = {"trajectory": None}
    for (name, controller), data in (motions or {}).items():
        place = f"trajectories/{cases[name]['slug']}@{controller.replace(' ', '_')}.nc"
        store_motion(folder / place, data)
        cases[name]["controllers"][controller]["trajectory"] = place
    experiment = {
        "title": "A made-up comparison",
        "question": "How close is the first | law?",
        "compare": {"objectives": list(COMPARED)},
        "motion": {"kind": "circle", "radius": 0.7},
    }
    (folder / "run.json").write_text(json.dumps({"experiment": experiment, "cases": cases}))
    return folder
