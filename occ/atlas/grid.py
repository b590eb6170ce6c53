"""From an experiment file to a grid of points: dimensions, their values, and blocks of plain numbers.

Keys whose values are numbers of the circle, the point or the start become arrays at once; every combination of the
others (the platform's numbers, or whole tables) is built as one case.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from occ.atlas.points import Points
from occ.errors import InputError
from occ.experiment.load import Experiment, assign, load_axes
from occ.experiment.naming import compact
from occ.experiment.schema import AtlasTable, ExperimentFile
from occ.motion import Circle

MOST_POINTS = 20_000_000
"""More points than this are taken for a mistake."""
ARRAYS = {
    "point.x": "x",
    "point.y": "y",
    "motion.radius": "radius",
    "motion.rate": "rate",
    "motion.phase": "phase",
    "start.heading": "heading",
    "start.heading_rate": "heading_rate",
}
"""Swept keys whose values are used as they are."""


@dataclass(frozen=True)
class Grid:
    """The points of an atlas.

    Args:
        experiment: title, question and tables; its cases are only some of the points.
        values: of each swept key.
        base: (7 + P, M) numbers of each combination of the keys that are not in `ARRAYS`: those of `ARRAYS`, the
            duration and which platform.
        parameters: (P, ..) numbers of the platforms that occur.
        wheel_count: n.
        options: of the table [atlas].
        overrides: ``KEY=VALUE`` with which the file was read.
    """

    experiment: Experiment
    values: dict[str, list[Any]]
    base: np.ndarray
    parameters: np.ndarray
    wheel_count: int
    options: AtlasTable
    overrides: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each swept key."""
        return tuple(len(values) for values in self.values.values())

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    @property
    def coordinates(self) -> dict[str, list[float] | list[str]]:
        """Values of each dimension: numbers, or texts such as ``laps=1``."""
        return {key: _labels(values) for key, values in self.values.items()}

    def points(self, first: int, last: int) -> Points:
        """The points first <= i < last, the first key varying slowest.

        Args:
            first: number of a point.
            last: number of a point.

        Returns:
            Their numbers.
        """
        places = np.unravel_index(np.arange(first, last), self.shape)
        combination = np.zeros(last - first, dtype=int)
        for place, (key, values) in zip(places, self.values.items(), strict=True):
            if key not in ARRAYS:
                combination = combination * len(values) + place
        numbers = dict(zip((*ARRAYS.values(), "duration", "platform"), self.base[:, combination], strict=True))
        for place, (key, values) in zip(places, self.values.items(), strict=True):
            if key in ARRAYS:
                numbers[ARRAYS[key]] = np.asarray(values, dtype=float)[place]
        used, platform = np.unique(numbers["platform"].astype(int), return_inverse=True)
        rest = {name: numbers[name] for name in ("radius", "rate", "phase", "heading", "heading_rate", "duration")}
        # Laps of a swept rate have a duration of their own.
        laps = np.isnan(rest["duration"])
        rest["duration"] = np.where(laps, self._laps * 2 * np.pi / np.abs(rest["rate"]), rest["duration"])
        point = np.array([numbers["x"], numbers["y"]])
        return Points(self.wheel_count, self.parameters[used], platform, point, **rest)

    @property
    def _laps(self) -> float:
        return float(self.experiment.cases[0].tables["horizon"].get("laps", np.nan))

    def blocks(self, size: int) -> Iterator[tuple[int, Points]]:
        """Number of the first point, and points, of each block of a size."""
        for first in range(0, self.size, size):
            yield first, self.points(first, min(first + size, self.size))


def load_grid(path: Path, overrides: Sequence[str] = ()) -> Grid:
    """Read and validate an experiment file whose sweep makes an atlas.

    Args:
        path: of the TOML file.
        overrides: ``KEY=VALUE`` as after `--set`.

    Returns:
        The grid; its points are made when they are asked for.

    Raises:
        InputError: one line for each mistake; nothing is swept, or the motion is not a circle.
    """
    experiment, values = load_axes(path, overrides, most=MOST_POINTS)
    if not values:
        raise InputError(
            f"{path}: sweep: nothing is swept; should name the keys of the atlas (occ circle shows one case)"
        )
    first = experiment.cases[0]
    kind = first.tables["motion"]["kind"]
    if kind != Circle.kind or "motion" in values:
        raise InputError(f'{path}: motion.kind: an atlas is one of circles; should be "circle", not "{kind}"')
    others = {key: axis for key, axis in values.items() if key not in ARRAYS}
    horizons = [key for key in others if key.startswith("horizon")]
    if horizons and "motion.rate" in values:
        raise InputError(
            f"{path}: sweep: {horizons[0]} and motion.rate cannot be swept at once; should be one of the two"
        )
    rows: list[tuple[float, ...]] = []
    platforms: dict[bytes, tuple[int, np.ndarray]] = {}
    wheels: set[int] = set()
    for combination in itertools.product(*others.values()):
        task = _file(first.tables, dict(zip(others, combination, strict=True))).task()
        numbers = task.platform.parameters()
        where = platforms.setdefault(numbers.tobytes(), (len(platforms), numbers))[0]
        circle = task.motion
        assert isinstance(circle, Circle)
        by_rate = "laps" in first.tables["horizon"] and "motion.rate" in values
        duration = np.nan if by_rate else task.duration
        start = task.start.heading, task.start.heading_rate
        rows.append((*task.point, circle.radius, circle.rate, circle.phase, *start, duration, where))
        wheels.add(task.platform.wheel_count)
    if len(wheels) > 1:
        counts = " and ".join(map(str, sorted(wheels)))
        raise InputError(f"{path}: sweep: platforms with {counts} wheels; all of an atlas should have the same number")
    parameters = np.array([numbers for _, numbers in platforms.values()])
    options = AtlasTable.model_validate(experiment.tables.get("atlas", {}))
    return Grid(
        experiment,
        values,
        np.array(rows, dtype=float).T,
        parameters,
        task.platform.wheel_count,
        options,
        tuple(overrides),
    )


def _file(tables: Mapping[str, Any], swept: Mapping[str, Any]) -> ExperimentFile:
    """The tables of the first case with other values."""
    data = copy.deepcopy(dict(tables))
    for key, value in swept.items():
        assign(data, key, copy.deepcopy(value))
    return ExperimentFile.model_validate(data)


def _labels(values: list[Any]) -> list[float] | list[str]:
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(value) for value in values]
    return [compact(value) for value in values]
