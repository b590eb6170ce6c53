"""Exports for tests: modules, their files in a folder, and the exported Python as functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from occ.export.export import printed
from occ.export.languages import Language
from occ.export.languages.numpy_code import NumPy
from occ.export.request import Request
from occ.export.routine import Module

ARGUMENTS = ("state", "torque", "acceleration", "wrench", "limit", "t", "point", "motion")
KEYS = ("platform_mass", "wheel_friction", "roller_friction", "half_track", "half_wheelbase", "wheel_radius")
SAMPLES = 1000


@lru_cache(maxsize=32)
def modules_of(*names: str, wrt: tuple[str, ...] = (), **options: Any) -> list[Module]:
    """The modules of these exports; ``wrt`` as after --wrt."""
    return Request(names or ("all",), wrt, ("python",), **options).modules()[0]


def write(folder: Path, modules: Sequence[Module], languages: Sequence[Language], samples: int = SAMPLES) -> None:
    for name, content in printed(modules, languages, samples).items():
        (folder / name).write_text(content)


def functions_of(module: Module) -> dict[str, Callable[..., np.ndarray]]:
    """The exported Python, run."""
    (text,) = NumPy().files(module).values()
    names: dict[str, Any] = {"__name__": module.name}
    exec(compile(text, module.name, "exec"), names)
    return {routine.name: names[routine.name] for routine in module.routines}
