"""How every figure looks: the one place for fonts, colours, line styles and the way it is written to a file."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from occ.experiment.store import replacing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#000000", "#D55E00", "#0072B2", "#009E73", "#E69F00", "#CC79A7", "#56B4E9")
"""Okabe and Ito's palette for the colour-blind, without its yellow, which is lost on white paper."""
DASHES: tuple[tuple[float, ...], ...] = (
    (),
    (5, 1.6),
    (1.2, 1.2),
    (7, 1.6, 1.2, 1.6),
    (9, 1.6, 1.2, 1.6, 1.2, 1.6),
    (11, 3),
    (2.2, 1.2, 2.2, 1.2, 2.2, 4),
)
"""A pattern for each colour, so that a print without colours can be read."""
GREY = "#8a8a8a"
LEGEND_WRAP = 26
"""Characters in a line of a legend or of a panel's title."""
TITLE_SIZE = 11.0
SMALLEST_TITLE = 8.0
"""[pt] A title too long for its figure is printed smaller, and past this broken into two lines."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_SETTINGS: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "sans-serif"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    # A fixed height spares matplotlib the search for one.
    "axes.titley": 1.0,
    "axes.titlelocation": "left",
    "grid.color": "#e2e2e2",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "legend.handlelength": 3.6,
    "lines.linewidth": 1.5,
    "lines.scale_dashes": False,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    # No "$" in a user's text is meant as mathematics.
    "text.parse_math": False,
    # Text stays text: it can be searched and read aloud, and its outlines do not depend on the machine.
    "svg.fonttype": "none",
    # A fixed salt makes the same identifiers every time.
    "svg.hashsalt": "occ",
    "path.simplify": True,
}


@contextmanager
def style() -> Iterator[None]:
    """The settings, for as long as a figure is built and written; matplotlib's own are left as they were."""
    import matplotlib

    # A user's own matplotlibrc changes nothing; the backend is never asked for, as no window is opened.
    defaults: dict[Any, Any] = {key: value for key, value in matplotlib.rcParamsDefault.items() if key != "backend"}
    with matplotlib.rc_context(rc=defaults | _SETTINGS):
        yield


def look(index: int) -> dict[str, Any]:
    """Colour and pattern of one line among several.

    Args:
        index: its place among them.

    Returns:
        Keyword arguments of `Axes.plot`.
    """
    # Past one round of colours the patterns are shifted, so that no pair of both comes back too soon.
    dashes = DASHES[(index + index // len(COLOURS)) % len(DASHES)]
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": (0, dashes) if dashes else "-"}


def controller_line(index: int) -> dict[str, Any]:
    """The look of a controller's curve.

    Args:
        index: of the controller in the experiment; 0 is the law, drawn heavier and beneath its rivals.

    Returns:
        Keyword arguments of `Axes.plot`.
    """
    return look(index) | {"linewidth": 2.6 if index == 0 else 1.5, "zorder": 2.0 + 0.01 * index}


def label(text: str) -> str:
    """A user's text as an entry of a legend: wrapped, and never hidden because of how it begins."""
    shown = textwrap.fill(text, LEGEND_WRAP)
    return f" {shown}" if shown.startswith("_") else shown


def blank(width: float, height: float, title: str, margin: float) -> Figure:
    """An empty figure with its title.

    Args:
        width: [in].
        height: [in].
        title: plain text.
        margin: [in] where the title begins.

    Returns:
        The figure.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    text, size = _fitted(title, width - margin - 0.1)
    # Further lines grow upwards, away from the panels.
    below = 0.5 * size / 72 if "\n" not in text else 0.09
    figure.text(margin / width, 1 - (0.3 + below) / height, text, fontsize=size, fontweight="bold", va="bottom")
    return figure


def _fitted(title: str, room: float) -> tuple[str, float]:
    """A title and its size [pt] for a width [in]: names of cases may be long, and have no spaces."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family="DejaVu Sans", weight="bold", size=TITLE_SIZE)
    width = text_to_path.get_text_width_height_descent(title, font, ismath=False)[0] / 72
    size = min(TITLE_SIZE, TITLE_SIZE * room / max(width, 1e-9))
    if size >= SMALLEST_TITLE:
        return title, size
    # Letters differ in width: a line has fewer of them than the average would allow.
    characters = int(0.9 * len(title) * room / width * TITLE_SIZE / SMALLEST_TITLE)
    first, second, *rest = textwrap.wrap(title, max(characters, 10))
    return f"{first}\n{second[:-1]}…" if rest else f"{first}\n{second}", SMALLEST_TITLE


def place(figure: Figure, box: tuple[float, float, float, float], share: Axes | None = None, **options: Any) -> Axes:
    """Add axes at a place in inches.

    Args:
        figure: to which.
        box: [in] left, bottom, width, height.
        share: axes whose time axis this one shares.
        options: of `Figure.add_axes`.

    Returns:
        The axes.
    """
    width, height = figure.get_size_inches()
    left, bottom, across, up = box
    axes = figure.add_axes((left / width, bottom / height, across / width, up / height), sharex=share, **options)
    # Labels at fixed places spare matplotlib measuring every number on the axes, twice.
    axes.xaxis.set_label_coords(0.5, -0.29 / up)
    axes.yaxis.set_label_coords(-0.5 / across, 0.5)
    return axes


def panels(width: float, heights: Sequence[float], title: str, margin: float = 0.75) -> tuple[Figure, list[Axes]]:
    """Panels one above the other with a common time axis and room for a legend on their right.

    Args:
        width: [in] of the panels.
        heights: [in] of each panel, from the top.
        title: of the figure, plain text.
        margin: [in] at the left, for labels.

    Returns:
        The figure and its axes, from the top; inner ones without labels of ticks.
    """
    top, bottom, between, right = 0.55, 0.55, 0.3, 2.65
    total = top + bottom + sum(heights) + between * (len(heights) - 1)
    figure = blank(margin + width + right, total, title, margin)
    axes: list[Axes] = []
    edge = total - top
    for height in heights:
        axes.append(place(figure, (margin, edge - height, width, height), axes[0] if axes else None))
        edge -= height + between
    for panel in axes[:-1]:
        panel.tick_params(labelbottom=False)
    return figure, axes


def power_of_ten(value: float, _: float = 0.0) -> str:
    """The label of a decade on a logarithmic axis: 10⁻⁸, and 1 and 10 as they are.

    Args:
        value: a power of ten.

    Returns:
        Text.
    """
    exponent = round(math.log10(value))
    return f"{value:g}" if exponent in {0, 1} else "10" + str(exponent).translate(_RAISED)


def legend_beside(panel: Axes, handles: Sequence[Artist], gap: float = 0.01) -> None:
    """A legend on the right of a panel, outside of the data.

    Args:
        panel: beside which it stands.
        handles: with their labels.
        gap: between them, as part of the panel's width.
    """
    panel.legend(
        handles=list(handles),
        loc="upper left",
        bbox_to_anchor=(1 + gap, 1.03),
        borderaxespad=0.0,
        labelspacing=0.6,
    )


def write(figure: Figure, path: Path) -> None:
    """Write a figure as SVG, without dates; a reader never meets half of it.

    Args:
        figure: built and written inside `style`.
        path: of the file; its folder is made.
    """
    with replacing(path) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None, "Creator": None})
