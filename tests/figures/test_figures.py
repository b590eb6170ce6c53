from __future__ import annotations

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.figures.comparison import Motions, plan, write_figures
from occ.figures.floor import path_figure
from occ.figures.over_time import cost_figure, force_figure, heading_figure, plain_number, visible_range
from occ.figures.style import COLOURS, DASHES, controller_line, label, look, style
from occ.figures.sweep import front_figure, gap_figure, value_figure
from occ.objectives import OBJECTIVES, objective
from occ.report.stored import Motion, load
from tests.report.synthetic import COMPARED, WHEELS, motion, row, store

NAMES = ("servo law", "faster_turn", "_spiky")
OVER_TIME = ("work.svg", "torque-squared.svg", "forces.svg", "heading.svg")
ALL = {*OVER_TIME, "paths.svg"}


@pytest.fixture(autouse=True)
def _styled() -> Iterator[None]:
    with style():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    motions = {("base", name): motion(spin=0.5 + i, spike=500.0 * (i == 2)) for i, name in enumerate(NAMES)}
    return store(tmp_path_factory.mktemp("stored"), [row(name) for name in NAMES], motions)


@pytest.fixture(scope="module")
def written(folder: Path) -> list[Path]:
    return write_figures(folder)


@pytest.fixture(scope="module")
def motions(folder: Path) -> Motions:
    stored = load(folder)
    found = {name: stored.motion("base", name) for name in NAMES}
    return {name: (i, item) for i, (name, item) in enumerate(found.items()) if item is not None}


def texts(path: Path) -> list[str]:
    return ["".join(item.itertext()).strip() for item in ET.parse(path).iter("{http://www.w3.org/2000/svg}text")]


def curves(panel: Any) -> dict[str, Any]:
    return {line.get_label().strip(): line for line in panel.get_lines()}


def test_every_figure_is_written_as_valid_xml(written: list[Path], folder: Path) -> None:
    assert {path.name for path in written} == ALL
    assert {path.name for path in (folder / "figures").iterdir()} == ALL
    for path in written:
        assert ET.parse(path).getroot().tag == "{http://www.w3.org/2000/svg}svg"


def test_no_date_and_the_same_bytes_again_whatever_the_users_settings(written: list[Path], folder: Path) -> None:
    import matplotlib

    before = [path.read_bytes() for path in written]
    told: list[str] = []
    with matplotlib.rc_context({"lines.color": "red", "axes.facecolor": "yellow", "figure.dpi": 50}):
        assert write_figures(folder, told.append) == written
        assert matplotlib.rcParams["axes.facecolor"] == "yellow"
    assert [path.read_bytes() for path in written] == before
    assert told == [path.name for path in written]
    assert not re.search(rb"dc:date|20\d\d-\d\d-\d\d", b"".join(before))


