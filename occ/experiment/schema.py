"""The tables of an experiment file as pydantic models, made from the dataclasses that they stand for.

A platform, motion or controller is declared once, as a dataclass with annotated fields; its table, its checks and its
part of the JSON Schema follow from that.  Nothing here is edited when one is added.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, reduce
from operator import or_
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeAlias,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from annotated_types import Ge, Le, MinLen
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Strict, Tag, create_model
from pydantic import model_validator as validator

from occ.checks import Positive
from occ.errors import InputError
from occ.experiment.documentation import key_texts, summary
from occ.model.platform import Platform
from occ.model.presets import PLATFORMS
from occ.motion import MOTIONS, ProgramMotion
from occ.objectives import OBJECTIVES
from occ.players import PLAYERS
from occ.task import LONGEST_HORIZON, Limits, Player, Start, Task

MOST_CASES = 100_000
"""More cases than this are taken for a mistake."""
NAME_CHARACTERS = r"[A-Za-z0-9 ._+-]+"
OWN_KIND = r"^.*[^/\\]\.py:[A-Za-z_][A-Za-z0-9_]*$"
"""The kind of a controller whose class is in a file of the user's own."""


class Table(BaseModel):
    """A table whose keys are all known and whose numbers are numbers and finite."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


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


class PlatformPreset(DataTable):
    """A table that stands for a family of platforms."""

    def build(self) -> Platform:
        """The platform; raises as above."""
        return cast(Platform, super().build().platform())


class ExactlyOneKey(DataTable):
    """A table with exactly one of its keys, which its class checks."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})


def table_model(
    cls: type, base: type[DataTable] = DataTable, tag: tuple[str, str] | None = None, **more: Any
) -> type[DataTable]:
    """The pydantic model of a dataclass's table.

    Args:
        cls: a dataclass with annotated fields.
        base: of the model.
        tag: key and value by which the table is told from its family's other ones.
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
    model = create_model(cls.__name__, __base__=base, __doc__=summary(cls), **keys)
    model.stands_for = cls
    model.tag = tag[1] if tag else ""
    return model


def toml_hint(hint: Any) -> Any:
    """A field's annotation as TOML can meet it: tuples are written as lists, dataclasses as tables, None not at all."""
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return _option_table(hint) if _is_option(hint) else table_model(hint)
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return Annotated[(toml_hint(arguments[0]), *arguments[1:])]
    if origin is tuple:
        items = tuple(item if item is Ellipsis else toml_hint(item) for item in arguments)
        return Annotated[tuple.__class_getitem__(items), Strict(False)]
    if origin in (Union, UnionType):
        members = [toml_hint(item) for item in arguments if item is not type(None)]
        return _one_of(members, "kind") if all(map(_is_option, arguments)) else reduce(or_, members)
    return hint


def _is_option(hint: Any) -> bool:
    """Whether a field's type is a dataclass with a kind: an option that is written as a table inside the table."""
    return isinstance(hint, type) and dataclasses.is_dataclass(hint) and hasattr(hint, "kind")


@cache
def _option_table(cls: Any) -> type[DataTable]:
    """The model of an option, the same wherever the option appears."""
    return table_model(cls, tag=("kind", cls.kind))


def _one_of(models: Iterable[type[DataTable]], key: str) -> Any:
    """The models of a family, told apart by their tag."""
    options = tuple(models)
    return Annotated[reduce(or_, options), Field(discriminator=key)] if len(options) > 1 else options[0]


def _controller_name(name: str) -> str:
    if not re.fullmatch(NAME_CHARACTERS, name) or name != name.strip() or not name.strip("."):
        raise ValueError(
            f'not a name ("{name}"); should be letters, digits, space and . _ + - without a space at either end, '
            "and not only dots"
        )
    return name


def _no_repetition(names: list[str]) -> list[str]:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f'"{name}" appears more than once; each objective should be named once')
    return names


ControllerName = Annotated[
    str,
    AfterValidator(_controller_name),
    Field(
        description="a name, unique in the file: letters, digits, space and . _ + -",
        json_schema_extra={"pattern": r"^(?!\.+$)(?! )[A-Za-z0-9 ._+-]+(?<! )$"},
    ),
]


@dataclass(frozen=True, kw_only=True)
class Point:
    """Point B in the body frame.

    Args:
        x: [m] b_X.
        y: [m] b_Y.
    """

    x: float
    y: float


@dataclass(frozen=True, kw_only=True)
class Horizon:
    """How long the task lasts: exactly one of laps and duration.

    Args:
        laps: of a motion with a period.
        duration: [s].
    """

    laps: Positive | None = None
    duration: Annotated[Positive, Le(LONGEST_HORIZON)] | None = None

    def __post_init__(self) -> None:
        if self.laps is None and self.duration is None:
            raise InputError("neither laps nor duration; should have exactly one of them")
        if self.laps is not None and self.duration is not None:
            raise InputError(
                f"laps ({self.laps:g}) and duration ({self.duration:g} s) contradict each other; "
                "should have exactly one of them"
            )

    def seconds(self, motion: ProgramMotion) -> float:
        """T = laps times the motion's period, or the given duration.

        Args:
            motion: whose laps are meant.

        Returns:
            [s].

        Raises:
            InputError: laps of a motion that does not return, or a horizon that is too long.
        """
        if self.laps is None:
            return cast(float, self.duration)
        if motion.period is None:
            raise InputError(
                f"laps ({self.laps:g}) of a {motion.kind}, which has no period; should be duration in seconds"
            )
        duration = self.laps * motion.period
        if not duration <= LONGEST_HORIZON:
            raise InputError(
                f"too long ({self.laps:g} laps of {motion.period:.4g} s); should last at most {LONGEST_HORIZON:g} s"
            )
        return duration


