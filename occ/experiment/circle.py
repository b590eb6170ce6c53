"""The one circle that an experiment file is about."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from occ.experiment.load import load_experiment
from occ.experiment.mistakes import ExperimentError
from occ.motion import Circle
from occ.task import Task


def circle_task(path: Path, overrides: Sequence[str] = (), allow_code: bool = False) -> Task:
    """The task of an experiment whose cases share platform, point, circle, start and limits.

    Args:
        path: of the TOML file.
        overrides: ``KEY=VALUE`` as after `--set`.
        allow_code: whether controllers may come from files of the user's own.

    Returns:
        The task of the first case.

    Raises:
        ExperimentError: mistakes in the file, another motion than a circle, or a sweep over several circles.
    """
    experiment = load_experiment(path, overrides, allow_code)
    tasks = [case.task() for case in experiment.cases]
    for task in tasks:
        if not isinstance(task.motion, Circle):
            raise ExperimentError([f'{path}: motion.kind: not a circle ("{task.motion.kind}"); should be "circle"'])
    count = len({(task.platform, task.point, task.motion, task.start, task.limits) for task in tasks})
    if count > 1:
        keys = ", ".join(key for key in experiment.swept if not key.startswith("horizon"))
        raise ExperimentError([f"{path}: sweep: {count} different circles; should be one: --set a value of {keys}"])
    return tasks[0]
