"""The frames into which languages put what they print."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any


@cache
def _environment() -> Any:
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )


def render(name: str, values: Mapping[str, Any]) -> str:
    """The text of a frame.

    Args:
        name: of the file NAME.j2 beside this module.
        values: that the frame takes.

    Returns:
        The content of a file.
    """
    return str(_environment().get_template(f"{name}.j2").render(**values))