def test_heavy_libraries_wait_until_something_is_drawn() -> None:
    code = (
        "import sys, occ.figures.comparison, occ.report.report; "
        "print({'matplotlib', 'jinja2', 'h5py', 'xarray'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@pytest.mark.parametrize("name", OVER_TIME)
def test_every_controller_is_named_in_the_figure(written: list[Path], name: str) -> None:
    path = next(item for item in written if item.name == name)
    assert set(NAMES) <= set(texts(path))


def test_axes_carry_units(motions: Motions) -> None:
    figures = [cost_figure(item, motions) for item in OBJECTIVES.values()]
    figures += [heading_figure(motions), force_figure(motions), path_figure(motions)]
    for figure in figures:
        for panel in figure.axes:
            assert re.fullmatch(r".*\[.+\]", panel.get_ylabel()), panel.get_ylabel()
        assert re.fullmatch(r".+ \[(s|m)\]", figure.axes[-1].get_xlabel())


def test_a_cost_is_the_stored_one_and_its_difference_to_the_law(motions: Motions) -> None:
    top, bottom = cost_figure(objective("work"), motions).axes
    for name, (_, stored) in motions.items():
        line, difference = curves(top)[name], curves(bottom)[name]
        np.testing.assert_array_equal(line.get_xdata(), stored["time"])
        np.testing.assert_array_equal(line.get_ydata(), stored["work"])
        np.testing.assert_array_equal(difference.get_ydata(), stored["work"] - motions[NAMES[0]][1]["work"])


def test_heading_and_forces_are_the_stored_ones(motions: Motions) -> None:
    top, bottom = heading_figure(motions).axes
    panels = force_figure(motions).axes
    for i, (name, (_, stored)) in enumerate(motions.items()):
        np.testing.assert_array_equal(curves(top)[name].get_ydata(), stored["heading"])
        np.testing.assert_array_equal(curves(bottom)[name].get_ydata(), stored["yaw_rate"])
        forces = [line.get_ydata() for line in panels[i].get_lines()]
        np.testing.assert_array_equal(forces, [stored["force_x"], stored["force_y"], stored["yaw_moment"]])
        torques = [line.get_ydata() for line in panels[len(motions) + i].get_lines()]
        np.testing.assert_array_equal(torques, stored["torque"])


def test_nearly_equal_costs_are_enlarged_while_far_ones_leave_the_scale() -> None:
    t = np.linspace(0.0, 1.0, 11)
    shared = {"law": 100 * t, "near": 99 * t, "far": 300 * t}
    data = {name: (i, Motion({"time": t, "work": values}, {})) for i, (name, values) in enumerate(shared.items())}
    _, bottom = cost_figure(objective("work"), data).axes
    low, high = bottom.get_ylim()
    assert -2 < low < -1
    assert 0 < high < 1
    assert "1 of 2 curves leave this scale" in bottom.get_title(loc="left")


def test_a_cost_that_dwarfs_the_others_is_named_with_its_value() -> None:
    t = np.linspace(0.0, 1.0, 11)
    shared = {"law": 10 * t, "near": 9 * t, "third": 12 * t, "huge": 1234.5 * t}
    data = {name: (i, Motion({"time": t, "work": values}, {})) for i, (name, values) in enumerate(shared.items())}
    top, _ = cost_figure(objective("work"), data).axes
    assert top.get_ylim()[1] == pytest.approx(12 * 1.08)
    assert [note.get_text() for note in top.texts] == ["huge goes up to 1234 J, off this scale"]


def test_a_short_peak_is_cut_and_told(motions: Motions) -> None:
    *_, calm, spiky = force_figure(motions).axes
    assert spiky.get_ylim()[1] < 3
    assert calm.get_ylim() == spiky.get_ylim()
    assert [note.get_text() for note in spiky.texts] == ["M_1 leaves this scale: 500 N m at t = 0 s"]
    assert not calm.texts


def test_the_curve_that_leaves_the_scale_is_told_and_not_a_larger_one_that_stays() -> None:
    # The yaw moment leaves the scale downwards for an instant, while F_X, which is larger, stays within it.
    t = np.unique(np.concatenate([np.linspace(0, 10, 101), np.linspace(0, 0.01, 200)]))
    force, jump = 125 - 25 * np.cos(t), np.where(t < 0.005, 20.0, 110.0)
    data = {"time": t, "force_x": force, "force_y": 0 * t + 120, "yaw_moment": jump, "torque": np.zeros((4, len(t)))}
    left, _ = force_figure({"law": (0, Motion(data, {}))}).axes
    assert [note.get_text() for note in left.texts] == ["M_Ω leaves this scale: 20 N m at t = 0 s"]


@pytest.mark.parametrize(
    ("value", "text"), [(8612.4, "8612"), (-359863.2, "-359863"), (6.8912, "6.891"), (2e9, "2e+09")]
)
def test_a_peak_is_a_plain_number(value: float, text: str) -> None:
    assert plain_number(value) == text


def inside(figure: Any, item: Any) -> bool:
    """Whether an artist lies within its figure."""
    box, page = item.get_window_extent(), figure.bbox
    return bool(page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0 and box.y1 <= page.y1)


@pytest.mark.parametrize("keys", [1, 6])
def test_a_title_stays_within_its_figure(motions: Motions, keys: int) -> None:
    where = "".join(f",controller.between.weights.torque_squared={k}" for k in range(keys))
    for figure in (force_figure(motions, where), heading_figure(motions, where), path_figure(motions, where)):
        (title,) = figure.texts
        assert inside(figure, title), title.get_text()
        assert title.get_text().replace("\n", "").endswith(("…", where[-20:]))
        assert title.get_window_extent().y0 > max(panel.bbox.y1 for panel in figure.axes)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_legend_of_the_paths_hides_no_axis(motions: Motions, count: int) -> None:
    figure = path_figure(dict(list(motions.items())[:count]))
    (legend,) = figure.legends
    figure.canvas.draw()
    assert inside(figure, legend)
    assert legend.get_window_extent().y1 < min(panel.get_tightbbox().y0 for panel in figure.axes)


def test_the_range_without_a_short_peak() -> None:
    t = np.unique(np.concatenate([np.linspace(0, 10, 101), np.linspace(0, 0.01, 200)]))
    calm = np.sin(t)
    peak = np.where(t < 0.005, 80.0, calm)
    low, high = visible_range([(t, calm), (t, peak)])
    assert calm.min() == low
    assert 1.0 < high < 1.5


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30))
def test_the_visible_range_never_leaves_the_data(values: list[float]) -> None:
    y = np.array(values)
    low, high = visible_range([(np.arange(float(len(y))), y)])
    assert y.min() <= low <= high <= y.max()


