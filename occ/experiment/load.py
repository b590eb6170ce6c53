"""From an experiment file to validated cases: reading, `--set`, sweeps, and every mistake with its place."""

from __future__ import annotations

import copy
import itertools
import math
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from occ.errors import InputError
from occ.experiment.case import Case
from occ.experiment.mistakes import (
    ExperimentError,
    Mistake,
    Place,
    describe,
    dotted,
    find_mistakes,
    shown,
)
from occ.experiment.naming import case_name, compact, controller_at, nearest, suggestion
from occ.experiment.own_code import OwnClass, OwnCode
from occ.experiment.schema import MOST_CASES, ExperimentFile, RangeTable, Sweep

SWEEPABLE = ("platform", "point", "motion", "start", "horizon", "limits", "plant", "controller")


@dataclass(frozen=True)
class Experiment:
    """A validated experiment.

    Args:
        title: one line, may be empty.
        question: what the experiment is to answer, may be empty.
        objectives: names of what is compared.
        swept: dotted names of the swept keys.
        cases: in the order of the sweep, the first key varying slowest.
        tables: the file's tables after `--set`, as plain data.
    """

    title: str
    question: str
    objectives: tuple[str, ...]
    swept: tuple[str, ...]
    cases: tuple[Case, ...]
    tables: dict[str, Any]


def load_experiment(path: Path, overrides: Sequence[str] = (), allow_code: bool = False) -> Experiment:
    """Read, override, expand and validate an experiment file.

    Args:
        path: of the TOML file.
        overrides: ``KEY=VALUE`` as after `--set`.
        allow_code: whether controllers may come from files of the user's own, which are loaded, that is, run.

    Returns:
        The experiment with all its cases.

    Raises:
        ExperimentError: with one line for each mistake.
    """
    return _loaded(path, overrides, allow_code, itertools.product, MOST_CASES)[0]


def load_axes(
    path: Path, overrides: Sequence[str] = (), allow_code: bool = False, most: int = MOST_CASES
) -> tuple[Experiment, dict[str, list[Any]]]:
    """The same for a grid of too many cases to be made one by one: each swept value appears in one case at least.

    Args:
        path: of the TOML file.
        overrides: ``KEY=VALUE`` as after `--set`.
        allow_code: as above.
        most: points that the grid may have.

    Returns:
        The experiment with the cases of one value of each key and the first values of all others, and the values of
        each swept key.

    Raises:
        ExperimentError: with one line for each mistake.
    """
    return _loaded(path, overrides, allow_code, _axes, most)


def _axes(*values: list[Any]) -> Iterator[tuple[Any, ...]]:
    """Every value once, beside the first values of the other keys; and the last ones of all."""
    first, last = tuple(axis[0] for axis in values), tuple(axis[-1] for axis in values)
    yield first
    for i, axis in enumerate(values):
        for value in axis[1:]:
            yield (*first[:i], value, *first[i + 1 :])
    if len(values) > 1:
        yield last


Combinations = Callable[..., Iterable[tuple[Any, ...]]]
"""From the values of each swept key to those of each case."""


def _loaded(
    path: Path, overrides: Sequence[str], allow_code: bool, combinations: Combinations, most: int
) -> tuple[Experiment, dict[str, list[Any]]]:
    data = read_toml(path)
    written = set(data)
    lines: list[str] = []
    assigned: list[str] = []
    for text in overrides:
        try:
            key, value = parse_override(text)
            _override(data, key, value)
            assigned.append(key)
        except InputError as error:
            lines.append(str(error))
    tables = copy.deepcopy(data)
    sweep, mistakes = _sweep_values(data)
    count = math.prod(len(values) for values in sweep.values())
    if count > most:
        mistakes.append(Mistake(("sweep",), f"too many cases ({count}); should be at most {most}"))
        sweep = {}
    cases, found = _expand(data, sweep, OwnCode(path.parent, allow_code), combinations)
    bad = {place[1] for place in (mistake.place for mistake in mistakes) if len(place) > 1}
    # A table that only a faulty entry of the sweep would have supplied is not missing.
    mistakes += [mistake for mistake in found if not any(_overlap(_key(mistake.place), str(key)) for key in bad)]
    lines += [_line(path, mistake, data, assigned, written) for mistake in mistakes]
    if lines:
        raise ExperimentError(list(dict.fromkeys(lines)))
    first = cases[0][0]
    experiment = Experiment(
        title=first.title,
        question=first.question,
        objectives=tuple(first.compare.objectives),
        swept=tuple(sweep),
        cases=tuple(case for _, case in cases),
        tables=tables,
    )
    return experiment, sweep


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Args:
        path: of the file.

    Returns:
        Plain data.

    Raises:
        ExperimentError: no such file, not UTF-8, or not TOML; one line that names file, line and column.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
        return tomllib.loads(text)
    except OSError as error:
        raise ExperimentError([f"{path}: cannot be read ({error.strerror}); should be a TOML file"]) from error
    except UnicodeDecodeError as error:
        raise ExperimentError([f"{path}: not a text in UTF-8 (byte {error.start}); should be a TOML file"]) from error
    except tomllib.TOMLDecodeError as error:
        where = re.search(r"^(.*) \(at (.*)\)$", str(error), re.DOTALL)
        reason, place = where.groups() if where else (str(error), "somewhere")
        raise ExperimentError([f"{path}: {place}: not TOML ({' '.join(reason.split())})"]) from error


