"""Units of the keys of experiment files, from the documentation of their tables."""

from __future__ import annotations

import re
from typing import Any

from occ.experiment.naming import controller_at
from occ.experiment.schema import CONTROLLERS, ExperimentFile
from occ.experiment.tables import Table, models_in

STATED = re.compile(r"(?:\([^)]*\) )?\[([^\]]+)\]")
"""How the meaning of a key begins: a shape where it is no number, and a unit."""


def unit_of(key: str, tables: dict[str, Any]) -> str:
    """The unit of a swept key; ``1`` where it has none.

    Args:
        key: dotted name.
        tables: of the experiment, which say of what kind a controller is; they may be empty.

    Returns:
        Plain text such as ``rad/s``.
    """
    steps = key.split(".")
    models: list[type[Table]] = [ExperimentFile]
    if steps[0] == "controller" and "controller" in tables:
        controller, steps = controller_at(tables, key.partition(".")[2])
        models = [model for model in CONTROLLERS if model.tag == controller.get("kind")]
    elif steps[:2] == ["plant", "platform"]:
        steps = steps[1:]  # the plant's platform has the keys of the model's
    meanings: list[str] = []
    for step in steps:
        fields = [field for model in models for name, field in model.model_fields.items() if step == name]
        meanings = [field.description or "" for field in fields]
        models = [model for field in fields for model in models_in(field.annotation)]
    return next((found.group(1) for found in map(STATED.match, meanings) if found), "1")