def test_a_lasting_value_is_never_cut() -> None:
    t = np.linspace(0.0, 10.0, 101)
    steps = np.where(t < 2.0, 80.0, 1.0)
    assert visible_range([(t, steps), (t, np.ones_like(t))]) == (1.0, 80.0)


def test_the_platform_is_drawn_where_it_is(motions: Motions) -> None:
    panel = path_figure(motions).axes[1]
    stored = motions[NAMES[1]][1]
    bodies, wheels, arrows = panel.collections
    assert panel.get_aspect() == 1.0
    end = stored["heading"][-1]
    turn = np.array([[np.cos(end), -np.sin(end)], [np.sin(end), np.cos(end)]])
    center = np.array([stored["x"][-1], stored["y"][-1]])
    corners = bodies.get_paths()[-1].vertices[:4]
    expected = WHEELS @ turn.T + center
    assert {tuple(item) for item in np.round(corners, 9)} == {tuple(item) for item in np.round(expected, 9)}
    last = [path.vertices[:4].mean(axis=0) for path in wheels.get_paths()[-4:]]
    np.testing.assert_allclose(last, expected, atol=1e-12)
    for path in wheels.get_paths():
        # A wheel of radius 0.05 m mounted along OX is 0.1 m long in the direction of the heading.
        assert np.hypot(*(path.vertices[0] - path.vertices[1])) == pytest.approx(0.1)
    shaft = arrows.get_paths()[-2].vertices
    direction = shaft[1] - shaft[0]
    np.testing.assert_allclose(direction / np.hypot(*direction), turn[:, 0], atol=1e-12)
    np.testing.assert_allclose(shaft[0], center, atol=1e-12)
    marks = np.array(panel.get_lines()[-1].get_data())
    np.testing.assert_allclose(marks[:, -1], stored["point"][:, -1], atol=1e-9)


def test_a_wheel_across_the_body_is_drawn_across(motions: Motions) -> None:
    stored = motions[NAMES[0]][1]
    attributes = stored.attributes | {"wheel_mounting_angles": np.full(4, np.pi / 2)}
    panel = path_figure({"law": (0, Motion(stored.data, attributes))}).axes[0]
    corners = panel.collections[1].get_paths()[0].vertices
    np.testing.assert_allclose(np.abs(corners[0] - corners[1]), [0.0, 0.1], atol=1e-12)


def test_everything_drawn_is_inside_the_panel(motions: Motions) -> None:
    for panel in path_figure(motions).axes:
        for collection in panel.collections:
            points = np.vstack([path.vertices for path in collection.get_paths()])
            (left, right), (bottom, top) = panel.get_xlim(), panel.get_ylim()
            assert left <= points[:, 0].min() <= points[:, 0].max() <= right
            assert bottom <= points[:, 1].min() <= points[:, 1].max() <= top


@pytest.mark.parametrize("count", [1, 5, 9])
def test_no_label_reaches_over_the_edge_of_its_figure(motions: Motions, count: int) -> None:
    stored = motions[NAMES[0]][1]
    long = {f"controller number {i} with a long and winding name": (i, stored) for i in range(count)}
    drawn = [
        cost_figure(objective("torque_squared"), long),
        heading_figure(long),
        force_figure(long),
        path_figure(long),
    ]
    for figure in drawn:
        figure.canvas.draw()
        edge = figure.bbox
        for artist in [*figure.texts, *figure.legends, *[panel.get_legend() for panel in figure.axes]]:
            if artist is not None:
                box = artist.get_window_extent()
                assert edge.x0 <= box.x0
                assert box.x1 <= edge.x1
                assert edge.y0 <= box.y0
                assert box.y1 <= edge.y1
        for panel in figure.axes:
            box = panel.get_tightbbox()
            assert edge.x0 - 0.5 <= box.x0
            assert edge.y0 - 0.5 <= box.y0


