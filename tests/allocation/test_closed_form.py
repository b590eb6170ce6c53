"""The closed form of four wheels against brute force and against its own dual certificates; three wheels; borders."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from occ.allocation import (
    LEAST_NORM,
    Criterion,
    ElectricPower,
    InputMap,
    LargestTorque,
    TorqueRange,
    WeightedNorm,
    allocate,
    input_map,
    platform_input_map,
)
from occ.allocation.allocator import solve
from occ.allocation.ranges import box
from occ.allocation.reach import zonotope
from occ.allocation.residuals import certified, proven_excess
from occ.allocation.result import question
from occ.model.platform import Platform, Wheel
from tests.allocation import wrenches
from tests.allocation.wrenches import (
    by_vertices,
    law_samples,
    law_wrenches,
    random_ranges,
    random_rates,
    random_wrenches,
    skewed_map,
    youbot_map,
)
from tests.strategies import reals, wheeled_platforms

CRITERIA = [*wrenches.CRITERIA, pytest.param(ElectricPower(1e-3), id="almost lossless")]


def nearly_parallel(count: int, angle: float) -> Platform:
    """Three wheels around the platform, and others in one place that differ by an angle [rad]."""

    def wheel(x: float, y: float, axis: float) -> Wheel:
        without = {"mass": 0.0, "spin_inertia": 0.0, "friction": 0.0, "roller_friction": 0.0}
        place = {"position": (x, y), "mounting_angle": axis, "roller_angle": 0.0}
        return Wheel(**place, radius=0.05, roller_radius=0.01, **without)

    around = [wheel(0.5 * math.cos(a), 0.5 * math.sin(a), a + math.pi / 2) for a in 2 * math.pi / 3 * np.arange(3)]
    together = [wheel(0.1, -0.2, 1.0 + i * angle) for i in range(count - 3)]
    return Platform(mass=10.0, mass_center=(0.0, 0.0), yaw_inertia=3.0, wheels=(*around, *together))


class TestBruteForce:
    """Every nu at which anything changes, and the lowest points in between."""

    @pytest.mark.parametrize("criterion", CRITERIA)
    @pytest.mark.parametrize("wheels", [youbot_map(), skewed_map()], ids=["youbot", "skewed"])
    @pytest.mark.parametrize("count", [3000, pytest.param(100_000, marks=pytest.mark.slow)])
    def test_best_torques_within_ranges(self, wheels: InputMap, criterion: Criterion, count: int) -> None:
        wrench, ranges, rates = (
            random_wrenches(wheels, 1.0, count, 1),
            random_ranges(wheels, count, 2),
            random_rates(count, 3),
        )
        found = allocate(wheels, wrench, ranges, criterion, rates)
        assert 0.2 < found.reachable.mean() < 0.9
        for k in range(0, count, 4000):
            few = slice(k, k + 4000)
            best = by_vertices(wheels, wrench[:, few], ranges.of(few), rates[:, few], criterion)
            reachable = found.reachable[few]
            assert np.array_equal(reachable, np.isfinite(best[0]))
            torque, best, own = found.torque[:, few][:, reachable], best[:, reachable], rates[:, few][:, reachable]
            np.testing.assert_allclose(criterion.value(torque, own), criterion.value(best, own), rtol=1e-9, atol=1e-12)
            # A minimum is flat: equal values leave torques open to the root of rounding, and power is flatter still.
            if not isinstance(criterion, ElectricPower):
                np.testing.assert_allclose(torque, best, atol=1e-7)
            assert ranges.of(few).of(reachable).side(torque).any(axis=0).mean() > 0.2

    @settings(max_examples=6)
    @given(platform=wheeled_platforms(4, 4), limit=reals(0.1, 5.0), seed=st.integers(0, 1000))
    def test_any_four_wheels(self, platform: Platform, limit: float, seed: int) -> None:
        wheels = platform_input_map(platform)
        wrench = random_wrenches(wheels, limit, 200, seed)
        found = allocate(wheels, wrench, limit)
        best = by_vertices(wheels, wrench, box(limit, 4), np.zeros((4, 200)), LEAST_NORM)
        assert np.array_equal(found.reachable, np.isfinite(best[0]))
        np.testing.assert_allclose(found.torque, best, atol=1e-8 * limit)

    def test_of_several_best_torques_the_least_norm(self) -> None:
        # Braking: every wheel gives power back for a whole interval of nu, and all of these cost nothing.
        wheels = youbot_map()
        rates = np.full((4, 1), 8.0)
        torque = np.array([[-0.5, -1.0, -0.7, -0.3]]).T
        found = allocate(wheels, wheels.wrench(torque), 5.0, ElectricPower(), rates)
        low, high = ElectricPower().best_null(wheels, wheels.min_norm @ wheels.wrench(torque), rates)
        assert low[0] < 0 < high[0]
        np.testing.assert_allclose(found.torque, wheels.min_norm @ wheels.wrench(torque), atol=1e-15)


class TestCertificates:
    """The dual function at multipliers alone meets the primal value."""

    @pytest.mark.parametrize("criterion", CRITERIA)
    def test_hundred_thousand_wrenches(self, criterion: Criterion) -> None:
        wheels, count = youbot_map(), 100_000
        wrench, ranges = random_wrenches(wheels, 1.0, count, 5), random_ranges(wheels, count, 6)
        rates = random_rates(count, 7)
        asked = question(wheels, wrench, ranges, criterion, rates)
        found = solve(asked)
        assert 0.3 < found.reachable.mean() < 0.7
        assert not found.failed.any()
        proof = certified(asked.of(found.reachable), found.torque[:, found.reachable])
        assert proof.wrench.max() < 1e-12
        assert proof.limits.max() < 1e-8
        assert np.abs(proof.gap).max() < 1e-9
        assert proof.prove.all()

    def test_every_wrench_out_of_reach_is_proven_to_be(self) -> None:
        wheels, count = youbot_map(), 100_000
        wrench, ranges = random_wrenches(wheels, 1.0, count, 5), random_ranges(wheels, count, 6)
        found = allocate(wheels, wrench, ranges)
        out = ~found.reachable
        excess, row = zonotope(wheels).excess(wheels.min_norm @ wrench, ranges)
        normals = zonotope(wheels).normals[row].T
        proven = np.max([proven_excess(wheels, wrench, ranges, side * normals) for side in (-1, 1)], axis=0)
        np.testing.assert_allclose(proven[out], excess[out], rtol=1e-6)
        np.testing.assert_allclose(found.excess[out], excess[out])
        assert proven[out].min() > 0

    @pytest.mark.parametrize("criterion", CRITERIA)
    def test_on_the_law(self, criterion: Criterion) -> None:
        wrench, rates = law_samples(2000)
        asked = question(youbot_map(), wrench, 1.0, criterion, rates)
        found = solve(asked)
        assert found.reachable.all()
        assert certified(asked, found.torque).largest.max() < 1e-9

    @pytest.mark.parametrize("criterion", CRITERIA)
    def test_bound_holds_for_any_multipliers_and_neighbours_are_not_proven(self, criterion: Criterion) -> None:
        wheels = youbot_map()
        wrench, rates = law_samples(200)
        asked = question(wheels, wrench, 1.0, criterion, rates)
        torque = solve(asked).torque
        force = criterion.multipliers(wheels, torque, asked.ranges, rates)
        rng = np.random.default_rng(0)
        value = criterion.value(torque, rates)
        for size in (0.0, 1e-6, 1e-2, 1.0):
            other = force * (1 + size * rng.normal(size=force.shape))
            bound = criterion.lower_bound(wheels, wrench, asked.ranges, rates, other)
            assert np.all(bound <= value * (1 + 1e-12))
        near = torque + 1e-3 * wheels.null_torque
        worse = criterion.value(near, rates) > value * (1 + 1e-6)
        outside = np.abs(near).max(axis=0) > 1.0 + 1e-6
        assert (worse | outside).mean() > 0.1
        assert not certified(asked, near).prove[worse | outside].any()
        assert not certified(asked, near + 1e-6).prove.any()

    def test_not_a_number_proves_nothing(self) -> None:
        asked = question(youbot_map(), law_wrenches(3), 1.0, LEAST_NORM)
        assert not certified(asked, np.full((4, 3), np.nan)).prove.any()
        nothing = proven_excess(asked.wheels, asked.wrench, asked.ranges, np.full((3, 3), np.nan))
        assert np.all(nothing == -np.inf)
        assert np.all(proven_excess(asked.wheels, asked.wrench, asked.ranges, np.zeros((3, 3))) == -np.inf)


class TestPeaks:
    """What the law needs."""

    @pytest.mark.parametrize(("criterion", "peak"), [(LEAST_NORM, 1.230), (LargestTorque(), 0.971)])
    def test_of_the_law(self, criterion: Criterion, peak: float) -> None:
        # mathematics, section 7.
        found = allocate(youbot_map(), law_wrenches(5000), 10.0, criterion)
        assert np.abs(found.torque).max() == pytest.approx(peak, abs=5e-4)

    def test_each_is_best_in_its_own_measure(self) -> None:
        wrench, rates = law_samples(400)
        criteria = [parameter.values[0] for parameter in CRITERIA]
        torques = [allocate(youbot_map(), wrench, 1.0, item, rates).torque for item in criteria]
        for criterion, own in zip(criteria, torques, strict=True):
            for other in torques:
                assert np.all(criterion.value(own, rates) <= criterion.value(other, rates) + 1e-12)
            assert any(criterion.value(own, rates).sum() < criterion.value(other, rates).sum() for other in torques)


class TestReach:
    """Borders, and what lies beyond them."""

    def test_excess_is_what_the_limits_lack(self) -> None:
        wheels = youbot_map()
        wrench = random_wrenches(wheels, 1.0, 60, 2)
        ranges = random_ranges(wheels, 60, 8)
        found = allocate(wheels, wrench, ranges)
        assert np.all(found.excess[found.reachable] == 0.0)
        assert np.all(found.wheel[found.reachable] == -1)
        for k in np.flatnonzero(~found.reachable):
            assert np.isnan(found.torque[:, k]).all()
            own, excess = ranges.of(np.array([k])), found.excess[k]
            for part, enough in ((1 + 1e-6, True), (1 - 1e-6, False)):
                wider = TorqueRange(own.lower - part * excess, own.upper + part * excess)
                assert allocate(wheels, wrench[:, [k]], wider).reachable.all() == enough
            # With just enough the named wheel is on its limit.
            wider = TorqueRange(own.lower - excess, own.upper + excess)
            at_least = allocate(wheels, wrench[:, [k]], wider).torque
            gap = np.minimum(wider.upper - at_least, at_least - wider.lower)[found.wheel[k], 0]
            assert gap == pytest.approx(0.0, abs=1e-8)

    @pytest.mark.parametrize("criterion", CRITERIA)
    def test_limit_exactly_at_the_least_reachable(self, criterion: Criterion) -> None:
        wheels = youbot_map()
        wrench, rates = random_wrenches(wheels, 1.0, 30, 3), random_rates(30, 4)
        for k in range(30):
            least = float(wheels.least_peak(wheels.min_norm @ wrench[:, [k]])[0])
            asked = question(wheels, wrench[:, [k]], least, criterion, rates[:, [k]])
            found = solve(asked)
            assert found.reachable.all()
            assert np.abs(found.torque).max() == pytest.approx(least, rel=1e-12)
            assert certified(asked, found.torque).prove.all()
            assert not allocate(wheels, wrench[:, [k]], least * (1 - 1e-6)).reachable.any()

    def test_no_wrench_needs_no_torque(self) -> None:
        for criterion in (LEAST_NORM, LargestTorque()):
            assert np.all(allocate(youbot_map(), np.zeros((3, 2)), 0.1, criterion).torque == 0.0)
        assert allocate(youbot_map(), np.zeros((3, 0)), 0.1).torque.shape == (4, 0)

    def test_wheel_that_the_null_torque_does_not_move(self) -> None:
        # Wheels 1 to 3 are parallel along X and in balance; wheel 4 alone pushes along Y.
        wheels = input_map(np.array([[1.0, 0, 1], [1, 0, 0], [1, 0, -1], [0, 1, 0]]))
        np.testing.assert_allclose(np.abs(wheels.null_torque[:, 0]), np.array([1, 2, 1, 0]) / 6**0.5, atol=1e-15)
        wrench = np.array([[3.0, 0, 0], [0.5, 1.2, 0.5], [0, 0, 1.0]]).T
        for criterion in (LEAST_NORM, LargestTorque(), ElectricPower()):
            asked = question(wheels, wrench, 1.0, criterion, np.ones((4, 3)))
            found = solve(asked)
            assert found.reachable.tolist() == [True, False, True]
            assert found.wheel.tolist() == [-1, 3, -1]
            assert found.excess[1] == pytest.approx(0.2)
            assert certified(asked.of(found.reachable), found.torque[:, found.reachable]).prove.all()

    @pytest.mark.parametrize("criterion", [LEAST_NORM, LargestTorque(), ElectricPower()])
    def test_three_wheels_have_one_torque(self, criterion: Criterion) -> None:
        angles = np.array([0.5, 2.6, 4.7])
        wheels = input_map(np.column_stack([np.sin(angles), -np.cos(angles), np.full(3, 0.2)]) / 0.05)
        torque = np.array([[1.0, 0.3], [-0.4, 1.3], [0.2, -0.1]])
        asked = question(wheels, wheels.wrench(torque), 1.1, criterion, np.ones((3, 2)))
        found = solve(asked)
        np.testing.assert_allclose(found.torque[:, 0], torque[:, 0], atol=1e-14)
        assert found.reachable.tolist() == [True, False]
        assert found.wheel.tolist() == [-1, 1]
        assert found.excess[1] == pytest.approx(0.2, abs=1e-14)
        assert certified(asked.of(found.reachable), found.torque[:, [0]]).prove.all()


class TestManyWheels:
    """The small quadratic programme, which four wheels can do, too."""

    @pytest.mark.parametrize("criterion", CRITERIA[:4])
    def test_four_wheels_are_the_closed_form(self, criterion: Criterion) -> None:
        wheels, count = skewed_map(), 60
        wrench, rates = random_wrenches(wheels, 1.0, count, 9), random_rates(count, 10)
        ranges = random_ranges(wheels, count, 11)
        asked = question(wheels, wrench, ranges, criterion, rates)
        one, other = solve(asked), asked.answer(criterion.of_many(asked))
        assert np.array_equal(one.reachable, other.reachable)
        np.testing.assert_allclose(one.torque, other.torque, atol=1e-8)

    @settings(max_examples=8)
    @given(platform=wheeled_platforms(5, 7), seed=st.integers(0, 1000))
    # Of nearly parallel wheels the best torques lie at a corner that is as sharp as their angle.
    @example(platform=nearly_parallel(5, 1e-9), seed=6)
    @example(platform=nearly_parallel(6, 1e-10), seed=3)
    @example(platform=nearly_parallel(6, 1e-8), seed=8)
    def test_any_wheels_are_certified(self, platform: Platform, seed: int) -> None:
        wheels = platform_input_map(platform)
        wrench = random_wrenches(wheels, 1.0, 8, seed)
        weight = tuple(np.random.default_rng(seed).uniform(0.2, 3, wheels.wheel_count).tolist())
        rates = wheels.wheel_rates @ np.random.default_rng(seed).normal(size=(3, 8)) * 0.3
        for criterion in (LEAST_NORM, WeightedNorm(weight), LargestTorque(), ElectricPower()):
            asked = question(wheels, wrench, 1.0, criterion, rates)
            found = solve(asked)
            least = wheels.least_peak(wheels.min_norm @ wrench)
            clear = np.abs(least - 1) > 1e-6
            assert np.array_equal(found.reachable[clear], least[clear] < 1)
            assert not found.failed.any()
            proof = certified(asked.of(found.reachable), found.torque[:, found.reachable])
            assert proof.largest.max(initial=0.0) < 1e-9
