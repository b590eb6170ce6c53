"""Dataclasses as tables of an experiment file: the pydantic model of a class, with its keys, checks and meanings."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from functools import cache, reduce
from operator import or_
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, Strict, create_model, field_validator
from pydantic import model_validator as validator

from occ.experiment.documentation import key_texts, summary

LARGEST = 1e9
"""In SI units, of any number: what is beyond it is a slip of the pen, and its square or cube may overflow."""
SMALLEST = 1e-100
"""The same at the other end; rounding of angles is far above it."""


class Table(BaseModel):
    """A table whose keys are all known and whose numbers are numbers, finite and of a size that has a meaning."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="after")
    @classmethod
    def _has_a_size(cls, value: Any) -> Any:
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and abs(number) > LARGEST:
                raise ValueError(f"out of range ({number:g}); should be at most {LARGEST:g} in size")
            if isinstance(number, float) and 0 < abs(number) < SMALLEST:
                raise ValueError(f"out of range ({number:g}); should be at least {SMALLEST:g} in size")
        return value


class DataTable(Table):
    """A table that stands for a dataclass."""

    stands_for: ClassVar[type]
    tag: ClassVar[str] = ""

    @validator(mode="after")
    def _can_be_built(self) -> DataTable:
        # Relations between keys are checked by the class itself; its InputError becomes a mistake of this table.
        self.build()
        return self

    def build(self) -> Any:
        """The instance that the table describes.

        Raises:
            InputError: numbers that do not fit each other.
        """
        names = [field.name for field in dataclasses.fields(self.stands_for)]
        return self.stands_for(**{name: built(getattr(self, name)) for name in names})


def built(value: Any) -> Any:
    """A key's value with the tables inside it as what they stand for."""
    if isinstance(value, DataTable):
        return value.build()
    return tuple(built(item) for item in value) if isinstance(value, tuple) else value


def table_model(
    cls: type, base: type[DataTable] = DataTable, tag: tuple[str, str] | None = None, label: str = "", **more: Any
) -> type[DataTable]:
    """The pydantic model of a dataclass's table.

    Args:
        cls: a dataclass with annotated fields.
        base: of the model.
        tag: key and value by which the table is told from its family's other ones.
        label: name of the model; that of the class by default.
        more: further keys, as pydantic takes them.

    Returns:
        A model with the same keys, constraints, defaults and meanings.
    """
    hints = get_type_hints(cls, include_extras=True)
    texts = {item.name: item.text for item in key_texts(cls)}
    keys: dict[str, Any] = {}
    if tag:
        keys[tag[0]] = (Literal[tag[1]], Field(description=summary(cls)))
    keys |= more
    for field in dataclasses.fields(cls):
        options: dict[str, Any] = {"description": texts[field.name] or None}
        if field.default is None:
            options["json_schema_extra"] = lambda schema: schema.pop("default")
        default: Any = field.default
        if _is_option(type(default)):
            given = {key: value for key, value in dataclasses.asdict(default).items() if value is not None}
            options["default"] = _option_table(default.__class__).model_validate({"kind": default.kind} | given)
        elif field.default is not dataclasses.MISSING:
            options["default"] = field.default
        elif field.default_factory is not dataclasses.MISSING:
            options["default_factory"] = field.default_factory
        keys[field.name] = (toml_hint(hints[field.name]), Field(**options))
    model = create_model(label or cls.__name__, __base__=base, __doc__=summary(cls), **keys)
    model.stands_for = cls
    model.tag = tag[1] if tag else ""
    return model


def toml_hint(hint: Any) -> Any:
    """A field's annotation as TOML can meet it: tuples are written as lists, dataclasses as tables, None not at all."""
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return _option_table(hint) if _is_option(hint) else _inner_table(hint)
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return Annotated[(toml_hint(arguments[0]), *arguments[1:])]
    if origin is tuple:
        items = tuple(item if item is Ellipsis else toml_hint(item) for item in arguments)
        return Annotated[tuple.__class_getitem__(items), Strict(False)]
    if origin in (Union, UnionType):
        members = [toml_hint(item) for item in arguments if item is not type(None)]
        return one_of(members, "kind") if all(map(_is_option, arguments)) else reduce(or_, members)
    return hint


def _is_option(hint: Any) -> bool:
    """Whether a field's type is a dataclass with a kind: an option that is written as a table inside the table."""
    return isinstance(hint, type) and dataclasses.is_dataclass(hint) and hasattr(hint, "kind")


@cache
def _inner_table(cls: Any) -> type[DataTable]:
    """The model of a dataclass without a kind, the same wherever it appears."""
    return table_model(cls)


@cache
def _option_table(cls: Any) -> type[DataTable]:
    """The model of an option, the same wherever the option appears; a controller may be an option of another one."""
    label = f"{cls.__name__}Inside" if hasattr(cls, "solve") else cls.__name__
    return table_model(cls, tag=("kind", cls.kind), label=label)


def one_of(models: Iterable[type[DataTable]], key: str) -> Any:
    """The models of a family, told apart by their tag."""
    options = tuple(models)
    return Annotated[reduce(or_, options), Field(discriminator=key)] if len(options) > 1 else options[0]


def models_in(annotation: Any) -> list[type[Table]]:
    """The models that a key's annotation is made of."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [model for item in get_args(annotation) for model in models_in(item)]
