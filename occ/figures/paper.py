"""The paper's Figs. 3 to 10, drawn from the CSV files on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import pandas as pd

from occ.errors import InputError
from occ.figures.paper_domain import portrait_figure, stability_figure
from occ.figures.paper_motion import critical_figure, steady_figure, translation_figure, work_figure
from occ.figures.paper_rotation import resonance_figure, yaw_rate_figure
from occ.figures.style import style, write
from occ.paper.data import csv_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWINGS: MappingProxyType[int, Callable[[pd.DataFrame], Figure]] = MappingProxyType(
    {
        3: stability_figure,
        4: steady_figure,
        5: portrait_figure,
        6: yaw_rate_figure,
        7: resonance_figure,
        8: critical_figure,
        9: translation_figure,
        10: work_figure,
    }
)


def draw(folder: Path, number: int) -> Path:
    """Draw ``figNN.svg`` from ``figNN.csv``.

    Args:
        folder: of both.
        number: of the figure.

    Returns:
        The file.

    Raises:
        InputError: the data are missing or the folder cannot be written.
    """
    source = csv_path(folder, number)
    try:
        # "1/2" is text; an empty cell of a text column is no text.
        table = pd.read_csv(source, dtype={"q": str})
    except OSError as error:
        raise InputError(f"{source}: cannot be read ({error.strerror}); occ paper writes it") from error
    path = source.with_suffix(".svg")
    with style():
        write(DRAWINGS[number](table), path)
    return path
