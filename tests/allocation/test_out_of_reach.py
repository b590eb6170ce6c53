"""Wrenches out of reach: the closest one, priorities and scaling, against certificates and CVXPY; the zonotope."""

from __future__ import annotations

from itertools import product
from typing import Any, get_args

import cvxpy as cp
import numpy as np
import pytest

from occ.allocation import Allocator, InputMap, LargestTorque, TorqueRange, allocate, input_map
from occ.allocation.criteria import LEAST_NORM
from occ.allocation.least_distance import least_distance
from occ.allocation.out_of_reach import Rule, nearest_wrench
from occ.allocation.ranges import box
from occ.allocation.reach import corners, zonotope
from occ.model.dynamics import dynamics
from occ.model.presets import youbot
from occ.task import Limits
from tests.allocation.wrenches import random_wrenches, youbot_map

INERTIA = np.array(dynamics(youbot()).coefficients.inertia)
RULES = get_args(Rule)


def six_wheels() -> InputMap:
    return input_map(np.random.default_rng(1).normal(size=(6, 3)) * [20.0, 20.0, 6.0])


def doubled_wheels() -> InputMap:
    """Two pairs of wheels that pull alike, so that facets have more than two free wheels."""
    return input_map(np.vstack([youbot_map().wheel_rates, youbot_map().wheel_rates[:2]]))


def out_of_reach(wheels: InputMap, count: int) -> tuple[np.ndarray, TorqueRange]:
    """Wrenches that random unsymmetric ranges cannot make."""
    rng = np.random.default_rng(7)
    shape = wheels.wheel_count, 4 * count
    ranges = TorqueRange(-rng.uniform(0.2, 2.0, shape), rng.uniform(0.2, 2.0, shape))
    wrench = random_wrenches(wheels, 1.5, 4 * count, 8)
    out = np.flatnonzero(~allocate(wheels, wrench, ranges).reachable)[:count]
    assert len(out) == count
    return wrench[:, out], ranges.of(out)


WHEELS = [pytest.param(m(), id=m.__name__) for m in (youbot_map, six_wheels, doubled_wheels)]


