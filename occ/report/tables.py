"""One description of a table, shown three ways: in the terminal, as Markdown and as LaTeX."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import rich.table

MISSING = "–"
SMALLEST_GAP = 1e-4
"""[%] Gaps are printed with at most four decimals; what is smaller is said to be smaller."""


GAP = 3
"""Characters between the columns of a table in a terminal, its edges included."""
UNBROKEN = "\N{NO-BREAK SPACE}"
LEAST_HEADING = 12
"""Characters of a heading in a terminal that are not broken into lines."""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Args:
        heading: plain words.
        unit: plain text such as "N² m² s"; empty where there is none.
        numeric: aligned to the right.
    """

    heading: str
    unit: str = ""
    numeric: bool = False


@dataclass(frozen=True)
class Table:
    """Cells that are already text, without any mark-up.

    Args:
        caption: plain words.
        columns: of the table.
        rows: each with one cell per column.
    """

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row of {len(row)} cells in a table of {len(self.columns)} columns")


def is_missing(value: Any) -> bool:
    """Whether there is no number or no text."""
    return value is None or value == "" or (isinstance(value, float) and math.isnan(value))


def significant(value: Any, digits: int) -> str:
    """A number with a fixed count of significant digits, trailing zeros kept.

    Args:
        value: a number, or None or NaN for a missing one.
        digits: significant digits.

    Returns:
        Such as ``201.390``; ``0`` for zero and a dash for a missing number.
    """
    if is_missing(value):
        return MISSING
    number = float(value)
    if not math.isfinite(number):
        return "-∞" if number < 0 else "∞"
    return "0" if number == 0 else f"{number:#.{digits}g}".rstrip(".")


def amount(value: Any) -> str:
    """An objective or an energy: six significant digits."""
    return significant(value, 6)


def peak(value: Any) -> str:
    """A peak torque, speed or power: four significant digits."""
    return significant(value, 4)


def residual(value: Any) -> str:
    """An error that should be nearly zero: its order of magnitude and one more digit."""
    return MISSING if is_missing(value) else "0" if float(value) == 0 else f"{float(value):.1e}"


def gap(value: Any) -> str:
    """A gap in percent: four significant digits, at most four decimals.

    Args:
        value: [%], or None or NaN where there is no gap.

    Returns:
        Such as ``0.5305``; ``0`` for exactly zero, and ``< 0.0001`` for anything too small to be printed, of either
        sign: below its resolution a gap has no sign.
    """
    if is_missing(value):
        return MISSING
    number = float(value)
    if not math.isfinite(number):
        return significant(number, 4)
    if number == 0:
        return "0"
    if abs(number) < SMALLEST_GAP:
        return "< 0.0001"
    decimals = min(4, max(0, 3 - math.floor(math.log10(abs(number)))))
    return f"{number:.{decimals}f}"


def markdown_text(text: str) -> str:
    """Text in which Markdown and HTML find nothing of their own.

    Args:
        text: of any content.

    Returns:
        One line of it, escaped.
    """
    return re.sub(r"([\\`*_{}\[\]<>|#~$&])", r"\\\1", " ".join(text.split()))


_LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "–": "--",
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
    "∞": r"$\infty$",
}


def latex_text(text: str) -> str:
    """Text that LaTeX prints as it is.

    Args:
        text: of any content.

    Returns:
        One line of it, escaped.
    """
    return "".join(_LATEX.get(character, character) for character in " ".join(text.split()))


def _latex_cell(text: str) -> str:
    # A hyphen in front of a number is a minus sign.
    escaped = re.sub(r"^-(?=\d)", "$-$", latex_text(text))
    # A bracket at the beginning of a row would be read as the argument of the line break before it.
    return f"{{{escaped}}}" if escaped.startswith("[") else escaped


def _heading(column: Column) -> str:
    return f"{column.heading} [{column.unit}]" if column.unit else column.heading


def markdown(table: Table) -> str:
    """A Markdown table, without its caption.

    Args:
        table: what to show.

    Returns:
        Lines, each with its line break.
    """
    head = [markdown_text(_heading(column)) for column in table.columns]
    rule = ["---:" if column.numeric else ":---" for column in table.columns]
    body = [[markdown_text(cell) for cell in row] for row in table.rows]
    return "".join(f"| {' | '.join(row)} |\n" for row in [head, rule, *body])


