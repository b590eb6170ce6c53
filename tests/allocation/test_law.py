"""The law with allocated torques before the referee: same motion, same work, limits held or refused with the reason."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.optimize import brentq, minimize_scalar

from occ.allocation import (
    BoxQp,
    Copper,
    Electric,
    ElectricPower,
    MinMax,
    MinNorm,
    Weighted,
    platform_input_map,
    realised,
)
from occ.allocation.out_of_reach import Rule
from occ.allocation.realised import change_times, peak_times
from occ.errors import Status
from occ.laws import PrescribedRotation, ServoLaw
from occ.model.platform import Platform, Wheel
from occ.model.presets import youbot
from occ.referee import examine, judge
from occ.task import Limits, Task
from tests.tasks import LAP, paper_task

BOX = ServoLaw(allocation=BoxQp())


def limited(torque: float, **overrides: Any) -> Task:
    return paper_task(limits=Limits(torque=torque), **overrides)


def omni(count: int) -> Platform:
    """Omni wheels all around."""
    angles = 0.3 + 2 * np.pi * np.arange(count) / count
    wheels = tuple(
        Wheel(
            position=(0.3 * np.cos(a), 0.25 * np.sin(a)),
            mounting_angle=a + np.pi / 2 + 0.1 * i,
            roller_angle=0.0,
            radius=0.05,
            roller_radius=0.01,
            mass=1.0,
            spin_inertia=0.003,
            friction=0.05,
        )
        for i, a in enumerate(angles)
    )
    return Platform(mass=20.0, mass_center=(0.02, 0.01), yaw_inertia=2.5, wheels=wheels)


@pytest.fixture(scope="module")
def minimum() -> dict[str, float]:
    """Measures of the law with its torques of minimum norm."""
    return judge(paper_task(), ServoLaw().solve(paper_task())).measures


class TestSameWork:
    """pi'^T Pi does not know how the wrench is shared."""

    @pytest.mark.parametrize("limit", [1.0])
    def test_of_every_allocation(self, minimum: dict[str, float], limit: float) -> None:
        record = judge(limited(limit), BOX.solve(limited(limit)))
        assert record.status is Status.OK, record.message
        m = record.measures
        assert m["work_J"] == pytest.approx(minimum["work_J"], rel=1e-9)
        assert m["torque_squared_N2m2s"] > minimum["torque_squared_N2m2s"] + 1e-3
        assert m["peak_torque_Nm"] == pytest.approx(limit, rel=1e-9)
        assert m["limit_excess"] == 0.0
        assert m["velocity_error_m_s"] < 1e-9

    def test_torque_squared_is_minimum_norm_plus_nu_squared(self, minimum: dict[str, float]) -> None:
        # |M|^2 = |M_min|^2 + nu^2; nu by hand: n = (1, 1, -1, -1)/2 and the one wheel over the limit is brought to it.
        limit = 1.1
        solution = ServoLaw().solve(paper_task())
        replay = examine(paper_task(), solution).replay
        assert replay is not None

        def peak(t: float) -> float:
            return float(np.abs(replay.sample(np.array([t])).torque).max()) - limit

        grid = np.linspace(0, LAP, 400)
        over = np.array([peak(t) for t in grid]) > 0
        edges = [brentq(peak, grid[k], grid[k + 1], xtol=1e-13) for k in np.flatnonzero(over[1:] != over[:-1])]
        assert len(edges) == 1
        extra, _ = quad_vec(lambda t: np.array([4 * peak(t) ** 2]), edges[0], LAP, epsabs=1e-12)
        box = BOX.solve(limited(limit))
        assert box.control is not None
        np.testing.assert_allclose(box.control.knots, edges, atol=1e-7)
        found = judge(limited(limit), box).measures["torque_squared_N2m2s"]
        assert found - minimum["torque_squared_N2m2s"] == pytest.approx(extra[0], rel=1e-8)

    def test_claim_is_the_same_motion(self) -> None:
        one, other = ServoLaw().solve(paper_task()).claimed, BOX.solve(limited(1.0)).claimed
        assert one is not None
        assert other is not None
        assert np.array_equal(one.state, other.state)

    def test_other_laws_take_it_too(self) -> None:
        free = judge(paper_task(4.0), PrescribedRotation(rate="program").solve(paper_task(4.0))).measures
        limit = 0.9 * free["peak_torque_Nm"]
        task = limited(limit, duration=4.0)
        assert judge(task, PrescribedRotation(rate="program").solve(task)).status is Status.INFEASIBLE
        record = judge(task, PrescribedRotation(rate="program", allocation=BoxQp()).solve(task))
        assert record.status is Status.OK, record.message
        assert record.measures["work_J"] == pytest.approx(free["work_J"], rel=1e-9)


