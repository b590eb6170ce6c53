"""The checker: no data whatever prove more than the truth, and mutations of each construction are refused."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import flint
import numpy as np
import pytest
from flint import arb

from occ.certify import Ends, certify_work, check, checker
from occ.certify.angle import Family, OneAngle, one_angle
from occ.certify.balls import Polynomial, Refused
from occ.certify.checker import at_level, examine, of_family
from occ.certify.lengths import Lengths
from occ.certify.proofs import CurveProof, Level, Split, Tree
from occ.certify.work import BITS
from occ.referee.reference import servo_end_state
from occ.task import Task
from occ.theory.minimum_work import minimum_work
from occ.theory.trigonometric import value
from tests.certify.test_certify_work import along_curve, lap
from tests.tasks import paper_task
from tests.theory.test_minimum_work import random_task


class Proven(NamedTuple):
    """A proof and what it proves."""

    task: Task
    ends: Ends
    proof: Tree
    claim: float


@cache
def proven(name: str) -> Proven:
    ends = Ends()
    if name in ("levels", "curve"):
        task, certificate = lap() if name == "levels" else along_curve()
    else:
        task = paper_task()
        ends = Ends("periodic") if name == "periodic" else Ends("law", tuple(map(float, servo_end_state(task))))
        certificate = certify_work(task, ends)
    assert certificate.word == "certified"
    assert certificate.proof is not None
    return Proven(task, ends, certificate.proof, certificate.lower)


@cache
def angle_of(found: Proven) -> OneAngle:
    with flint.ctx.workprec(BITS):
        return one_angle(found.task, found.ends)


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("law", "periodic")]


@pytest.fixture(params=["levels", "curve", *SLOW])
def whole(request: pytest.FixtureRequest) -> Proven:
    found = proven(request.param)
    assert check(found.task, found.proof, found.claim, found.ends) == found.claim
    return found


def mapped(tree: Tree, change: Callable[[Level | CurveProof], Tree]) -> Tree:
    """The same families with other proofs."""
    if isinstance(tree, Split):
        return tree._replace(below=mapped(tree.below, change), above=mapped(tree.above, change))
    return change(tree)


def of_curve(tree: Tree, change: Callable[[CurveProof], CurveProof]) -> Tree:
    return mapped(tree, lambda leaf: change(leaf) if isinstance(leaf, CurveProof) else leaf)


def way_to_the_weakest(found: Proven) -> list[bool]:
    """Turns, True for above, that lead to the leaf with the least bound."""
    way, tree, family = [], found.proof, Family()
    with flint.ctx.workprec(BITS):
        problem = angle_of(found)
        while isinstance(tree, Split):
            parts = family.split(tree.axis, tree.place)
            bounds = [of_family(problem, *part) for part in zip(parts, (tree.below, tree.above), strict=True)]
            way.append(bounds[1] < bounds[0])
            family, tree = parts[way[-1]], tree.above if way[-1] else tree.below
    return way


def without_part(tree: Tree, way: list[bool], depth: int) -> Tree:
    """The cut at a depth is left out: the proof of the other part stands for both."""
    assert isinstance(tree, Split)
    if depth == 0:
        return tree.below if way[0] else tree.above
    if way[0]:
        return tree._replace(above=without_part(tree.above, way[1:], depth - 1))
    return tree._replace(below=without_part(tree.below, way[1:], depth - 1))


# What is proven is true.


@pytest.mark.parametrize("seed", range(4))
def test_each_family_bounds_the_motions_in_it(seed: int) -> None:
    # Motions at random, of which nothing is optimal; what they cost by a sum over a fine grid.
    random, task = np.random.default_rng(seed), random_task(seed)
    with flint.ctx.workprec(BITS):
        problem = one_angle(task)
        e = problem.task
        power, of_end = (np.array([float(c) for c in p.coefficients]) for p in (e.power, e.of_end))
        z, rate, start, cell = float(e.friction), float(e.rate), float(e.start), 2 * np.pi / problem.lengths.count
        for _ in range(12):
            knots = np.concatenate([[0.0], np.cumsum(random.normal(scale=1.5, size=random.integers(1, 5)))])
            share = np.linspace(0, 1, 4001)
            way = np.interp(share, np.linspace(0, 1, len(knots)), knots)
            speed, middle = np.diff(way) * 4000 / task.duration, (way[1:] + way[:-1]) / 2
            cost = np.mean(z * speed**2 + value(power, start + middle)) * task.duration
            cost += 2 * z * rate * way[-1] + value(of_end, start + way[-1]) - float(e.swing(e.start))
            low, high, end = way.min() / cell, way.max() / cell, way[-1] / cell
            slack = random.choice([0.0, 0.3, 5.0, 400.0], size=6)
            family = Family(
                end - slack[0] - 1e-6,
                end + slack[1] + 1e-6,
                low - slack[2] - 1e-6,
                min(0.0, low + slack[3] + 1e-6),
                max(0.0, high - slack[4] - 1e-6),
                high + slack[5] + 1e-6,
            )
            for level in (-np.inf, *random.normal(scale=np.abs(power).sum(), size=3)):
                assert at_level(problem, family, Level(float(level))) <= cost + 1e-4 * (1 + abs(cost))


def random_tree(random: np.random.Generator, family: Family, scale: float, depth: int) -> Tree:
    """Any data: they need not even be of use."""
    axis = ("end", "left", "right")[random.integers(3)]
    place = float(random.normal(scale=60.0))
    try:
        parts = family.split(axis, place)
    except Refused:
        parts = None
    if depth == 0 or parts is None:
        return Level(float(random.normal(scale=scale)))
    below, above = (random_tree(random, part, scale, depth - 1) for part in parts)
    return Split(axis, place, below, above)


def test_no_tree_proves_too_much() -> None:
    passed = 0
    for seed in range(3):
        random, task = np.random.default_rng(seed), random_task(seed)
        exact = minimum_work(task).work
        with flint.ctx.workprec(BITS):
            problem = one_angle(task)
            far = Level(3 * float(sum(abs(c) for c in problem.task.power.coefficients)))
            for _ in range(5):
                # Ends far away need a level at which a turn pays; all others may have any.
                inner = random_tree(random, Family(first=-480.0, last=480.0), far.level, 6)
                try:
                    proof = Split("end", 480.0, Split("end", -480.0, far, inner), far)
                    assert examine(problem, proof) <= exact + 1e-12 * abs(exact)
                    passed += 1
                except Refused:
                    continue
    assert passed > 6


def test_no_level_proves_too_much(whole: Proven) -> None:
    state = None if whole.ends.state is None else np.array(whole.ends.state)
    exact = minimum_work(whole.task, whole.ends.end, state).work
    for change in (-0.1, 5.0, 500.0):
        other = mapped(whole.proof, lambda leaf, c=change: Level(leaf.level + c) if isinstance(leaf, Level) else leaf)
        try:
            assert check(whole.task, other, ends=whole.ends) <= exact * (1 + 1e-12)
        except Refused as refusal:
            assert "a turn pays" in str(refusal)  # noqa: PT017 - either a refusal or less


# Mutations.


def test_wrong_sign_is_refused(whole: Proven) -> None:
    def turned(leaf: Level | CurveProof) -> Tree:
        return Level(-leaf.level) if isinstance(leaf, Level) else replace(leaf, speed=-leaf.speed)

    with pytest.raises(Refused):
        check(whole.task, mapped(whole.proof, turned), whole.claim, whole.ends)


def test_v_that_runs_backwards_is_noticed(whole: Proven, monkeypatch: pytest.MonkeyPatch) -> None:
    # If V_t had the other sign in the checker it would prove what is not true.
    monkeypatch.setattr(checker, "_action", lambda problem, level, way: way + arb(level) * problem.task.duration)
    assert check(whole.task, whole.proof, ends=whole.ends) != whole.claim


@pytest.mark.parametrize(
    "change",
    [
        lambda p: replace(p, curvature=tuple(3 * c for c in p.curvature)),
        lambda p: replace(p, acceleration=tuple(-a for a in p.acceleration)),
        # A curvature at the end that the end term does not support.
        lambda p: replace(p, curvature=(*p.curvature[:-1], 1e4)),
        # A shortened time, and one that is squeezed.
        lambda p: replace(p, times=p.times[:-1], acceleration=p.acceleration[:-1], curvature=p.curvature[:-1]),
        lambda p: replace(p, times=tuple(0.999 * t for t in p.times)),
        lambda p: replace(p, times=(p.times[0], p.times[2], p.times[1], *p.times[3:])),
        lambda p: replace(p, acceleration=p.acceleration[1:]),
        lambda p: replace(p, acceleration=(math.nan, *p.acceleration[1:])),
        lambda p: replace(p, curvature=(*p.curvature[:9], math.nan, *p.curvature[10:])),
    ],
)
def test_mutations_of_a_curve_are_refused(change: Callable[[CurveProof], CurveProof]) -> None:
    found = proven("curve")
    with pytest.raises(Refused):
        check(found.task, of_curve(found.proof, change), found.claim)


@pytest.mark.slow
@pytest.mark.parametrize("axis", ["left", "right"])
def test_narrow_or_misplaced_window_is_refused(axis: str) -> None:
    found = proven("curve")

    def moved(tree: Tree, to: float) -> Tree:
        if isinstance(tree, Split):
            tree = tree._replace(place=to) if tree.axis == axis else tree
            return tree._replace(below=moved(tree.below, to), above=moved(tree.above, to))
        return tree

    assert isinstance(found.proof, Split)
    for to in (-1.0, 1.0):
        with pytest.raises(Refused):
            check(found.task, moved(found.proof, to), found.claim)


def test_family_left_out_is_refused(whole: Proven) -> None:
    # One proof in the place of two: it speaks of more motions than it was made for.
    way = way_to_the_weakest(whole)
    # The first cuts leave out whole sides, the last ones single cells.
    for depth in {0, len(way) // 2, len(way) - 1}:
        with pytest.raises(Refused):
            check(whole.task, without_part(whole.proof, way, depth), whole.claim, whole.ends)


@pytest.mark.parametrize(
    "wrong",
    [
        Level(math.inf),
        Level(math.nan),
        Split("end", math.nan, Level(), Level()),
        Split("right", -3.0, Level(), Level()),
        Split("left", math.inf, Level(), Level()),
    ],
)
def test_data_that_are_no_proof_are_refused(wrong: Tree) -> None:
    with pytest.raises(Refused):
        check(paper_task(), wrong)


def test_dropped_end_term_is_refused(whole: Proven) -> None:
    with flint.ctx.workprec(BITS):
        problem = angle_of(whole)
        e = problem.task
        without = replace(e, swing=e.swing.scaled(arb(0)), rest=e.rest.scaled(arb(0)))
        if problem.end is None:
            # What the end costs is part of what is proven: without it the proof proves something else.
            end = float(e.end_cost(e.start + arb(1.1183778)))
            assert end < 0
            with pytest.raises(Refused, match="above what is proven"):
                check(whole.task, whole.proof, whole.claim - end)
            with contextlib.suppress(Refused):
                assert examine(replace(problem, task=without), whole.proof) != pytest.approx(whole.claim, rel=1e-6)
        # The kinetic energy of the start, and what is paid for a given end.
        paid = float(problem.paid)
        assert (paid != 0) == (whole.ends.end != "periodic")
        if paid:
            bare = examine(replace(problem, paid=arb(0)), whole.proof)
            assert bare == pytest.approx(whole.claim - paid, rel=1e-12)
            with pytest.raises(Refused, match="above what is proven"):
                check(whole.task, whole.proof, whole.claim + abs(paid), whole.ends)


def blurred(problem: OneAngle, radius: float) -> OneAngle:
    power = Polynomial(problem.task.power.c_0 + arb(0, radius), *problem.task.power.coefficients[1:])
    task = replace(problem.task, power=power)
    end = None if problem.end is None or problem.repeat else problem.lengths.place(problem.end)
    # Places at which a ball holds zero are many: they need not be looked at closely.
    return replace(problem, task=task, lengths=Lengths(task, problem.lengths.count, end, grain=1e-2))


def test_underestimated_radius_is_refused(whole: Proven) -> None:
    with pytest.raises(Refused, match="above what is proven"):
        check(whole.task, whole.proof, float(np.nextafter(whole.claim, np.inf)), whole.ends)
    with flint.ctx.workprec(BITS):
        problem = angle_of(whole)
        # Everything that the balls hold is bounded: the least power of all for the whole time.
        least = whole.claim - 1e-2 * whole.task.duration
        try:
            assert examine(blurred(problem, 1e-2), whole.proof) <= least + 1e-6 * abs(least)
        except Refused as refusal:
            assert "curvature" in str(refusal)  # noqa: PT017 - either a refusal or less
        wide = examine(replace(problem, paid=problem.paid + arb(0, 0.5)), whole.proof)
        assert wide == pytest.approx(whole.claim - 0.5, abs=1e-5)


def test_shortened_time_is_refused(whole: Proven) -> None:
    # Less time needs less work; the proof of one horizon is none of another.
    with flint.ctx.workprec(BITS):
        problem = angle_of(whole)
        shorter = replace(problem, task=replace(problem.task, duration=problem.task.duration * arb(0.999)))
        with contextlib.suppress(Refused):
            assert examine(shorter, whole.proof) < whole.claim - 1e-4 * abs(whole.claim)


def test_faster_start_is_refused() -> None:
    # More kinetic energy to start with needs less work.
    found = proven("levels")
    faster = replace(found.task, start=replace(found.task.start, heading_rate=0.5))
    with pytest.raises(Refused, match="above what is proven"):
        check(faster, found.proof, found.claim)


def test_free_start_has_no_places_to_go_to() -> None:
    cycle = Ends("periodic", free_start=True)
    certificate = certify_work(paper_task(), cycle)
    assert certificate.word == "certified"
    proof = mapped(certificate.proof or Level(), lambda leaf: Split("right", 3.0, leaf, leaf))
    with pytest.raises(Refused, match="where motions begin"):
        check(paper_task(), proof, ends=cycle)
