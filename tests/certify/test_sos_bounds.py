"""Certified bounds in a comparison: which rows they hold for, what a gap means, and a row below a bound."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import occ
from occ.certify import Ends, squares
from occ.certify.sos import Degree
from occ.cli import app
from occ.errors import BoundViolation
from occ.experiment import proven
from occ.experiment.bounds import Bound, bound_columns
from occ.experiment.case import Case
from occ.experiment.load import load_experiment
from occ.experiment.proven import proven_bounds, with_bounds
from occ.objectives import COPPER_LOSS, OBJECTIVES
from occ.report.circle import circle_lines
from occ.theory.extremals import NoExtremal

SECTION5 = Path(occ.__file__).parents[1] / "experiments" / "section5.toml"
LEAST = 29.17156773
"""[N^2 m^2 s]"""


def case_of(*settings: str) -> Case:
    return load_experiment(SECTION5, ("sweep.horizon=[{laps = 1}]", *settings), False).cases[0]


def row(value: float, name: str = "torque_squared", local: str | None = None, **other: Any) -> dict[str, Any]:
    standard = {"case": "base", "controller": "c", "status": "ok", "keep": "path", "start": "given", "end": "free"}
    values = dict.fromkeys((item.column for item in OBJECTIVES.values()), value)
    return standard | values | {"local_objective": local, OBJECTIVES[name].column: value} | other


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """0.086 per cent below the optimum is enough here."""
    monkeypatch.setattr(squares, "DEGREES", (Degree(2, 2), Degree(4, 2)))
    proven._squares.cache_clear()
    yield
    proven._squares.cache_clear()


@pytest.fixture(scope="module")
def rows() -> list[dict[str, Any]]:
    optimum = row(LEAST + 1e-8, local="torque_squared")
    return [row(31.248), optimum, row(30.0, start="own"), row(29.5, keep="tube", tube_radius_m=0.1)]


def test_rows_of_the_class_have_a_certified_gap_with_its_uncertainty(rows: list[dict[str, Any]]) -> None:
    bounds = proven_bounds(case_of(), rows, "torque_squared", certify=True).bounds
    law, optimum, own, tube = (bound_columns(item, "torque_squared", bounds) for item in rows)
    assert LEAST * (1 - 1e-3) < law["torque_squared_bound"] <= LEAST
    assert law["torque_squared_bound_kind"] == "certified"
    # The law's gap is 7.118 per cent; the bound is as loose as the optimum's own gap says, which is not resolved.
    loose = optimum["torque_squared_gap_percent"]
    assert 0 < loose < 0.1
    assert law["torque_squared_gap_percent"] - loose == pytest.approx(7.118, abs=0.01)
    for columns in (law, optimum):
        assert columns["torque_squared_gap_uncertainty_percent"] == pytest.approx(loose, rel=1e-3)
    assert [item["torque_squared_bound_kind"] for item in (own, tube)] == ["none", "none"]


def test_row_below_a_certified_bound_stops_the_run(rows: list[dict[str, Any]]) -> None:
    case = case_of()
    bounds = proven_bounds(case, rows, "copper_loss", certify=True).bounds
    impossible = row(COPPER_LOSS * 29.0, "copper_loss")
    with pytest.raises(
        BoundViolation, match=r"copper_loss 36\.4\d* J is below the certified bound 36\.6\d* J"
    ) as error:
        bound_columns(impossible, "copper_loss", bounds)
    assert "one of the two is wrong" in str(error.value)
    # Limits can only raise the least value: a row under limits is no excuse.
    limited = proven_bounds(case_of("limits.torque=1.2"), rows, "copper_loss", certify=True).bounds
    assert [bound.value for bound in limited] == [bound.value for bound in bounds]


def test_what_is_not_covered_has_no_bound(rows: list[dict[str, Any]]) -> None:
    def found(case: Case, some: list[dict[str, Any]], name: str, certify: bool = True) -> list[Bound]:
        return proven_bounds(case, some, name, certify=certify).bounds

    assert not found(case_of(), rows, "torque_squared", certify=False)
    assert not found(case_of(), rows[2:], "torque_squared")
    assert not found(case_of(), rows, "peak_torque")
    assert not found(case_of("plant.platform.wheel_friction=0.2"), rows, "torque_squared")
    straight = load_experiment(SECTION5.with_name("ellipse.toml"), (), False).cases[0]
    assert not found(straight, rows, "torque_squared")


@pytest.mark.parametrize("name", ["work", "bus_work"])
def test_a_row_says_why_a_bound_that_was_looked_for_is_missing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise NoExtremal("least work: no extremal was found")

    monkeypatch.setattr(Ends, "least", fails)
    monkeypatch.setattr(squares, "DEGREES", ())
    failed = row(202.0, status="failed", message="gave up")
    some = [row(202.0, message=""), row(203.0, message="12 starts"), failed, row(201.0, start="own", message="")]
    found = with_bounds(case_of(), some, (name,), certify=name != "work")
    reason = "least work: no extremal was found" if name == "work" else "nothing was tried"
    words = f"no proven bound of {name}: {reason}"
    assert [item["message"] for item in found] == [words, f"12 starts; {words}", "gave up", ""]
    assert [item[f"{name}_bound_kind"] for item in found] == ["none"] * 4
    monkeypatch.undo()
    assert [item["message"] for item in with_bounds(case_of(), some[:2], ("work",))] == ["", "12 starts"]


@pytest.mark.slow
def test_certified_work_to_a_given_end() -> None:
    ends = [row(210.0, "work", end="law"), row(201.0, "work")]
    bounds = proven_bounds(case_of(), ends[:1], "work", certify=True).bounds
    law = [bound for bound in bounds if bound.motions.end == "law"]
    assert [bound.kind for bound in law] == ["exact", "certified"]
    exact, certified = law
    assert exact.value * (1 - 1e-4) < certified.value <= exact.value
    # What the referee lets pass at the end is not held against a row; how loose the bound is, is.
    assert certified.uncertainty == exact.uncertainty
    assert certified.open == pytest.approx(exact.value - certified.value)


def test_net_work_bounds_what_is_not_given_back() -> None:
    bounds = proven_bounds(case_of(), [row(202.0)], "positive_work", certify=True).bounds
    assert [bound.kind for bound in bounds] == ["certified"]
    assert 200.3 < bounds[0].value < 200.3271190338


def test_circle_command_proves_the_long_run() -> None:
    result = CliRunner().invoke(app, ["circle", str(SECTION5), "--certify", "--json"])
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    bounds = summary["long_run_bounds"]
    assert {cost: item["unit"] for cost, item in bounds.items()} == {
        "work": "W",
        "torque_squared": "N^2 m^2",
        "electric": "W",
    }
    for item in bounds.values():
        assert item["word"] == "certified"
        assert item["upper"] * (1 - 1e-6) <= item["lower"] <= item["upper"]
    # In one angle the proof is as good as the arithmetic.
    assert summary["least_mean_power_W"] * (1 - 1e-10) <= bounds["work"]["lower"] <= summary["least_mean_power_W"]
    line = next(line for line in circle_lines(case_of().task(), summary) if "least mean torque squared" in line)
    assert "N² m² (certified" in line