class TestOutOfReach:
    """Infeasible with wheel, time and amount."""

    def test_at_0_9(self) -> None:
        solution = BOX.solve(limited(0.9))
        assert solution.status is Status.INFEASIBLE
        assert judge(limited(0.9), solution).status is Status.INFEASIBLE
        words = re.fullmatch(
            r"wheel (\d) torque needs ([\d.]+) N m at t = ([\d.]+) s even with the best allocation; "
            r"limit 0.9 N m \(([\d.]+) N m too much\)",
            solution.message,
        )
        assert words, solution.message
        wheel, needs, t, lacks = (float(word) for word in words.groups())
        # mathematics, section 7.
        assert needs == pytest.approx(0.971, abs=5e-4)
        assert lacks == pytest.approx(needs - 0.9, abs=1e-4)
        # On the motion itself: at that time no nu does with less, and that wheel is one that is at the peak.
        sample = ServoLaw().solve(paper_task())
        verdict = examine(paper_task(), sample)
        assert verdict.replay is not None
        m = verdict.replay.sample(np.array([t])).torque
        shifted = m + np.linspace(-1, 1, 20001) * np.array([[1], [1], [-1], [-1]]) / 2
        best = np.abs(shifted).max(axis=0).argmin()
        assert np.abs(shifted[:, best]).max() == pytest.approx(needs, abs=1e-4)
        assert abs(shifted[int(wheel) - 1, best]) == pytest.approx(needs, abs=1e-4)

    def test_minimum_norm_is_left_to_the_referee(self) -> None:
        solution = ServoLaw(allocation=MinNorm()).solve(limited(1.0))
        assert solution.status is Status.OK
        record = judge(limited(1.0), solution)
        assert record.status is Status.INFEASIBLE
        assert record.measures["peak_torque_Nm"] == pytest.approx(1.2297, abs=5e-5)

    def test_tight_scenario(self) -> None:
        # mathematics, section 7: at twice the rate 2.1 N m do not suffice for minimum norm, which needs 2.47.
        task = limited(2.1, rate=-0.8, duration=LAP / 2)
        record = judge(task, ServoLaw().solve(task))
        assert record.status is Status.INFEASIBLE
        assert record.measures["peak_torque_Nm"] == pytest.approx(2.47, abs=5e-3)
        assert judge(task, BOX.solve(task)).status is Status.OK

    def test_border_of_reach(self) -> None:
        solution = BOX.solve(limited(0.5))
        needs = float(re.search(r"needs ([\d.]+)", solution.message).group(1))
        assert BOX.solve(limited(needs + 1e-4)).status is Status.OK
        assert BOX.solve(limited(needs - 1e-4)).status is Status.INFEASIBLE

    def test_peak_between_samples(self) -> None:
        # A fast turn: between two samples the torque changes by more than what is looked for here.
        law = PrescribedRotation(rate=4.0, allocation=BoxQp())
        task = paper_task(3.0)
        solution = PrescribedRotation(rate=4.0).solve(task)
        replay = examine(task, solution).replay
        assert replay is not None
        assert solution.claimed is not None
        wheels = platform_input_map(task.platform)

        def least(t: np.ndarray) -> np.ndarray:
            return wheels.least_peak(replay.sample(t).torque)

        grid = np.linspace(0, 3.0, 3001)
        best = grid[least(grid).argmax()]
        around = minimize_scalar(
            lambda t: -least(np.array([t]))[0], bounds=(best - 1e-3, best + 1e-3), options={"xatol": 1e-9}
        )
        needs = -around.fun
        assert 0.1 < around.x < 2.9
        assert least(solution.claimed.t).max() < needs - 2e-5
        refused = law.solve(limited(needs - 1e-5, duration=3.0))
        assert refused.status is Status.INFEASIBLE
        assert f"needs {needs:.4f} N m" in refused.message
        # Every peak comes again after a turn against the circle.
        found = re.search(r"t = ([\d.]+) s", refused.message)
        assert found
        turns = (float(found.group(1)) - around.x) * 4.4 / (2 * np.pi)
        assert turns == pytest.approx(round(turns), abs=1e-3)
        assert "(1e-05 N m too much)" in refused.message
        assert law.solve(limited(needs + 1e-5, duration=3.0)).status is Status.OK


