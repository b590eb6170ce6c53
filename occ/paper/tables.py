"""The data of one figure, and how it is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occ.experiment.store import write_text

if TYPE_CHECKING:
    import pandas as pd

COMPUTED = "computed; not printed in the copy at hand"
CHOSEN = "chosen; not printed in the copy at hand"
PRINTED = "printed"
"""Where a number of a figure is from; the column ``source`` says it for each curve."""


@dataclass(frozen=True)
class FigureData:
    """What a figure of the paper shows.

    Args:
        table: all that is drawn, a row for each point.
        agreement: how far full and reduced model are apart, a row for each motion.
    """

    table: pd.DataFrame
    agreement: Sequence[Mapping[str, float | str]] = ()


def frame(parts: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Stack curves: numbers and texts of a curve are repeated on each of its rows.

    Args:
        parts: for each curve its columns, arrays (N,) or single values; a column that a curve lacks stays empty.

    Returns:
        One table.
    """
    import pandas as pd

    frames = []
    for part in parts:
        count = max((np.size(value) for value in part.values() if not isinstance(value, str)), default=1)
        frames.append(pd.DataFrame({name: _column(value, count) for name, value in part.items()}))
    return pd.concat(frames, ignore_index=True)


def _column(value: Any, count: int) -> Any:
    if isinstance(value, str):
        return [value] * count
    return np.broadcast_to(np.asarray(value), (count,))


def write_table(path: Path, table: pd.DataFrame, digits: int) -> None:
    """Write a table as CSV, whole or not at all.

    Args:
        path: of the file.
        table: numbers and text.
        digits: significant digits of the numbers.

    Raises:
        InputError: the folder cannot be written.
    """
    write_text(path, table.to_csv(index=False, float_format=f"%.{digits}g", lineterminator="\n"))