def parse_override(text: str) -> tuple[str, Any]:
    """Key and value of ``KEY=VALUE``; VALUE as in TOML, or else a plain string.

    Args:
        text: as after `--set`.

    Returns:
        Dotted key and value.

    Raises:
        InputError: no key or no equals sign.
    """
    key, sign, value = (part.strip() for part in text.partition("="))
    if not key or not sign:
        raise InputError(f'--set {text}: not an assignment; should be KEY=VALUE such as "motion.radius=0.6"')
    try:
        parsed = tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError:
        return key, value
    return key, parsed["value"] if parsed.keys() == {"value"} else value


def assign(data: dict[str, Any], key: str, value: Any) -> None:
    """Write a value under a dotted key; tables on the way are made where they are missing.

    Args:
        data: tables of a file, changed in place.
        key: such as ``motion.radius``, ``horizon`` or ``controller.min work.intervals``.
        value: plain data.

    Raises:
        InputError: no controller of that name, or a value on the way that is not a table; says what would be right.
    """
    root, _, rest = key.partition(".")
    table, steps = data, key.split(".")
    if root == "controller" and rest:
        table, steps = controller_at(data, rest)
    for step in steps[:-1]:
        table = table.setdefault(step, {})
        if not isinstance(table, dict):
            raise InputError(f"{step} is not a table ({shown(table)}); should be one to have the key {steps[-1]}")
    if root == "horizon" and rest:
        # Its keys exclude each other: the new one replaces the old one.
        table.clear()
    table[steps[-1]] = value


def _override(data: dict[str, Any], key: str, value: Any) -> None:
    root, _, rest = key.partition(".")
    if root == "sweep" and rest:
        sweep = data.setdefault("sweep", {})
        if isinstance(sweep, dict):
            data["sweep"] = {**_flat(sweep), rest: value}
        return
    try:
        assign(data, key, value)
    except InputError as error:
        raise InputError(f"--set {key}: {error}") from error
    if isinstance(data.get("sweep"), dict):
        # What is set is not swept any more.
        data["sweep"] = {name: values for name, values in _flat(data["sweep"]).items() if not _overlap(name, key)}


def _overlap(one: str, other: str) -> bool:
    """Whether two dotted keys decide about the same thing; the keys of the horizon exclude each other."""
    if one.startswith("horizon.") and other.startswith("horizon."):
        return True
    return one == other or one.startswith(f"{other}.") or other.startswith(f"{one}.")


def _flat(sweep: dict[str, Any]) -> dict[str, Any]:
    """The sweep with dotted names also where TOML has read unquoted dotted keys as nested tables."""
    flat: dict[str, Any] = {}
    for key, value in sweep.items():
        if isinstance(value, dict) and value and not value.keys() & {"from", "to", "count"}:
            flat |= {f"{key}.{inner}": item for inner, item in _flat(value).items()}
        else:
            flat[key] = value
    return flat


def _sweep_values(data: dict[str, Any]) -> tuple[dict[str, list[Any]], list[Mistake]]:
    """Take the sweep out of the data: values by dotted key, and what is wrong with its form."""
    raw = data.pop("sweep", {})
    raw = {"sweep": _flat(raw) if isinstance(raw, dict) else raw}
    mistakes: list[Mistake] = []
    try:
        Sweep.model_validate(raw)
    except ValidationError as error:
        mistakes = describe(error, raw, Sweep)
        if not isinstance(raw["sweep"], dict):
            return {}, mistakes
    wrong = {mistake.place[1] for mistake in mistakes}
    sweep: dict[str, list[Any]] = {}
    for key, entry in raw["sweep"].items():
        if key in wrong:
            continue
        root = key.partition(".")[0]
        rival = next((other for other in sweep if _overlap(other, key)), None)
        values = list(_spaced(RangeTable.model_validate(entry), entry)) if isinstance(entry, dict) else entry
        repeated = [value for value, times in Counter(map(compact, values)).items() if times > 1]
        text = ""
        if root not in SWEEPABLE:
            text = f"cannot be swept; {suggestion(nearest(root, list(SWEEPABLE)), list(SWEEPABLE))}"
        elif root == "controller" and key.endswith(".name"):
            text = "a name cannot be swept; should be another key of the controller"
        elif rival:
            text = f'contradicts the sweep of "{rival}"; should be only one of them'
        elif repeated:
            text = f"the same value more than once ({repeated[0]}); should be different values"
        if text:
            mistakes.append(Mistake(("sweep", key), text))
        else:
            sweep[key] = values
    return sweep, mistakes


