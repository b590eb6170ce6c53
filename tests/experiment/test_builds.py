"""What a worker builds once and what it keeps: programs of a structure, functions of a platform, memory."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from occ.atlas.comparison import Comparison, compare
from occ.experiment.load import load_experiment
from occ.experiment.pool import Engine
from occ.optimal import transcription
from tests.experiment import tiny
from tests.experiment.jobs import resident_after

OPTIMUM = """
[[controller]]
name = "min torque2"
kind = "collocation"
objective = "torque_squared"
intervals = 7
degree = 4
tolerance = 1e-2

[sweep]
"motion.radius" = [0.60, 0.70, 0.75]
"platform.wheel_friction" = [0.09, 0.12]
"""


def comparisons(path: Path) -> list[Comparison]:
    experiment = load_experiment(path)
    return [Comparison(case, experiment.objectives) for case in experiment.cases]


def test_a_program_is_built_once_and_solved_with_other_numbers(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    built = []
    honest = transcription.nonlinear_solver

    def counted(*arguments: Any, **options: Any) -> Any:
        built.append(arguments)
        return honest(*arguments, **options)

    monkeypatch.setattr(transcription, "nonlinear_solver", counted)
    first, *others = comparisons(write(tiny(more=OPTIMUM)))
    compare(first)
    assert built
    built.clear()
    torques = [compare(item)[2]["torque_squared_N2m2s"] for item in others]
    assert not built
    assert len(set(torques)) == len(others)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_cases(write: Callable[..., Path]) -> None:
    """Each case has another platform; the parent gets its items from a generator and keeps nothing of them."""
    sweep = '\n[sweep]\n"platform.platform_mass" = { from = 20.0, to = 40.0, count = 100 }\n'
    items = comparisons(write(tiny(more=sweep)))
    here, parent, child = psutil.Process(), [], []
    for _, memory in Engine(workers=1, time_limit=60.0).each(resident_after, iter(items)):
        assert isinstance(memory, int), memory
        child.append(memory)
        parent.append(here.memory_info().rss)
    # What is kept of the latest platforms is full by then.
    for memory in (parent, child):
        before, after = np.mean(memory[40:50]), np.mean(memory[90:100])
        assert after - before < 50 * 10_000
