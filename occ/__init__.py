"""occ: how close is a control law for an omnidirectional platform to energy-optimal?

``import occ`` answers at once; each name is loaded when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from occ.control import PythonControl as PythonControl
    from occ.control import SymbolicControl as SymbolicControl
    from occ.errors import InputError as InputError
    from occ.errors import OccError as OccError
    from occ.errors import Status as Status
    from occ.laws import Moment as Moment
    from occ.laws import PathKeepingLaw as PathKeepingLaw
    from occ.laws import PrescribedRotation as PrescribedRotation
    from occ.laws import ServoLaw as ServoLaw
    from occ.model.dynamics import Dynamics as Dynamics
    from occ.model.dynamics import dynamics as dynamics
    from occ.model.platform import Platform as Platform
    from occ.model.platform import Wheel as Wheel
    from occ.model.presets import omni3 as omni3
    from occ.model.presets import youbot as youbot
    from occ.motion import Circle as Circle
    from occ.motion import Ellipse as Ellipse
    from occ.motion import FigureEight as FigureEight
    from occ.motion import Line as Line
    from occ.motion import ProgramMotion as ProgramMotion
    from occ.motion import RestToRestLine as RestToRestLine
    from occ.motion import SplineMotion as SplineMotion
    from occ.optimal.collocation import Collocation as Collocation
    from occ.optimal.cost import Weights as Weights
    from occ.referee import Record as Record
    from occ.referee import judge as judge
    from occ.task import Claim as Claim
    from occ.task import Limits as Limits
    from occ.task import Solution as Solution
    from occ.task import Start as Start
    from occ.task import Task as Task
    from occ.trajectory import Trajectory as Trajectory

__version__ = "0.1.0"

_HOMES = {
    "occ.control": ("PythonControl", "SymbolicControl"),
    "occ.errors": ("InputError", "OccError", "Status"),
    "occ.laws": ("Moment", "PathKeepingLaw", "PrescribedRotation", "ServoLaw"),
    "occ.model.dynamics": ("Dynamics", "dynamics"),
    "occ.model.platform": ("Platform", "Wheel"),
    "occ.model.presets": ("omni3", "youbot"),
    "occ.motion": ("Circle", "Ellipse", "FigureEight", "Line", "ProgramMotion", "RestToRestLine", "SplineMotion"),
    "occ.optimal.collocation": ("Collocation",),
    "occ.optimal.cost": ("Weights",),
    "occ.referee": ("Record", "judge"),
    "occ.task": ("Claim", "Limits", "Solution", "Start", "Task"),
    "occ.trajectory": ("Trajectory",),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = ["__version__", *sorted(_HOME)]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'occ' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
