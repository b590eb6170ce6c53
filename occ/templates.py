"""Texts made from a frame and values: the one place that knows the template library."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any


def render(frame: Path, values: Mapping[str, Any], filters: Mapping[str, Callable[..., str]] | None = None) -> str:
    """The text of a frame; a value that the frame asks for and does not get is an error.

    Args:
        frame: the file of the frame.
        values: that the frame takes.
        filters: functions that the frame may apply to values.

    Returns:
        The content of a file.
    """
    environment = _environment(frame.parent)
    if filters:
        environment = environment.overlay()
        environment.filters = environment.filters | dict(filters)
    return str(environment.get_template(frame.name).render(**values))


@cache
def _environment(folder: Path) -> Any:
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
