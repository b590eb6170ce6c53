"""What is wrong with an experiment, one line for each mistake: place, what is wrong (value); what would be right."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from occ.errors import InputError
from occ.experiment.naming import nearest, slug, suggestion
from occ.experiment.own_code import OwnClass, OwnCode, check_player, is_own
from occ.experiment.schema import (
    NAME_CHARACTERS,
    ExperimentFile,
    HorizonTable,
    LimitsTable,
    MotionTable,
    PlantTable,
    PlatformTable,
    PointTable,
    StartTable,
    experiment_model,
)
from occ.experiment.tables import DataTable, Table, models_in
from occ.laws.base import PathKeepingLaw
from occ.model.presets import youbot
from occ.plant import Plant
from occ.task import Limits, Start, Task

Place = tuple[str | int, ...]
"""Keys from the top of the file downwards; list entries by their number from 0."""
LONGEST_VALUE = 60
"""Characters of a value that are shown."""

_ADAPTERS: dict[str, TypeAdapter[DataTable]] = {
    name: TypeAdapter(table)
    for name, table in {
        "platform": PlatformTable,
        "point": PointTable,
        "motion": MotionTable,
        "start": StartTable,
        "horizon": HorizonTable,
        "limits": LimitsTable,
    }.items()
}


class ExperimentError(InputError):
    """An experiment file that cannot be meant.

    Args:
        lines: one for each mistake.
    """

    def __init__(self, lines: list[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.lines,)


@dataclass(frozen=True)
class Mistake:
    """One thing that is wrong.

    Args:
        place: where.
        text: what, and what would be right.
    """

    place: Place
    text: str


def find_mistakes(
    data: dict[str, Any], code: OwnCode
) -> tuple[ExperimentFile | None, tuple[OwnClass, ...], list[Mistake]]:
    """Validate the tables of one case.

    Args:
        data: as read from TOML, without a sweep.
        code: where kinds that are classes of the user's own are looked up.

    Returns:
        The validated tables, None where there is a mistake, the user's own classes in them, and all mistakes.
    """
    own, mistakes = _own_classes(data, code)
    model = experiment_model(tuple(item.table() for item in own))
    # A kind that could not be loaded is no valid one either; that is said once.
    said = {mistake.place for mistake in mistakes}
    try:
        file = model.model_validate(data)
    except ValidationError as error:
        file = None
        mistakes += [mistake for mistake in describe(error, data, model) if mistake.place not in said]
    mistakes += _contradictions(data, file, model)
    return (None if mistakes else file), own, mistakes


def _own_classes(data: dict[str, Any], code: OwnCode) -> tuple[tuple[OwnClass, ...], list[Mistake]]:
    """The classes of the user's own that the controllers name, each once, and what is wrong with their files."""
    own: dict[str, OwnClass] = {}
    mistakes: list[Mistake] = []
    controllers = data.get("controller")
    for i, table in enumerate(controllers if isinstance(controllers, list) else ()):
        kind = table.get("kind") if isinstance(table, dict) else None
        if isinstance(kind, str) and is_own(kind):
            try:
                own[kind] = code.find(kind)
            except InputError as error:
                mistakes.append(Mistake(("controller", i, "kind"), str(error)))
    return tuple(own.values()), mistakes


def describe(error: ValidationError, data: Any, model: type[Table] = ExperimentFile) -> list[Mistake]:
    """The mistakes behind a pydantic error.

    Args:
        error: with any number of mistakes.
        data: what was validated.
        model: against what.

    Returns:
        One mistake for each place, in the order of the model.
    """
    places: dict[Place, list[ErrorDetails]] = {}
    for item in error.errors(include_url=False):
        places.setdefault(_place(item, data), []).append(item)
    missing = {place for place, items in places.items() if items[0]["type"] == "missing"}
    mistakes, misspelt = [], set()
    for place, items in places.items():
        if items[0]["type"] == "extra_forbidden":
            valid = list(_keys_beside(model, items[0]["loc"]))
            # A misspelt key is one mistake, not an unknown key and a missing one.
            absent = [key for key in valid if (*place[:-1], key) in missing]
            near = nearest(place[-1], absent) or nearest(place[-1], valid)
            misspelt.add((*place[:-1], near))
            mistakes.append(Mistake(place, f"unknown key; {suggestion(near, valid)}"))
        else:
            mistakes.append(Mistake(place, _text(items, model)))
    return [mistake for mistake in mistakes if mistake.place not in missing & misspelt]