def test_a_missing_trajectory_leaves_its_controller_out(folder: Path, tmp_path: Path) -> None:
    motions = {("base", name): motion(spin=0.5 + i) for i, name in enumerate(NAMES)}
    lone = store(tmp_path, [row(name) for name in NAMES], motions)
    next((lone / "trajectories").glob("*@faster_turn.nc")).unlink()
    assert {path.name for path in write_figures(lone)} == ALL
    shown = texts(lone / "figures" / "heading.svg")
    assert "faster_turn" not in shown
    assert "servo law" in shown
    # Its rivals keep the look that they have in every other figure.
    spiky = controller_line(2)
    assert spiky["color"] in (lone / "figures" / "heading.svg").read_text().upper()


def test_without_any_trajectory_there_is_no_figure(tmp_path: Path) -> None:
    assert write_figures(store(tmp_path, [row("law", None, status="crashed")])) == []


def test_figures_of_several_cases_have_its_name(tmp_path: Path) -> None:
    cases = ("one lap", "30 s")
    stored = store(tmp_path, [row("law", case=case) for case in cases], {(case, "law"): motion() for case in cases})
    names = {path.name for path in write_figures(stored)}
    assert names == {f"{slug}-{name}" for slug in ("one_lap", "30_s") for name in ALL}
    assert "Heading and yaw rate over time, 30 s" in texts(tmp_path / "figures" / "30_s-heading.svg")


def sweep(tmp_path: Path, count: int) -> Path:
    cases = [f"motion.radius={0.5 + 0.1 * i:.1f}" for i in range(count)]
    rows = [
        row(name, 90.0 + i + 5 * k, case=case, **{"motion.radius": 0.5 + 0.1 * i, "motion.kind": "circle"})
        for i, case in enumerate(cases)
        for k, name in enumerate(("law", "rival"))
    ]
    return store(tmp_path, rows, {(case, "law"): motion() for case in cases})


def test_many_cases_have_a_figure_of_the_gap_and_only_three_of_their_own(tmp_path: Path) -> None:
    names = [item.name for item in plan(load(sweep(tmp_path, 7)))]
    assert names[:2] == ["gap-work-motion.radius.svg", "gap-torque_squared-motion.radius.svg"]
    assert names[2:4] == ["work-motion.radius.svg", "torque_squared-motion.radius.svg"]
    # One more is planned and drawn only where B leaves its program.
    assert len(names) == 4 + 3 * (len(ALL) + 1)
    assert not [name for name in names if name.startswith("gap-work-motion.kind")]


def test_the_gap_is_the_stored_one(tmp_path: Path) -> None:
    stored = load(sweep(tmp_path, 7))
    figure = gap_figure(stored, objective("work"), "motion.radius")
    assert figure is not None
    (panel,) = figure.axes
    for name, line in curves(panel).items():
        rows = stored.rows[stored.rows["controller"] == name]
        np.testing.assert_array_equal(line.get_xdata(), rows["motion.radius"].astype(float))
        np.testing.assert_array_equal(line.get_ydata(), rows["work_gap_percent"])
    assert panel.get_ylabel() == "gap [%]"
    assert panel.get_xlabel() == "motion.radius [m]"


def test_the_value_over_a_swept_key_is_the_stored_one(tmp_path: Path) -> None:
    stored = load(sweep(tmp_path, 4))
    assert "work-motion.radius.svg" in [item.name for item in plan(stored)]
    figure = value_figure(stored, objective("work"), "motion.radius")
    assert figure is not None
    (panel,) = figure.axes
    for name, line in curves(panel).items():
        rows = stored.rows[stored.rows["controller"] == name]
        np.testing.assert_array_equal(line.get_ydata(), rows["work_J"])
    assert panel.get_ylabel() == "work [J]"


def test_curves_of_another_swept_key_are_told_apart(tmp_path: Path) -> None:
    limits = (0.8, 1.2)
    rows = [
        row("law", 80.0 + i + limit, case=f"{i} {limit}", **{"motion.radius": i, "limits.torque": limit})
        for i in range(3)
        for limit in limits
    ]
    figure = value_figure(load(store(tmp_path, rows)), objective("work"), "motion.radius")
    assert figure is not None
    (panel,) = figure.axes
    for line, limit in zip(panel.get_lines(), limits, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), 80.0 + np.arange(3) + limit)
    legend = panel.get_legend()
    markers = {str(line.get_label()): line.get_marker() for line in legend.get_lines()}
    assert markers["limits.torque=0.8"] == panel.get_lines()[0].get_marker()
    assert markers["limits.torque=1.2"] == panel.get_lines()[1].get_marker()
    assert markers["limits.torque=0.8"] != markers["limits.torque=1.2"]