def latex(table: Table) -> str:
    """A LaTeX table for the package booktabs.

    Args:
        table: what to show.

    Returns:
        A ``table`` environment, with its last line break.
    """
    form = "".join("r" if column.numeric else "l" for column in table.columns)
    lines = [
        r"\begin{table}",
        r"\centering\footnotesize\setlength{\tabcolsep}{4pt}",
        rf"\caption{{{latex_text(table.caption)}}}",
        rf"\begin{{tabular}}{{{form}}}",
        r"\toprule",
        _latex_row([_heading(column) for column in table.columns]),
        r"\midrule",
        *(_latex_row(row) for row in table.rows),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _latex_row(cells: Sequence[str]) -> str:
    return " & ".join(_latex_cell(cell) for cell in cells) + r" \\"


def plain_lines(table: Table) -> list[str]:
    """Caption, headings and rows in columns of even width, for a file or another program.

    Args:
        table: what to show.

    Returns:
        Lines without mark-up.
    """
    lines = [[_heading(column) for column in table.columns], *table.rows]
    widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    sides = [str.rjust if column.numeric else str.ljust for column in table.columns]
    shown = [[side(cell, width) for side, cell, width in zip(sides, line, widths, strict=True)] for line in lines]
    return [table.caption, *("  ".join(cells).rstrip() for cells in shown)]


def _folded(table: Table, k: int) -> list[str]:
    """The lines of a column's heading, about as wide as its cells."""
    width = max([LEAST_HEADING, *(len(row[k]) for row in table.rows)])
    column = table.columns[k]
    # A unit stays in one piece: its spaces are no places to break at.
    text = _heading(Column(column.heading, column.unit.replace(" ", UNBROKEN)))
    lines = textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)
    return [line.replace(UNBROKEN, " ") for line in lines] or [""]


def parts(table: Table, room: int) -> list[Table]:
    """A table in pieces that a terminal has room for; each begins with the columns that name the rows.

    Args:
        table: what to show.
        room: characters of a line.

    Returns:
        The table itself where it fits; a column that is too wide alone has a piece of its own.
    """
    cells = [[*_folded(table, k), *(row[k] for row in table.rows)] for k in range(len(table.columns))]
    widths = [max(map(len, column)) + GAP for column in cells]
    # Rows are named by the controller, or by case and controller, or by whatever comes first.
    named = 2 if [column.heading for column in table.columns[1:2]] == ["controller"] else 1
    names, used = list(range(named)), 0
    pieces: list[list[int]] = [[]]
    for k in range(named, len(widths)):
        if pieces[-1] and sum(widths[:named]) + used + widths[k] > room:
            pieces.append([])
            used = 0
        pieces[-1].append(k)
        used += widths[k]
    return [
        Table(
            table.caption if number == 0 else f"{table.caption}, continued",
            tuple(table.columns[k] for k in names + piece),
            tuple(tuple(row[k] for k in names + piece) for row in table.rows),
        )
        for number, piece in enumerate(pieces)
    ]


_COLOURS = {"ok": "green", "infeasible": "yellow", "failed": "red", "unstable": "red", "crashed": "red"}


def terminal(table: Table) -> rich.table.Table:
    """A table for the terminal, with the states of the rows in colour.

    Args:
        table: what to show.

    Returns:
        What ``rich`` prints.
    """
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    shown = RichTable(
        title=Text(table.caption, style="bold"), box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False
    )
    for k, column in enumerate(table.columns):
        shown.add_column(
            Text("\n".join(_folded(table, k))),
            justify="right" if column.numeric else "left",
            vertical="bottom" if column.numeric else "top",
            no_wrap=column.numeric,
            overflow="fold",
        )
    for row in table.rows:
        cells = zip(row, table.columns, strict=True)
        shown.add_row(
            *(Text(cell, style=_COLOURS.get(cell, "") if column.heading == "status" else "") for cell, column in cells)
        )
    return shown
