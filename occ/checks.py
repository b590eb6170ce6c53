"""One declaration of what a number may be, used by the Python constructors and by the experiment files alike.

A field annotated ``Positive`` is checked by `check_fields` when a dataclass is built in Python, and the same
annotation becomes the constraint (and the JSON Schema) of the key in an experiment file.
"""

from __future__ import annotations

import sys
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le

from occ.errors import InputError

Positive = Annotated[float, Gt(0)]
NonNegative = Annotated[float, Ge(0)]
Angle = float
"""[rad]"""
Vector2 = tuple[float, float]


def _violation(value: Any, hint: Any) -> str | None:
    """What `value` should have been, or None where it satisfies `hint`."""
    origin = get_origin(hint)
    if origin is Annotated:
        base, *rules = get_args(hint)
        wrong = _violation(value, base)
        if wrong:
            return wrong
        for rule in rules:
            if isinstance(rule, Gt) and not value > rule.gt:
                return f"greater than {rule.gt}"
            if isinstance(rule, Ge) and not value >= rule.ge:
                return f"at least {rule.ge}"
            if isinstance(rule, Le) and not value <= rule.le:
                return f"at most {rule.le}"
        return None
    if origin is Literal:
        options = get_args(hint)
        return None if value in options else "one of " + ", ".join(map(repr, options))
    if origin is tuple:
        return _tuple_violation(value, get_args(hint))
    if hint is bool:
        return None if isinstance(value, bool) else "true or false"
    if hint is float or hint is int:
        kinds = (int, float) if hint is float else (int,)
        if isinstance(value, bool) or not isinstance(value, kinds):
            return "a number" if hint is float else "a whole number"
        # Beyond the largest float a whole number is none of ours, either.
        return None if abs(value) <= sys.float_info.max else "a finite number"
    if isinstance(hint, type) and is_dataclass(hint):
        return None if isinstance(value, hint) else f"a {hint.__name__}"
    options = get_args(hint)
    if options:  # a union
        wrongs = [_violation(value, option) for option in options if option is not type(None)]
        if (value is None and type(None) in options) or None in wrongs:
            return None
        return " or ".join(str(wrong) for wrong in wrongs)
    return None


def _tuple_violation(value: Any, items: tuple[Any, ...]) -> str | None:
    if not isinstance(value, tuple):
        return "a tuple"
    if len(items) == 2 and items[1] is Ellipsis:
        wrongs = [_violation(item, items[0]) for item in value]
    elif len(value) != len(items):
        return f"a tuple of {len(items)} entries"
    else:
        wrongs = [_violation(item, hint) for item, hint in zip(value, items, strict=True)]
    return next((f"a tuple whose entries are {wrong}" for wrong in wrongs if wrong), None)


_HINTS: dict[type, dict[str, Any]] = {}


def _hints_of(cls: type) -> dict[str, Any]:
    """Annotations of a dataclass; resolving them takes longer than all checks, so they are kept."""
    if cls not in _HINTS:
        _HINTS[cls] = get_type_hints(cls, include_extras=True)
    return _HINTS[cls]


def check_fields(instance: Any) -> None:
    """Refuse a dataclass instance whose fields break their annotations.

    Numbers (NumPy's too) are first turned into plain Python numbers, so that instances compare and hash by value.

    Raises:
        InputError: names class, field and value, and says what would be right.
    """
    cls = type(instance)
    hints = _hints_of(cls)
    for field in fields(instance):
        hint = hints.get(field.name)
        value = _plain(getattr(instance, field.name))
        object.__setattr__(instance, field.name, value)
        wrong = _violation(value, hint)
        if wrong:
            raise InputError(f"{cls.__name__}: {field.name} should be {wrong}, not {value!r}")


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return tuple(_plain(item) for item in value)
    if hasattr(value, "tolist") and hasattr(value, "dtype"):
        return _plain(value.tolist())
    return value
