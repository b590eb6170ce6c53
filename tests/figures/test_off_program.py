"""The figure of B's distance from its program."""

from __future__ import annotations

import numpy as np

from occ.figures.off_program import off_program_figure
from occ.figures.style import style
from occ.report.stored import Motion


def motion(error: np.ndarray) -> Motion:
    t = np.linspace(0.0, 4.0, 101)
    program = np.array([np.cos(t), np.sin(t)])
    aside = error * np.array([[0.6], [0.8]])
    return Motion({"time": t, "program": program, "point": program + aside}, {})


def test_nothing_to_draw_where_all_keep_the_program() -> None:
    assert off_program_figure({"law": (0, motion(np.full(101, 5e-7)))}) is None


def test_distance_over_time() -> None:
    # 1 cm that stays, 1 cm that decays as exp(-4 t), and a controller that keeps its program.
    t = np.linspace(0.0, 4.0, 101)
    errors = {"stays": np.full(101, 0.01), "decays": 0.01 * np.exp(-4 * t), "keeps": np.full(101, 1e-14)}
    with style():
        figure = off_program_figure({name: (i, motion(error)) for i, (name, error) in enumerate(errors.items())})
    assert figure is not None
    (panel,) = figure.axes
    assert panel.get_yscale() == "log"
    assert panel.get_title(loc="left") == "1 of 3 curves stay below this scale"
    for line, error in list(zip(panel.lines, errors.values(), strict=True))[:2]:
        np.testing.assert_allclose(line.get_ydata(), error, atol=1e-15)
    assert panel.get_ylim()[0] > max(panel.lines[2].get_ydata())
    assert panel.yaxis.get_major_formatter().format_ticks([1e-8, 1e-4, 0.1, 1.0, 10.0]) == [
        "10⁻⁸", "10⁻⁴", "10⁻¹", "1", "10",
    ]  # fmt: skip
