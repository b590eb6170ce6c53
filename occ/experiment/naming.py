"""Names of cases, as people read them and as folders and files can carry them, and names that were misspelt."""

from __future__ import annotations

import hashlib
import re
from difflib import get_close_matches
from typing import Any

from occ.errors import InputError

BASE = "base"
"""The case of an experiment without a sweep."""
LONGEST_FILE_NAME = 120


def slug(name: str) -> str:
    """The part of a file's name that stands for a case or a controller.

    Args:
        name: of any content.

    Returns:
        Letters, digits and . + = , - _ only, at most `LONGEST_FILE_NAME` characters.
    """
    text = re.sub(r"[^A-Za-z0-9.+=,_-]", "_", name)
    if len(text) <= LONGEST_FILE_NAME:
        return text
    digest = hashlib.sha256(name.encode()).hexdigest()[:12]
    return f"{text[: LONGEST_FILE_NAME - 13]}-{digest}"


def compact(value: Any) -> str:
    """A value in the name of a case: shortest exact number, ``laps=1`` for a table, ``[0.1,0.2]`` for a list."""
    if isinstance(value, dict):
        return ",".join(f"{key}={compact(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list | tuple):
        return f"[{','.join(compact(item) for item in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value).removesuffix(".0")
    return str(value)


def case_name(swept: dict[str, Any]) -> str:
    """``motion.radius=0.6,horizon.laps=1``; ``base`` where nothing is swept.

    Args:
        swept: values by dotted name; tables as dictionaries.

    Returns:
        A name that differs where a value differs.
    """
    parts: list[str] = []
    for key, value in swept.items():
        if isinstance(value, dict) and value:
            parts += [f"{key}.{name}={compact(item)}" for name, item in value.items()]
        else:
            parts.append(f"{key}={compact(value)}")
    return ",".join(parts) or BASE


def nearest(name: Any, valid: list[str]) -> str | None:
    """The valid name that is nearest to a misspelt one, or None."""
    return next(iter(get_close_matches(str(name), valid, 1)), None)


def suggestion(near: str | None, valid: list[str]) -> str:
    """The words that follow the semicolon after an unknown name."""
    return f'did you mean "{near}"?' if near else f"valid: {', '.join(valid)}"


def controller_at(tables: dict[str, Any], rest: str) -> tuple[dict[str, Any], list[str]]:
    """The table of the controller that a dotted key names, and the steps inside it; names may contain dots.

    Args:
        tables: of an experiment.
        rest: of the key, without its first step ``controller``.

    Returns:
        The controller's table, and the names of the keys on the way from there.

    Raises:
        InputError: no controller of that name, or no key of it; says what would be right.
    """
    controllers = tables.get("controller")
    listed = [table for table in controllers if isinstance(table, dict)] if isinstance(controllers, list) else []
    named = {str(table.get("name")): table for table in listed}
    for name in sorted(named, key=len, reverse=True):
        if rest.startswith(f"{name}.") and len(rest) > len(name) + 1:
            return named[name], rest[len(name) + 1 :].split(".")
    if rest in named:
        raise InputError(
            f'a whole controller cannot be given; should be one of its keys such as "controller.{rest}.kind"'
        )
    wrong = rest.rpartition(".")[0] or rest
    raise InputError(f'unknown controller "{wrong}"; {suggestion(nearest(wrong, list(named)), list(named))}')