def test_a_swept_weight_gives_a_front_with_the_law_beside_it(tmp_path: Path) -> None:
    key = "controller.between.weights.work"
    weights, torques = [1.0, 2.0, 4.0], [9.0, 8.0, 7.5]
    rows = []
    for weight, torque in zip(weights, torques, strict=True):
        of_case = {"case": str(weight), key: weight}
        rows.append(row("law", 80.0, **of_case))
        rows.append(row("between", 70.0 + weight, **of_case, torque_squared_N2m2s=torque))
        rows.append(row("spiky", 70.0, **of_case, torque_squared_N2m2s=1e6))
    stored = load(store(tmp_path, rows))
    assert f"front-work-torque_squared-{key}.svg" in [item.name for item in plan(stored)]
    figure = front_figure(stored, (objective("work"), objective("torque_squared")), key)
    assert figure is not None
    (panel,) = figure.axes
    lines = curves(panel)
    assert set(lines) == {"law", "between"}
    np.testing.assert_array_equal(lines["between"].get_xdata(), [71.0, 72.0, 74.0])
    np.testing.assert_array_equal(lines["between"].get_ydata(), torques)
    assert len(lines["law"].get_xdata()) == 1
    # The weights stand beside their points, and none upon another.
    assert [text.get_text() for text in panel.texts[:3]] == ["1", "2", "4"]
    # What is far beyond the front is said and not drawn.
    assert any("spiky" in text.get_text() and "1e+06" in text.get_text() for text in panel.texts)
    assert panel.get_xlabel().startswith("work [J]")
    assert panel.get_ylabel() == "torque squared [N² m² s]"


def test_gaps_of_several_sizes_have_plain_numbers_on_their_axis(tmp_path: Path) -> None:
    rows = [row("law", 80.0 * (1 + 10.0 ** (i - 4)), case=str(i), **{"motion.radius": i}) for i in range(7)]
    folder = store(tmp_path, rows)
    names = {f"{kind}{name}-motion.radius.svg" for kind in ("gap-", "") for name in COMPARED}
    assert {path.name for path in write_figures(folder)} == names
    shown = texts(folder / "figures" / "gap-work-motion.radius.svg")
    assert {"0", "0.1", "1", "10", "100"} <= set(shown)


def test_swept_values_of_several_sizes_are_the_ticks_of_their_axis(tmp_path: Path) -> None:
    radii = [0.002, 0.005, 0.01, 0.05]
    folder = store(tmp_path, [row("law", 80.0, case=str(x), **{"motion.radius": x}) for x in radii])
    write_figures(folder)
    shown = set(texts(folder / "figures" / "work-motion.radius.svg"))
    assert {f"{x:g}" for x in radii} <= shown
    assert not [text for text in shown if "$" in text]


def test_no_mathematical_markup_is_shown_as_text(written: list[Path]) -> None:
    assert not [text for path in written for text in texts(path) if "$" in text]


def test_without_a_gap_there_is_no_figure_of_it(tmp_path: Path) -> None:
    rows = [row("law", case=str(i), start="own", **{"motion.radius": i}) for i in range(7)]
    assert gap_figure(load(store(tmp_path, rows)), objective("work"), "motion.radius") is None


def test_lines_differ_without_their_colours() -> None:
    assert len(set(DASHES)) == len(DASHES) == len(COLOURS)
    looks = {(look(i)["color"], str(look(i)["linestyle"])) for i in range(28)}
    assert len(looks) == 28


def test_a_label_is_never_hidden_nor_read_as_mathematics() -> None:
    assert not label("_name").startswith("_")
    assert "\n" in label("a very long name of a controller in one line")


def test_the_trajectories_of_the_experiment_layer_are_understood(tmp_path: Path) -> None:
    from occ.experiment.dataset import motion_dataset
    from occ.laws import ServoLaw
    from occ.model.presets import youbot
    from occ.motion import Circle
    from occ.referee import examine
    from occ.task import Task

    task = Task(platform=youbot(), point=(0.4, 0.05), motion=Circle(radius=0.7, rate=-0.4, phase=1.5), duration=0.5)
    verdict = examine(task, ServoLaw().solve(task))
    folder = store(tmp_path, [row("law"), row("other")], {("base", "law"): motion()})
    motion_dataset(task, verdict, {}).to_netcdf(folder / "trajectories/base@law.nc", engine="h5netcdf")
    assert {path.name for path in write_figures(folder)} == ALL
