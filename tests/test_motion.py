"""Contract of program motions: every motion in `MOTIONS` is checked by the examples below.

To add a motion: give it one or more examples in `EXAMPLES`.
"""

from __future__ import annotations

import math
import pickle
from collections import Counter
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from occ.errors import InputError
from occ.motion import MOTIONS, Circle, Line, ProgramMotion
from tests.strategies import circles, lines, reals

EXAMPLES: dict[str, list[ProgramMotion]] = {
    "circle": [Circle(radius=0.7, rate=-0.4, phase=math.pi / 2), Circle(radius=0.3, rate=1.3)],
    "line": [Line(velocity=(0.3, -0.2), start=(1.0, 2.0)), Line(velocity=(0.0, 0.5))],
}

every_motion = pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: motion.kind)


def examples(motion: type[ProgramMotion]) -> list[ProgramMotion]:
    if motion.kind not in EXAMPLES:
        pytest.fail(f"the motion {motion.kind!r} has no example: add one to EXAMPLES in {__name__}")
    return EXAMPLES[motion.kind]


def times_of(motion: ProgramMotion) -> np.ndarray:
    """Times of the first lap (or ten seconds) that no way-point meets by accident."""
    return np.random.default_rng(7).uniform(0.02, 0.98, 25) * (motion.period or 10.0)


def derivative(values: Any, times: np.ndarray, step: float) -> np.ndarray:
    """Fourth-order central differences in time of a function of times."""
    near, far = (values(times + k * step) - values(times - k * step) for k in (1, 2))
    return np.asarray((8 * near - far) / (12 * step))


@every_motion
def test_examples_are_of_their_motion(motion: type[ProgramMotion]) -> None:
    for example in examples(motion):
        assert type(example) is motion


def test_no_two_motions_have_one_name() -> None:
    assert max(Counter(motion.kind for motion in MOTIONS).values()) == 1


@every_motion
def test_velocity_and_acceleration_are_derivatives_of_the_position(motion: type[ProgramMotion]) -> None:
    for example in examples(motion):
        times = times_of(example)
        step = 1e-4 * (example.period or 10.0)
        position, velocity, acceleration = example.at(times)
        size, speed = np.abs(position).max(), np.abs(velocity).max()
        found = derivative(lambda t, example=example: example.at(t)[0], times, step)
        np.testing.assert_allclose(velocity, found, rtol=1e-8, atol=1e-8 * speed + 1e-13 * size / step)
        found = derivative(lambda t, example=example: example.at(t)[1], times, step)
        fastest = np.abs(acceleration).max()
        np.testing.assert_allclose(acceleration, found, rtol=1e-8, atol=1e-8 * fastest + 1e-13 * speed / step)


@every_motion
def test_one_period_is_one_lap_and_no_part_of_it_is(motion: type[ProgramMotion]) -> None:
    for example in examples(motion):
        if example.period is None:
            continue
        assert example.period > 0
        times = times_of(example)
        for now, later in zip(example.at(times), example.at(times + example.period), strict=True):
            np.testing.assert_allclose(later, now, rtol=0, atol=1e-11 * np.abs(now).max())
        for parts in (2, 3, 4, 5):
            now, later = example.at(times)[0], example.at(times + example.period / parts)[0]
            assert np.abs(later - now).max() > 1e-3 * np.abs(now).max(), f"already periodic in 1/{parts} of it"


@every_motion
def test_the_velocity_turns_at_the_turning_rate_where_there_is_one(motion: type[ProgramMotion]) -> None:
    for example in examples(motion):
        if example.turning_rate is None:
            continue
        _, velocity, acceleration = example.at(times_of(example))
        turning = (velocity[0] * acceleration[1] - velocity[1] * acceleration[0]) / (velocity**2).sum(axis=0)
        np.testing.assert_allclose(turning, example.turning_rate, rtol=1e-12)


@every_motion
def test_many_times_at_once_are_the_same_as_one_after_the_other(motion: type[ProgramMotion]) -> None:
    for example in examples(motion):
        times = times_of(example)
        together = example.at(times)
        assert [part.shape for part in together] == [(2, len(times))] * 3
        for i, t in enumerate(times):
            for part, single in zip(together, example.at(float(t)), strict=True):
                np.testing.assert_array_equal(single, part[:, i : i + 1])


@every_motion
def test_motions_are_values_that_travel_to_other_processes(motion: type[ProgramMotion]) -> None:
    for example in examples(motion):
        copy = pickle.loads(pickle.dumps(example))
        assert copy == example
        assert hash(copy) == hash(example)
        np.testing.assert_array_equal(copy.values(), example.values())
        assert example.values().dtype == float


def spoiled(value: Any) -> list[Any]:
    """A number, or the first number of nested tuples, replaced by what is not a finite number."""
    if isinstance(value, tuple) and value:
        return [(bad, *value[1:]) for bad in spoiled(value[0])] + [value[0]]
    if isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool)):
        return [math.nan, math.inf, -math.inf, True, "1.0", 1j]
    return []


@every_motion
def test_what_is_not_a_finite_number_is_refused_by_the_name_of_its_field(motion: type[ProgramMotion]) -> None:
    refused = 0
    for example in examples(motion):
        for field in fields(example):
            for bad in spoiled(getattr(example, field.name)):
                with pytest.raises(InputError, match=field.name):
                    replace(example, **{field.name: bad})
                refused += 1
    assert refused > 0


@given(circle=circles(), t=reals(-100.0, 100.0))
def test_a_circle_is_the_formula_before_equation_4_1(circle: Circle, t: float) -> None:
    angle = circle.rate * t + circle.phase
    towards, along = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    position, velocity, acceleration = (part[:, 0] for part in circle.at(t))
    np.testing.assert_allclose(position, circle.radius * towards, rtol=0, atol=1e-13)
    np.testing.assert_allclose(velocity, circle.radius * circle.rate * along, rtol=0, atol=1e-13)
    np.testing.assert_allclose(acceleration, -circle.radius * circle.rate**2 * towards, rtol=0, atol=1e-13)
    assert circle.period == pytest.approx(2 * math.pi / abs(circle.rate), rel=1e-15)


@given(line=lines(), t=reals(-100.0, 100.0))
def test_a_line_has_constant_velocity_and_no_period(line: Line, t: float) -> None:
    position, velocity, acceleration = (part[:, 0] for part in line.at(t))
    np.testing.assert_allclose(position, [line.start[i] + line.velocity[i] * t for i in (0, 1)], rtol=0, atol=1e-13)
    np.testing.assert_array_equal(velocity, line.velocity)
    np.testing.assert_array_equal(acceleration, [0.0, 0.0])
    assert line.period is None
    assert line.turning_rate is None


@pytest.mark.parametrize("changes", [{"radius": 0.0}, {"radius": -0.7}, {"rate": 0.0}, {"rate": 0}, {"rate": -0.0}])
def test_a_circle_without_size_or_speed_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(InputError, match=r"^Circle: "):
        Circle(**({"radius": 0.7, "rate": -0.4} | changes))
