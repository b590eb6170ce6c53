"""OSQP and CVXPY against the closed form; whatever a solver says, wrong answers do not get through."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import osqp
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occ.allocation import (
    LEAST_NORM,
    Criterion,
    ElectricPower,
    LargestTorque,
    allocate,
    platform_input_map,
)
from occ.allocation.osqp_qp import OsqpAllocator
from occ.allocation.reference import Reference
from occ.allocation.result import question
from occ.model.platform import Platform
from tests.allocation.wrenches import (
    CRITERIA,
    law_samples,
    law_wrenches,
    random_ranges,
    random_rates,
    random_wrenches,
    youbot_map,
)
from tests.strategies import reals, wheeled_platforms


class TestAgreement:
    """Three ways, one answer."""

    @pytest.mark.parametrize("criterion", CRITERIA)
    @pytest.mark.parametrize("limit", [1.0, 0.95])
    def test_on_the_law(self, criterion: Criterion, limit: float) -> None:
        wheels = youbot_map()
        wrench, rates = law_samples(40)
        by_qp = OsqpAllocator(wheels, criterion).allocate(wrench, limit, rates)
        closed = allocate(wheels, wrench, limit, criterion, rates)
        assert not by_qp.failed.any()
        assert np.array_equal(by_qp.reachable, closed.reachable)
        np.testing.assert_allclose(by_qp.torque, closed.torque, atol=1e-8)
        np.testing.assert_allclose(by_qp.excess, closed.excess, atol=1e-12)
        written = Reference(wheels, criterion)
        for k in range(0, 40, 8):
            answer = written.solve(wrench[:, k], limit, rates[:, k])
            assert (answer.torque is not None) == closed.reachable[k]
            if answer.torque is not None:
                value = criterion.value(closed.torque[:, [k]], rates[:, [k]])[0]
                assert answer.value == pytest.approx(value, rel=1e-8)
                np.testing.assert_allclose(answer.torque, closed.torque[:, k], atol=2e-4)

    @pytest.mark.parametrize("criterion", CRITERIA)
    @pytest.mark.parametrize("count", [150, pytest.param(4000, marks=pytest.mark.slow)])
    def test_random_wrenches_within_random_ranges(self, criterion: Criterion, count: int) -> None:
        wheels = youbot_map()
        # A linear programme is hard for OSQP: it takes most of its iterations.
        count = count // 4 if isinstance(criterion, LargestTorque) else count
        wrench, rates = random_wrenches(wheels, 1.0, count, 21), random_rates(count, 22)
        ranges = random_ranges(wheels, count, 23)
        by_qp = OsqpAllocator(wheels, criterion).allocate(wrench, ranges, rates)
        closed = allocate(wheels, wrench, ranges, criterion, rates)
        # Every discrepancy is one that OSQP admits: within its iterations it has shown neither.  Of quadratic
        # programmes these are a few at a kink of the power, or within some 1e-5 N m of the border of reach.
        assert by_qp.failed.mean() < (0.06 if isinstance(criterion, LargestTorque) else 1e-3)
        assert np.array_equal(by_qp.reachable | by_qp.failed, closed.reachable | by_qp.failed)
        both = by_qp.reachable & closed.reachable
        values = [criterion.value(found.torque[:, both], rates[:, both]) for found in (by_qp, closed)]
        np.testing.assert_allclose(values[0], values[1], rtol=1e-7, atol=1e-9)
        written, decided, tried = Reference(wheels, criterion), 0, count // 10
        for k in range(tried):
            answer = written.solve(wrench[:, k], ranges.of(np.array([k])), rates[:, k])
            if np.isnan(answer.value):
                continue  # a range without an inside, which an interior point cannot reach
            assert (answer.torque is not None) == closed.reachable[k]
            decided += 1
            if answer.torque is not None:
                value = criterion.value(closed.torque[:, [k]], rates[:, [k]])[0]
                assert answer.value == pytest.approx(value, rel=1e-6, abs=1e-8)
        assert decided > 0.6 * tried

    @settings(max_examples=5)
    @given(platform=wheeled_platforms(3, 6), limit=reals(0.1, 5.0), seed=st.integers(0, 1000))
    def test_any_wheels_against_cvxpy(self, platform: Platform, limit: float, seed: int) -> None:
        wheels = platform_input_map(platform)
        wrench = random_wrenches(wheels, limit, 10, seed)
        found = OsqpAllocator(wheels).allocate(wrench, limit)
        least = wheels.least_peak(wheels.min_norm @ wrench) / limit
        clear = np.abs(least - 1) > 1e-4
        assert not found.failed[clear].any()
        assert np.array_equal(found.reachable[clear], least[clear] < 1)
        written = Reference(wheels)
        for k in np.flatnonzero(clear)[:3]:
            answer = written.solve(wrench[:, k], limit)
            assert (answer.torque is not None) == found.reachable[k]
            if answer.torque is not None:
                assert answer.value == pytest.approx((found.torque[:, k] ** 2).sum(), rel=1e-7, abs=1e-10)

    def test_multipliers_of_cvxpy_are_certificates_too(self) -> None:
        wheels = youbot_map()
        wrench, rates = law_samples(9)
        for criterion in (LEAST_NORM, ElectricPower(), LargestTorque()):
            written, ranges = Reference(wheels, criterion), question(wheels, wrench, 1.0, criterion, rates)
            for k in range(9):
                answer = written.solve(wrench[:, k], 1.0, rates[:, k])
                assert answer.force is not None
                one = ranges.of(np.array([k]))
                bound = criterion.lower_bound(wheels, one.wrench, one.ranges, one.rates, answer.force[:, None])
                assert bound[0] == pytest.approx(answer.value, rel=1e-6)

    def test_order_of_the_wrenches_does_not_matter(self) -> None:
        # The workspace is warm: what it solved before must not show.
        wrench = random_wrenches(youbot_map(), 1.0, 60, 4)
        forward = OsqpAllocator(youbot_map()).allocate(wrench, 1.0)
        backward = OsqpAllocator(youbot_map()).allocate(wrench[:, ::-1], 1.0)
        assert np.array_equal(forward.reachable, backward.reachable[::-1])
        np.testing.assert_allclose(forward.torque, backward.torque[:, ::-1], atol=1e-9)


class TestLyingSolver:
    """Whatever OSQP says."""

    WRENCH = youbot_map().wrench(np.array([[1.0, 0.2, -0.3, 0.1]]).T) * 1.77

    def answer(self, monkeypatch: pytest.MonkeyPatch, x: Any, y: Any, certificate: Any, wrench: Any = None) -> Any:
        said = SimpleNamespace(x=x, y=y, prim_inf_cert=certificate, info=SimpleNamespace(status="solved"))
        monkeypatch.setattr(osqp.OSQP, "solve", lambda self, raise_error=None: said)
        return OsqpAllocator(youbot_map()).allocate(self.WRENCH if wrench is None else wrench, 1.0)

    def unit(self) -> float:
        """OSQP's variables are torques in units of the largest minimum-norm torque."""
        return float(np.abs(youbot_map().min_norm @ self.WRENCH).max())

    def test_honest_answer(self) -> None:
        assert self.unit() > 1.0
        assert OsqpAllocator(youbot_map()).allocate(self.WRENCH, 1.0).reachable.all()

    def test_point_that_is_not_optimal(self, monkeypatch: pytest.MonkeyPatch) -> None:
        inside = allocate(youbot_map(), self.WRENCH, 0.98).torque[:, 0]
        found = self.answer(monkeypatch, inside / self.unit(), np.zeros(7), None)
        assert found.failed.all()
        assert not found.reachable.any()
        assert np.isnan(found.torque).all()

    def test_point_outside_the_box(self, monkeypatch: pytest.MonkeyPatch) -> None:
        far = (youbot_map().min_norm @ self.WRENCH)[:, 0] + youbot_map().null_torque[:, 0] * 3.0
        assert np.abs(far).max() > 1.0
        assert self.answer(monkeypatch, far / self.unit(), np.zeros(7), None).failed.all()

    def test_point_that_only_names_the_right_wheel(self, monkeypatch: pytest.MonkeyPatch) -> None:
        # From there the solution is found without the solver, and proven.
        right = allocate(youbot_map(), self.WRENCH, 1.0)
        near = right.torque[:, 0] + 3e-6 * youbot_map().null_torque[:, 0]
        found = self.answer(monkeypatch, near / self.unit(), np.zeros(7), None)
        np.testing.assert_allclose(found.torque, right.torque, atol=1e-12)

    @pytest.mark.parametrize("x", [np.full(4, np.nan), None, np.zeros(3)])
    def test_numbers_that_are_none(self, monkeypatch: pytest.MonkeyPatch, x: Any) -> None:
        assert self.answer(monkeypatch, x, np.zeros(7), None).failed.all()

    @pytest.mark.parametrize("certificate", [np.array([1.0, 0, 0, -1, 0, 0, 0]), np.full(7, np.nan), np.zeros(7), None])
    def test_false_certificate(self, monkeypatch: pytest.MonkeyPatch, certificate: Any) -> None:
        found = self.answer(monkeypatch, np.full(4, np.nan), np.full(7, np.nan), certificate)
        assert found.failed.all()
        assert found.excess[0] == 0.0

    def test_certificate_that_proves_nothing_of_a_wrench_out_of_reach(self, monkeypatch: pytest.MonkeyPatch) -> None:
        honest = OsqpAllocator(youbot_map()).allocate(2 * self.WRENCH, 1.0)
        assert honest.wheel[0] >= 0
        assert not honest.failed.any()
        found = self.answer(monkeypatch, np.full(4, np.nan), np.full(7, np.nan), np.zeros(7), 2 * self.WRENCH)
        assert found.failed.all()

    def test_strided_columns_are_not_what_osqp_reads(self) -> None:
        # OSQP takes a strided view for contiguous memory; the allocator hands it rows.
        wrench = np.asfortranarray(law_wrenches(6))
        found = OsqpAllocator(youbot_map(), LargestTorque()).allocate(wrench[:, ::2], 1.0)
        right = allocate(youbot_map(), wrench[:, ::2], 1.0, LargestTorque())
        np.testing.assert_allclose(found.torque, right.torque, atol=1e-9)
