"""The pieces of the criteria: slopes that balance, and what each says of itself to the solvers."""

from __future__ import annotations

import numpy as np
import pytest

from occ.allocation import ElectricPower, WeightedNorm, allocate
from occ.allocation.criteria.slopes import balanced, normal_slope
from occ.allocation.least_norm import least_norm
from occ.allocation.ranges import box
from occ.allocation.residuals import certified
from occ.allocation.result import question
from tests.allocation.wrenches import youbot_map


class TestBalance:
    """Slopes within their intervals that a null torque does not feel."""

    @staticmethod
    def intervals(wheels: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Around the slopes of a random multiplier: points, pieces and rays, several of each in one sample."""
        rng = np.random.default_rng(wheels)
        null = np.linalg.qr(rng.normal(size=(wheels, wheels - 3)))[0]
        slope = rng.normal(size=(wheels, count))
        slope -= null @ (null.T @ slope)
        room = rng.choice([0.0, 0.3, 2.0, np.inf], (2, wheels, count), p=[0.4, 0.15, 0.15, 0.3])
        return np.stack([slope - room[0], slope + room[1]]), null

    def test_of_four_wheels(self) -> None:
        (low, high), null = self.intervals(4, 5000)
        # Several wheels at their limits, which all pull the same way, are among them.
        assert ((np.isinf(high) & (null > 0)).sum(axis=0) >= 2).mean() > 0.05
        found = balanced(low, high, null[:, 0])
        assert np.all((found >= low - 1e-14) & (found <= high + 1e-14))
        np.testing.assert_allclose(null[:, 0] @ found, 0.0, atol=1e-13)

    def test_which_of_several_wheels_at_their_limits_is_taken_does_not_matter(self) -> None:
        # In the reverse order another wheel takes what is lacking: other multipliers, which give the same bound.
        wheels, norm = youbot_map(), WeightedNorm((1.0, 1.0, 9.0, 9.0))
        torque = np.array([[1.0, 1.0, 0.6, 0.6]]).T
        ranges, wrench = box(1.0, 4), wheels.wrench(torque)
        low, high = norm.slopes(torque, torque)
        high = np.where(torque == 1.0, np.inf, high)
        null = wheels.null_torque[:, 0]
        one, other = balanced(low, high, null), balanced(low[::-1], high[::-1], null[::-1])[::-1]
        assert np.abs(one - other)[:2].min() > 1.0
        for slope in (one, other):
            force = -wheels.min_norm.T @ slope
            np.testing.assert_allclose(wheels.wheel_rates @ force, -slope, atol=1e-12)
            bound = norm.lower_bound(wheels, wrench, ranges, torque, force)
            np.testing.assert_allclose(bound, norm.value(torque, torque), rtol=1e-14)

    def test_of_six_wheels(self) -> None:
        (low, high), null = self.intervals(6, 150)
        basis = np.linalg.svd(null.T)[2][3:].T
        for k in range(150):
            found = normal_slope(low[:, k], high[:, k], basis)
            assert np.all((found >= low[:, k] - 1e-14) & (found <= high[:, k] + 1e-14))
            np.testing.assert_allclose(null.T @ found, 0.0, atol=1e-13)

    def test_no_slopes_where_the_intervals_contradict_each_other(self) -> None:
        # By hand: g = Q mu with two equal rows, of which one should be 1 and the other 2.
        basis = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0, 0, 1.0]]) / [1, 1, 2**0.5]
        one = np.array([0.0, 0.0, 1.0, 2.0])
        assert np.all(normal_slope(one, one, basis) == 0.0)

    def test_two_wheels_at_their_limits_share_what_is_lacking(self) -> None:
        # By hand: n = (1, 1, -1, -1)/2; wheels 3 and 4 are dear, so that 1 and 2 are driven to 1 N m together.
        wheels, norm = youbot_map(), WeightedNorm((1.0, 1.0, 9.0, 9.0))
        torque = np.array([[1.0, 1.0, 0.6, 0.6]]).T
        asked = question(wheels, wheels.wrench(torque), 1.0, norm)
        found = allocate(wheels, wheels.wrench(torque), 1.0, norm)
        np.testing.assert_allclose(found.torque, torque, atol=1e-14)
        assert certified(asked, found.torque).prove.all()


def test_least_norm_leaves_a_wheel_that_nothing_moves() -> None:
    null, one = np.array([[1.0], [0.0]]), np.ones(2)
    found = least_norm(null, np.array([0.5, 0.9]), -one, one, one, 1e-9)
    np.testing.assert_allclose(found, [0.0, 0.9], atol=1e-15)
    assert np.isnan(least_norm(null, np.array([0.5, 1.1]), -one, one, one, 1e-9)).all()


@pytest.mark.parametrize("criterion", [WeightedNorm((1.0, 4.0, 0.3, 2.0)), ElectricPower(), ElectricPower(0.1)])
def test_programme_has_the_value_of_the_criterion(criterion: WeightedNorm | ElectricPower) -> None:
    # For electric power with the least distance d of each wheel from its idle interval.
    rng = np.random.default_rng(5)
    torque, rates, unit = rng.normal(size=(4, 50)), rng.normal(size=(4, 50)) * 6, rng.uniform(0.5, 2, 50)
    programme = criterion.programme(rates, unit)
    z = torque / unit
    if isinstance(criterion, ElectricPower):
        idle = np.sort([np.zeros_like(rates), -rates / criterion.loss / unit], axis=0)
        z = np.vstack([z, np.maximum(z - idle[1], idle[0] - z).clip(0.0)])
    within = programme.rows @ z
    assert np.all((within >= programme.low - 1e-12) & (within <= programme.high + 1e-12))
    value = (programme.quadratic[:, None] * z**2).sum(axis=0) / 2 + (programme.linear * z).sum(axis=0)
    np.testing.assert_allclose(value * programme.value_unit, criterion.value(torque, rates), rtol=1e-12)
