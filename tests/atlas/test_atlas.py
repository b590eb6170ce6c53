"""An atlas: numbers of the theory at every point, whatever the engine, the blocks and the interruptions."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from occ.atlas import motion
from occ.atlas import run as atlas_run
from occ.atlas.columns import Columns
from occ.atlas.dataset import read_atlas, read_failures, write_atlas, write_failures
from occ.atlas.grid import Grid, load_grid
from occ.atlas.least_work import law_work
from occ.atlas.long_run import long_run_columns
from occ.atlas.run import Block, Comparison, Failure, Found, make_atlas
from occ.atlas.variables import REGIMES
from occ.errors import InputError
from occ.experiment.child import Lost
from occ.experiment.load import load_experiment
from occ.experiment.pool import Engine
from occ.theory.circle import circle_quantities
from occ.theory.coefficients import yaw_coefficients
from occ.theory.dissipation import energy_of
from occ.theory.equation import reduced_motion, yaw_acceleration
from occ.theory.minimum_work import minimum_work
from occ.theory.summary import circle_setting
from tests.atlas import SWEEP, atlas_text, made
from tests.experiment import HERE
from tests.experiment.conftest import Occ, Write, occ, occ_as_it_is, write

__all__ = ["occ", "occ_as_it_is", "write"]


def test_published_gaps(write: Write, tmp_path: Path) -> None:
    """0.161 %, 13.3 % and 6.4 % at b = (0.40, 0.05)."""
    path = write(atlas_text('"motion.radius" = [0.6, 0.7]\n"motion.rate" = [-0.4, 0.4]\n'))
    gap = made(path, tmp_path / "out")["long_run_gap_percent"]
    assert float(gap.sel({"motion.radius": 0.7, "motion.rate": -0.4})) == pytest.approx(0.161, abs=5e-4)
    assert float(gap.sel({"motion.radius": 0.7, "motion.rate": 0.4})) == pytest.approx(13.3, abs=0.05)
    assert float(gap.sel({"motion.radius": 0.6, "motion.rate": -0.4})) == pytest.approx(6.4, abs=0.05)


def test_check_values_of_the_long_run_and_the_finite_horizon(write: Write, tmp_path: Path, printed: Any) -> None:
    path = write(
        atlas_text('horizon = [{ laps = 1 }, { duration = 30.0 }]\n"motion.radius" = [0.3, 0.7]\n', "least_work")
    )
    data = made(path, tmp_path / "out")
    lap = data.sel({"horizon": "laps=1", "motion.radius": 0.7})
    long = data.sel({"horizon": "duration=30", "motion.radius": 0.7})
    for name, one, value in (
        ("critical_radius_m", lap, "0.647403193343"),
        ("critical_speed_m_s", lap, "26.5482182534"),
        ("alpha_rad", lap, "0.0887386943436"),
        ("beta_rad", lap, "0.124354994547"),
        ("epsilon", lap, "0.0471341483901"),
        ("stable_psi_tilde_rad", lap, "-0.478863232355"),
        ("unstable_psi_tilde_rad", lap, "0.301385843667"),
        ("eigenvalue_real_1_s", lap, "-0.167160849869"),
        ("law_torque_Nm", lap, "1.22530952523"),
        ("law_mean_power_W", lap, "12.4027335158"),
        ("least_mean_power_W", lap, "12.3827824586"),
        ("optimal_switch_radius_m", lap, "0.532954910017"),
        ("law_work_J", lap, "201.389773055"),
        ("least_work_J", lap, "200.32711903371"),
        ("law_work_J", long, "378.753508466"),
        ("least_work_J", long, "377.321044772"),
    ):
        assert float(one[name]) == printed(value), name
    small = data.sel({"horizon": "laps=1", "motion.radius": 0.3})
    assert str(small["law_regime"].values) == str(small["least_mean_power_regime"].values) == "rotational"
    assert float(small["least_mean_power_W"]) == printed("2.5640777")


@pytest.mark.parametrize("radius", [0.1, 0.5, 0.64])
def test_mean_power_of_a_rotating_law_is_that_of_its_simulation(write: Write, tmp_path: Path, radius: float) -> None:
    path = write(atlas_text(f'"motion.radius" = [{radius}, 0.7]\n'))
    data = made(path, tmp_path / "out").sel({"motion.radius": radius})
    task = load_experiment(path).cases[0].task()
    period = float(data["period_s"])
    first = math.ceil(8.0 / 0.17 / period) * period
    # The mean over one period, after the transient, by the trapezoidal rule: exact for periodic functions.
    t = np.concatenate([[0.0], np.linspace(first, first + period, 4001)])
    c = yaw_coefficients(task.platform, task.point)
    angle, yaw_rate = reduced_motion(c, radius, -0.4, (-1.0, 0.1), t)
    power = energy_of(task.platform, task.point, task.motion).dissipation(angle[1:], yaw_rate[1:])
    assert float(data["law_mean_power_W"]) == pytest.approx(float(power[:-1].mean()), rel=1e-8)
    assert angle[-1] - angle[1] == pytest.approx(2 * math.pi, rel=1e-7)
    mean = (angle[-1] - angle[1]) / period - 0.4
    assert float(data["mean_yaw_rate_rad_s"]) == pytest.approx(mean, rel=1e-6)


def test_each_point_is_that_of_its_own_case(write: Write, tmp_path: Path) -> None:
    """Platform, point, motion and start from the sweep reach the right point of the arrays."""
    sweep = (
        '"platform.wheel_friction" = [0.05, 0.11]\n"motion.radius" = { from = 0.3, to = 0.7, count = 3 }\n'
        '"platform.mass_center" = [[0.0, 0.01], [0.016, -0.026]]\n"start.heading" = [0, 1.0]\n'
        '"motion.rate" = [-0.4, 1]\n'
    )
    path = write(atlas_text(sweep, "least_work"))
    grid = load_grid(path)
    cases = load_experiment(path).cases
    assert grid.size == len(cases) == 48
    for number in (0, 5, 17, 30, 47):
        task = cases[number].task()
        one = grid.points(number, number + 1)
        np.testing.assert_array_equal(one.parameters[0], task.platform.parameters())
        assert (one.radius[0], one.rate[0]) == (task.motion.radius, task.motion.rate)
        assert tuple(one.point[:, 0]) == task.point
        assert one.heading[0] == task.start.heading
        assert one.duration[0] == task.duration
        columns, reasons = atlas_run.least_work_columns(one)
        assert reasons == []
        assert columns["least_work_J"][0] == pytest.approx(minimum_work(task).work, rel=1e-12)


def test_regimes_are_what_they_say(write: Write, tmp_path: Path) -> None:
    data = made(write(atlas_text(SWEEP)), tmp_path / "out")
    ratio = data["radius_ratio"].values
    assert np.all((data["regime"].values == "steady") == (ratio > 1))
    steady = data["law_regime"].values == "steady"
    assert np.all(data["eigenvalue_real_1_s"].values[steady] < 0)
    assert np.all(np.isnan(data["period_s"].values) == (ratio > 1))
    # No rotation strategy, the law's own in particular, is below the least mean power.
    assert np.all(data["long_run_gap_percent"].values > -1e-9)


@pytest.mark.parametrize("rate", [-0.4, 0.4])
def test_the_critical_radius_is_that_of_occ_circle(write: Write, rate: float) -> None:
    """Up to rounding, from both sides, with the power of its one steady rotation."""
    path = write(atlas_text(f'"motion.rate" = [{rate}]\n"motion.radius" = [0.6, 0.7]\n'))
    one = load_grid(path).points(0, 1)
    critical = float(circle_quantities(one.coefficients, one.radius, one.rate).critical_radius[0])
    radii = [critical * (1 + offset) for offset in (-1e-8, -5e-10, 0.0, 5e-10, 1e-8)]
    path = write(atlas_text(f'"motion.rate" = [{rate}]\n"motion.radius" = {radii}\n'))
    columns, reasons = long_run_columns(load_grid(path).points(0, 5))
    assert reasons == []
    said = [circle_setting(case.task()).regime for case in load_experiment(path).cases]
    assert said == ["rotational", "critical", "critical", "critical", "steady"]
    assert [REGIMES[i] for i in columns["regime"]] == said
    assert [REGIMES[i] for i in columns["law_regime"]] == said
    np.testing.assert_allclose(columns["stable_psi_tilde_rad"][1:4], columns["stable_psi_tilde_rad"][2], atol=1e-14)
    np.testing.assert_allclose(columns["law_mean_power_W"][1:4], columns["law_mean_power_W"][2], rtol=1e-8)
    assert columns["law_mean_power_W"][4] == pytest.approx(columns["law_mean_power_W"][2], rel=1e-3)


def test_file_has_units_provenance_and_the_same_values(write: Write, tmp_path: Path) -> None:
    path = write(atlas_text(SWEEP))
    back, grid = made(path, tmp_path / "out"), load_grid(path)
    columns = make_atlas(path, grid, tmp_path / "out", HERE).columns
    assert set(columns) == set(back.data_vars)
    for name, values in columns.items():
        texts = np.array(REGIMES)[values] if values.dtype == np.int8 else values
        np.testing.assert_array_equal(back[name].values.ravel(), texts)
    for key, values in grid.values.items():
        np.testing.assert_array_equal(back[key].values, values)
    assert tuple(back.dims) == ("motion.radius", "motion.rate")
    for variable in back.variables.values():
        assert variable.attrs["units"]
        assert variable.attrs["long_name"]
    assert json.loads(back.attrs["experiment"])["motion"]["kind"] == "circle"
    assert {"code", "versions", "depth", "title"} <= set(back.attrs)
    content = (tmp_path / "out" / "atlas.nc").read_bytes()
    made(write(atlas_text(SWEEP)), tmp_path / "again")
    assert (tmp_path / "again" / "atlas.nc").read_bytes() == content


def test_stored_points_are_not_worked_out_again(write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atlas_run, "SIZES", {"long_run": 3, "least_work": 3})
    solved: list[Any] = []
    original = atlas_run.solve

    def counted(item: Any, tell: Any) -> bytes:
        solved.append(item)
        if len(solved) == 3:
            raise KeyboardInterrupt
        return original(item, tell)

    monkeypatch.setattr(atlas_run, "solve", counted)
    path = write(atlas_text(SWEEP))
    with pytest.raises(KeyboardInterrupt):
        made(path, tmp_path / "out")
    data = made(path, tmp_path / "out")
    assert len(solved) == 1 + math.ceil(load_grid(path).size / 3)
    # In one go: the same to the last bit; in blocks of another size rounding may differ.
    monkeypatch.setattr(atlas_run, "solve", original)
    assert data.identical(made(path, tmp_path / "other"))
    monkeypatch.undo()
    xr.testing.assert_allclose(data, made(path, tmp_path / "whole"), rtol=1e-11)


def test_lost_blocks_are_missing_values_with_reasons_and_are_tried_again(write: Write, tmp_path: Path) -> None:
    class Losing(Engine):
        def each(self, function: Any, items: Any, heard: Any = None) -> Any:
            for number, _ in enumerate(items):
                yield number, Lost("ended by a test")

    path = write(atlas_text('"motion.radius" = [0.6, 0.7]\n', "least_work"))
    grid = load_grid(path)
    found = make_atlas(path, grid, tmp_path / "out", Losing(in_process=True))
    assert np.all(np.isnan(found.columns["long_run_gap_percent"]))
    assert [(item.point, item.message) for item in found.failures] == [(0, "ended by a test"), (1, "ended by a test")]
    again = make_atlas(path, grid, tmp_path / "out", HERE)
    assert again.failures == []
    assert np.all(np.isfinite(again.columns["work_gap_percent"]))


def test_command(write: Write, occ: Occ, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = occ("atlas", write(atlas_text(SWEEP)), "--out", out)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    assert "% of points" in result.stdout
    assert (out / "atlas.nc").is_file()
    text = (out / "report.md").read_text()
    assert "figures/long-run.svg" in text
    assert (out / "figures" / "long-run.svg").stat().st_size > 5000
    assert not (out / "failures.csv").exists()
    for command in (("atlas", tmp_path / "tiny.toml", "--out", out), ("report", out)):
        (out / "report.md").unlink()
        again = occ(*command)
        assert (again.exit_code, again.stdout) == (0, result.stdout)
        assert (out / "report.md").read_text() == text


def test_failures_are_read_as_they_were_written(write: Write, tmp_path: Path) -> None:
    grid = load_grid(write(atlas_text('"motion.radius" = [0.6, 0.7]\n')))
    failures = [Failure(0, "", "failed", 'a "reason", in words'), Failure(1, "law", "infeasible", "3 N m; limit 2 N m")]
    rows = write_failures(grid, Found(Columns(grid.size), {}, failures), tmp_path)
    assert read_failures(tmp_path) == rows
    assert rows[1] == ("motion.radius=0.7", "law", "infeasible", "3 N m; limit 2 N m")
    assert write_failures(grid, Found(Columns(grid.size), {}, []), tmp_path) == read_failures(tmp_path) == []
    (tmp_path / "failures.csv").write_text("point,reason\n0,none\n")
    with pytest.raises(InputError, match="not a table of failures; its columns should be point, controller"):
        read_failures(tmp_path)


@pytest.mark.parametrize(
    ("sweep", "words"),
    [
        ("", "nothing is swept"),
        ('"motion.radius" = [0.6, -0.7]\n', "motion.radius"),
        (
            '"point.x" = { from = 0.1, to = 1.0, count = 9999 }\n"point.y" = { from = 1.0, to = 2.0, count = 9999 }\n',
            "too many cases",
        ),
        ('horizon = [{ laps = 1 }]\n"motion.rate" = [0.1, 0.2]\n', "cannot be swept at once"),
        ('platform = [{ preset = "youbot" }, { preset = "omni3" }]\n', "platforms with 3 and 4 wheels"),
        ('"platform.wheel_radius" = [0.05, 0.0]\n', "should be greater than 0"),
        ('"limits.torque" = [-2.0]\n', "should be greater than 0"),
        ('"platform.friction_scale" = [nan]\n', "not finite"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    write: Write, occ: Occ, tmp_path: Path, sweep: str, words: str
) -> None:
    result = occ("atlas", write(atlas_text(sweep)), "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert words in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_comparison_loses_only_the_controllers_that_are_lost_alone(write: Write, tmp_path: Path) -> None:
    class Losing(Engine):
        def each(self, function: Any, items: Any, heard: Any = None) -> Any:
            items = list(items)
            for number, outcome in super().each(function, items):
                gone = isinstance(items[number], Comparison) or getattr(items[number], "controller", "") == "servo law"
                yield number, Lost("ended by a test") if gone else outcome

    path = write(atlas_text('"motion.radius" = [0.6, 0.7]\n', "comparison"))
    grid = load_grid(path)
    found = make_atlas(path, grid, tmp_path / "out", Losing(in_process=True))
    assert [(item.point, item.controller, item.message) for item in found.failures] == [
        (point, "servo law", "ended by a test") for point in range(2)
    ]
    again = make_atlas(path, grid, tmp_path / "out", HERE)
    assert again.failures == []
    law = load_experiment(path).cases[0].controllers.index("servo law")
    for name, values in again.rows.items():
        np.testing.assert_array_equal(np.delete(found.rows[name], law, 1), np.delete(values, law, 1), name)


def test_other_motions_are_refused(write: Write, tmp_path: Path) -> None:
    text = atlas_text('"point.x" = [0.3, 0.4]\n').replace(
        'kind = "circle"\nradius = 0.70', 'kind = "ellipse"\nsemi_axes = [0.7, 0.5]'
    )
    with pytest.raises(InputError, match='should be "circle", not "ellipse"'):
        load_grid(write(text))


def test_unwritable_folder_is_one_line(write: Write, occ: Occ, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    result = occ("atlas", write(atlas_text(SWEEP)), "--out", tmp_path / "taken")
    assert (result.exit_code, len(result.stderr.splitlines())) == (2, 1)
    assert "cannot be written" in result.stderr


def test_comparison(write: Write, tmp_path: Path) -> None:
    """Rows of the referee with gaps of their class, and no gap where a limit is broken."""
    path = write(atlas_text('"motion.radius" = [0.7, 1.4]\n', "comparison") + "\n[limits]\ntorque = 1.4\n")
    grid = load_grid(path)
    found = make_atlas(path, grid, tmp_path / "out", HERE)
    write_atlas(grid, found, tmp_path / "out")
    data = read_atlas(tmp_path / "out")
    law = data.sel(controller="servo law")
    assert list(law["status"].values) == ["ok", "infeasible"]
    assert float(law["work_gap_percent"][0]) > 0
    assert np.isnan(law["work_gap_percent"][1])
    assert data["work_J"].attrs["units"] == "J"
    ((point, status, reason),) = [
        (item.point, item.status, item.message) for item in found.failures if item.controller == "servo law"
    ]
    assert (point, status) == (1, "infeasible")
    assert "limit 1.4 N m" in reason
    task = load_experiment(path).cases[0].task()
    assert float(law["work_bound"][0]) == pytest.approx(minimum_work(task).work, rel=1e-9)


def test_items_are_plain_data(write: Write, tmp_path: Path) -> None:
    import pickle

    path = write(atlas_text(SWEEP))
    grid: Grid = load_grid(path)
    block = Block(grid.points(0, 4), False)
    case = Comparison(load_experiment(path).cases[0], ("work",))
    assert pickle.loads(pickle.dumps(block)).points.digest == block.points.digest
    assert pickle.loads(pickle.dumps(case)).case.key == case.case.key


@pytest.mark.slow
def test_with_weak_friction_the_start_decides_what_becomes_of_the_law(write: Write, tmp_path: Path) -> None:
    """Beside a stable steady rotation there is a rotational motion that attracts most starts."""
    sweep = '"platform.friction_scale" = [0.02, 1.0]\n"start.heading_rate" = [0.0, -0.5]\n'
    path = write(atlas_text(sweep).replace("radius = 0.70", "radius = 0.37813217815670785"))
    data = made(path, tmp_path / "out").sel({"platform.friction_scale": 0.02})
    assert list(data["law_regime"].values) == ["rotational", "steady"]
    assert list(data["regime"].values) == ["steady", "steady"]
    rotating = data.isel({"start.heading_rate": 0})
    task = load_experiment(path).cases[0].task()
    c = yaw_coefficients(task.platform, task.point)
    period = float(rotating["period_s"])
    t = np.concatenate([[0.0], np.linspace(40 * period, 41 * period, 4001)])
    angle, yaw_rate = reduced_motion(c, task.motion.radius, -0.4, (-math.pi / 2, 0.0), t)
    power = energy_of(task.platform, task.point, task.motion).dissipation(angle[1:], yaw_rate[1:])
    assert float(rotating["law_mean_power_W"]) == pytest.approx(float(power[:-1].mean()), rel=1e-7)


def test_a_motion_that_stops_the_integrator_stands_alone(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    """The others are what they are without it, and nobody says that it is steady."""
    text = atlas_text('"motion.radius" = [0.38, 0.42]\n"start.heading_rate" = [0.0, -0.5]\n')
    text = text.replace('preset = "youbot"', 'preset = "youbot"\nfriction_scale = 0.02')
    points = load_grid(write(text)).points(0, 4)
    stuck = np.flatnonzero(points.radius == 0.42)
    others = np.delete(np.arange(len(points)), stuck)
    columns, reasons = long_run_columns(points)
    law, more = law_work(points.coefficients, points)
    assert reasons == more == []
    assert {REGIMES[i] for i in columns["law_regime"]} == {"steady", "rotational"}

    def stopping(c: Any, radius: Any, rate: Any, psi_tilde: np.ndarray, yaw_rate: np.ndarray) -> np.ndarray:
        away = np.abs(psi_tilde - points.psi_tilde[0]) > 0.1
        return np.where((radius == 0.42) & away, np.nan, yaw_acceleration(c, radius, rate, psi_tilde, yaw_rate))

    monkeypatch.setattr(motion, "yaw_acceleration", stopping)
    found, reasons = long_run_columns(points)
    work, more = law_work(points.coefficients, points)
    assert [i for i, _ in reasons] == [i for i, _ in more] == list(stuck)
    for _, reason in (*reasons, *more):
        assert "cannot be followed for" in reason
        assert "no step of the integrator is short enough" in reason
        assert "physical range" not in reason
    assert {REGIMES[i] for i in found["law_regime"][stuck]} == {""}
    assert np.all(np.isnan(found["law_mean_power_W"][stuck]))
    assert np.all(np.isnan(work[stuck]))
    np.testing.assert_array_equal(found["law_regime"][others], columns["law_regime"][others])
    np.testing.assert_allclose(found["law_mean_power_W"][others], columns["law_mean_power_W"][others], rtol=1e-12)
    np.testing.assert_allclose(work[others], law[others], rtol=1e-9)


def test_a_motion_that_leaves_says_so_and_stops_no_other(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    points = load_grid(write(atlas_text('"motion.radius" = [0.4, 0.41, 0.42]\n', "least_work"))).points(0, 3)
    law, none = law_work(points.coefficients, points)

    def pushed(c: Any, radius: Any, rate: Any, psi_tilde: np.ndarray, yaw_rate: np.ndarray) -> np.ndarray:
        return yaw_acceleration(c, radius, rate, psi_tilde, yaw_rate) + np.where(radius == 0.41, 1e7, 0.0)

    monkeypatch.setattr(motion, "yaw_acceleration", pushed)
    work, reasons = law_work(points.coefficients, points)
    assert none == []
    assert reasons == [(1, "the law's yaw rate leaves every physical range: it passes 10000 rad/s")]
    np.testing.assert_allclose(work[[0, 2]], law[[0, 2]], rtol=1e-9)
