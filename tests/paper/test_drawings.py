"""The drawings: axes with units, curves that differ without colours, and a word on what was chosen."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from typer.testing import CliRunner

from occ.cli import app
from occ.errors import InputError
from occ.figures.paper import DRAWINGS, draw
from occ.figures.style import style
from occ.paper.data import FIGURES, figure_numbers

Table = Callable[[int], pd.DataFrame]
COMMITTED = Path(__file__).parents[2] / "reports" / "paper"
PRINTED_IN_FULL = {3}
"""Figures without a number that the copy at hand lacks."""


@pytest.fixture(autouse=True)
def _styled() -> Iterator[None]:
    with style():
        yield


def test_there_is_a_drawing_for_every_figure() -> None:
    assert list(DRAWINGS) == list(FIGURES) == list(range(3, 11))


@pytest.mark.parametrize("number", DRAWINGS)
def test_axes_have_units(number: int, committed: Table) -> None:
    figure = DRAWINGS[number](committed(number))
    shared = {axes.get_shared_x_axes().get_siblings(axes)[-1] for axes in figure.axes}
    for axes in figure.axes:
        if axes in shared and any(label.get_visible() for label in axes.get_xticklabels()):
            assert any(re.search(r"\[.+\]", other.get_xlabel()) for other in figure.axes)
        labels = [axes.get_xlabel(), axes.get_ylabel()]
        assert all(re.search(r"\[.+\]", text) for text in labels if text), labels
        assert any(labels)


@pytest.mark.parametrize("number", DRAWINGS)
def test_curves_of_a_panel_differ_without_colours(number: int, committed: Table) -> None:
    def look(line: Any) -> tuple[Any, ...]:
        return (
            tuple(line._dash_pattern[1] or ()),
            line.get_linewidth() > 2.1,
            line.get_marker(),
            line.get_linewidth() < 1,
        )

    for axes in DRAWINGS[number](committed(number)).axes:
        named = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
        assert len({look(line) for line in named}) == len(named), [line.get_label() for line in named]


@pytest.mark.parametrize("number", DRAWINGS)
def test_what_was_chosen_is_said_in_the_figure(number: int, committed: Table) -> None:
    figure = DRAWINGS[number](committed(number))
    texts = " ".join(text.get_text() for text in figure.texts)
    assert texts.startswith(f"Fig. {number} ")
    if number not in PRINTED_IN_FULL:
        assert "copy at hand" in texts
        assert re.search(r"chosen|computed", texts)


@pytest.mark.parametrize("number", DRAWINGS)
def test_nothing_is_written_outside_of_the_figure(number: int, committed: Table) -> None:
    figure = DRAWINGS[number](committed(number))
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    box = figure.get_tightbbox(canvas.get_renderer())
    width, height = figure.get_size_inches()
    assert box.x0 > 0
    assert box.y0 > 0
    assert box.x1 < width
    assert box.y1 < height


def words(path: Path) -> list[str]:
    return ["".join(item.itertext()).strip() for item in ET.parse(path).iter("{http://www.w3.org/2000/svg}text")]


@pytest.mark.parametrize("number", DRAWINGS)
def test_the_committed_drawings_are_made_from_the_committed_data(number: int, tmp_path: Path) -> None:
    name = f"fig{number:02d}"
    (tmp_path / f"{name}.csv").write_bytes((COMMITTED / f"{name}.csv").read_bytes())
    path = draw(tmp_path, number)
    assert words(path) == words(COMMITTED / f"{name}.svg")
    assert not re.search(r"\d\d:\d\d:\d\d|<dc:date>", path.read_text())


def test_numbers_of_figures() -> None:
    assert figure_numbers([]) == list(range(3, 11))
    assert figure_numbers(["10", "3", "3"]) == [3, 10]


@pytest.mark.parametrize("text", ["2", "11", "0", "-4", "4.0", "x", ""])
def test_a_figure_that_is_none_is_one_line(text: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["paper", f"--figure={text}", "--out", str(out)])
    assert result.exit_code == 2
    assert len(result.output.splitlines()) == 1
    assert "from 3 to 10" in result.output
    assert not out.exists()


def test_several_figures_at_once(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["paper", "--figure", "3", "9", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert {path.name for path in tmp_path.iterdir()} == {
        "fig03.csv",
        "fig03.svg",
        "fig09.csv",
        "fig09.svg",
        "fig09_agreement.csv",
    }


def test_a_drawing_without_its_data(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"fig03\.csv: cannot be read"):
        draw(tmp_path, 3)
