"""Closed form, OSQP, CVXPY and enumeration agree; proofs prove; bad input and bad solvers are caught."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import osqp
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occ.allocation import closed_form, input_map, platform_input_map, reference
from occ.allocation.osqp_qp import BoxLimitedQp
from occ.allocation.residuals import proven_peak, residuals
from occ.errors import InputError
from occ.model.platform import Platform
from tests.allocation.wrenches import by_enumeration, law_wrenches, random_wrenches, youbot_map
from tests.strategies import reals, wheeled_platforms


class TestInputMap:
    """The wheel set alone."""

    def test_null_torque_of_the_paper(self) -> None:
        # mathematics, section 2: n = (1, 1, -1, -1).
        (null,) = youbot_map().null_torque.T
        np.testing.assert_allclose(null / null[0], [1, 1, -1, -1], atol=1e-14)

    def test_least_peak_of_the_paper(self) -> None:
        # With n = (1, 1, -1, -1) two wheels bind: max over pairs of |m_i n_j - m_j n_i| / 2.
        m = youbot_map().min_norm @ random_wrenches(youbot_map(), 1.0, 50, 0)
        n = np.array([1, 1, -1, -1])
        pairs = [abs(m[i] * n[j] - m[j] * n[i]) / 2 for i in range(4) for j in range(i)]
        np.testing.assert_allclose(youbot_map().least_peak(m), np.max(pairs, axis=0), rtol=1e-13)

    @settings(max_examples=8)
    @given(platform=wheeled_platforms(3, 6), seed=st.integers(0, 1000))
    def test_least_peak_is_the_linear_programme(self, platform: Platform, seed: int) -> None:
        wheels = platform_input_map(platform)
        wrench = random_wrenches(wheels, 1.0, 2, seed)
        for k in range(2):
            least = wheels.least_peak(wheels.min_norm @ wrench)[k]
            assert reference.least_peak(wheels, wrench[:, k]) == pytest.approx(least, rel=1e-6)

    @settings(max_examples=8)
    @given(platform=wheeled_platforms(3, 6), seed=st.integers(0, 1000))
    def test_no_torque_has_a_smaller_peak(self, platform: Platform, seed: int) -> None:
        wheels = platform_input_map(platform)
        rng = np.random.default_rng(seed)
        torque = rng.uniform(-1, 1, (wheels.wheel_count, 500))
        assert np.all(wheels.least_peak(torque) <= np.abs(torque).max(axis=0) * (1 + 1e-12))

    def test_peaks_of_the_law(self) -> None:
        # mathematics, section 7: minimum norm needs 1.230, min-max allocation 0.971.
        m = youbot_map().min_norm @ law_wrenches(629)
        assert np.abs(m).max() == pytest.approx(1.2297, abs=5e-5)
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
    def test_bad_wheel_sets(self, rates: np.ndarray, words: str) -> None:
        with pytest.raises(InputError, match=words):
            input_map(rates)


class TestClosedForm:
    """Three and four wheels."""

    def test_against_enumeration(self) -> None:
        wheels = youbot_map()
        wrench = np.hstack([law_wrenches(100) * 1.1, random_wrenches(wheels, 1.1, 1500, 1)])
        found = closed_form.allocate(wheels, wrench, 1.1)
        assert 0.2 < found.reachable.mean() < 0.95
        clipped = 0
        for k in range(wrench.shape[1]):
            best = by_enumeration(wheels, wrench[:, k], 1.1)
            assert found.reachable[k] == (best is not None)
            if best is not None:
                np.testing.assert_allclose(found.torque[:, k], best, atol=1e-12)
                clipped += not np.allclose(best, wheels.min_norm @ wrench[:, k])
        assert clipped > 50

    @settings(max_examples=15)
    @given(platform=wheeled_platforms(4, 4), limit=reals(0.1, 5.0), seed=st.integers(0, 1000))
    def test_any_four_wheels_against_enumeration(self, platform: Platform, limit: float, seed: int) -> None:
        wheels = platform_input_map(platform)
        wrench = random_wrenches(wheels, limit, 40, seed)
        found = closed_form.allocate(wheels, wrench, limit)
        for k in range(40):
            best = by_enumeration(wheels, wrench[:, k], limit)
            assert found.reachable[k] == (best is not None)
            if best is not None:
                np.testing.assert_allclose(found.torque[:, k], best, atol=1e-9 * limit)

    def test_makes_the_wrench_within_the_limit_and_nothing_else_is_smaller(self) -> None:
        wheels = youbot_map()
        wrench = law_wrenches(200)
        found = closed_form.allocate(wheels, wrench, 1.0)
        assert found.reachable.all()
        np.testing.assert_allclose(wheels.wrench(found.torque), wrench, atol=1e-12 * np.abs(wrench).max())
        assert np.abs(found.torque).max() <= 1.0 + 1e-15
        for nu in np.linspace(-1.5, 1.5, 301):
            other = wheels.min_norm @ wrench + nu * wheels.null_torque
            fits = np.abs(other).max(axis=0) <= 1.0
            assert np.all((other**2).sum(axis=0)[fits] >= (found.torque**2).sum(axis=0)[fits] - 1e-12)

    def test_excess_is_what_the_limit_lacks(self) -> None:
        wheels = youbot_map()
        wrench = random_wrenches(wheels, 1.0, 300, 2)
        found = closed_form.allocate(wheels, wrench, 1.0)
        assert np.all(found.excess[found.reachable] == 0.0)
        assert np.all(found.wheel[found.reachable] == -1)
        for k in np.flatnonzero(~found.reachable)[:60]:
            assert np.isnan(found.torque[:, k]).all()
            enough = 1.0 + found.excess[k]
            assert closed_form.allocate(wheels, wrench[:, [k]], enough * (1 + 1e-8)).reachable.all()
            assert not closed_form.allocate(wheels, wrench[:, [k]], enough * (1 - 1e-6)).reachable.any()
            # With the least sufficient limit the named wheel is on it.
            at_least = closed_form.allocate(wheels, wrench[:, [k]], enough).torque[:, 0]
            assert abs(at_least[found.wheel[k]]) == pytest.approx(enough, rel=1e-9)

    def test_limit_exactly_at_the_least_reachable(self) -> None:
        wheels = youbot_map()
        wrench = random_wrenches(wheels, 1.0, 50, 3)
        for k in range(50):
            least = float(wheels.least_peak(wheels.min_norm @ wrench[:, [k]])[0])
            found = closed_form.allocate(wheels, wrench[:, [k]], least)
            assert found.reachable.all()
            assert np.abs(found.torque).max() == pytest.approx(least, rel=1e-12)
            assert closed_form.proven(wheels, wrench[:, [k]], found.torque, least).all()

    def test_no_wrench_needs_no_torque(self) -> None:
        assert np.all(closed_form.allocate(youbot_map(), np.zeros((3, 2)), 0.1).torque == 0.0)
        assert np.all(BoxLimitedQp(youbot_map(), 0.1).allocate(np.zeros((3, 2))).torque == 0.0)
        assert closed_form.allocate(youbot_map(), np.zeros((3, 0)), 0.1).torque.shape == (4, 0)

    def test_wheel_that_the_null_torque_does_not_move(self) -> None:
        # Wheels 1 to 3 are parallel along X and in balance; wheel 4 alone pushes along Y.
        wheels = input_map(np.array([[1.0, 0, 1], [1, 0, 0], [1, 0, -1], [0, 1, 0]]))
        np.testing.assert_allclose(np.abs(wheels.null_torque[:, 0]), np.array([1, 2, 1, 0]) / 6**0.5, atol=1e-15)
        found = closed_form.allocate(wheels, np.array([[3.0, 0, 0], [0.5, 1.2, 0.5], [0, 0, 1.0]]).T, 1.0)
        assert found.reachable.tolist() == [True, False, True]
        assert found.wheel.tolist() == [-1, 3, -1]
        assert found.excess[1] == pytest.approx(0.2)

    def test_three_wheels_have_one_torque(self) -> None:
        angles = np.array([0.5, 2.6, 4.7])
        wheels = input_map(np.column_stack([np.sin(angles), -np.cos(angles), np.full(3, 0.2)]) / 0.05)
        torque = np.array([[1.0, 0.3], [-0.4, 1.3], [0.2, -0.1]])
        found = closed_form.allocate(wheels, wheels.wrench(torque), 1.1)
        np.testing.assert_allclose(found.torque[:, 0], torque[:, 0], atol=1e-14)
        assert found.reachable.tolist() == [True, False]
        assert found.wheel.tolist() == [-1, 1]
        assert found.excess[1] == pytest.approx(0.2, abs=1e-14)


class TestOsqp:
    """Any number of wheels."""

    def test_agrees_on_the_law(self) -> None:
        wheels = youbot_map()
        wrench = law_wrenches(60)
        for limit in (1.2, 1.0, 0.95):
            by_qp = BoxLimitedQp(wheels, limit).allocate(wrench)
            closed = closed_form.allocate(wheels, wrench, limit)
            assert not by_qp.failed.any()
            assert np.array_equal(by_qp.reachable, closed.reachable)
            np.testing.assert_allclose(by_qp.torque, closed.torque, atol=1e-9)
            np.testing.assert_allclose(by_qp.excess, closed.excess, atol=1e-12)
            for k in range(0, 60, 12):
                written = reference.least_norm(wheels, wrench[:, k], limit)
                assert (written is not None) == closed.reachable[k]
                if written is not None:
                    np.testing.assert_allclose(written, closed.torque[:, k], atol=2e-5)

    @settings(max_examples=12)
    @given(platform=wheeled_platforms(3, 6), limit=reals(0.1, 5.0), seed=st.integers(0, 1000))
    def test_any_wheels_against_cvxpy(self, platform: Platform, limit: float, seed: int) -> None:
        wheels = platform_input_map(platform)
        wrench = random_wrenches(wheels, limit, 12, seed)
        found = BoxLimitedQp(wheels, limit).allocate(wrench)
        least = wheels.least_peak(wheels.min_norm @ wrench) / limit
        clear = np.abs(least - 1) > 1e-4
        assert not found.failed[clear].any()
        assert np.array_equal(found.reachable[clear], least[clear] < 1)
        if wheels.wheel_count <= 4:
            both = found.reachable & clear
            closed = closed_form.allocate(wheels, wrench, limit)
            np.testing.assert_allclose(found.torque[:, both], closed.torque[:, both], atol=1e-8 * limit)
        for k in np.flatnonzero(clear)[:3]:
            written = reference.least_norm(wheels, wrench[:, k], limit)
            assert (written is not None) == found.reachable[k]
            if written is not None:
                assert (written**2).sum() == pytest.approx((found.torque[:, k] ** 2).sum(), rel=1e-5, abs=1e-9)

    def test_order_of_the_wrenches_does_not_matter(self) -> None:
        # The workspace is warm: what it solved before must not show.
        wrench = random_wrenches(youbot_map(), 1.0, 80, 4)
        forward = BoxLimitedQp(youbot_map(), 1.0).allocate(wrench)
        backward = BoxLimitedQp(youbot_map(), 1.0).allocate(wrench[:, ::-1])
        assert np.array_equal(forward.reachable, backward.reachable[::-1])
        np.testing.assert_allclose(forward.torque, backward.torque[:, ::-1], atol=1e-9)


class TestProof:
    """Residuals know right from wrong."""

    def found(self) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        wheels, wrench = youbot_map(), law_wrenches(60)
        torque = closed_form.allocate(wheels, wrench, 1.0).torque
        force, bound = closed_form.multipliers(wheels, torque, 1.0)
        return wheels, wrench, torque, force, bound

    def test_multipliers_of_the_closed_form_prove_it(self) -> None:
        wheels, wrench, torque, force, bound = self.found()
        assert (np.abs(bound).max(axis=0) > 0.1).sum() > 40
        for k in range(60):
            kkt = residuals(wheels, wrench[:, k], 1.0, torque[:, k], force[:, k], bound[:, k])
            assert kkt.largest(1.0) < 1e-12
        assert closed_form.proven(wheels, wrench, torque, 1.0).all()

    def test_dual_objective_is_a_lower_bound_of_every_torque(self) -> None:
        wheels, wrench, torque, force, bound = self.found()
        rng = np.random.default_rng(0)
        for k in range(0, 60, 6):
            wrong = residuals(
                wheels,
                wrench[:, k],
                1.0,
                torque[:, k],
                force[:, k] + rng.normal(size=3) * 0.01,
                bound[:, k] + rng.normal(size=4) * 0.1,
            )
            assert wrong.gap > 0
            assert not wrong.prove(1.0)

    @pytest.mark.parametrize("size", [1e-7, 1e-3])
    def test_neighbours_are_not_proven(self, size: float) -> None:
        wheels, wrench, torque, force, bound = self.found()
        k = 40
        for direction in (*np.eye(4), wheels.null_torque[:, 0]):
            near = torque[:, k] + size * direction
            assert not residuals(wheels, wrench[:, k], 1.0, near, force[:, k], bound[:, k]).prove(1.0)
            assert not closed_form.proven(wheels, wrench[:, [k]], near[:, None], 1.0).any()

    def test_not_a_number_proves_nothing(self) -> None:
        wheels, wrench, torque, force, bound = self.found()
        assert not residuals(wheels, wrench[:, 0], 1.0, torque[:, 0] * np.nan, force[:, 0], bound[:, 0]).prove(1.0)
        assert proven_peak(wheels, wrench[:, 0], np.full(3, np.nan)) == 0.0
        assert proven_peak(wheels, wrench[:, 0], np.zeros(3)) == 0.0

    def test_no_certificate_proves_more_than_the_least_peak(self) -> None:
        wheels, wrench, *_ = self.found()
        least = wheels.least_peak(wheels.min_norm @ wrench)
        rng = np.random.default_rng(1)
        for k in range(0, 60, 6):
            forces = rng.normal(size=(200, 3)) * [1, 1, 0.3]
            assert max(proven_peak(wheels, wrench[:, k], w) for w in forces) <= least[k] * (1 + 1e-12)


class TestLyingSolver:
    """Whatever OSQP says, wrong answers do not get through."""

    WRENCH = youbot_map().wrench(np.array([[1.0, 0.2, -0.3, 0.1]]).T) * 1.77

    def answer(self, monkeypatch: pytest.MonkeyPatch, x: Any, y: Any, certificate: Any, status: str) -> Any:
        said = SimpleNamespace(
            x=x,
            y=y,
            prim_inf_cert=certificate,
            info=SimpleNamespace(status=status, status_val=1 if x is not None else 3),
        )
        qp = BoxLimitedQp(youbot_map(), 1.0)
        monkeypatch.setattr(osqp.OSQP, "solve", lambda self, raise_error=None: said)
        return qp.allocate(self.WRENCH)

    def test_honest_answer(self) -> None:
        minimum = youbot_map().min_norm @ self.WRENCH
        assert np.abs(minimum).max() > 1.0
        assert BoxLimitedQp(youbot_map(), 1.0).allocate(self.WRENCH).reachable.all()

    def test_point_that_is_not_optimal(self, monkeypatch: pytest.MonkeyPatch) -> None:
        wheels = youbot_map()
        inside = closed_form.allocate(wheels, self.WRENCH, 0.98).torque[:, 0]
        assert np.abs(inside).max() < 1.0
        found = self.answer(monkeypatch, inside, np.zeros(7), None, "solved")
        assert found.failed.all()
        assert not found.reachable.any()
        assert np.isnan(found.torque).all()

    def test_point_outside_the_box(self, monkeypatch: pytest.MonkeyPatch) -> None:
        minimum = (youbot_map().min_norm @ self.WRENCH)[:, 0]
        assert self.answer(monkeypatch, 0.8 * minimum, np.zeros(7), None, "solved").failed.all()

    def test_point_that_only_names_the_right_wheel(self, monkeypatch: pytest.MonkeyPatch) -> None:
        # From there the solution is found without the solver, and proven.
        minimum = (youbot_map().min_norm @ self.WRENCH)[:, 0]
        found = self.answer(monkeypatch, minimum, np.zeros(7), None, "solved")
        right = closed_form.allocate(youbot_map(), self.WRENCH, 1.0)
        np.testing.assert_allclose(found.torque, right.torque, atol=1e-12)

    @pytest.mark.parametrize("x", [np.full(4, np.nan), None, np.zeros(3)])
    def test_numbers_that_are_none(self, monkeypatch: pytest.MonkeyPatch, x: Any) -> None:
        assert self.answer(monkeypatch, x, np.zeros(7), None, "solved").failed.all()

    def test_false_certificate(self, monkeypatch: pytest.MonkeyPatch) -> None:
        for certificate in (np.array([1.0, 0, 0, -1, 0, 0, 0]), np.full(7, np.nan), np.zeros(7), None):
            found = self.answer(monkeypatch, np.full(4, np.nan), np.full(7, np.nan), certificate, "primal infeasible")
            assert found.failed.all()
            assert found.excess[0] == 0.0

    def test_certificate_that_proves_nothing_of_a_wrench_out_of_reach(self, monkeypatch: pytest.MonkeyPatch) -> None:
        qp = BoxLimitedQp(youbot_map(), 1.0)
        assert qp.allocate(2 * self.WRENCH).wheel[0] >= 0
        assert not qp.allocate(2 * self.WRENCH).failed.any()
        nothing = SimpleNamespace(x=np.full(4, np.nan), y=np.full(7, np.nan), prim_inf_cert=np.zeros(7))
        monkeypatch.setattr(osqp.OSQP, "solve", lambda self, raise_error=None: nothing)
        assert qp.allocate(2 * self.WRENCH).failed.all()


class TestBadInput:
    """Each refused with the name of what is wrong."""

    @pytest.mark.parametrize("limit", [0.0, -1.0, np.nan, np.inf, True, "1", None])
    def test_limits(self, limit: Any) -> None:
        with pytest.raises(InputError, match="limit"):
            closed_form.allocate(youbot_map(), np.zeros((3, 1)), limit)
        with pytest.raises(InputError, match="limit"):
            BoxLimitedQp(youbot_map(), limit)
        with pytest.raises(InputError, match="limit"):
            reference.least_norm(youbot_map(), np.zeros(3), limit)

    @pytest.mark.parametrize(
        ("wrench", "words"),
        [
            (np.zeros(3), "shape"),
            (np.zeros((4, 2)), "shape"),
            (np.array([[0.0, 0], [0, np.nan], [0, 0]]), "sample 1"),
            (np.array([[np.inf], [0], [0]]), "finite"),
            ([[1, 2], [3]], "numbers"),
            ([["a"], ["b"], ["c"]], "numbers"),
        ],
    )
    def test_wrenches(self, wrench: Any, words: str) -> None:
        for allocate in (
            lambda: closed_form.allocate(youbot_map(), wrench, 1.0),
            lambda: BoxLimitedQp(youbot_map(), 1.0).allocate(wrench),
        ):
            with pytest.raises(InputError, match=words):
                allocate()

    def test_closed_form_of_five_wheels(self) -> None:
        wheels = input_map(np.vstack([youbot_map().wheel_rates, [20.0, 0.0, 3.0]]))
        with pytest.raises(InputError, match="not 5"):
            closed_form.allocate(wheels, np.zeros((3, 1)), 1.0)