def shown(value: Any) -> str:
    """A value much as TOML writes it, on one line and not too long."""
    if isinstance(value, float):
        text = repr(value)
    elif isinstance(value, bool | str | int | list | dict):
        text = json.dumps(value, ensure_ascii=False, default=str)
    else:
        text = str(value)
    text = " ".join(text.split())
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


def dotted(place: Place, data: Mapping[str, Any]) -> str:
    """A place as people write it; controllers by name, other list entries by their number from 1."""
    parts: list[str] = []
    rest = list(place)
    if len(rest) > 1 and rest[0] == "controller" and isinstance(rest[1], int):
        name = _controller_names(data).get(rest[1], "")
        parts = [f"controller.{name}" if re.fullmatch(NAME_CHARACTERS, name) else f"controller #{rest[1] + 1}"]
        rest = rest[2:]
    for step in rest:
        if isinstance(step, int):
            parts[-1] += f" #{step + 1}"
        else:
            parts.append(step)
    return ".".join(parts)


def _controller_names(data: Mapping[str, Any]) -> dict[int, str]:
    controllers = data.get("controller")
    tables = enumerate(controllers) if isinstance(controllers, list) else ()
    return {i: table["name"] for i, table in tables if isinstance(table, dict) and isinstance(table.get("name"), str)}


def _place(item: ErrorDetails, data: Any) -> Place:
    """Where an error is in the data: pydantic's place without the labels of unions and tags."""
    place: list[str | int] = []
    labelled: Any = None
    for i, step in enumerate(item["loc"]):
        if isinstance(data, dict) and data is not labelled and step in (data.get("kind"), data.get("preset")):
            # A tag may be the name of one of the table's keys, too; pydantic puts it before the key.
            labelled = data
            continue
        inside = (isinstance(data, dict) and step in data) or (
            isinstance(data, list | tuple) and isinstance(step, int) and step < len(data)
        )
        if inside:
            place.append(step)
            data = data[step]
        elif item["type"] == "missing" and i == len(item["loc"]) - 1:
            place.append(step)
    if item["type"].startswith("union_tag"):
        place.append(item["ctx"]["discriminator"].strip("'"))
    return tuple(place)


def _tables_at(model: type[Table], steps: tuple[str | int, ...]) -> list[type[Table]]:
    """The models that may stand at one of pydantic's places."""
    options = [model]
    for step in steps:
        field = options[0].model_fields.get(str(step)) if len(options) == 1 else None
        if field is not None:
            options = models_in(field.annotation)
        elif len(options) > 1 and isinstance(step, str):
            options = [item for item in options if issubclass(item, DataTable) and item.tag == step]
    return options


def _keys_beside(model: type[Table], steps: tuple[str | int, ...]) -> dict[str, str]:
    """The valid keys beside the last one of pydantic's places, with their meaning."""
    fields = [field for table in _tables_at(model, steps[:-1]) for field in table.model_fields.items()]
    return {field.alias or name: field.description or "" for name, field in fields}


_WANTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "finite_number": "a finite number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list in square brackets",
    "list_type": "a list in square brackets",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "a list of at least {min_length}",
    "too_long": "a list of at most {max_length}",
}
_WRONG = {"finite_number": "not finite", "too_short": "too few", "too_long": "too many"}


def _text(items: list[ErrorDetails], model: type[Table]) -> str:
    """What is wrong at one place; the members of a union each have their error there."""
    first = items[0]
    kind, value, context = first["type"], first["input"], first.get("ctx", {})
    if kind == "value_error":
        return re.sub(r"^\w+: ", "", str(context["error"]))
    if first["loc"][0] == "controller" and len(first["loc"]) == 1:
        return "should be at least one table, each under its own line [[controller]]"
    if kind == "missing":
        key = first["loc"][-1]
        if len(first["loc"]) == 1:
            return f"missing; needed: a table [{key}]"
        return f"missing; needed: {_keys_beside(model, first['loc']).get(str(key)) or 'a number'}"
    if kind == "union_tag_not_found":
        tags = [table.tag for table in _tables_at(model, first["loc"]) if issubclass(table, DataTable)]
        return f"missing; needed: one of {', '.join(tags)}"
    if kind == "union_tag_invalid":
        return _unknown_name(value[context["discriminator"].strip("'")], _quoted(context["expected_tags"]))
    if kind == "literal_error" and len(items) == 1:
        return _unknown_name(value, _quoted(context["expected"]))
    wanted = [_wanted(item) for item in items]
    wrong = "wrong type" if kind.endswith("_type") else _WRONG.get(kind, "out of range")
    return f"{wrong} ({shown(value)}); should be {' or '.join(dict.fromkeys(wanted))}"