if TYPE_CHECKING:
    PlatformTable: TypeAlias = PlatformPreset
    PointTable: TypeAlias = DataTable
    MotionTable: TypeAlias = DataTable
    StartTable: TypeAlias = DataTable
    HorizonTable: TypeAlias = DataTable
    LimitsTable: TypeAlias = DataTable
    CONTROLLERS: tuple[type[DataTable], ...]
    ControllerTable: TypeAlias = DataTable
    ObjectiveName: TypeAlias = str
else:
    PlatformTable = _one_of(
        (table_model(cls, PlatformPreset, ("preset", name)) for name, cls in PLATFORMS.items()), "preset"
    )
    PointTable = table_model(Point)
    MotionTable = _one_of((table_model(cls, tag=("kind", cls.kind)) for cls in MOTIONS), "kind")
    StartTable = table_model(Start)
    HorizonTable = table_model(Horizon, ExactlyOneKey)
    LimitsTable = table_model(Limits)
    CONTROLLERS = tuple(table_model(cls, tag=("kind", cls.kind), name=(ControllerName, ...)) for cls in PLAYERS)
    ControllerTable = _one_of(CONTROLLERS, "kind")
    ObjectiveName = Literal[tuple(OBJECTIVES)]


class CompareTable(Table):
    """What is compared."""

    objectives: Annotated[list[ObjectiveName], MinLen(1), AfterValidator(_no_repetition)] = Field(
        default=["work"],
        description="each gets a bound and a gap in every row",
        json_schema_extra={"uniqueItems": True},
    )


class RangeTable(Table):
    """Evenly spaced values, both ends included."""

    start: float = Field(alias="from", description="first value")
    end: float = Field(alias="to", description="last value")
    count: Annotated[int, Ge(2), Le(MOST_CASES)] = Field(description="number of values")


SweepValues = Annotated[
    Annotated[list[Any], MinLen(1), Tag("list")] | Annotated[RangeTable, Tag("range")],
    Discriminator(lambda value: "range" if isinstance(value, dict) else "list"),
]


class Sweep(Table):
    """What is varied; the cross product of all values makes the cases, the first key varying slowest."""

    sweep: dict[str, SweepValues] = Field(
        default_factory=dict, description="dotted names of keys, or names of tables, with their values"
    )


class ExperimentFile(Sweep):
    """An experiment of occ: a platform, a motion of its point B, a start, a horizon, and the controllers to compare."""

    title: str = Field(default="", description="one line")
    question: str = Field(default="", description="what the experiment is to answer")
    platform: PlatformTable
    point: PointTable
    motion: MotionTable
    start: StartTable = Field(default_factory=lambda: StartTable())
    horizon: HorizonTable
    limits: LimitsTable = Field(default_factory=lambda: LimitsTable())
    controller: Annotated[list[ControllerTable], MinLen(1)]
    compare: CompareTable = Field(default_factory=CompareTable)

    def task(self) -> Task:
        """The task of all controllers.

        Raises:
            InputError: laps of a motion that does not return, or a horizon that is too long.
        """
        point, motion, horizon = self.point.build(), self.motion.build(), self.horizon.build()
        return Task(
            platform=self.platform.build(),
            point=(point.x, point.y),
            motion=motion,
            duration=horizon.seconds(motion),
            start=self.start.build(),
            limits=self.limits.build(),
        )

    def players(self) -> dict[str, Player]:
        """The controllers by name, in the order of the file."""
        return {getattr(table, "name"): table.build() for table in self.controller}  # noqa: B009  (made by table_model)


@cache
def experiment_model(own: tuple[type[DataTable], ...] = ()) -> type[ExperimentFile]:
    """The model of experiment files that name controllers of the user's own, too.

    Args:
        own: tables of those controllers.

    Returns:
        `ExperimentFile` itself where there are none.
    """
    if not own:
        return ExperimentFile
    table: Any = _one_of((*CONTROLLERS, *own), "kind")
    return create_model("ExperimentFile", __base__=ExperimentFile, controller=(Annotated[list[table], MinLen(1)], ...))


def models_in(annotation: Any) -> list[type[Table]]:
    """The models that a key's annotation is made of."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [model for item in get_args(annotation) for model in models_in(item)]


def json_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of experiment files."""
    schema = ExperimentFile.model_json_schema()
    schema["$defs"]["OwnController"] = _own_controller_schema(schema["$defs"]["ServoLaw"]["properties"]["name"])
    schema["properties"]["controller"]["items"]["oneOf"].append({"$ref": "#/$defs/OwnController"})
    # A sweep may supply a whole table, so that only a file without one must have them all.
    tables = [name for name in schema["required"] if name != "controller"]
    schema |= {"required": ["controller"], "anyOf": [{"required": ["sweep"]}, {"required": tables}]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _own_controller_schema(name: dict[str, Any]) -> dict[str, Any]:
    """A controller of the user's own, whose further keys only its file knows."""
    kind = {"type": "string", "pattern": OWN_KIND, "description": "path/to/file.py:ClassName, beside the experiment"}
    return {
        "type": "object",
        "description": "A controller from a file of your own, loaded only with --allow-code; its fields are the keys.",
        "properties": {"kind": kind, "name": name},
        "required": ["kind", "name"],
    }