class TestWheelSets:
    """Three, five and six wheels."""

    @pytest.mark.parametrize("count", [3, pytest.param(5, marks=pytest.mark.slow), 6])
    def test_limit_between_least_peak_and_minimum_norm(self, count: int) -> None:
        task = paper_task(3.0, platform=omni(count))
        wheels = platform_input_map(task.platform)
        verdict = examine(task, ServoLaw().solve(task))
        assert verdict.samples is not None
        m = verdict.samples.torque
        least, norm = wheels.least_peak(m).max(), np.abs(m).max()
        free = verdict.record.measures
        assert judge(task, BOX.solve(task)).measures == free
        low = limited(0.99 * least, duration=3.0, platform=task.platform)
        refused = BOX.solve(low)
        assert refused.status is Status.INFEASIBLE
        assert f"needs {least:.4f}" in refused.message
        if count == 3:
            assert least == pytest.approx(norm, rel=1e-12)
            return
        assert norm > 1.02 * least
        between = limited((least + norm) / 2, duration=3.0, platform=task.platform)
        record = judge(between, BOX.solve(between))
        assert record.status is Status.OK, record.message
        assert record.measures["work_J"] == pytest.approx(free["work_J"], rel=1e-9)
        assert record.measures["torque_squared_N2m2s"] > free["torque_squared_N2m2s"]

    @pytest.mark.parametrize(
        ("said", "words"),
        [(np.nan, "neither a torque nor its impossibility"), (0.3, "fails its recomputed residuals")],
    )
    def test_no_word_of_many_wheels_is_believed(self, monkeypatch: pytest.MonkeyPatch, said: float, words: str) -> None:
        task = paper_task(1.0, platform=omni(5), limits=Limits(torque=50.0))
        monkeypatch.setattr(ElectricPower, "of_many", lambda self, asked: np.full_like(asked.min_norm, said))
        solution = ServoLaw(allocation=Electric()).solve(task)
        assert solution.status is Status.FAILED
        assert words in solution.message
        assert judge(task, solution).status is Status.FAILED

    @pytest.mark.parametrize("allocation", [BoxQp(), MinMax(), Electric(), Weighted(weights=(1.0, 2.0, 3.0, 4.0))])
    def test_wrong_allocation_is_a_failed_row(self, monkeypatch: pytest.MonkeyPatch, allocation: Any) -> None:
        right = realised.solve

        def wrong(asked: Any) -> Any:
            found = right(asked)
            return replace(found, torque=found.torque + 1e-5 * platform_input_map(youbot()).null_torque)

        monkeypatch.setattr(realised, "solve", wrong)
        solution = ServoLaw(allocation=allocation).solve(limited(1.1))
        assert solution.status is Status.FAILED
        assert "fails its recomputed residuals" in solution.message


ALL_LIMITS = Limits(torque=1.0, wheel_power=7.0, stall_torque=2.6, no_load_speed=13.0)
KINDS = [
    *((kind, ALL_LIMITS) for kind in (MinMax(), Electric(), Copper(), Weighted(weights=(3.0, 1.0, 1.0, 2.0)))),
    (BoxQp(), Limits(torque=1.0)),
    (BoxQp(), Limits(wheel_power=7.0)),
    (BoxQp(), Limits(stall_torque=2.6, no_load_speed=13.0)),
]


class TestKinds:
    """Every kind under every limit: same motion, limits held between samples, each best in its own measure."""

    @pytest.mark.slow
    @pytest.mark.parametrize(("kind", "limits"), KINDS)
    def test_holds_its_limits(self, kind: Any, limits: Limits) -> None:
        task = paper_task(6.0, limits=limits)
        plain = judge(task, ServoLaw().solve(task))
        assert plain.status is Status.INFEASIBLE
        record = judge(task, ServoLaw(allocation=kind).solve(task))
        assert record.status is Status.OK, record.message
        assert record.measures["limit_excess"] < 1e-9
        assert record.measures["work_J"] == pytest.approx(plain.measures["work_J"], rel=1e-9)

    def test_peaks_of_the_law(self, minimum: dict[str, float]) -> None:
        # mathematics, section 7: 1.230 N m by minimum norm, 0.971 by the least largest torque.
        assert minimum["peak_torque_Nm"] == pytest.approx(1.230, abs=5e-4)
        found = judge(paper_task(), ServoLaw(allocation=MinMax()).solve(paper_task())).measures
        assert found["peak_torque_Nm"] == pytest.approx(0.971, abs=5e-4)

    @pytest.mark.parametrize(
        ("limits", "words"),
        [
            (Limits(wheel_power=4.0), "by 4 W at "),
            (Limits(stall_torque=2.0, no_load_speed=9.0), "by the torque-speed line at "),
        ],
    )
    def test_message_names_the_limit_that_binds(self, limits: Limits, words: str) -> None:
        solution = ServoLaw(allocation=BoxQp()).solve(paper_task(limits=limits))
        assert solution.status is Status.INFEASIBLE
        assert words in solution.message
        assert solution.message.startswith("wheel ")


