"""Bounds by sums of squares: known least values from below, and mutations that the check refuses."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from typing import cast

import casadi as ca
import flint
import numpy as np
import pytest
from flint import arb
from hypothesis import given, settings

from occ.certify import checker, sos
from occ.certify.balls import Refused, positive_definite
from occ.certify.bellman import Inequality, State, end_force, harmonics
from occ.certify.endless import certify_endless
from occ.certify.ends import FREE, Ends
from occ.certify.proofs import SquaresProof, TurnsProof
from occ.certify.running import Cost, inequality, running_costs, scales_of
from occ.certify.series import Series
from occ.certify.sos import Degree, propose
from occ.certify.squares import BITS, DEGREES, _attempt, _Effort, certify_squares, check_squares
from occ.model.coefficients import coefficients, unpack
from occ.model.platform import Platform
from occ.model.presets import YouBot
from occ.motion import Circle
from occ.referee.reference import servo_end_state
from occ.task import Task
from occ.theory.dissipation import energy_of
from occ.theory.long_run import long_run
from occ.theory.minimum_work import minimum_work
from tests.strategies import circles, platforms, points
from tests.tasks import paper_task
from tests.theory.test_minimum_work import random_task

LEAST_WORK, LEAST_SQUARES = 200.3271190337, 29.17156773
"""[J] and [N^2 m^2 s], one lap of the paper's circle with a free end."""
LAST_DIGIT = 1e-8
CYCLE = Ends("periodic", free_start=True)


@settings(max_examples=6)
@given(platforms(), points(), circles())
def test_costs_are_those_of_the_platform(platform: Platform, point: tuple[float, float], circle: Circle) -> None:
    # In balls from the contact condition by hand; here by the model of eq. (2.16).
    task = Task(platform=platform, point=point, motion=circle, duration=1.0)
    x, yaw_rate, acceleration = 0.8, 0.6, -0.9
    speed, difference = circle.radius * circle.rate, yaw_rate - circle.rate
    direction = np.array([point[1], -point[0], 1.0])
    program = speed * np.array([np.sin(x), np.cos(x), 0.0])
    turned = speed * np.array([np.cos(x), -np.sin(x), 0.0]) * difference
    k = unpack(ca.DM(coefficients(platform)), platform.wheel_count)
    velocity = direction * yaw_rate + program
    wrench = np.array(k.wrench(ca.DM(velocity), ca.DM(direction * acceleration + turned)))[:, 0]
    torque = np.array(k.min_norm) @ wrench
    inertia, friction = np.array(k.inertia), np.array(k.friction)
    with flint.ctx.workprec(BITS):
        costs, scales = running_costs(task), scales_of(task)
        place = harmonics(arb(x), 2)
        found = [float(cost.at(place, difference / scales.rate, acceleration / scales.acceleration)) for cost in costs]
    expected = [torque @ torque, wrench @ velocity, velocity @ friction @ velocity, velocity @ inertia @ velocity / 2]
    size = float(np.abs(wrench) @ (np.abs(velocity) + 1)) + torque @ torque
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * size)


def proven(task: Task, cost: Cost, degree: Degree, ends: Ends = FREE) -> tuple[Inequality, SquaresProof, float]:
    with flint.ctx.workprec(BITS):
        problem = inequality(task, cost, ends)
        proof = propose(problem, degree, 1e-9)
    return problem, proof, check_squares(problem, proof)


@cache
def lap(cost: Cost) -> tuple[Inequality, SquaresProof, float]:
    return proven(paper_task(), cost, Degree(4, 2))


def test_work_of_one_lap() -> None:
    # The gap that is asked for is 1e-3 per cent.
    assert LEAST_WORK * (1 - 1e-5) < lap("work")[2] <= LEAST_WORK * (1 + 1e-12)


def test_squares_of_the_torques_of_one_lap() -> None:
    assert LEAST_SQUARES * (1 - 1e-3) < lap("torque_squared")[2] <= LEAST_SQUARES * (1 + LAST_DIGIT)


