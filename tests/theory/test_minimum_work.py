"""The least work on the circle: published values, dynamic programming, and what any infimum must satisfy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline

from occ.atlas.least_work import least_work_columns
from occ.atlas.points import Points
from occ.errors import InputError, Status
from occ.laws.base import yaw_motion
from occ.laws.servo import ServoLaw
from occ.model.presets import YouBot, youbot
from occ.motion import Circle
from occ.referee.reference import servo_end_state
from occ.task import Start, Task
from occ.theory.better_laws import SlowManifold
from occ.theory.dissipation import CircleEnergy, energy_of
from occ.theory.dynamic_programming import DynamicProgram, least_work
from occ.theory.extremals import NoExtremal, Problem, to_fixed_end, to_free_end
from occ.theory.minimum_work import LeastWork, least_work_fixed_end, minimum_work
from occ.theory.optimal_heading import optimal_heading
from occ.theory.quadrature import FINE, Well
from occ.theory.trigonometric import TURN, derivative, value
from tests.tasks import LAP, paper_task

QUICK = (1, 8, 9)
"""Random tasks with a short horizon."""
RETURN = DynamicProgram(steps=20, points=480)


@pytest.mark.parametrize(("duration", "expected"), [(LAP, 200.327119033710), (30.0, 377.321044772185)])
def test_published_infimum_of_the_free_end(duration: float, expected: float) -> None:
    # The last printed digit is of the order of rounding in a sum of terms of 250 J.
    assert minimum_work(paper_task(duration=duration)).work == pytest.approx(expected, rel=2e-14)


@pytest.mark.parametrize("rate", [-0.6, -0.3])
def test_root_that_is_hit_exactly_is_an_extremal(rate: float) -> None:
    # The time taken equals the horizon to the last bit here, where a root finder stops without closing its bracket.
    motion = Circle(radius=0.2, rate=rate, phase=math.pi / 2)
    task = replace(paper_task(), motion=motion, duration=2 * math.pi / abs(rate))
    assert minimum_work(task).work == pytest.approx(minimum_work(replace(task, duration=task.duration + 1e-9)).work)


@pytest.mark.parametrize("seed", [308, 894])
def test_returns_that_wait_at_a_barrier_are_found_on_both_sides(seed: int) -> None:
    # Over three laps the motion all but rests near a minimum of U, so closely that rounding hides how closely: there
    # and back at the level of that minimum, and waiting, is what it costs.
    task = random_task(seed)
    energy = energy_of(task.platform, task.point, task.motion)
    start, duration = task.start.heading - task.motion.phase, 3 * TURN / abs(task.motion.rate)
    well = Well(float(energy.friction), energy.power, (start,))
    ((minimum, bottom),) = zip(well.minima, well.bottoms, strict=True)
    expected = []
    for barrier in (minimum - TURN * math.ceil((minimum - start) / TURN), start + (minimum - start) % TURN):
        way, _ = quad(
            lambda x: 2 * math.sqrt(float(energy.friction) * max(float(value(energy.power, x)) - bottom, 0.0)),
            *sorted((start, barrier)),
            epsabs=1e-12,
            epsrel=1e-12,
        )
        expected.append(2 * way + bottom * duration)
    found = to_fixed_end(Problem(well, start, duration), start)
    assert sorted(way.action for way in found) == pytest.approx(sorted(expected), rel=1e-9)
    assert all(len(way.places) == 3 for way in found)


@pytest.mark.parametrize(("seed", "laps"), [(1092, 3), (1631, 3), (1730, 2)])
def test_no_return_from_a_wait_at_a_minimum_of_the_power_costs_less(seed: int, laps: int) -> None:
    task = random_task(seed)
    task = replace(task, duration=laps * TURN / abs(task.motion.rate))
    energy = energy_of(task.platform, task.point, task.motion)
    start = task.start.heading - task.motion.phase
    well, least = Well(float(energy.friction), energy.power), minimum_work(task, end="periodic").work
    ways = [
        (place + TURN * (k + math.ceil((start - place) / TURN)), bottom)
        for place, bottom in zip(well.minima, well.bottoms, strict=True)
        for k in (-1, 0)
    ]
    waits = []
    for place, bottom in ways:
        h = np.array([1e-9 * np.abs(energy.power).sum() - bottom])
        if (value(energy.power, np.linspace(start, place, 400)) + h > 0).all():
            ends = np.array([start]), np.array([place])
            (time,), (length,) = well.integrals(ends, h, tuple(value(energy.power, x) + h for x in ends), FINE)
            # There and back, and waiting at the level of U for what is left.
            waits.append(2 * (length - h[0] * time) + bottom * (task.duration - 2 * time))
            assert 2 * time < task.duration
    assert waits
    assert least <= min(waits) * (1 + 1e-12)


def shot_backwards(energy: CircleEnergy, slope: np.ndarray, ends: np.ndarray, duration: float) -> np.ndarray:
    """Angle at the start, and number of turning points, of ways that end with transversality, by integration."""
    friction, force = float(energy.friction), derivative(energy.power)

    def rate(state: np.ndarray) -> np.ndarray:
        return np.array([-state[1], -value(force, state[0]) / (2 * friction)])

    state = np.array([ends, -value(slope, ends) / (2 * friction)])
    steps = max(400, int(40 * duration))
    h, turns, sign = duration / steps, np.zeros(len(ends)), np.sign(state[1])
    for _ in range(steps):
        k_1 = rate(state)
        k_2 = rate(state + h / 2 * k_1)
        k_3 = rate(state + h / 2 * k_2)
        state = state + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + rate(state + h * k_3))
        turns += np.sign(state[1]) != sign
        sign = np.sign(state[1])
    return np.array([state[0], turns])


SHOTS = 3000
"""Ends on one turn."""


@pytest.mark.parametrize("seed", [1, 22, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 10, 12, 14, 19))])
def test_shooting_finds_the_same_extremals(seed: int) -> None:
    # Over such horizons ways to neighbouring ends of the grid do not part too far.  By symmetry under full turns each
    # end of one turn stands for an end in every cell.
    task = random_task(seed)
    energy = energy_of(task.platform, task.point, task.motion)
    slope = end_slope(energy)
    start = task.start.heading - task.motion.phase
    well = Well(float(energy.friction), energy.power, (start,))
    cells = np.arange(-4, 4)
    found = to_free_end(Problem(well, start, task.duration), slope, cells)
    ends = start + np.linspace(0, TURN, SHOTS + 1)
    first, turns = shot_backwards(energy, slope, ends, task.duration)
    shot = []
    for k in cells:
        # The way to the end in cell k begins at the start when the one to its image begins k turns below.
        miss = first + TURN * k - start
        (crossing,) = np.nonzero((miss[1:] > 0) != (miss[:-1] > 0))
        crossing = crossing[(turns[crossing] <= 1) & (turns[crossing + 1] <= 1)]
        shot += ((ends[crossing] + ends[crossing + 1]) / 2 + TURN * k).tolist()
    # Each in the step of the grid in which the angle at the start passes the given one, and no other.
    assert sorted(way.places[-1] for way in found) == pytest.approx(sorted(shot), abs=0.51 * TURN / SHOTS)


def test_two_extremals_close_together_are_both_found() -> None:
    # Between two points of the search the time falls below the horizon and rises above it again.
    task = random_task(1813)
    energy = energy_of(task.platform, task.point, task.motion)
    slope = end_slope(energy)
    start = task.start.heading - task.motion.phase
    well = Well(float(energy.friction), energy.power, (start,))
    ends = np.linspace(-4.36, -4.22, 281)
    miss = shot_backwards(energy, slope, ends, task.duration)[0] - start
    (crossing,) = np.nonzero((miss[1:] > 0) != (miss[:-1] > 0))
    found = [way.places[-1] for way in to_free_end(Problem(well, start, task.duration), slope, np.arange(-1, 1))]
    inside = sorted(end for end in found if ends[0] < end < ends[-1])
    assert len(inside) == 2
    assert inside == pytest.approx((ends[crossing] + ends[crossing + 1]) / 2, abs=0.51 * (ends[1] - ends[0]))


def end_slope(energy: CircleEnergy) -> np.ndarray:
    """(5,) [J/rad] of what a free end costs."""
    slope = derivative(energy.rest_of_yaw) + 2 * energy.drag
    slope[0] += 2 * energy.friction * energy.rate
    return slope


def random_task(seed: int) -> Task:
    """Any circle, point, friction, start and horizon from 0.3 to 1.5 laps."""
    random = np.random.default_rng(seed)
    scale = 10 ** random.uniform(-1.0, 0.5)
    preset = YouBot()
    platform = YouBot(
        wheel_friction=preset.wheel_friction * scale * random.uniform(0.5, 2.0),
        roller_friction=preset.roller_friction * scale,
    ).platform()
    rate = random.choice([-1, 1]) * 10 ** random.uniform(-1.0, 0.0)
    return Task(
        platform=platform,
        point=tuple(random.uniform(-0.5, 0.5, 2)),
        motion=Circle(radius=10 ** random.uniform(-1.0, 0.2), rate=rate, phase=random.uniform(-3.0, 3.0)),
        duration=random.uniform(0.3, 1.5) * TURN / abs(rate),
        start=Start(heading=random.uniform(-3.0, 3.0), heading_rate=random.uniform(-1.0, 1.0)),
    )


def by_dynamic_programming(task: Task) -> float:
    steps, largest = int(30 + 3 * task.duration), 6 * abs(task.motion.rate) + 1
    found = least_work(task, DynamicProgram(steps=steps, points=300, largest_rate=largest))
    if found.error > 3e-6:
        # Its own estimate says that the angles are too few for this task.
        found = least_work(task, DynamicProgram(steps=steps, points=900, largest_rate=largest))
    return found.work


@pytest.mark.parametrize("seed", QUICK)
def test_dynamic_programming_finds_no_less(seed: int) -> None:
    task = random_task(seed)
    assert minimum_work(task).work == pytest.approx(by_dynamic_programming(task), rel=3e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [seed for seed in range(24) if seed not in QUICK])
def test_dynamic_programming_finds_no_less_on_many_tasks(seed: int) -> None:
    task = random_task(seed)
    assert minimum_work(task).work == pytest.approx(by_dynamic_programming(task), rel=3e-6)


def test_end_of_the_law_by_two_methods() -> None:
    task = paper_task()
    state = servo_end_state(task)
    exact = minimum_work(task, end="law", end_state=state).work
    assert exact == pytest.approx(least_work(task, RETURN, (state[2], state[5])).work, rel=1e-7)


@pytest.mark.parametrize("winding", [0, -1])
def test_return_to_the_start_by_two_methods(winding: int) -> None:
    task = paper_task()
    exact = minimum_work(task, end="periodic", winding=winding).work
    assert exact == pytest.approx(least_work(task, RETURN, (TURN * winding, 0.0)).work, rel=1e-7)


def test_least_over_windings_is_the_least() -> None:
    task = paper_task()
    each = [minimum_work(task, end="periodic", winding=k).work for k in range(-3, 3)]
    assert minimum_work(task, end="periodic").work == min(each)


def test_cycle_is_the_least_return_over_all_starts() -> None:
    task = paper_task()
    for winding in (-1, 0):
        cycle = minimum_work(task, end="periodic", winding=winding, free_start=True).work
        starts = np.linspace(-3.0, 3.0, 13)
        returns = [
            minimum_work(replace(task, start=Start(heading=float(x))), end="periodic", winding=winding).work
            for x in starts
        ]
        assert min(returns) >= cycle - 1e-9 * cycle
    # A steady rotation is a cycle; the best of them is the best one here.
    energy = energy_of(task.platform, task.point, task.motion)
    steady = float(value(energy.power, np.linspace(0, TURN, 100_001)).min()) * LAP
    assert minimum_work(task, end="periodic", winding=-1, free_start=True).work == pytest.approx(steady, rel=1e-8)


@pytest.mark.parametrize(("radius", "duration"), [(0.7, LAP), (0.3, LAP), (0.7, 300.0), (0.55, 60.0)])
def test_free_end_is_the_least_over_all_ends(radius: float, duration: float) -> None:
    task = paper_task(duration=duration, radius=radius)
    energy = energy_of(task.platform, task.point, task.motion)
    free = minimum_work(task)

    def ending_at(x: float) -> LeastWork:
        kinetic = free.start_kinetic_energy, float(value(energy.rest_of_yaw, x))
        return least_work_fixed_end(energy, places[0], x, kinetic, duration)

    places = free.extremal.places
    assert ending_at(places[-1]).work == pytest.approx(free.work, rel=1e-12)
    for step in (-TURN, -3.0, -1.0, -0.1, -1e-3, 1e-3, 0.1, 1.0, 3.0, TURN):
        assert ending_at(places[-1] + step).work > free.work


def test_the_law_needs_more() -> None:
    for duration, gap in ((LAP, "0.5305"), (30.0, "0.3796")):
        task = paper_task(duration=duration)
        energy = energy_of(task.platform, task.point, task.motion)
        motion, _ = yaw_motion(ServoLaw(), task, 1e-11)
        nodes, weights = np.polynomial.legendre.leggauss(600)
        t = duration / 2 * (1 + nodes)
        heading, yaw_rate, _ = motion(t)
        angle = heading - task.motion.phase - task.motion.rate * t
        work = duration / 2 * float(weights @ energy.dissipation(angle, yaw_rate))
        last, _, _ = motion(np.array([duration])), None, None
        end = last[0, 0] - task.motion.phase - task.motion.rate * duration
        work += float(energy.kinetic_energy(end, last[1, 0]) - energy.kinetic_energy(-math.pi / 2, 0.0))
        least = minimum_work(task).work
        assert 100 * (work / least - 1) == pytest.approx(float(gap), abs=5e-5)


@pytest.mark.parametrize(("radius", "duration"), [(0.7, LAP), (0.7, 30.0), (0.3, 40.0)])
@pytest.mark.parametrize("to_law", [False, True])
def test_optimal_heading_needs_the_least_work(radius: float, duration: float, to_law: bool) -> None:
    task = paper_task(duration=duration, radius=radius)
    state = servo_end_state(task)
    best = minimum_work(task, end="law", end_state=state) if to_law else minimum_work(task)
    motion = optimal_heading(task, best.extremal, state[5] if to_law else None, per_piece=401)
    keep = np.insert(np.diff(motion.t) > 1e-9, 0, True)
    t, heading, yaw_rate = motion.t[keep], motion.heading[keep], motion.yaw_rate[keep]
    assert t[0] == 0
    assert t[-1] == pytest.approx(duration, rel=1e-8)
    # The heading's spline through the places and its own derivative, not the formula for the yaw rate.
    spline = CubicHermiteSpline(t, heading, yaw_rate)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    fine = t[:-1, None] + np.diff(t)[:, None] * (1 + nodes) / 2
    energy = energy_of(task.platform, task.point, task.motion)
    angle = spline(fine) - task.motion.phase - task.motion.rate * fine
    dissipation = energy.dissipation(angle, spline(fine, 1)) @ weights / 2 @ np.diff(t)
    work = dissipation + best.end_kinetic_energy - best.start_kinetic_energy
    assert work == pytest.approx(best.work, rel=1e-6)
    before, after = motion.yaw_rate[0] - motion.jump_at_start, motion.yaw_rate[-1] + motion.jump_at_end
    assert energy.kinetic_energy(best.extremal.places[0], before) == pytest.approx(best.start_kinetic_energy, rel=1e-9)
    assert energy.kinetic_energy(best.extremal.places[-1], after) == pytest.approx(best.end_kinetic_energy, rel=1e-9)


def test_first_jump_of_the_yaw_rate_is_free_and_the_infimum_is_far_below_without_its_price() -> None:
    # Only the kinetic energy at the start enters: a higher yaw rate there is paid back in full.
    task = paper_task()
    faster = replace(task, start=Start(heading=0.0, heading_rate=1.0))
    energy = energy_of(task.platform, task.point, task.motion)
    paid = float(energy.kinetic_energy(-math.pi / 2, 1.0) - energy.kinetic_energy(-math.pi / 2, 0.0))
    assert minimum_work(task).work - minimum_work(faster).work == pytest.approx(paid, rel=1e-10)


def test_frictionless_platform_gives_back_all_but_the_least_kinetic_energy() -> None:
    platform = YouBot(wheel_friction=0.0, roller_friction=0.0).platform()
    task = paper_task(platform=platform)
    energy = energy_of(platform, task.point, task.motion)
    lowest = float(value(energy.rest_of_yaw, np.linspace(0, TURN, 200_001)).min())
    start = float(energy.kinetic_energy(-math.pi / 2, 0.0))
    assert minimum_work(task).work == pytest.approx(lowest - start, rel=1e-8)


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="whole number of laps"):
        minimum_work(paper_task(duration=10.0), end="periodic")
    with pytest.raises(InputError, match="not 'rest'"):
        minimum_work(paper_task(), end="rest")
    with pytest.raises(InputError, match="turns"):
        minimum_work(paper_task(duration=1e6, rate=4.0, radius=0.1))


def test_a_search_that_finds_nothing_is_said_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("to_free_end", "to_fixed_end"):
        monkeypatch.setattr(f"occ.theory.minimum_work.{name}", lambda *_: [])
    task = paper_task()
    with pytest.raises(NoExtremal, match=r"from psi~ = -1\.5708 rad to a free end in 15\.708 s"):
        minimum_work(task)
    with pytest.raises(NoExtremal, match=r"to psi~ = -7\.85398 rad"):
        minimum_work(task, "periodic", winding=-2)
    with pytest.raises(NoExtremal, match="no extremal was found"):
        minimum_work(task, "periodic", winding=-2, free_start=True)
    # Who asks for it on the way to something else goes on without it.
    assert SlowManifold().solve(task).status is Status.OK
    points = Points(4, youbot().parameters()[None], np.zeros(1, int), np.array([[0.4], [0.05]]), *np.ones((6, 1)))
    columns, ((number, reason),) = least_work_columns(points)
    assert np.isnan(columns["least_work_J"]).all()
    assert (number, "no extremal was found" in reason) == (0, True)
