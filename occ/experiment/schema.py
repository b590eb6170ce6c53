"""The tables of an experiment file, made from the dataclasses that they stand for.

A platform, motion or controller is declared once, as a dataclass with annotated fields; its table, its checks and its
part of the JSON Schema follow from that.  Nothing here is edited when one is added.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, cast

from annotated_types import Ge, Le, MinLen
from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Strict, Tag, create_model

from occ.checks import Positive
from occ.errors import InputError
from occ.experiment.tables import DataTable, Table, one_of, table_model
from occ.model.platform import Platform
from occ.model.presets import PLATFORMS
from occ.motion import MOTIONS, ProgramMotion
from occ.objectives import OBJECTIVES
from occ.plant import Plant
from occ.players import PLAYERS
from occ.task import LONGEST_HORIZON, Limits, Player, Start, Task

MOST_CASES = 100_000
"""More cases than this are taken for a mistake."""
NAME_CHARACTERS = r"[A-Za-z0-9 ._+-]+"
OWN_KIND = r"^.*[^/\\]\.py:[A-Za-z_][A-Za-z0-9_]*$"
"""The kind of a controller whose class is in a file of the user's own."""


class PlatformPreset(DataTable):
    """A table that stands for a family of platforms."""

    def build(self) -> Platform:
        """The platform; raises as above."""
        return cast(Platform, super().build().platform())


class ExactlyOneKey(DataTable):
    """A table with exactly one of its keys, which its class checks."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})


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
    PlatformTable = one_of(
        (table_model(cls, PlatformPreset, ("preset", name)) for name, cls in PLATFORMS.items()), "preset"
    )
    PointTable = table_model(Point)
    MotionTable = one_of((table_model(cls, tag=("kind", cls.kind)) for cls in MOTIONS), "kind")
    StartTable = table_model(Start)
    HorizonTable = table_model(Horizon, ExactlyOneKey)
    LimitsTable = table_model(Limits)
    CONTROLLERS = tuple(table_model(cls, tag=("kind", cls.kind), name=(ControllerName, ...)) for cls in PLAYERS)
    ControllerTable = one_of(CONTROLLERS, "kind")
    ObjectiveName = Literal[tuple(OBJECTIVES)]


def _without_default(schema: dict[str, Any]) -> None:
    """TOML has no null, so that a key that may be left out has no default to show."""
    del schema["default"]


class PlantTable(Table):
    """How the real platform differs from the model that the controllers know; errors are measures then."""

    platform: dict[str, Any] = Field(
        default_factory=dict, description="keys of [platform] that are different, and their real values"
    )
    start_offset: Annotated[tuple[float, float, float], Strict(False)] = Field(
        default=(0.0, 0.0, 0.0), description="x [m], y [m] and heading [rad] of the start beside the planned one"
    )
    sample_rate: Positive | None = Field(
        default=None,
        description="[Hz] at which the controllers see the state; torques are held in between",
        json_schema_extra=_without_default,
    )

    def build(self, model: PlatformPreset) -> Plant:
        """The plant of a platform.

        Raises:
            ValidationError: values that are none of the platform's.
            InputError: numbers that do not fit each other.
        """
        real = type(model).model_validate(model.model_dump(exclude_none=True) | self.platform)
        return Plant(platform=real.build(), start_offset=self.start_offset, sample_rate=self.sample_rate)


class CompareTable(Table):
    """What is compared."""

    objectives: Annotated[list[ObjectiveName], MinLen(1), AfterValidator(_no_repetition)] = Field(
        default=["work"],
        description="each gets a bound and a gap in every row",
        json_schema_extra={"uniqueItems": True},
    )
    certified: bool = Field(
        default=False,
        description="whether to look for proofs of the bounds in ball arithmetic, too; they take seconds for each case",
    )


class AtlasTable(Table):
    """How deep `occ atlas` looks at each point, and which lines its maps show."""

    depth: Literal["long_run", "least_work", "comparison"] = Field(
        default="long_run",
        description="long_run: closed forms; least_work: the law's work over the horizon and the least there is; "
        "comparison: all controllers, limits and bounds",
    )
    speed_lines: list[Positive] = Field(default=[0.8], description="[m/s] speeds of B to draw a line for")
    torque_lines: list[Positive] = Field(default=[2.1], description="[N m] steady wheel torques to draw a line for")


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
    plant: PlantTable | None = Field(default=None, json_schema_extra=_without_default)
    controller: Annotated[list[ControllerTable], MinLen(1)]
    compare: CompareTable = Field(default_factory=CompareTable)
    atlas: AtlasTable = Field(default_factory=AtlasTable)

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
            plant=self.plant.build(self.platform) if self.plant is not None else None,
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
    table: Any = one_of((*CONTROLLERS, *own), "kind")
    return create_model("ExperimentFile", __base__=ExperimentFile, controller=(Annotated[list[table], MinLen(1)], ...))
