"""Certified bounds of the work: enclosures that hold, brackets that close, and mutations that the checker refuses."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import flint
import numpy as np
import pytest
from flint import arb
from hypothesis import given, settings

from occ.certify import Certificate, certify_work, check
from occ.certify.balls import Polynomial, Refused, enclose
from occ.certify.curve import CurveProof
from occ.certify.straight import StraightProof
from occ.laws import ServoLaw
from occ.model.platform import Platform
from occ.motion import Circle
from occ.referee import judge
from occ.task import Task
from occ.theory.dissipation import energy_of
from occ.theory.minimum_work import minimum_work
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


@cache
def lap() -> tuple[Task, Certificate]:
    task = paper_task()
    return task, certify_work(task)


def test_bracket_of_one_lap_closes() -> None:
    task, certificate = lap()
    assert certificate.word == "certified"
    assert isinstance(certificate.proof, CurveProof)
    assert 200.327119033710 * (1 - 1e-6) < certificate.lower <= 200.327119033711
    law = judge(task, ServoLaw().solve(task)).measures["work_J"]
    assert 100 * (law / certificate.lower - 1) == pytest.approx(0.5305, abs=5e-5)


@pytest.mark.slow
def test_bracket_of_thirty_seconds_closes() -> None:
    certificate = certify_work(paper_task(30.0))
    assert 377.321044772185 * (1 - 1e-6) < certificate.lower <= 377.321044772186
    assert str(certificate).startswith("certified: at least 377.321")


@pytest.mark.slow
def test_straight_way_closes_to_rounding() -> None:
    task = paper_task(radius=0.55)
    certificate = certify_work(task)
    assert isinstance(certificate.proof, StraightProof)
    assert abs(certificate.gap) < 1e-13


@pytest.mark.parametrize("seed", [8, 9])
def test_floors_are_below_everything(seed: int) -> None:
    task = random_task(seed)
    floor = check(task, None)
    assert floor <= minimum_work(task).work * (1 + 1e-12)
    record = judge(task, ServoLaw().solve(task))
    assert floor <= record.measures["work_J"]


def test_what_stays_open_is_an_interval() -> None:
    certificate = certify_work(random_task(1), budget=0.0)
    assert certificate.word == "unresolved"
    assert certificate.lower < certificate.upper
    assert str(certificate).startswith("unresolved: between")


def curve_proof() -> tuple[Task, CurveProof, float]:
    task, certificate = lap()
    assert isinstance(certificate.proof, CurveProof)
    assert check(task, certificate.proof, certificate.lower) == certificate.lower
    return task, certificate.proof, certificate.lower


def test_wrong_sign_is_refused() -> None:
    task, proof, claim = curve_proof()
    for wrong in (
        replace(proof, curvature=tuple(3 * c for c in proof.curvature)),
        replace(proof, speed=-proof.speed),
        replace(proof, acceleration=tuple(-a for a in proof.acceleration)),
    ):
        with pytest.raises(Refused):
            check(task, wrong, claim)


def test_dropped_end_term_is_refused() -> None:
    task, proof, claim = curve_proof()
    with flint.ctx.workprec(96):
        enclosed = enclose(task)
        place = enclosed.start + arb(1.1183778)
        end_cost = float(enclosed.end_cost(place))
    # The end costs something negative here: a bound without it is too high.
    assert end_cost < 0
    with pytest.raises(Refused, match="above what is proven"):
        check(task, proof, claim - end_cost)
    # A curvature at the end that the end term does not support.
    with pytest.raises(Refused, match="curvature"):
        check(task, replace(proof, curvature=(*proof.curvature[:-1], 1e4)), claim)


def test_underestimated_radius_is_refused() -> None:
    task, proof, claim = curve_proof()
    with pytest.raises(Refused, match="above what is proven"):
        check(task, proof, float(np.nextafter(claim, np.inf)))


def test_shortened_time_is_refused() -> None:
    task, proof, claim = curve_proof()
    short = replace(
        proof,
        times=proof.times[:-1],
        acceleration=proof.acceleration[:-1],
        curvature=proof.curvature[:-1],
    )
    with pytest.raises(Refused, match="the horizon is"):
        check(task, short, claim)
    squeezed = replace(proof, times=tuple(0.999 * t for t in proof.times))
    with pytest.raises(Refused, match="the horizon is"):
        check(task, squeezed, claim)
    # The proof of one horizon is none of another.
    with pytest.raises(Refused, match="the horizon is"):
        check(paper_task(LAP * 1.001), proof, claim)


@pytest.mark.slow
def test_narrow_or_misplaced_window_is_refused() -> None:
    task, proof, claim = curve_proof()
    low, high = proof.window
    for window in ((1, high), (low, high - 30), (low, -1)):
        with pytest.raises(Refused):
            check(task, replace(proof, window=window), claim)


@pytest.mark.slow
def test_straight_proof_with_wrong_numbers_is_refused() -> None:
    task = paper_task(radius=0.55)
    certificate = certify_work(task)
    proof = certificate.proof
    assert isinstance(proof, StraightProof)
    for wrong in (
        replace(proof, energy=-20.0),
        replace(proof, energy=proof.energy + 0.5),
        replace(proof, end=-proof.end),
        replace(proof, end=proof.end + 0.05),
        replace(proof, hole=(-3, proof.hole[1])),
        replace(proof, hole=(proof.hole[0] - 60, proof.hole[1])),
    ):
        with pytest.raises(Refused):
            check(task, wrong, certificate.lower)
