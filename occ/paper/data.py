"""The figures of the paper: which there are, and the files with the data behind them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import MappingProxyType

from occ.errors import InputError
from occ.paper.domain import stability_domain
from occ.paper.implementation import critical_starts, near_translation, steady_rotation, work_of_laws
from occ.paper.motions import AGREEMENT_COLUMNS
from occ.paper.portraits import phase_portraits
from occ.paper.rotation import resonances, yaw_rates
from occ.paper.tables import FigureData, write_table

FIGURES: MappingProxyType[int, Callable[[], FigureData]] = MappingProxyType(
    {
        3: stability_domain,
        4: steady_rotation,
        5: phase_portraits,
        6: yaw_rates,
        7: resonances,
        8: critical_starts,
        9: near_translation,
        10: work_of_laws,
    }
)
DIGITS = 8
AGREEMENT_DIGITS = 1
"""Differences of rounding size: only their order is the same on another machine."""


def figure_numbers(texts: Sequence[str]) -> list[int]:
    """Which figures are meant.

    Args:
        texts: numbers as the user wrote them; none means all.

    Returns:
        Increasing, without repetition.

    Raises:
        InputError: a number that is not one of `FIGURES`.
    """
    for text in texts:
        if not text.strip().isdecimal() or int(text) not in FIGURES:
            known = f"{min(FIGURES)} to {max(FIGURES)}"
            raise InputError(f"--figure {text}: no figure with data behind it; should be a number from {known}")
    return sorted({int(text) for text in texts}) or list(FIGURES)


def csv_path(folder: Path, number: int) -> Path:
    """FOLDER/figNN.csv."""
    return folder / f"fig{number:02d}.csv"


def write_data(folder: Path, number: int) -> None:
    """Compute a figure's data and write ``figNN.csv`` and, where it shows motions, ``figNN_agreement.csv``.

    Args:
        folder: where.
        number: of the figure.

    Raises:
        InputError: the folder cannot be written.
    """
    import pandas as pd

    data = FIGURES[number]()
    write_table(csv_path(folder, number), data.table, DIGITS)
    if data.agreement:
        table = pd.DataFrame(list(data.agreement), columns=list(AGREEMENT_COLUMNS))
        write_table(folder / f"fig{number:02d}_agreement.csv", table, AGREEMENT_DIGITS)
