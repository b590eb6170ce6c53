"""The table that comes with every function: random inputs and what CasADi makes of them."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from occ.export.evaluate import rounding
from occ.export.routine import Routine, evaluate_function

SAMPLES = 100
"""Random inputs in the table of a function."""
TOLERANCE = 1e-12
"""Largest difference from CasADi, relative to the value or to its scale."""
SINGLE_TOLERANCE = 1e-5
"""The same in single precision."""
GATHERED = 0.01
"""Part of the sizes that an entry is gathered from which counts as its scale: at 1e-12 and 1e-5 this is what rounding
alone can do in double and in single precision, with a margin of 100 and of 1."""


class Table(NamedTuple):
    """Inputs and results of N samples.

    Args:
        inputs: of each argument, (size, N); every number is one of single precision, too.
        results: (rows times columns, N), row by row.
        scale: (rows times columns,) what a difference is small against where the result itself is small: its root
            mean square over the samples, or `GATHERED` times that of the sizes from which it is gathered.
    """

    inputs: list[np.ndarray]
    results: np.ndarray
    scale: np.ndarray


@lru_cache(maxsize=512)
def table_of(routine: Routine, samples: int = SAMPLES) -> Table:
    """Random inputs, the same in every run, and CasADi's results.

    Args:
        routine: of any arguments.
        samples: N.

    Returns:
        The table; one sample where there is no argument.
    """
    random = np.random.default_rng(0)
    inputs = []
    for argument in routine.arguments:
        middle, spread = np.array(argument.middle)[:, None], np.array(argument.spread)[:, None]
        values = middle + spread * random.uniform(-1.0, 1.0, (argument.size, samples))
        inputs.append(values.astype(np.float32).astype(float))
    results = evaluate_function(routine.function, inputs)
    gathered = GATHERED * rounding(routine.program, routine.shape, inputs)
    return Table(inputs, results, np.maximum(_mean_size(results), _mean_size(gathered)))


def _mean_size(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=1)))


def error_of(table: Table, results: np.ndarray) -> float:
    """Largest |result - expected| / max(|expected|, scale).

    Args:
        table: with the expected results.
        results: (rows times columns, N).

    Returns:
        The error; infinite where a result is not a number.
    """
    difference = np.abs(results - table.results)
    size = np.maximum(np.abs(table.results), table.scale[:, None])
    # Where the scale is zero, all is zero.
    relative = np.where(difference == 0.0, 0.0, difference / np.where(size > 0.0, size, 1e-300))
    worst = float(relative.max(initial=0.0))
    return worst if np.isfinite(worst) else np.inf


def table_text(routine: Routine, table: Table) -> str:
    """The rows of the CSV file: first the scale of each column, then a sample a row; inputs before results.

    Args:
        routine: for the names of the columns.
        table: of the routine.

    Returns:
        Lines; that of the columns' names is a comment.
    """
    heads = [f"{argument.name}.{entry}" for argument in routine.arguments for entry in argument.entries]
    rows, columns = routine.shape
    heads += [f"{routine.result}[{i + 1} {j + 1}]" for i in range(rows) for j in range(columns)]
    samples = np.vstack([*table.inputs, table.results])
    scale = np.concatenate([*(np.zeros(len(x)) for x in table.inputs), table.scale])
    lines = [",".join(repr(float(x)) for x in row) for row in (scale, *samples.T)]
    return "\n".join([f"# columns: {', '.join(heads)}", *lines, ""])
