"""A bound holds for the rows whose class lies inside its own, and for no other."""

from __future__ import annotations

from typing import Any

import pytest

from occ.errors import BoundViolation
from occ.experiment.bounds import Bound, MotionClass, bound_columns, local_bounds


def row(value: float, end: str = "free", local: str | None = None, **other: Any) -> dict[str, Any]:
    standard = {"case": "base", "controller": "c", "status": "ok", "keep": "path", "start": "given"}
    return standard | {"end": end, "local_objective": local, "work_J": value, "torque_squared_N2m2s": value} | other


def bounds_of(rows: list[dict[str, Any]], name: str = "work") -> list[tuple[Any, str, Any]]:
    found = local_bounds(rows, name)
    columns = [bound_columns(item, name, found) for item in rows]
    return [(item[f"{name}_bound"], item[f"{name}_bound_kind"], item[f"{name}_gap_percent"]) for item in columns]


def test_gap_is_relative_to_the_smallest_local_optimum() -> None:
    rows = [row(110.0), row(100.0, local="work"), row(104.0, local="work")]
    assert bounds_of(rows) == [(100.0, "local", 10.0), (100.0, "local", 0.0), (100.0, "local", 4.0)]


def test_free_end_bounds_law_end_but_not_the_other_way_round() -> None:
    free, law = row(100.0, local="work"), row(120.0, end="law", local="work")
    assert bounds_of([free, law]) == [(100.0, "local", 0.0), (120.0, "local", 0.0)]
    assert bounds_of([row(130.0), law])[0] == (None, "none", None)
    assert bounds_of([free, row(130.0, end="law")])[1] == (100.0, "local", 30.0)


def test_tightest_bound_is_the_largest_that_holds() -> None:
    # The free optimum is a poor one here; for the law end the larger of both bounds counts.
    rows = [row(125.0, local="work"), row(120.0, end="law", local="work"), row(130.0, end="law")]
    assert bounds_of(rows)[2][0] == 125.0


def test_negative_gap_shows_a_local_optimum_that_is_not_global() -> None:
    assert bounds_of([row(90.0), row(100.0, local="work")])[0] == (100.0, "local", -10.0)


@pytest.mark.parametrize("other", [{"start": "own"}, {"keep": "tube"}, {"start": "free"}])
def test_another_keep_or_start_is_not_covered(other: dict[str, str]) -> None:
    assert bounds_of([row(90.0, **other), row(100.0, local="work")])[0] == (None, "none", None)


def test_own_start_bounds_nothing_and_is_bounded_by_nothing() -> None:
    rows = [row(90.0, start="own"), row(80.0, start="own", local="work")]
    assert bounds_of(rows) == [(None, "none", None)] * 2


def test_row_that_is_not_ok_has_no_gap_and_makes_no_bound() -> None:
    rows = [row(90.0, status="infeasible"), row(100.0, local="work", status="failed"), row(120.0)]
    assert bounds_of(rows) == [(None, "none", None)] * 3


def test_local_optimum_of_another_objective_is_no_bound() -> None:
    rows = [row(90.0), row(100.0, local="torque_squared")]
    assert bounds_of(rows) == [(None, "none", None)] * 2
    assert bounds_of(rows, "torque_squared")[0] == (100.0, "local", -10.0)


def test_zero_bound_has_no_relative_gap() -> None:
    assert bounds_of([row(1.0), row(0.0, local="work")])[0] == (0.0, "local", None)


def test_feasible_row_below_a_certified_bound_is_an_error() -> None:
    certified = Bound(100.0, "certified", MotionClass("path", "given", "free"))
    with pytest.raises(BoundViolation, match=r"case base, controller c: work 99\.9 J .* 100\.0 J"):
        bound_columns(row(99.9), "work", [certified])
    assert bound_columns(row(100.0 - 1e-9), "work", [certified])["work_gap_percent"] == pytest.approx(0, abs=1e-8)
    # Neither an infeasible row nor one of another class contradicts the proof.
    for harmless in (row(99.9, status="infeasible"), row(99.9, start="own"), row(99.9, keep="tube")):
        assert bound_columns(harmless, "work", [certified])["work_bound_kind"] == "none"


def test_a_difference_of_large_works_is_as_uncertain_as_they_are() -> None:
    # Without friction a periodic motion takes no work; what is left of 5 J to and fro is rounding.
    exact = Bound(0.0, "exact", MotionClass("path", "given", "free"))
    flowing = row(-1.8e-12) | {"absolute_work_J": 5.0}
    assert bound_columns(flowing, "work", [exact])["work_bound_kind"] == "exact"
    with pytest.raises(BoundViolation):
        bound_columns(flowing | {"work_J": -1e-7}, "work", [exact])
    with pytest.raises(BoundViolation):
        bound_columns(row(-1.8e-12), "work", [exact])


def test_certified_bound_is_checked_also_where_a_local_one_is_tighter() -> None:
    motions = MotionClass("path", "given", "free")
    with pytest.raises(BoundViolation):
        bound_columns(row(99.0), "work", [Bound(100.0, "certified", motions), Bound(101.0, "local", motions)])


def test_proven_bounds_stand_before_local_ones_and_the_strongest_word_counts() -> None:
    motions = MotionClass("path", "given", "free")
    exact, certified = Bound(100.0, "exact", motions), Bound(100.0 - 1e-5, "certified", motions, 1e-5)
    local = Bound(100.5, "local", motions)
    columns = bound_columns(row(101.0), "work", [exact, local])
    assert (columns["work_bound"], columns["work_bound_kind"]) == (100.0, "exact")
    assert bound_columns(row(101.0), "work", [exact, certified, local])["work_bound_kind"] == "certified"
    # A certificate that leaves more than a millionth open is weaker than the formula.
    loose = Bound(99.9, "certified", motions)
    assert bound_columns(row(101.0), "work", [exact, loose])["work_bound_kind"] == "exact"


def test_exact_bound_is_not_to_be_passed_either_but_for_what_the_referee_lets_pass() -> None:
    motions = MotionClass("path", "given", "law")
    with pytest.raises(BoundViolation, match="exact bound"):
        bound_columns(row(99.9, end="law"), "work", [Bound(100.0, "exact", motions)])
    columns = bound_columns(row(99.9, end="law"), "work", [Bound(100.0, "exact", motions, 0.2)])
    assert columns["work_gap_percent"] == pytest.approx(-0.1)
    assert columns["work_gap_uncertainty_percent"] == pytest.approx(0.2, rel=1e-6)


def test_a_tube_contains_narrower_ones_and_the_path_and_ends_contain_the_path() -> None:
    def motions(keep: str, radius: float = 0.0, end: str = "free") -> MotionClass:
        return MotionClass(keep, "given", end, radius)

    path, narrow, wide, ends = motions("path"), motions("tube", 0.01), motions("tube", 0.1), motions("ends")
    order = [path, narrow, wide, ends]
    contained = [[one.contains(other) for other in order] for one in order]
    assert contained == [
        [True, False, False, False],
        [True, True, False, False],
        [True, True, True, False],
        [True, False, False, True],
    ]
    assert not motions("tube", 0.1, "rest").contains(narrow)


def test_a_tube_is_measured_against_the_optimum_of_its_own_radius() -> None:
    tube = {"keep": "tube", "tube_radius_m": 0.01}
    rows = [
        row(95.0, **tube),
        row(90.0, local="work", **tube),
        row(80.0, local="work", **tube | {"tube_radius_m": 0.1}),
    ]
    assert bounds_of(rows)[0][:2] == (90.0, "local")