@pytest.mark.slow
def test_squares_of_the_torques_close() -> None:
    certificate = certify_squares(paper_task(), "torque_squared", upper=LEAST_SQUARES)
    assert certificate.word == "certified"
    assert LEAST_SQUARES * (1 - 1e-6) < certificate.lower <= LEAST_SQUARES * (1 + LAST_DIGIT)
    assert certificate.seconds < 60
    assert 56.74081224 * (1 - 1e-4) < proven(paper_task(30.0), "torque_squared", Degree(8, 2))[2] < 56.740813


def test_second_solver_proves_it_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sos, "SOLVERS", {"SCS": sos.SOLVERS["SCS"]})
    with flint.ctx.workprec(BITS):
        problem = inequality(paper_task(), "work", CYCLE)
        bound = check_squares(problem, propose(problem, Degree(2, 2), 1e-6))
    assert 194.5082920155 * (1 - 1e-4) < bound < 194.5082920156


def test_without_friction_nothing_is_proven_and_nothing_breaks() -> None:
    task = paper_task(platform=YouBot(wheel_friction=0.0, roller_friction=0.0).platform())
    assert certify_squares(task, "work", effort=1).lower == -np.inf
    assert "nothing costs" in str(certify_endless(task, "work", effort=1))


def test_what_is_proven_does_not_hang_on_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the effort ends is a matter of counts: a slow machine proves the same."""
    found = certify_squares(paper_task(), "work", effort=30_000)
    assert found.reason.endswith("the effort allowed is spent")
    assert found.degree == DEGREES[1]
    clock = itertools.count(step=1000.0)
    monkeypatch.setattr("time.process_time", lambda: next(clock))
    again = certify_squares(paper_task(), "work", effort=30_000)
    assert (again.lower, again.degree, again.reason) == (found.lower, found.degree, found.reason)
    assert again.seconds > 100 * found.seconds


def test_steady_cycle_with_degree_two() -> None:
    # The start is free: it is best to stand where U is least, and V = 0 nearly shows it.
    _, _, bound = proven(paper_task(), "work", Degree(2, 2), CYCLE)
    least = minimum_work(paper_task(), "periodic", free_start=True).work
    assert least == pytest.approx(194.5082920155, rel=1e-12)
    assert least * (1 - 1e-6) < bound <= least * (1 + 1e-12)


def test_work_to_the_end_of_the_law() -> None:
    task = paper_task()
    state = servo_end_state(task)
    _, _, bound = proven(task, "work", Degree(4, 2), Ends("law", tuple(state)))
    least = minimum_work(task, "law", state).work
    # The bound of the free end would be 0.1 per cent lower.
    assert least * (1 - 1e-4) < bound <= least * (1 + 1e-12)


@pytest.mark.parametrize("seed", [2, 8])
def test_bounds_of_random_tasks_are_below_the_least_work(seed: int) -> None:
    task = random_task(seed)
    least = minimum_work(task).work
    assert least - 1e-2 * abs(least) < proven(task, "work", Degree(4, 2))[2] <= least + 1e-12 * abs(least)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10, 16))
def test_bounds_of_more_random_tasks(seed: int) -> None:
    task = random_task(seed)
    least = minimum_work(task).work
    certificate = certify_squares(task, "work", upper=least, effort=50_000)
    assert certificate.lower <= least + 1e-12 * abs(least)
    assert certificate.gap < 0.2
    assert str(certificate).startswith(certificate.word)


def test_return_to_the_start_by_its_turns() -> None:
    # Every number of turns is an end of its own, reached by ways of its own: one V for all of them is far below.
    task, degree = paper_task(), Degree(4, 2)
    least = minimum_work(task, "periodic").work
    with flint.ctx.workprec(BITS):
        problem = inequality(task, "work", Ends("periodic"))
        whole, _ = _attempt(problem, degree, _Effort(0), None)
        bound, proof = _attempt(problem, degree, _Effort(0), -1)
    assert isinstance(proof, TurnsProof)
    assert whole + 20 < bound <= least * (1 + 1e-12)
    assert check_squares(problem, proof, bound) == bound
    # The linear part says how many turns there are: it has to fall to one side, and the turns have to be told.
    for wrong in (
        replace(proof, turns=0),
        replace(proof, turns=-1.5),
        replace(proof, upto=replace(proof.upto, slope=-proof.upto.slope)),
        replace(proof, above=proof.upto),
        proof.above,
    ):
        with pytest.raises(Refused):
            check_squares(problem, wrong, bound)


def test_what_is_given_back_and_lost_is_electric() -> None:
    # Copper loss is positive: the electric energy is above the least work, and above k times the least squares.
    assert lap("electric")[2] > LEAST_WORK + 1.257 * LEAST_SQUARES


def test_long_run_with_a_steady_rotation() -> None:
    task = paper_task()
    found = certify_endless(task, "torque_squared")
    assert not found.cycle.turns
    # An independent way to the best steady rotation: the torques that keep each angle.
    k = unpack(ca.DM(coefficients(task.platform)), 4)
    x = np.linspace(0, 2 * np.pi, 20_000)
    velocity = np.array(
        [0.05 * -0.4 + 0.7 * -0.4 * np.sin(x), 0.4 * 0.4 + 0.7 * -0.4 * np.cos(x), np.full_like(x, -0.4)]
    )
    wrench = np.array(k.friction) @ velocity
    wrench += [np.einsum("in,ij,jn->n", velocity, np.array(h), velocity) / 2 for h in k.gyroscopic]
    least = float(np.min(np.sum((np.array(k.min_norm) @ wrench) ** 2, axis=0)))
    assert found.cycle.mean == pytest.approx(least, rel=1e-6)
    assert least * (1 - 1e-6) < found.certificate.lower <= least * (1 + 1e-12)


def test_long_run_with_a_turning_motion() -> None:
    task = paper_task(radius=0.3)
    found = certify_endless(task, "work")
    energy = energy_of(task.platform, task.point, cast(Circle, task.motion))
    closed_form = float(long_run(energy).mean_power)
    assert found.cycle.turns
    assert found.cycle.mean == pytest.approx(closed_form, rel=1e-9)
    assert closed_form * (1 - 1e-6) < found.certificate.lower <= closed_form * (1 + 1e-12)


def test_long_run_of_a_turning_motion_with_torques_that_count() -> None:
    # No closed form here: what the motion costs and what is proven meet, whatever either of them is.
    found = certify_endless(paper_task(radius=0.3), "torque_squared")
    assert found.cycle.turns
    assert 0 <= found.certificate.gap < 1e-5


def test_force_of_the_end_is_how_the_bound_moves_with_it() -> None:
    task = paper_task()
    with flint.ctx.workprec(BITS):
        problem = inequality(task, "torque_squared", Ends("law", (0.0, 0.0, -4.4, 0.0, 0.0, -0.3)))
        assert problem.end is not None
        proof = SquaresProof({(0, 0, 1, 2): 1.5, (1, 0, 0, 1): -0.7, (2, 0, 2, 0): 0.4}, 0.0, ())
        v = Series({key: arb(c) for key, c in proof.value.items()})
        moved = [
            replace(problem, end=State(problem.end.angle + 1e-6, problem.end.rate)),
            replace(problem, end=State(problem.end.angle, problem.end.rate + 1e-6 / problem.scales.rate)),
        ]
        changes = [abs(float((other.bound(v, 0.0) - problem.bound(v, 0.0)) / 1e-6)) for other in moved]
        assert end_force(problem, proof) == pytest.approx(sum(changes), rel=1e-4)
        assert end_force(replace(problem, end=None), proof) == 0
        # A cycle may end anywhere: at least as much as at any one end.
        cycle = inequality(task, "torque_squared", CYCLE)
        assert end_force(cycle, proof) > sum(changes)


def test_left_side_of_the_inequality_is_what_v_changes_along_a_motion() -> None:
    task, random, push = paper_task(), np.random.default_rng(3), 0.7
    with flint.ctx.workprec(BITS):
        problem = inequality(task, "torque_squared")
        keys = [(i, 0, k, h) for i in range(3) for k in range(4) for h in range(-2, 3)]
        v = Series({key: arb(float(random.normal())) for key in keys})
        slope = problem.flow(v, 0.0) - problem.cost

    def along(series: Series, t: float) -> float:
        """A motion with psi~ = 0.3 + 0.9 t + 0.35 t^2."""
        angle, rate = 0.3 + 0.9 * t + push * t * t / 2, 0.9 + push * t
        waves, phase = harmonics(arb(angle), 3), np.arccos(2 * t / task.duration - 1)
        w, a = rate / problem.scales.rate, push / problem.scales.acceleration
        return float(
            sum(float(c * waves[h]) * w**i * a**j * np.cos(k * phase) for (i, j, k, h), c in series.terms.items())
        )

    quotient = (along(v, 2 + 1e-5) - along(v, 2 - 1e-5)) / 2e-5
    assert along(slope, 2.0) == pytest.approx(quotient, rel=1e-7)


# Mutations.


@pytest.fixture(params=["work", "torque_squared"])
def whole(request: pytest.FixtureRequest) -> tuple[Inequality, SquaresProof, float]:
    problem, proof, claim = lap(request.param)
    assert check_squares(problem, proof, claim) == claim
    return problem, proof, claim


def test_wrong_sign_is_refused(whole: tuple[Inequality, SquaresProof, float]) -> None:
    problem, proof, claim = whole
    for factor in (-1.0, 1.001):
        wrong = replace(proof, value={key: factor * c for key, c in proof.value.items()})
        with pytest.raises(Refused):
            check_squares(problem, wrong, claim)
    key = max(proof.value, key=lambda key: abs(proof.value[key]) * (key[2] > 0))
    with pytest.raises(Refused):
        check_squares(problem, replace(proof, value=proof.value | {key: -proof.value[key]}), claim)


def test_dropped_end_term_is_refused(whole: tuple[Inequality, SquaresProof, float]) -> None:
    problem, proof, claim = whole
    with pytest.raises(Refused, match="ends is missing"):
        check_squares(problem, replace(proof, end=None))
    # Whoever starts V higher says that the end pays for it.
    higher = proof.value | {(0, 0, 0, 0): proof.value[0, 0, 0, 0] + 1e-3}
    with pytest.raises(Refused, match="positive definite"):
        check_squares(problem, replace(proof, value=higher), claim)
    assert problem.end_cost is not None
    if problem.end_cost.terms:
        # The kinetic energy at the end, and that at the start.
        with pytest.raises(Refused, match="positive definite"):
            check_squares(replace(problem, end_cost=Series({})), proof)
        with pytest.raises(Refused, match="above what is proven"):
            check_squares(problem, proof, claim - float(problem.paid))


def test_underestimated_radius_is_refused(
    whole: tuple[Inequality, SquaresProof, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, proof, claim = whole
    with pytest.raises(Refused, match="above what is proven"):
        check_squares(problem, proof, float(np.nextafter(claim, np.inf)))
    blurred = replace(problem, cost=Series({key: c + arb(0, 1e-4) for key, c in problem.cost.terms.items()}))
    with pytest.raises(Refused, match="rounding radius"):
        check_squares(blurred, proof)
    # What is printed is the lower end of the ball.
    wide = check_squares(replace(problem, paid=problem.paid + arb(0, 0.5)), proof)
    assert claim - 0.5 - 1e-6 < wide < claim - 0.5
    # It is the radius that refuses: a check without it would pass.
    monkeypatch.setattr(
        checker, "positive_definite", lambda rows: positive_definite([[arb(c.mid()) for c in row] for row in rows])
    )
    assert check_squares(blurred, proof) == claim


def test_shortened_time_is_refused(whole: tuple[Inequality, SquaresProof, float]) -> None:
    problem, proof, claim = whole
    assert problem.duration is not None
    for factor in (0.999, 1.001):
        with pytest.raises(Refused):
            check_squares(replace(problem, duration=problem.duration * factor), proof, claim)
    # V as if the horizon were half as long.
    halves = {key: c * (-1) ** key[2] for key, c in proof.value.items()}
    with pytest.raises(Refused):
        check_squares(problem, replace(proof, value=halves), claim)


def test_what_v_may_not_hold_is_refused(whole: tuple[Inequality, SquaresProof, float]) -> None:
    problem, proof, _ = whole
    for key in ((0, 1, 0, 0), (3, 0, 0, 0)):
        with pytest.raises(Refused, match="may not have"):
            check_squares(problem, replace(proof, value=proof.value | {key: 1e-9}))
    with pytest.raises(Refused, match="depends on time"):
        check_squares(replace(problem, duration=None), proof)
