"""The referee finds out: mutated solutions and a mutated referee turn a row from ok to not ok."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy import integrate

from occ.control import PythonControl
from occ.errors import Status
from occ.laws import PrescribedRotation, ServoLaw
from occ.objectives import OBJECTIVES
from occ.optimal.collocation import Collocation
from occ.referee import MEASURES, judge
from occ.referee import replay as replay_module
from occ.referee.reference import servo_end_state
from occ.task import Claim, Limits, Solution, Start, Task
from occ.trajectory import Trajectory
from tests.tasks import LAP, paper_task

Mutation = Callable[[Task, Solution], Solution]


def with_torque(
    solution: Solution, change: Callable[[float, np.ndarray, Callable[..., np.ndarray]], np.ndarray]
) -> Solution:
    control = solution.control
    assert control is not None
    torque = control.segment(0.0, LAP)
    return replace(solution, control=PythonControl(lambda t, x: change(t, x, lambda t, x: torque(t, x).copy())))


def shift_a_claimed_state(_: Task, s: Solution) -> Solution:
    assert s.claimed is not None
    state = s.claimed.state.copy()
    state[0] += 1e-3
    return replace(s, claimed=Trajectory(s.claimed.t, state, s.claimed.state_rate))


def shift_the_start(_: Task, s: Solution) -> Solution:
    assert s.start_state is not None
    return replace(s, start_state=s.start_state + np.array([1e-6, 0, 0, 0, 0, 0]))


def turn_the_start(task: Task, s: Solution) -> Solution:
    return replace(s, start_state=task.state_on_program(0.0, 0.1, 0.0))


def spin_the_start(task: Task, s: Solution) -> Solution:
    """The bogus optimum: kinetic energy at the start that nobody pays for."""
    return replace(s, start_state=task.state_on_program(0.0, 0.0, 5.0), claimed=None)


def scale_one_torque(_: Task, s: Solution) -> Solution:
    factors = np.array([1.0, 1.0 + 1e-5, 1.0, 1.0])
    return with_torque(s, lambda t, x, torque: factors * torque(t, x))


def reverse_time(_: Task, s: Solution) -> Solution:
    return with_torque(s, lambda t, x, torque: torque(LAP - t, x))


def reverse_the_claim(_: Task, s: Solution) -> Solution:
    assert s.claimed is not None
    return replace(s, claimed=Trajectory(s.claimed.t, s.claimed.state[:, ::-1], s.claimed.state_rate[:, ::-1]))


def stop_early(_: Task, s: Solution) -> Solution:
    assert s.claimed is not None
    half = len(s.claimed.t) // 2
    c = s.claimed
    return replace(s, claimed=Trajectory(c.t[:half], c.state[:, :half], c.state_rate[:, :half]))


def claim_the_laws_end(_: Task, s: Solution) -> Solution:
    return replace(s, claim=Claim(start=s.claim.start, end="law"))


@pytest.fixture(scope="module")
def task() -> Task:
    return paper_task()


@pytest.fixture(scope="module")
def law(task: Task) -> Solution:
    return ServoLaw().solve(task)


class TestMutations:
    """Each of these lies is found."""

    @pytest.mark.parametrize(
        ("mutate", "words"),
        [
            (shift_a_claimed_state, "away from the true one"),
            (shift_the_start, "away from the task's start"),
            (turn_the_start, "away from the task's start"),
            (spin_the_start, "away from the task's start"),
            (scale_one_torque, "B leaves its program"),
            (reverse_time, "B leaves its program"),
            (reverse_the_claim, "away from the true one"),
            (stop_early, "not the whole horizon"),
        ],
    )
    def test_of_the_law(self, task: Task, law: Solution, mutate: Mutation, words: str) -> None:
        assert judge(task, law).status is Status.OK
        record = judge(task, mutate(task, law))
        assert record.status is Status.FAILED
        assert words in record.message

    def test_a_free_optimum_does_not_end_like_the_law(self, task: Task) -> None:
        solution = Collocation(objective="torque_squared").solve(task)
        assert judge(task, solution).status is Status.OK
        record = judge(task, claim_the_laws_end(task, solution))
        assert record.status is Status.FAILED
        assert "servo law's end" in record.message

    def test_a_prescribed_rotation_may_not_claim_the_given_start(self, task: Task) -> None:
        solution = PrescribedRotation(rate="program").solve(task)
        assert judge(task, solution).status is Status.OK
        record = judge(task, replace(solution, claim=Claim(start="given")))
        assert record.status is Status.FAILED

    def test_a_ledger_without_kinetic_energy_does_not_close(
        self, task: Task, law: Solution, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        honest = replay_module._energies(4)

        def without_kinetic_term(_: int) -> ca.Function:
            packed, state = honest.sx_in(0), honest.sx_in(1)
            kinetic, dissipation, rates = honest(packed, state)
            return ca.Function("energies", [packed, state], [0 * kinetic + ca.SX(0), dissipation, rates])

        monkeypatch.setattr(replay_module, "_energies", without_kinetic_term)
        record = judge(task, law)
        assert record.status is Status.FAILED
        assert "energy ledger" in record.message

    def test_a_player_without_an_answer_fails(self, task: Task) -> None:
        record = judge(task, Solution(control=None, start_state=None))
        assert record.status is Status.FAILED
        assert record.message
        assert record.measures == {}

    def test_an_infinite_torque_is_unstable_and_not_a_traceback(self, task: Task, law: Solution) -> None:
        for wrong in (np.nan, np.inf, 1e300):
            record = judge(task, replace(law, control=PythonControl(lambda t, x, w=wrong: np.full(4, w))))
            assert record.status is Status.UNSTABLE
            assert "t = " in record.message


class TestMeasures:
    """Every measure, recomputed by hand."""

    def test_of_a_rotation_in_closed_form(self) -> None:
        # psi = omega_B t: body velocities are constant, so all powers and torques are constant in time.
        task = paper_task()
        solution = PrescribedRotation(rate="program", heading=1.1488).solve(task)
        m = judge(task, solution).measures
        dynamics = task.dynamics
        start = task.state_on_program(0.0, 1.1488, -0.4)
        wrench = np.array(dynamics.inverse(start, np.zeros(3)))[:, 0]
        torque = np.array(dynamics.min_norm_torque(wrench))[:, 0]
        rates = np.array(dynamics.wheel_rates(start))[:, 0]
        power = torque * rates
        assert m["work_J"] == pytest.approx(LAP * power.sum(), rel=1e-11)
        assert m["positive_work_J"] == pytest.approx(LAP * power.clip(0).sum(), rel=1e-11)
        assert m["absolute_work_J"] == pytest.approx(LAP * np.abs(power).sum(), rel=1e-11)
        assert m["bus_work_J"] == pytest.approx(LAP * max(power.sum(), 0), rel=1e-11)
        assert m["torque_squared_N2m2s"] == pytest.approx(LAP * (torque**2).sum(), rel=1e-11)
        assert m["copper_loss_J"] == pytest.approx(1.257 * m["torque_squared_N2m2s"], rel=1e-13)
        assert m["electric_J"] == pytest.approx(m["work_J"] + m["copper_loss_J"], rel=1e-13)
        assert m["peak_torque_Nm"] == pytest.approx(np.abs(torque).max(), rel=1e-11)
        assert m["peak_wheel_speed_rad_s"] == pytest.approx(np.abs(rates).max(), rel=1e-11)
        assert m["peak_power_W"] == pytest.approx(np.abs(power).max(), rel=1e-11)
        assert m["kinetic_change_J"] == pytest.approx(0.0, abs=1e-10)

    def test_kinked_integrands_against_a_fine_riemann_sum(self) -> None:
        # Translation: each wheel's power changes its sign several times in a lap.
        task = paper_task()
        solution = PrescribedRotation(rate=0.0).solve(task)
        m = judge(task, solution).measures
        t = (np.arange(16_384) + 0.5) * LAP / 16_384
        state = task.states_on_program(t, np.zeros_like(t), np.zeros_like(t))
        assert solution.control is not None
        torque = solution.control.torque(t, state)
        power = torque * (np.array(task.dynamics.coefficients.wheel_rates) @ state[3:])
        assert (np.diff(np.sign(power)) != 0).sum() > 4
        assert m["positive_work_J"] == pytest.approx(power.clip(0).sum() * LAP / len(t), rel=3e-7)
        assert m["absolute_work_J"] == pytest.approx(np.abs(power).sum() * LAP / len(t), rel=3e-7)

    def test_every_objective_and_every_column_is_there(self, task: Task, law: Solution) -> None:
        row = judge(task, law).row
        assert set(MEASURES) <= set(row)
        assert all(isinstance(row[name], float) for name in MEASURES)
        assert {item.column for item in OBJECTIVES.values()} <= set(MEASURES)

    def test_replay_error_and_defect_measure_what_was_claimed(self, task: Task, law: Solution) -> None:
        assert law.claimed is not None
        state = law.claimed.state.copy()
        state[1] += 3e-5
        rate = law.claimed.state_rate.copy()
        rate[5, 7] += 0.25
        record = judge(task, replace(law, claimed=Trajectory(law.claimed.t, state, rate)))
        assert record.measures["replay_error_m"] == pytest.approx(3e-5, rel=1e-3)
        assert record.measures["defect"] == pytest.approx(0.25, rel=1e-6)


class TestLimits:
    """Torque, speed and power limits of the experiment."""

    @pytest.mark.parametrize(
        ("limits", "words"),
        [
            (Limits(torque=1.1), ["wheel 1 torque needs 1.2297 N m", "limit 1.1 N m"]),
            (Limits(wheel_speed=7.0), ["speed needs 7.8", "rad/s", "limit 7 rad/s"]),
            (Limits(wheel_power=9.0), ["power needs 9.5", "W at t = ", "limit 9 W"]),
            (Limits(torque=1.0, wheel_speed=7.8), ["torque"]),
        ],
    )
    def test_a_limit_that_is_passed_is_named(self, limits: Limits, words: list[str]) -> None:
        task = paper_task(limits=limits)
        record = judge(task, ServoLaw().solve(task))
        assert record.status is Status.INFEASIBLE
        assert all(word in record.message for word in words), record.message
        assert record.measures["limit_excess"] > 0.01

    def test_limits_that_hold(self) -> None:
        task = paper_task(limits=Limits(torque=1.23, wheel_speed=7.9, wheel_power=9.54))
        record = judge(task, ServoLaw().solve(task))
        assert record.status is Status.OK
        assert record.measures["limit_excess"] == 0.0

    def test_the_peak_is_found_between_nodes(self) -> None:
        # mathematics: the law's peak torque by minimum norm is 1.2297 N m.
        task = paper_task()
        peak = judge(task, ServoLaw().solve(task)).measures["peak_torque_Nm"]
        solution = ServoLaw().solve(task)
        assert solution.claimed is not None
        t = np.linspace(10.0, 12.0, 20_001)
        state = replay_module.Replay(task.platform, solution.control, solution.start_state, LAP).at(t)
        assert solution.control is not None
        fine = np.abs(solution.control.torque(t, state)).max()
        assert peak == pytest.approx(1.2297, abs=5e-5)
        assert peak == pytest.approx(fine, rel=1e-9)
        assert peak >= fine * (1 - 1e-12)


class TestReferences:
    """The referee's own end state of the law."""

    @pytest.mark.parametrize("start", [Start(), Start(heading=1.0, heading_rate=-0.5)])
    def test_agrees_with_the_law(self, start: Start) -> None:
        task = paper_task(start=start)
        claimed = ServoLaw().solve(task).claimed
        assert claimed is not None
        np.testing.assert_allclose(servo_end_state(task), claimed.state[:, -1], atol=1e-8)

    def test_that_is_not_reached_is_said(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def halfway(function: Callable[..., object], span: tuple[float, float], *arguments: object, **more: object):
            outcome = original(function, (span[0], span[1] / 2), *arguments, **more)
            outcome.success = False
            return outcome

        task = paper_task(start=Start(heading=0.987))
        solution = replace(ServoLaw().solve(task), claim=Claim(end="law"))
        original = integrate.solve_ivp
        monkeypatch.setattr(integrate, "solve_ivp", halfway)
        record = judge(task, solution)
        assert record.status is Status.FAILED
        assert "end state to be compared with is not known" in record.message
        assert f"at t = {LAP / 2:.6g} s" in record.message
        monkeypatch.undo()
        assert judge(task, solution).status is Status.OK
