"""Certified bounds of the work: enclosures that hold, brackets that close, and mutations that the checker refuses."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cache

import flint
import numpy as np
import pytest
from flint import arb
from hypothesis import given, settings

from occ.certify import Certificate, Ends, certify_work, check
from occ.certify.balls import Polynomial, Refused, enclose
from occ.certify.lengths import Lengths
from occ.certify.long_run import check_mean_power, least_mean_power
from occ.certify.proofs import CurveProof, Level, leaves
from occ.laws import ServoLaw
from occ.model.platform import Platform
from occ.motion import Circle
from occ.referee import judge
from occ.referee.reference import servo_end_state
from occ.task import Task
from occ.theory.coefficients import yaw_coefficients
from occ.theory.dissipation import circle_of, energy_of
from occ.theory.long_run import long_run, switch_radius
from occ.theory.minimum_work import minimum_work
from occ.theory.quadrature import FINE, Well
from occ.theory.trigonometric import value
from tests.strategies import circles, platforms, points
from tests.tasks import LAP, paper_task
from tests.theory.test_minimum_work import random_task


@settings(max_examples=8)
@given(platforms(), points(), circles())
def test_balls_hold_what_casadi_computes(platform: Platform, point: tuple[float, float], circle: Circle) -> None:
    # Another derivation, from the contact condition by hand: the two agree to the rounding of doubles.
    task = Task(platform=platform, point=point, motion=circle, duration=1.0)
    enclosed, energy = enclose(task), energy_of(platform, point, circle)
    size = 1e-9 * (1 + float(np.abs(energy.power).sum()))
    assert float(enclosed.friction) == pytest.approx(float(energy.friction), rel=1e-9, abs=1e-12)
    for x in (-2.0, 0.3, 1.7):
        assert float(enclosed.power(arb(x))) == pytest.approx(float(value(energy.power, x)), abs=size)
        assert float(enclosed.rest(arb(x))) == pytest.approx(float(value(energy.rest_of_yaw, x)), rel=1e-8, abs=1e-8)
        difference = float(enclosed.swing(arb(x)) - enclosed.swing(arb(0)))
        angle_part = 2 * float(energy.friction * energy.rate) * x
        wanted = float(energy.of_end_points(x) - energy.of_end_points(0.0)) - angle_part
        assert difference == pytest.approx(wanted, abs=size)


def test_enclosures_of_polynomials_hold_all_values() -> None:
    random = np.random.default_rng(5)
    for _ in range(20):
        coefficients = random.normal(size=5)
        p = Polynomial(*(arb(float(c)) for c in coefficients))
        x, e = random.uniform(-3, 3), random.uniform(-1.5, 1.5)
        width = random.uniform(0, 0.3)
        box, shift = arb(x, width), arb(e, width)
        rest = p.remainder_on(box, shift)
        for share in random.uniform(-1, 1, size=(10, 2)):
            y, d = x + share[0] * width, e + share[1] * width
            assert p.on(box).overlaps(arb(float(value(coefficients, y))))
            slope = p.derivative()(arb(y))
            exact = 2 * (p(arb(y + d)) - p(arb(y)) - slope * d) / arb(d) ** 2
            assert rest.overlaps(exact)


@pytest.mark.parametrize("seed", [3, 9])
def test_lengths_are_below_the_integral_and_close_to_it(seed: int) -> None:
    # Against the quadrature of the theory, which maps the ends away instead of halving cells.
    task = random_task(seed)
    energy = energy_of(task.platform, task.point, circle_of(task))
    well = Well(float(energy.friction), energy.power)
    random = np.random.default_rng(seed)
    with flint.ctx.workprec(96):
        lengths = Lengths(enclose(task), 60)
        for rise in (0.0, 1e-6, 0.01, 1.0):
            h = rise * float(np.abs(energy.power).sum()) - lengths.lowest
            first, last = np.floor(random.uniform(-90, 90, 2) * 64) / 64
            ends = [np.array([float(lengths.place(float(p)))]) for p in (first, last)]
            levels = tuple(value(energy.power, x) + h for x in ends)
            exact = float(well.integrals((ends[0], ends[1]), np.array([h]), levels, FINE)[1][0])
            found = lengths.way(h, float(first), float(last))
            assert exact * (1 - 3e-6) <= found <= exact * (1 + 1e-14)


def test_lowest_power_is_enclosed_from_below_to_rounding() -> None:
    task = paper_task()
    with flint.ctx.workprec(96):
        lengths = Lengths(enclose(task), 60)
        energy = energy_of(task.platform, task.point, circle_of(task))
        bottom = Well(float(energy.friction), energy.power).bottom
        assert bottom - 1e-12 < lengths.lowest <= bottom + 1e-14
        clear = lengths.clear(0.0, 1, -bottom - 0.5)
        assert clear is not None
        # U = min U + 0.5 W at the place where it stops to be above it.
        assert float(lengths.task.power(lengths.place(clear))) == pytest.approx(bottom + 0.5, abs=1e-5)


def leaves_of(certificate: Certificate) -> list[Level | CurveProof]:
    assert certificate.proof is not None
    return leaves(certificate.proof)


@cache
def lap() -> tuple[Task, Certificate]:
    task = paper_task()
    return task, certify_work(task, construction="levels")


def test_bracket_of_one_lap_closes() -> None:
    task, certificate = lap()
    assert certificate.word == "certified"
    assert all(isinstance(leaf, Level) for leaf in leaves_of(certificate))
    assert 200.327119033710 * (1 - 1e-6) < certificate.lower <= 200.327119033711
    law = judge(task, ServoLaw().solve(task)).measures["work_J"]
    assert 100 * (law / certificate.lower - 1) == pytest.approx(0.5305, abs=1e-4)


@cache
def along_curve() -> tuple[Task, Certificate]:
    task = paper_task()
    return task, certify_work(task, construction="curve")


def test_bracket_of_one_lap_closes_along_a_curve() -> None:
    _, certificate = along_curve()
    assert certificate.word == "certified"
    assert sum(isinstance(leaf, CurveProof) for leaf in leaves_of(certificate)) == 1
    assert 200.327119033710 * (1 - 1e-6) < certificate.lower <= 200.327119033711


def test_the_closer_proof_is_tried_first() -> None:
    certificate = certify_work(paper_task(30.0))
    assert sum(isinstance(leaf, CurveProof) for leaf in leaves_of(certificate)) == 1
    assert 377.321044772185 * (1 - 1e-7) < certificate.lower <= 377.321044772186


@pytest.mark.slow
@pytest.mark.parametrize("construction", ["levels", "curve"])
def test_bracket_of_thirty_seconds_closes(construction: str) -> None:
    certificate = certify_work(paper_task(30.0), construction=construction)
    assert 377.321044772185 * (1 - 1e-6) < certificate.lower <= 377.321044772186
    assert str(certificate).startswith("certified: at least 377.32")


@pytest.mark.slow
@pytest.mark.parametrize(("duration", "rate"), [(LAP, 0.4), (30.0, 0.4), (600.0, 0.4), (600.0, -0.4)])
def test_reversed_and_long_horizons_close(duration: float, rate: float) -> None:
    # The optimum goes almost a full turn to the other valley, and turns there.
    task = paper_task(duration, rate=rate)
    certificate = certify_work(task)
    assert certificate.word == "certified"
    assert certificate.lower <= minimum_work(task).work * (1 + 1e-12)


def ends_of(task: Task) -> list[Ends]:
    return [
        Ends("law", tuple(map(float, servo_end_state(task)))),
        Ends("periodic"),
        Ends("periodic", free_start=True),
    ]


@pytest.mark.parametrize("index", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_brackets_of_given_and_periodic_ends_close(index: int) -> None:
    task = paper_task()
    ends = ends_of(task)[index]
    certificate = certify_work(task, ends)
    assert certificate.word == "certified"
    assert certificate.lower <= certificate.upper * (1 + 1e-12)
    assert certificate.proof is not None
    assert check(task, certificate.proof, certificate.lower, ends) == certificate.lower
    # The proof of one class is none of another.
    other = Ends("periodic") if ends.end == "law" else Ends()
    with pytest.raises(Refused):
        check(task, certificate.proof, certificate.upper, other)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_random_tasks_close(seed: int) -> None:
    task = random_task(seed)
    certificate = certify_work(task)
    assert certificate.word == "certified"
    assert certificate.lower <= certificate.upper + 1e-12 * abs(certificate.upper)


@pytest.mark.parametrize(
    "seed", [77, pytest.param(49, marks=pytest.mark.slow), pytest.param(234, marks=pytest.mark.slow)]
)
def test_tasks_with_several_good_ways_close(seed: int) -> None:
    # No theorem about the best way is needed, so that nothing hinges on how many there are.
    certificate = certify_work(random_task(seed))
    assert certificate.word == "certified"
    assert certificate.lower <= certificate.upper + 1e-12 * abs(certificate.upper)


def test_what_is_proven_does_not_hang_on_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether the number of families is enough or not: a slow machine proves the same."""
    few = certify_work(random_task(1), families=20)
    assert (few.word, few.reason) == ("unresolved", "no better proof by 20 families of motions")
    found = certify_work(random_task(1))
    clock = itertools.count(step=1000.0)
    monkeypatch.setattr("time.process_time", lambda: next(clock))
    again = certify_work(random_task(1))
    assert (again.word, again.lower, again.reason) == ("certified", found.lower, "")