def _spaced(table: RangeTable, entry: dict[str, Any]) -> Iterator[float]:
    """Evenly spaced values, exact at both ends; in between rounded to 15 digits, so that 0.3 stays 0.3."""
    steps = table.count - 1
    whole = all(isinstance(entry[end], int) for end in ("from", "to")) and (entry["to"] - entry["from"]) % steps == 0
    for i in range(table.count):
        if whole:
            yield entry["from"] + (entry["to"] - entry["from"]) // steps * i
        elif i in (0, steps):
            yield table.start if i == 0 else table.end
        else:
            yield float(f"{(table.start * (steps - i) + table.end * i) / steps:.15g}")


def _expand(
    data: dict[str, Any], sweep: dict[str, list[Any]], code: OwnCode, combinations: Combinations
) -> tuple[list[tuple[ExperimentFile, Case]], list[Mistake]]:
    """Every case of the sweep, validated like a file without a sweep."""
    cases: list[tuple[ExperimentFile, Case]] = []
    found: dict[Mistake, list[dict[str, Any]]] = {}
    for values in combinations(*sweep.values()):
        swept = dict(zip(sweep, values, strict=True))
        own = copy.deepcopy(data)
        unassigned = []
        for key, value in swept.items():
            try:
                assign(own, key, copy.deepcopy(value))
            except InputError as error:
                unassigned.append(Mistake(("sweep", key), str(error)))
        file, classes, mistakes = find_mistakes(own, code)
        for mistake in [*unassigned, *mistakes]:
            found.setdefault(mistake, []).append(swept)
        if file is not None and not unassigned:
            cases.append((file, _case(file, classes, swept)))
    total = math.prod(len(values) for values in sweep.values())
    return cases, [_placed(mistake, swepts, sweep, total, data) for mistake, swepts in found.items()]


def _case(file: ExperimentFile, classes: tuple[OwnClass, ...], swept: dict[str, Any]) -> Case:
    tables = file.model_dump(mode="json", include=set(SWEEPABLE), exclude_none=True)
    resolved = {key: value if isinstance(value, dict) else _value_at(tables, key) for key, value in swept.items()}
    return Case(case_name(resolved), resolved, tables, classes)


def _value_at(tables: dict[str, Any], key: str) -> Any:
    """A swept value as the schema understood it: 1 becomes 1.0 where a number is meant."""
    root, _, rest = key.partition(".")
    table, steps = controller_at(tables, rest) if root == "controller" else (tables, key.split("."))
    for step in steps[:-1]:
        table = table[step]
    return table[steps[-1]]


def _placed(
    mistake: Mistake, swepts: list[dict[str, Any]], sweep: dict[str, list[Any]], total: int, data: dict[str, Any]
) -> Mistake:
    """The mistake with its place in the sweep, and the swept values that all cases with this mistake share."""
    place = mistake.place
    key = dotted(place, data)
    source = next((name for name in sweep if key == name or key.startswith(f"{name}.")), None)
    if source is not None and place[0] != "sweep":
        place = ("sweep", key)
    text = mistake.text
    shared = [name for name in sweep if all(swept[name] == swepts[0][name] for swept in swepts)]
    # The text itself shows a swept value that is wrong by itself.
    if len(swepts) < total and shared != [key]:
        values = ", ".join(f"{name} = {compact(swepts[0][name])}" for name in shared)
        text += f" [where {values}]" if values else ""
    return Mistake(place, text)


def _key(place: Place) -> str:
    return ".".join(str(step) for step in place)


def _line(path: Path, mistake: Mistake, data: dict[str, Any], assigned: list[str], written: set[str]) -> str:
    """The mistake on one line, with the file or with `--set`, whichever it comes from."""
    key = dotted(mistake.place, data)
    for name in assigned:
        if key == name or key.startswith(f"{name}.") or (name.startswith(f"{key}.") and key not in written):
            return f"--set {key}: {mistake.text}"
    return f"{path}: {key}: {mistake.text}"
