"""The wheel set alone: null torque, least possible largest torque, and wheel sets that cannot be meant."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occ.allocation import LargestTorque, input_map, platform_input_map
from occ.allocation.reference import Reference
from occ.model.platform import Platform
from tests.allocation.wrenches import law_wrenches, random_wrenches, youbot_map
from tests.strategies import wheeled_platforms


def test_null_torque_of_the_paper() -> None:
    # mathematics, section 2: n = (1, 1, -1, -1).
    (null,) = youbot_map().null_torque.T
    np.testing.assert_allclose(null / null[0], [1, 1, -1, -1], atol=1e-14)


def test_least_peak_of_the_paper() -> None:
    # With n = (1, 1, -1, -1) two wheels bind: max over pairs of |m_i n_j - m_j n_i| / 2.
    m = youbot_map().min_norm @ random_wrenches(youbot_map(), 1.0, 50, 0)
    n = np.array([1, 1, -1, -1])
    pairs = [abs(m[i] * n[j] - m[j] * n[i]) / 2 for i in range(4) for j in range(i)]
    np.testing.assert_allclose(youbot_map().least_peak(m), np.max(pairs, axis=0), rtol=1e-13)


@settings(max_examples=4)
@given(platform=wheeled_platforms(3, 6), seed=st.integers(0, 1000))
def test_least_peak_is_the_linear_programme(platform: Platform, seed: int) -> None:
    wheels = platform_input_map(platform)
    wrench = random_wrenches(wheels, 1.0, 2, seed)
    written = Reference(wheels, LargestTorque())
    for k in range(2):
        least = wheels.least_peak(wheels.min_norm @ wrench)[k]
        assert written.solve(wrench[:, k], 1e3).value == pytest.approx(least, rel=1e-7)


@settings(max_examples=8)
@given(platform=wheeled_platforms(3, 6), seed=st.integers(0, 1000))
def test_no_torque_has_a_smaller_peak(platform: Platform, seed: int) -> None:
    wheels = platform_input_map(platform)
    rng = np.random.default_rng(seed)
    torque = rng.uniform(-1, 1, (wheels.wheel_count, 500))
    assert np.all(wheels.least_peak(torque) <= np.abs(torque).max(axis=0) * (1 + 1e-12))


def test_peaks_of_the_law() -> None:
    # mathematics, section 7: minimum norm needs 1.230, min-max allocation 0.971.
    m = youbot_map().min_norm @ law_wrenches(629)
    assert np.abs(m).max() == pytest.approx(1.230, abs=5e-4)
    assert youbot_map().least_peak(m).max() == pytest.approx(0.971, abs=5e-4)


@pytest.mark.parametrize(
    ("rates", "words"),
    [
        (np.ones((4, 2)), "shape"),
        (np.eye(3)[:2], "at least 3"),
        (np.full((4, 3), np.nan), "finite"),
        (np.outer([1, 2, 3, 4], [1, 2, 3]), "rank 3"),
    ],
)
def test_bad_wheel_sets(rates: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        input_map(rates)
    assert "\n" not in str(caught.value)
