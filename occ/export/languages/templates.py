"""The frames into which languages put what they print."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from occ import templates


def render(name: str, values: Mapping[str, Any]) -> str:
    """The text of a frame.

    Args:
        name: of the file NAME.j2 beside this module.
        values: that the frame takes.

    Returns:
        The content of a file.
    """
    return templates.render(Path(__file__).parent / f"{name}.j2", values)