class TestRules:
    """Saturated torques and the true dynamics: B leaves its program, the limits are held."""

    @pytest.mark.parametrize("rule", get_args(Rule))
    def test_b_leaves_its_program(self, rule: Rule) -> None:
        task = limited(0.75, duration=2.0)
        solution = ServoLaw(allocation=BoxQp(out_of_reach=rule)).solve(task)
        assert solution.claim.keep == "none"
        record = judge(task, solution)
        assert record.status is Status.OK, record.message
        assert record.keep == "none"
        assert record.measures["limit_excess"] <= 1e-12
        assert record.measures["peak_torque_Nm"] == pytest.approx(0.75, rel=1e-12)
        assert 1e-3 < record.measures["position_error_end_m"] < 0.5
        assert "limit 0.75 N m" in record.message
        assert f"rule {rule}" in record.message

    def test_in_reach_a_rule_changes_nothing(self) -> None:
        task = limited(1.0, duration=3.0)
        laws = [ServoLaw(allocation=BoxQp(out_of_reach=rule)) for rule in (None, "scale")]
        one, other = (judge(task, law.solve(task)) for law in laws)
        assert one.measures == other.measures
        assert one.keep == other.keep == "path"


class TestControl:
    """M(t, x) anywhere, not only on the law's own motion."""

    def test_segment_is_the_same_function(self) -> None:
        solution = BOX.solve(limited(1.0))
        assert solution.control is not None
        assert solution.claimed is not None
        rng = np.random.default_rng(0)
        t = solution.claimed.t[::40]
        state = solution.claimed.state[:, ::40] + rng.normal(size=(6, len(t))) * 0.02
        many = solution.control.torque(t, state)
        single = solution.control.segment(0.0, LAP)
        np.testing.assert_allclose(
            np.column_stack([single(time, state[:, k]).copy() for k, time in enumerate(t)]), many, atol=1e-14
        )

    def test_out_of_reach_keeps_the_wrench_and_not_the_limit(self) -> None:
        solution, plain = BOX.solve(limited(1.0)), ServoLaw().solve(paper_task())
        assert solution.control is not None
        assert plain.control is not None
        t, state = np.array([1.0]), np.array([[0.0, 0, 0, 0, 0, 6.0]]).T
        found = solution.control.torque(t, state)
        assert np.abs(found).max() > 1.0
        assert np.array_equal(found, plain.control.torque(t, state))


class TestTimes:
    """Peaks and changes between samples, by functions with known ones."""

    def test_peaks(self) -> None:
        # Maxima at 0.3 + 2 k and at 1.1 + 2 k; the third function stays far below its limit.
        def loads(t: np.ndarray) -> np.ndarray:
            return np.vstack(
                [np.cos(np.pi * (t - 0.3)), 1 + 0.1 * np.cos(np.pi * (t - 1.1)), 0.5 * np.cos(np.pi * (t - 0.7))]
            )

        found = np.sort(peak_times(loads, np.linspace(0, 4, 41)))
        np.testing.assert_allclose(found, [0.3, 1.1, 2.3, 3.1], atol=1e-6)

    def test_changes(self) -> None:
        # Two changes between the same two samples, one near an end of the horizon.
        edges = np.array([1.23456789, 1.26, 2.0 / 3, 3.999])

        def form(t: np.ndarray) -> np.ndarray:
            return (t[None, :] >= np.sort(edges)[:, None]).sum(axis=0, keepdims=True)

        np.testing.assert_allclose(change_times(form, np.linspace(0, 4, 41)), np.sort(edges), atol=1e-12)
        assert change_times(lambda t: np.zeros((2, len(t))), np.linspace(0, 4, 41)).size == 0