def test_what_stays_open_is_an_interval() -> None:
    certificate = certify_work(random_task(1), families=0)
    assert certificate.word == "unresolved"
    assert certificate.lower < certificate.upper
    assert str(certificate).startswith("unresolved: between")


@pytest.mark.parametrize(("radius", "expected"), [(0.3, "2.5640777"), (0.7, "12.3827824586")])
@pytest.mark.parametrize("rate", [-0.4, 0.4])
def test_least_mean_power_is_certified(
    radius: float, expected: str, rate: float, printed: Callable[[str], object]
) -> None:
    task = paper_task(radius=radius, rate=rate)
    lower = least_mean_power(task)
    exact = float(long_run(energy_of(task.platform, task.point, circle_of(task))).mean_power)
    assert exact * (1 - 1e-9) < lower <= exact
    assert lower == printed(expected)
    assert check_mean_power(task, lower) <= lower
    # Nothing above the least mean power is proven.
    for share in (1e-9, 1e-3, 0.5):
        with pytest.raises(Refused):
            check_mean_power(task, exact * (1 + share))


def test_switch_radius_is_where_the_certified_regime_changes() -> None:
    # A steady bound is proven above the radius, below it a turning motion needs less than every steady one.
    radius = float(switch_radius(yaw_coefficients(paper_task().platform, paper_task().point)))
    for factor, steady in ((1 + 1e-6, True), (1 - 1e-6, False)):
        task = paper_task(radius=factor * radius)
        bottom = float(long_run(energy_of(task.platform, task.point, circle_of(task))).steady_power)
        if steady:
            assert check_mean_power(task, bottom * (1 - 1e-14)) == pytest.approx(bottom, rel=1e-13)
        else:
            with pytest.raises(Refused, match="a turn pays"):
                check_mean_power(task, bottom * (1 - 1e-14))