class TestRules:
    """Each does what it says."""

    @pytest.mark.parametrize("rule", RULES)
    @pytest.mark.parametrize("wheels", WHEELS)
    def test_result_is_on_the_border_of_reach(self, wheels: InputMap, rule: Rule) -> None:
        wrench, ranges = out_of_reach(wheels, 40)
        moved = nearest_wrench(wheels, wrench, ranges, rule, INERTIA)
        found = allocate(wheels, moved, ranges)
        assert found.reachable.all()
        excess, _ = zonotope(wheels).excess(wheels.min_norm @ moved, ranges)
        np.testing.assert_allclose(excess, 0.0, atol=1e-9)

    @pytest.mark.parametrize("wheels", WHEELS)
    def test_closest_is_certified_by_a_separating_plane(self, wheels: InputMap) -> None:
        # |Pi' - Pi| >= (w Pi - max of w over the zonotope) / |w| for every w; w = A^-1 (Pi - Pi') makes it equal.
        wrench, ranges = out_of_reach(wheels, 40)
        moved = nearest_wrench(wheels, wrench, ranges, "closest", INERTIA)
        inverse = np.linalg.inv(INERTIA)
        plane = inverse @ (wrench - moved)
        rows = wheels.wheel_rates @ plane
        most = (np.where(rows > 0, ranges.upper, ranges.lower) * rows).sum(axis=0)
        bound = ((plane * wrench).sum(axis=0) - most) / np.sqrt((plane * (INERTIA @ plane)).sum(axis=0))
        distance = np.sqrt(((wrench - moved) * plane).sum(axis=0))
        np.testing.assert_allclose(bound, distance, rtol=1e-9, atol=1e-11)

    @pytest.mark.parametrize("rule", ["translation_first", "rotation_first", "scale"])
    @pytest.mark.parametrize("wheels", WHEELS[:2])
    def test_priorities_by_cvxpy(self, wheels: InputMap, rule: Rule) -> None:
        wrench, ranges = out_of_reach(wheels, 6)
        moved = nearest_wrench(wheels, wrench, ranges, rule, INERTIA)
        first, then = (slice(0, 2), slice(2, 3)) if rule == "translation_first" else (slice(2, 3), slice(0, 2))
        for k in range(6):
            torque = cp.Variable(wheels.wheel_count)
            made = wheels.wheel_rates.T @ torque
            within: list[Any] = [torque <= ranges.upper[:, k], torque >= ranges.lower[:, k]]
            size = float(np.abs(wrench[:, k]).max())
            if rule == "scale":
                share = cp.Variable()
                best = cp.Problem(cp.Maximize(share), [*within, made == share * wrench[:, k]]).solve(solver=cp.CLARABEL)
                np.testing.assert_allclose(moved[:, k], best * wrench[:, k], atol=1e-6 * size)
                continue
            for part, fixed in ((first, []), (then, [cp.norm(made[first] - moved[first, k]) <= 1e-7 * size])):
                goal = cp.Minimize(cp.norm(made[part] - wrench[part, k]))
                best = cp.Problem(goal, [*within, *fixed]).solve(solver=cp.CLARABEL)
                assert np.linalg.norm(moved[part, k] - wrench[part, k]) == pytest.approx(best, abs=1e-5 * size)

    def test_what_comes_first_is_kept_where_it_can_be(self) -> None:
        wheels, limit = youbot_map(), 1.0
        force_only = np.array([[30.0], [5.0], [0.0]])
        wrench = force_only + np.array([[0.0], [0.0], [60.0]])
        kept = nearest_wrench(wheels, wrench, box(limit, 4), "translation_first", INERTIA)
        np.testing.assert_allclose(kept[:2], wrench[:2], atol=1e-12)
        assert 0 < kept[2, 0] < 60.0
        moment_only = np.array([[300.0], [50.0], [12.0]])
        kept = nearest_wrench(wheels, moment_only, box(limit, 4), "rotation_first", INERTIA)
        assert kept[2, 0] == pytest.approx(12.0, abs=1e-12)
        scaled = nearest_wrench(wheels, wrench, box(limit, 4), "scale", INERTIA)
        np.testing.assert_allclose(np.cross(scaled[:, 0], wrench[:, 0]), 0.0, atol=1e-10)

    @pytest.mark.parametrize("rule", RULES)
    def test_nearly_parallel_wheels(self, rule: Rule) -> None:
        rng = np.random.default_rng(2)
        for angle in (1e-10, 1e-9, 1e-8, 1e-6):
            rows = rng.normal(size=(6, 3)) * [20.0, 20.0, 6.0]
            rows[5] = rows[4] + angle * rows[0]
            wrench, ranges = out_of_reach(input_map(rows), 10)
            moved = nearest_wrench(input_map(rows), wrench, ranges, rule, INERTIA)
            assert allocate(input_map(rows), moved, ranges).reachable.all()

    def test_scaling_that_reaches_nothing(self) -> None:
        # Wheels that have to brake cannot make a small wrench.
        ranges = TorqueRange(np.full((4, 1), 0.5), np.full((4, 1), 1.0))
        wrench = np.array([[-10.0], [0.0], [0.0]])
        assert np.isnan(nearest_wrench(youbot_map(), wrench, ranges, "scale", INERTIA)).all()
        assert np.isfinite(nearest_wrench(youbot_map(), wrench, ranges, "closest", INERTIA)).all()


