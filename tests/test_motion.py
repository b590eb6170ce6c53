"""Contract of program motions: every motion in `MOTIONS` is checked by the examples below.

To add a motion: give it one or more examples in `EXAMPLES`.
"""

from __future__ import annotations

import math
import pickle
from collections import Counter
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from occ.errors import InputError
from occ.motion import MOTIONS, Circle, Ellipse, FigureEight, Line, ProgramMotion, RestToRestLine, SplineMotion
from tests.strategies import circles, ellipses, figure_eights, lines, motions, reals, rest_to_rest_lines, splines

OPEN = SplineMotion(points=((0.1, 0.2), (0.6, 0.4), (1.3, -0.2), (2.0, 0.1)), times=(0.0, 2.0, 3.1, 6.3))
CLOSED = SplineMotion(
    points=((0.5, 0.1), (0.1, 0.7), (-0.6, 0.2), (-0.2, -0.5), (0.5, 0.1)), times=(0.0, 2.0, 4.5, 5.9, 8.0), closed=True
)

EXAMPLES: dict[str, list[ProgramMotion]] = {
    "circle": [Circle(radius=0.7, rate=-0.4, phase=math.pi / 2), Circle(radius=0.3, rate=1.3)],
    "ellipse": [Ellipse(semi_axes=(0.9, 0.5), rate=-0.4, phase=0.3, tilt=0.5), Ellipse(semi_axes=(0.2, 0.6), rate=1.1)],
    "figure_eight": [
        FigureEight(semi_axes=(0.8, 0.4), rate=0.4),
        FigureEight(semi_axes=(0.3, 0.5), rate=-0.9, phase=1),
    ],
    "line": [Line(velocity=(0.3, -0.2), start=(1.0, 2.0)), Line(velocity=(0.0, 0.5))],
    "rest_to_rest": [
        RestToRestLine(start=(0.3, -0.1), end=(1.0, 2.0), duration=6.3),
        RestToRestLine(start=(0.0, 0.0), end=(0.0, -0.5), duration=20.0),
    ],
    "spline": [OPEN, CLOSED, SplineMotion(points=((1.0, 0.0), (0.0, 0.0), (1.0, 0.0)), times=(0, 4, 9))],
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


def pieces(spline: SplineMotion) -> list[list[np.ndarray]]:
    """For each piece the position and its first five derivatives at its begin and end, (2, 2) each.

    A polynomial of degree five is fitted to positions inside the piece only.
    """
    found = []
    for begin, end in zip(spline.times[:-1], spline.times[1:], strict=True):
        nodes = np.cos(np.pi * (np.arange(10) + 0.5) / 10)
        position = spline.at((begin + end) / 2 + (end - begin) / 2 * nodes)[0]
        fits = [np.polynomial.Polynomial.fit(nodes, row, 5, domain=[-1, 1]) for row in position]
        for fit, row in zip(fits, position, strict=True):
            np.testing.assert_allclose(fit(nodes), row, rtol=0, atol=1e-12, err_msg="not a polynomial of degree 5")
        ends = np.array([-1.0, 1.0])
        found.append([np.array([f.deriv(j)(ends) for f in fits]) * (2 / (end - begin)) ** j for j in range(6)])
    return found


def test_knots_are_the_times_at_which_a_derivative_jumps() -> None:
    np.testing.assert_array_equal(OPEN.knots(20.0), [2.0, 3.1, 6.3])
    np.testing.assert_array_equal(OPEN.knots(3.1), [2.0])
    np.testing.assert_allclose(CLOSED.knots(15.0), [2.0, 4.5, 5.9, 8.0, 10.0, 12.5, 13.9], rtol=1e-15)
    np.testing.assert_array_equal(CLOSED.knots(8.0), [2.0, 4.5, 5.9])
    line = RestToRestLine(start=(0.0, 0.0), end=(1.0, 0.0), duration=4.0)
    assert [line.knots(t).tolist() for t in (3.0, 4.0, 5.0)] == [[], [], [4.0]]
    smooth = (*EXAMPLES["circle"], *EXAMPLES["ellipse"], *EXAMPLES["figure_eight"], *EXAMPLES["line"])
    assert all(motion.knots(1e3).size == 0 for motion in smooth)


@given(motion=motions(), start=reals(0.0, 12.0))
def test_velocity_and_acceleration_are_integrated_to_the_motion(motion: ProgramMotion, start: float) -> None:
    # Across knots and ends too; the panels of the quadrature end where a higher derivative jumps.
    end = start + 1.5
    knots = motion.knots(end)
    edges = np.unique([start, end, *np.linspace(start, end, 4), *knots[knots > start]])
    nodes, weights = np.polynomial.legendre.leggauss(12)
    t = (edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2).ravel()
    w = (np.diff(edges)[:, None] * weights / 2).ravel()
    position, velocity, _ = motion.at(np.array([start, end]))
    inside = motion.at(t)
    np.testing.assert_allclose(position[:, 1] - position[:, 0], inside[1] @ w, rtol=0, atol=1e-12)
    np.testing.assert_allclose(velocity[:, 1] - velocity[:, 0], inside[2] @ w, rtol=0, atol=1e-11)


@given(ellipse=ellipses(), t=reals(-100.0, 100.0))
def test_an_ellipse_is_a_sum_of_two_opposite_rotations(ellipse: Ellipse, t: float) -> None:
    # e^(i tilt) (a cos u + i b sin u) = e^(i tilt) ((a + b)/2 e^(iu) + (a - b)/2 e^(-iu)), u = rate t + phase.
    (a, b), w = ellipse.semi_axes, 1j * ellipse.rate
    forth, back = np.exp(w * t + 1j * ellipse.phase), np.exp(-w * t - 1j * ellipse.phase)
    tilt = np.exp(1j * ellipse.tilt)
    for order, part in enumerate(ellipse.at(t)):
        expected = tilt * ((a + b) / 2 * w**order * forth + (a - b) / 2 * (-w) ** order * back)
        np.testing.assert_allclose(part[:, 0], [expected.real, expected.imag], rtol=0, atol=1e-12)
    assert ellipse.period == pytest.approx(2 * math.pi / abs(ellipse.rate), rel=1e-15)
    assert ellipse.turning_rate is None


@given(circle=circles(), t=reals(-50.0, 50.0))
def test_an_ellipse_of_equal_semi_axes_is_a_circle(circle: Circle, t: float) -> None:
    size = (circle.radius, circle.radius)
    ellipse = Ellipse(semi_axes=size, rate=circle.rate, phase=circle.phase - 0.3, tilt=0.3)
    for one, other in zip(ellipse.at(t), circle.at(t), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11)


@given(eight=figure_eights(), t=reals(-100.0, 100.0))
def test_a_figure_eight_is_a_lissajous_figure(eight: FigureEight, t: float) -> None:
    (a, b), w, u = eight.semi_axes, eight.rate, eight.rate * t + eight.phase
    position, velocity, acceleration = (part[:, 0] for part in eight.at(t))
    np.testing.assert_allclose(position, [a * math.sin(u), b * math.sin(2 * u)], rtol=0, atol=1e-12)
    np.testing.assert_allclose(velocity, [a * w * math.cos(u), 2 * b * w * math.cos(2 * u)], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        acceleration, [-a * w**2 * math.sin(u), -4 * b * w**2 * math.sin(2 * u)], rtol=0, atol=1e-12
    )
    # Its implicit equation: (y / (2 b))^2 = (x / a)^2 (1 - (x / a)^2).
    x, y = position[0] / a, position[1] / (2 * b)
    assert y**2 == pytest.approx(x**2 * (1 - x**2), abs=1e-12)
    assert eight.turning_rate is None


def test_the_velocity_of_a_figure_eight_does_not_turn_at_all_over_a_lap() -> None:
    (eight, _) = EXAMPLES["figure_eight"]
    velocity = eight.at(np.linspace(0.0, eight.period or 0.0, 2001))[1]
    direction = np.unwrap(np.arctan2(velocity[1], velocity[0]))
    assert direction[-1] - direction[0] == pytest.approx(0.0, abs=1e-9)
    assert np.ptp(direction) > math.pi


@given(line=rest_to_rest_lines(), later=reals(0.0, 50.0))
def test_a_rest_to_rest_line_rests_at_both_ends_and_outside(line: RestToRestLine, later: float) -> None:
    at_start = np.array([-later, 0.0])
    at_end = np.array([line.duration, line.duration + later])
    for times, where in ((at_start, line.start), (at_end, line.end)):
        position, velocity, acceleration = line.at(times)
        np.testing.assert_allclose(position, np.array([where, where]).T, rtol=0, atol=1e-15 * 4)
        np.testing.assert_allclose(velocity, 0.0, rtol=0, atol=1e-14)
        np.testing.assert_allclose(acceleration, 0.0, rtol=0, atol=1e-13)
    assert line.period is None
    assert line.turning_rate is None


@given(line=rest_to_rest_lines(), share=reals(0.0, 1.0))
def test_a_rest_to_rest_line_is_straight_and_symmetric_in_time(line: RestToRestLine, share: float) -> None:
    way, time = np.subtract(line.end, line.start), share * line.duration
    position, velocity, acceleration = line.at(np.array([time, line.duration - time]))
    for part in (position - np.array(line.start)[:, None], velocity, acceleration):
        np.testing.assert_allclose(way[0] * part[1] - way[1] * part[0], 0.0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(position.sum(axis=1), np.add(line.start, line.end), rtol=0, atol=1e-14)
    np.testing.assert_allclose(velocity[:, 0], velocity[:, 1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(acceleration[:, 0], -acceleration[:, 1], rtol=0, atol=1e-12)
    # The largest speed of 10 u^3 - 15 u^4 + 6 u^5 is 30 / 16, at u = 1/2.
    middle = line.at(line.duration / 2)[1][:, 0]
    np.testing.assert_allclose(middle, 15 / 8 * way / line.duration, rtol=0, atol=1e-13)
    assert np.hypot(*velocity[:, 0]) <= np.hypot(*middle) * (1 + 1e-14)


@given(line=rest_to_rest_lines(), t=reals(-1.0, 10.0))
def test_a_spline_of_two_points_is_the_rest_to_rest_line(line: RestToRestLine, t: float) -> None:
    # Position, velocity and acceleration at both ends determine a polynomial of degree five.
    spline = SplineMotion(points=(line.start, line.end), times=(0.0, line.duration))
    for one, other in zip(spline.at(t), line.at(t), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


@given(spline=splines())
def test_a_spline_passes_its_points_on_time(spline: SplineMotion) -> None:
    points = np.array(spline.points).T
    for laps in (0.0, 3.0) if spline.closed else (0.0,):
        found = spline.at(np.array(spline.times) + laps * spline.times[-1])[0]
        np.testing.assert_allclose(found, points, rtol=0, atol=1e-12)


@given(spline=splines())
def test_a_spline_is_smooth_to_the_fourth_derivative(spline: SplineMotion) -> None:
    found = pieces(spline)
    if spline.closed:
        found.append(found[0])
    for before, after in pairwise(found):
        for order in range(5):
            size = max(1.0, np.abs(before[order]).max(), np.abs(after[order]).max())
            step = after[order][:, 0] - before[order][:, 1]
            assert np.abs(step).max() < 1e-9 * size, f"derivative {order} jumps by {step}"


def test_the_fifth_derivative_of_a_spline_does_jump() -> None:
    # Otherwise the test above might compare a piece with itself.
    for spline in (OPEN, CLOSED):
        found = pieces(spline)
        assert all(np.abs(b[5][:, 0] - a[5][:, 1]).max() > 0.1 for a, b in pairwise(found))


@given(spline=splines())
def test_velocity_and_acceleration_of_a_spline_are_its_derivatives_at_its_knots(spline: SplineMotion) -> None:
    knots = np.array(spline.times if spline.closed else spline.times[1:-1])
    if not knots.size:
        return
    _, velocity, acceleration = spline.at(knots)
    step = 1e-3
    found = derivative(lambda t: spline.at(t)[0], knots, step)
    np.testing.assert_allclose(velocity, found, rtol=0, atol=1e-8)
    # The fourth derivative of the velocity jumps there, so that the differences are of third order only.
    found = derivative(lambda t: spline.at(t)[1], knots, step)
    np.testing.assert_allclose(acceleration, found, rtol=0, atol=1e-6)


@given(spline=splines(closed=False), later=reals(0.0, 20.0))
def test_an_open_spline_rests_at_both_ends_and_outside(spline: SplineMotion, later: float) -> None:
    end = spline.times[-1]
    for times, where in (([-later, 0.0], spline.points[0]), ([end, end + later], spline.points[-1])):
        position, velocity, acceleration = spline.at(np.array(times))
        np.testing.assert_allclose(position, np.array([where, where]).T, rtol=0, atol=1e-12)
        np.testing.assert_allclose(velocity, 0.0, rtol=0, atol=1e-11)
        np.testing.assert_allclose(acceleration, 0.0, rtol=0, atol=1e-10)
    assert spline.period is None


@given(spline=splines(closed=True), t=reals(0.0, 10.0))
def test_a_closed_spline_repeats_itself(spline: SplineMotion, t: float) -> None:
    assert spline.period == spline.times[-1]
    for laps in (-2, 1, 5):
        for now, later in zip(spline.at(t), spline.at(t + laps * spline.period), strict=True):
            np.testing.assert_allclose(later, now, rtol=0, atol=1e-9)


def test_closed_splines_through_points_of_a_circle_approach_it_with_order_six() -> None:
    # de Boor, A Practical Guide to Splines, chapter XIII: the error of a spline of degree k is of order h^(k + 1).
    circle = Circle(radius=1.0, rate=1.0)
    errors = []
    for count in (16, 32):
        times = np.linspace(0.0, circle.period, count + 1)
        points = circle.at(times)[0].T
        points[-1] = points[0]
        spline = SplineMotion(points=points, times=times, closed=True)
        between = np.linspace(0.0, circle.period, 1001)
        errors.append(np.abs(spline.at(between)[0] - circle.at(between)[0]).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.1)


def test_a_spline_has_one_formula_for_all_numbers() -> None:
    other = replace(OPEN, points=((0.0, 0.0), (1.0, 1.0), (2.0, 0.0), (0.0, 0.5)), times=(0.0, 1.0, 2.0, 4.0))
    assert other.structure() == OPEN.structure()
    assert len(other.values()) == len(OPEN.values())
    assert CLOSED.structure() != replace(CLOSED, closed=False).structure()


WAY: dict[str, Any] = {"points": ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0)), "times": (0.0, 1.0, 2.0, 3.0)}
RUN: dict[str, Any] = {"start": (0.0, 0.0), "end": (1.0, 0.0), "duration": 2.0}
OVAL: dict[str, Any] = {"semi_axes": (0.8, 0.4), "rate": 0.4}


@pytest.mark.parametrize(
    ("motion", "valid", "changes", "words"),
    [
        *(
            (cls, OVAL, changes, words)
            for cls in (Ellipse, FigureEight)
            for changes, words in (
                ({"rate": 0.0}, "rate 0 .* positive or negative"),
                ({"rate": -0.0}, "rate 0 .* positive or negative"),
                ({"semi_axes": (0.8, 0.0)}, "semi_axes should be .* greater than 0"),
                ({"semi_axes": (-0.8, 0.4)}, "semi_axes should be .* greater than 0"),
                ({"semi_axes": (0.8,)}, "semi_axes should be a tuple of 2"),
                ({"semi_axes": 0.8}, "semi_axes should be a tuple"),
            )
        ),
        (RestToRestLine, RUN, {"end": (0.0, 0.0)}, "end .* is the start"),
        (RestToRestLine, RUN, {"duration": 0.0}, "duration should be greater than 0"),
        (RestToRestLine, RUN, {"duration": -1.0}, "duration should be greater than 0"),
        (RestToRestLine, RUN, {"end": (1.0, 0.0, 0.0)}, "end should be a tuple of 2"),
        (SplineMotion, WAY, {"points": ((0.0, 0.0),), "times": (0.0,)}, "points should be at least 2"),
        (SplineMotion, WAY, {"points": (), "times": ()}, "points should be at least 2"),
        (SplineMotion, WAY, {"points": ((0.0, 0.0), (0.0, 0.0), (1.0, 1.0), (2.0, 0.0))}, "points 1 and 2 coincide"),
        (SplineMotion, WAY, {"points": ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (2.0,))}, "points should be a tuple"),
        (SplineMotion, WAY, {"points": (0.0, 1.0, 2.0, 3.0)}, "points should be a tuple"),
        (SplineMotion, WAY, {"times": (0.0, 1.0, 2.0)}, "times should be 4 numbers.* not 3"),
        (SplineMotion, WAY, {"times": (0.5, 1.0, 2.0, 3.0)}, "times should begin with 0 s, not 0.5"),
        (SplineMotion, WAY, {"times": (0.0, 2.0, 1.0, 3.0)}, "times should increase .* number 3 is 1.0 s after 2.0 s"),
        (SplineMotion, WAY, {"times": (0.0, 1.0, 1.0, 3.0)}, "times should increase .* number 3"),
        (SplineMotion, WAY, {"times": (0.0, 1e-9, 1.0, 1e3)}, "times should be spaced more evenly"),
        (SplineMotion, WAY, {"times": (0.0, 1e-300, 1.0, 1e300)}, "times should be spaced more evenly"),
        (SplineMotion, WAY, {"closed": 1}, "closed should be true or false, not 1"),
        (SplineMotion, WAY, {"closed": "yes"}, "closed should be true or false"),
        (
            SplineMotion,
            WAY | {"closed": True},
            {"points": (*WAY["points"][:3], (0.0, 0.1))},
            "points of a closed spline should end with the first",
        ),
        (
            SplineMotion,
            WAY | {"closed": True},
            {"points": ((0.0, 0.0), (1.0, 0.0), (0.0, 0.0)), "times": (0.0, 1.0, 2.0)},
            "points should be at least 4 for a closed spline, not 3",
        ),
    ],
)
def test_motions_that_cannot_be_are_refused_by_name(
    motion: type[ProgramMotion], valid: dict[str, Any], changes: dict[str, Any], words: str
) -> None:
    motion(**valid)
    with pytest.raises(InputError, match=f"^{motion.__name__}: {words}"):
        motion(**(valid | changes))
