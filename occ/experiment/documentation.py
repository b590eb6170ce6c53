"""What the docstrings of platforms, motions and controllers say of them, for `occ list` and the JSON Schema."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
from collections.abc import Sequence
from typing import Any, NamedTuple


class KeyText(NamedTuple):
    """One key of a table.

    Args:
        name: as in experiment files.
        text: meaning with unit; empty where the class does not say.
        default: None where the key is required or simply absent.
        required: whether the key must be given.
        unit: empty where the field's metadata has none.
        symbol: of the paper.
        source: of the default.
    """

    name: str
    text: str
    default: Any
    required: bool
    unit: str = ""
    symbol: str = ""
    source: str = ""


def summary(cls: type) -> str:
    """The first paragraph of a class's own docstring, on one line."""
    return " ".join((inspect.cleandoc(cls.__doc__ or "")).split("\n\n")[0].split())


def key_texts(cls: type) -> list[KeyText]:
    """Name, meaning and default of each field of a dataclass, from its `Args:` section and the fields' metadata."""
    described = argument_texts(cls)
    texts = []
    for field in dataclasses.fields(cls):
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        default = None if required or field.default is dataclasses.MISSING else field.default
        meta = {name: str(field.metadata.get(name, "")) for name in ("unit", "symbol", "source")}
        text = described.get(field.name, "")
        if not text and meta["symbol"]:
            text = f"[{meta['unit']}] {meta['symbol']}; default from {meta['source']}"
        texts.append(KeyText(field.name, text, default, required, **meta))
    return texts


def argument_texts(cls: type) -> dict[str, str]:
    """Meaning of each argument in the docstring's `Args:` section, continuation lines joined."""
    section = re.search(r"^Args:\n((?:[ ]+.*\n?|\n)*)", inspect.cleandoc(cls.__doc__ or "") + "\n", re.MULTILINE)
    found: dict[str, str] = {}
    name = ""
    for line in section.group(1).splitlines() if section else []:
        start = re.match(r" {4}(\w+): (.*)", line)
        if start:
            name = start.group(1)
            found[name] = start.group(2).strip()
        elif name and line.strip():
            found[name] += " " + line.strip()
    return found


def listing(family: str) -> str:
    """What an experiment can name of one family, as text.

    Args:
        family: ``platforms``, ``motions``, ``controllers`` or ``objectives``.

    Returns:
        Lines without a line break at the end.
    """
    from occ.model.presets import PLATFORMS
    from occ.motion import MOTIONS
    from occ.objectives import OBJECTIVES
    from occ.players import PLAYERS

    if family == "objectives":
        rows = [(item.name, item.unit, item.meaning) for item in OBJECTIVES.values()]
        return "\n".join(["objectives ([compare] objectives = [...])", *aligned(rows, "  ")])
    head, members = {
        "platforms": ('platforms ([platform] preset = "...")', list(PLATFORMS.items())),
        "motions": ('motions ([motion] kind = "...")', _kinds(MOTIONS)),
        "controllers": ('controllers ([[controller]] kind = "...")', _kinds(PLAYERS)),
    }[family]
    lines = [head]
    for name, cls in members:
        lines.append(f"  {name}: {summary(cls)}")
        lines += aligned([(key.name, _default(key), key.text) for key in key_texts(cls)], "    ")
    return "\n".join(lines)


def _kinds(classes: Sequence[type]) -> list[tuple[str, type]]:
    return [(vars(cls)["kind"], cls) for cls in classes]


def _default(key: KeyText) -> str:
    if key.required:
        return "required"
    if isinstance(key.default, tuple):
        return f"[{', '.join(map(str, key.default))}]"
    return json.dumps(key.default) if isinstance(key.default, str | int | float) else "optional"


def aligned(rows: Sequence[tuple[str, ...]], indent: str) -> list[str]:
    """Lines of a table whose columns are as wide as their widest cell."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [indent + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