class TestAllocator:
    """Both stages, in and out of reach."""

    @pytest.mark.parametrize("criterion", [LEAST_NORM, LargestTorque()])
    @pytest.mark.parametrize("rule", RULES)
    def test_limits_are_always_held_and_reachable_wrenches_kept(self, rule: Rule, criterion: Any) -> None:
        wheels = youbot_map()
        wrench = random_wrenches(wheels, 1.0, 200, 3)
        rates = np.random.default_rng(4).normal(size=(4, 200)) * 6
        limits = Limits(torque=1.0, wheel_power=6.0, stall_torque=3.0, no_load_speed=30.0)
        allocator = Allocator(wheels, limits, criterion, rule, INERTIA)
        min_norm = wheels.min_norm @ wrench
        torque = allocator.torque(min_norm, rates)
        assert np.abs(torque).max() <= 1.0
        assert np.abs(torque * rates).max() <= 6.0 * (1 + 1e-12)
        assert np.abs(torque / 3.0 + rates / 30.0).max() <= 1.0 + 1e-12
        reachable = allocate(wheels, wrench, allocator.ask(min_norm, rates).ranges).reachable
        assert 0.2 < reachable.mean() < 0.8
        made = wheels.wrench(torque)
        np.testing.assert_allclose(made[:, reachable], wrench[:, reachable], atol=1e-9)
        assert np.abs(made - wrench).max(axis=0)[~reachable].min() > 1e-6

    def test_without_a_rule_the_wrench_is_kept_and_the_limit_is_not(self) -> None:
        wheels = youbot_map()
        wrench = random_wrenches(wheels, 1.0, 50, 3)
        min_norm = wheels.min_norm @ wrench
        torque = Allocator(wheels, Limits(torque=1.0), LEAST_NORM, None, INERTIA).torque(min_norm, np.zeros((4, 50)))
        out = ~allocate(wheels, wrench, 1.0).reachable
        np.testing.assert_allclose(wheels.wrench(torque), wrench, atol=1e-9)
        assert np.array_equal(torque[:, out], min_norm[:, out])
        assert np.abs(torque[:, out]).max(axis=0).min() > 1.0


class TestZonotope:
    """Facets and corners against all combinations of limits."""

    @pytest.mark.parametrize("wheels", WHEELS)
    def test_facets_support_the_corners(self, wheels: InputMap) -> None:
        _, ranges = out_of_reach(wheels, 3)
        normals, offsets = zonotope(wheels).halfspaces(ranges)
        for k in range(3):
            ends = np.column_stack([ranges.lower[:, k], ranges.upper[:, k]])
            points = wheels.wrench(np.array(list(product(*ends))).T)
            np.testing.assert_allclose((normals @ points).max(axis=1), offsets[:, k], atol=1e-12)
            drawn = corners(wheels, ranges, k)
            # Every facet holds at least a triangle of the corners.
            touching = np.abs(normals @ drawn - offsets[:, [k]]) < 1e-9
            assert touching.sum(axis=1).min() >= 3

    def test_reach_of_the_youbot_along_its_axes(self) -> None:
        # All four wheels pull along X; C_phi has 1/R there: F_X at most 4 L / R.
        drawn = corners(youbot_map(), box(2.0, 4))
        assert drawn[0].max() == pytest.approx(4 * 2.0 / 0.0475, rel=1e-12)
        assert drawn[2].max() == pytest.approx(4 * 2.0 * (0.15 + 0.235) / 0.0475, rel=1e-12)


class TestLeastDistance:
    """The small programme behind it."""

    def test_known_answers(self) -> None:
        x, u = least_distance(np.array([[-1.0, 0.0], [0.0, 1.0]]), np.array([-2.0, 1.0]))
        np.testing.assert_allclose(x, [2.0, 0.0], atol=1e-15)
        np.testing.assert_allclose(u, [2.0, 0.0], atol=1e-15)
        x, _ = least_distance(np.array([[-1.0, -1.0], [0.0, 1.0]]), np.array([-3.0, 1.0]))
        np.testing.assert_allclose(x, [2.0, 1.0], atol=1e-14)
        x, _ = least_distance(np.eye(2), np.array([1.0, 0.0]))
        assert np.all(x == 0.0)

    def test_nothing_satisfies_a_contradiction(self) -> None:
        x, u = least_distance(np.array([[1.0], [-1.0]]), np.array([-1.0, -1.0]))
        assert x is None
        # A certificate: a combination of the rows that vanishes and whose right side is negative.
        assert u[0] - u[1] == pytest.approx(0.0, abs=1e-12)
        assert -u.sum() < 0
