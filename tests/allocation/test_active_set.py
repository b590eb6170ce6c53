"""Electric power of five and more wheels: every sample solved and certified, degenerate ones above all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from occ.allocation import LEAST_NORM, ElectricPower, InputMap, TorqueRange, allocate, input_map
from occ.allocation.allocator import solve
from occ.allocation.ranges import NO_LIMIT
from occ.allocation.reference import Reference
from occ.allocation.residuals import certified
from occ.allocation.result import Question, question
from occ.errors import InputError
from tests.allocation.wrenches import random_ranges, random_wrenches

LOSSES = (1.257, 1e-3, 50.0)
SAMPLES = 4


def wheel_set(seed: int, count: int) -> InputMap:
    """Random wheels; of three sets one has wheels that pull alike, and one is of whole numbers."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, 3))
    if seed % 3 == 0:
        rows[-1], rows[-2] = rows[0], -rows[1]
    elif seed % 3 == 1:
        rows = np.round(rows)
    try:
        return input_map(rows * [20.0, 20.0, 6.0])
    except InputError:
        return wheel_set(seed + 1, count)


def box(asked: Question, rng: np.random.Generator) -> Question:
    return asked


def unlike_ranges(asked: Question, rng: np.random.Generator) -> Question:
    """Some of them points, some without end, some without rest."""
    return again(asked, limits=random_ranges(asked.wheels, SAMPLES, int(rng.integers(1000))))


def border_of_reach(asked: Question, rng: np.random.Generator) -> Question:
    least = np.maximum(asked.wheels.least_peak(asked.min_norm), 1e-3) * np.ones((asked.wheels.wheel_count, 1))
    return again(asked, limits=TorqueRange(-least, least))


def corners_of_the_box(asked: Question, rng: np.random.Generator) -> Question:
    """Wrenches of torques that are all at a limit or at rest."""
    torque = rng.integers(-1, 2, size=asked.min_norm.shape).astype(float)
    return again(asked, wrench=asked.wheels.wrench(torque))


def almost_at_corners(asked: Question, rng: np.random.Generator) -> Question:
    """As before, with limits and idle intervals that miss the torques by about as much as the corners are moved."""
    torque = rng.integers(-1, 2, size=asked.min_norm.shape).astype(float)
    size = 10.0 ** rng.uniform(-8, -5, torque.shape)
    limits = TorqueRange(-1 - size * rng.uniform(size=torque.shape), 1 + size * rng.uniform(size=torque.shape))
    rates = np.where(rng.uniform(size=torque.shape) < 0.5, size, -asked.criterion.loss * torque + size)
    return again(asked, wrench=asked.wheels.wrench(torque), limits=limits, rates=rates)


def all_at_rest(asked: Question, rng: np.random.Generator) -> Question:
    return again(asked, rates=np.zeros_like(asked.rates))


def rates_of_a_motion(asked: Question, rng: np.random.Generator) -> Question:
    return again(asked, rates=asked.wheels.wheel_rates @ (rng.normal(size=(3, SAMPLES)) * [[0.3], [0.3], [1.0]]))


KINDS = (box, unlike_ranges, border_of_reach, corners_of_the_box, almost_at_corners, all_at_rest, rates_of_a_motion)


def again(
    asked: Question,
    wrench: np.ndarray | None = None,
    limits: TorqueRange | None = None,
    rates: np.ndarray | None = None,
) -> Question:
    """The same question with something else."""
    return question(
        asked.wheels,
        asked.wrench if wrench is None else wrench,
        limits or asked.ranges,
        asked.criterion,
        asked.rates if rates is None else rates,
    )


def ask(seed: int, count: int, loss: float, kind: Callable[[Question, np.random.Generator], Question]) -> Question:
    wheels, rng = wheel_set(seed, count), np.random.default_rng(seed)
    rates = rng.normal(size=(count, SAMPLES)) * 5 * (rng.uniform(size=(count, SAMPLES)) > 0.2)
    wrench = random_wrenches(wheels, 1.0, SAMPLES, seed)
    return kind(question(wheels, wrench, 1.0, ElectricPower(loss), rates), rng)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sets", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_every_sample_is_solved_and_proven(sets: int, kind: Callable[..., Question]) -> None:
    reached = 0
    for seed in range(sets):
        for count in (5, 6, 7, 8, 12):
            asked = ask(seed, count, LOSSES[(seed + count) % 3], kind)
            found = solve(asked)
            assert not found.failed.any(), (seed, count)
            good = found.reachable
            reached += good.sum()
            proof = certified(asked.of(good), found.torque[:, good])
            assert proof.prove.all(), (seed, count, proof.largest.max())
    assert reached > 0.4 * 5 * sets * SAMPLES


def test_a_wheel_that_only_rounding_moves_does_not_push_for_ever() -> None:
    # Two pairs of parallel wheels leave the fifth no null torque but 1e-13 of one, and here it is at its limit.
    asked = ask(42, 5, LOSSES[2], border_of_reach)
    share = np.abs(asked.wheels.null_torque).max(axis=1).min()
    assert 0.0 < share < 1e-12
    found = solve(asked)
    assert found.reachable.all()
    assert not found.failed.any()
    assert certified(asked, found.torque).prove.all()


def test_a_wheel_without_a_limit_that_only_rounding_loads_does_not_bring_a_wrench_into_reach() -> None:
    # The third wheel's torque is the wrench's own, and its range is another point; wheels 2 and 4, which are parallel,
    # have no limit at all.
    asked = ask(27, 5, LOSSES[2], unlike_ranges)
    least, most = (bound[2, 1] for bound in asked.bounds)
    assert least == most != pytest.approx(asked.min_norm[2, 1], rel=0.1)
    assert (asked.bounds[1][[1, 3], 1] == NO_LIMIT).all()
    found = solve(asked)
    assert not found.reachable[1]
    assert not found.failed.any()


@pytest.mark.parametrize("kind", [box, corners_of_the_box])
@pytest.mark.parametrize("count", [5, 6])
def test_value_is_that_of_cvxpy(count: int, kind: Callable[..., Question]) -> None:
    asked = ask(2, count, 1.257, kind)
    found = solve(asked)
    written = Reference(asked.wheels, asked.criterion)
    for k in range(SAMPLES):
        answer = written.solve(asked.wrench[:, k], 1.0, asked.rates[:, k])
        assert (answer.torque is not None) == found.reachable[k]
        if answer.torque is not None:
            value = asked.criterion.value(found.torque[:, [k]], asked.rates[:, [k]])[0]
            assert value == pytest.approx(answer.value, rel=1e-7, abs=1e-9)


def test_of_several_best_torques_the_least_norm() -> None:
    # Wheels 1 and 2 pull alike, so that what they share costs nothing while both give power back.
    wheels = wheel_set(0, 6)
    rates = np.full((6, 1), 9.0)
    torque = np.array([[-0.9, -0.3, -0.7, -0.5, -0.2, -0.4]]).T
    wrench = wheels.wrench(torque)
    found = allocate(wheels, wrench, 1.0, ElectricPower(), rates)
    assert ElectricPower().value(found.torque, rates)[0] == pytest.approx(0.0, abs=1e-14)
    # All wheels may be idle together, between -phi'/k and 0.
    idle = TorqueRange(np.full((6, 1), -1.0), np.zeros((6, 1)))
    np.testing.assert_allclose(found.torque, allocate(wheels, wrench, idle, LEAST_NORM).torque, atol=1e-12)
    assert (found.torque**2).sum() < (torque**2).sum() - 0.01