def _wanted(item: ErrorDetails) -> str:
    if item["type"] == "literal_error":
        return " or ".join(f'"{name}"' for name in _quoted(item["ctx"]["expected"]))
    form = _WANTED.get(item["type"])
    return form.format(**item.get("ctx", {})) if form else re.sub(r"^\w+ should ", "", item["msg"]).removeprefix("be ")


def _unknown_name(value: Any, valid: list[str]) -> str:
    near = nearest(value, valid) if isinstance(value, str) else None
    return f"unknown name ({shown(value)}); {suggestion(near, valid)}"


def _quoted(expected: str) -> list[str]:
    return re.findall(r"'([^']*)'", expected)


def _contradictions(
    data: dict[str, Any], file: ExperimentFile | None, model: type[ExperimentFile]
) -> Iterator[Mistake]:
    """Mistakes that are only visible between tables; a table that is wrong by itself hides none of the others'."""
    names = _controller_names(data)
    for i, name in names.items():
        twin = next((other for j, other in names.items() if j < i and slug(other).lower() == slug(name).lower()), None)
        if twin is not None:
            yield Mistake(("controller", i, "name"), f'not unique ("{name}"); should differ from "{twin}"')
    parts = {name: _part(name, data, file) for name in _ADAPTERS}
    motion, horizon = parts["motion"], parts["horizon"]
    duration = None
    if motion and horizon:
        try:
            duration = horizon.seconds(motion)
        except InputError as error:
            yield Mistake(("horizon", "laps"), str(error))
    plant = None
    if parts["platform"] and "plant" in data:
        plant, wrong = _plant(data)
        yield from wrong
    if motion:
        try:
            yield from _unplayable(data, file, model, parts | {"plant": plant}, duration)
        except InputError as error:
            yield Mistake(("plant",), re.sub(r"^\w+: ", "", str(error)))


class _PlantPlatform(Table):
    """The platform's table with the plant's numbers in it."""

    platform: PlatformTable


def _plant(data: dict[str, Any]) -> tuple[Plant | None, list[Mistake]]:
    """The plant of a valid platform, and what is wrong with its numbers."""
    table = data["plant"]
    try:
        plant = PlantTable.model_validate(table)
    except ValidationError:
        return None, []
    if "preset" in plant.platform:
        text = (
            f"not a number of the platform ({shown(plant.platform['preset'])}); the plant has the preset of [platform]"
        )
        return None, [Mistake(("plant", "platform", "preset"), text)]
    whole = {"platform": data["platform"] | plant.platform}
    try:
        real = _PlantPlatform.model_validate(whole).platform.build()
    except ValidationError as error:
        wrong = describe(error, whole, _PlantPlatform)
        return None, [Mistake(("plant", *mistake.place), mistake.text) for mistake in wrong]
    return Plant(platform=real, start_offset=plant.start_offset, sample_rate=plant.sample_rate), []


def _unplayable(
    data: dict[str, Any],
    file: ExperimentFile | None,
    model: type[ExperimentFile],
    parts: dict[str, Any],
    duration: float | None,
) -> Iterator[Mistake]:
    """Controllers that cannot do this task."""
    point = parts["point"]
    # What only another table's mistake hides is stood in for by something valid.
    task = Task(
        platform=parts["platform"] or youbot(),
        point=(point.x, point.y) if point else (0.0, 0.0),
        motion=parts["motion"],
        duration=duration or 1.0,
        start=parts["start"] or Start(),
        limits=parts["limits"] or Limits(),
        plant=parts["plant"],
    )
    controllers = data.get("controller")
    controller = _controller_adapter(model)
    for i, table in enumerate(controllers if isinstance(controllers, list) else ()):
        player = file.controller[i].build() if file else _built(controller, table)
        # Without a horizon only what does not depend on it can be checked.
        if player is not None and (duration or isinstance(player, PathKeepingLaw)):
            try:
                check_player(player, task)
            except InputError as error:
                yield Mistake(("controller", i), re.sub(r"^\w+: ", "", str(error)))


@cache
def _controller_adapter(model: type[ExperimentFile]) -> TypeAdapter[DataTable]:
    """For a single controller's table."""
    (table,) = get_args(model.model_fields["controller"].annotation)
    return TypeAdapter(table)


def _part(name: str, data: dict[str, Any], file: ExperimentFile | None) -> Any:
    """What a table stands for, or None where the table is wrong by itself."""
    return getattr(file, name).build() if file else _built(_ADAPTERS[name], data.get(name, {}))


def _built(adapter: TypeAdapter[DataTable], table: Any) -> Any:
    try:
        return adapter.validate_python(table).build()
    except ValidationError:
        return None
