"""The laws on a platform that is not what they know: measured velocities, stabilisation, replay, sampling, offsets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from occ.control import PythonControl
from occ.errors import InputError, Status
from occ.experiment.load import ExperimentError, load_experiment
from occ.laws import MeasuredServoLaw, PathKeepingLaw, PrescribedRotation, ServoLaw, Stabilisation
from occ.model.presets import omni3, youbot
from occ.open_loop import OpenLoop
from occ.optimal.collocation import Collocation
from occ.plant import Plant
from occ.referee import examine, judge
from occ.referee.replay import Replay
from occ.task import Limits
from tests.experiment import tiny
from tests.tasks import paper_task

STABILISED = ServoLaw(stabilisation=Stabilisation(position=4.0, velocity=4.0))
MORE_FRICTION = Plant(platform=youbot(wheel_friction=0.110 * 1.01))
CENTIMETRE = Plant(start_offset=(0.01, 0.0, 0.0))


def measures(law: Any, plant: Plant | None, **overrides: Any) -> dict[str, float]:
    task = paper_task(plant=plant, **overrides)
    record = judge(task, law.solve(task))
    assert record.status is Status.OK, record.message
    return record.measures


class TestOnItsProgram:
    """Nothing to correct: every variant is one law."""

    @pytest.mark.parametrize("law", [MeasuredServoLaw(), STABILISED, OpenLoop(of=ServoLaw())])
    def test_same_motion_and_same_work(self, law: Any) -> None:
        task = paper_task(4.0)
        one, other = judge(task, ServoLaw().solve(task)), judge(task, law.solve(task))
        assert other.status is Status.OK, other.message
        assert other.keep == "path"
        assert other.measures["work_J"] == pytest.approx(one.measures["work_J"], rel=1e-10)
        assert other.measures["torque_squared_N2m2s"] == pytest.approx(one.measures["torque_squared_N2m2s"], rel=1e-9)

    def test_a_plant_that_differs_in_nothing_changes_nothing(self) -> None:
        task = paper_task(2.0)
        same = replace(task, plant=Plant(platform=youbot()))
        assert not same.off_model
        assert judge(same, ServoLaw().solve(same)) == judge(task, ServoLaw().solve(task))


class TestDrift:
    """Program (3.1) is a constraint on velocities: an error of the position never heals by itself."""

    @pytest.mark.parametrize("law", [ServoLaw(), MeasuredServoLaw()])
    def test_one_centimetre_stays_one_centimetre(self, law: PathKeepingLaw) -> None:
        found = measures(law, CENTIMETRE)
        assert found["position_error_end_m"] == pytest.approx(0.01, rel=1e-7)
        assert found["position_error_m"] == pytest.approx(0.01, rel=1e-7)
        assert found["work_J"] == pytest.approx(measures(ServoLaw(), None)["work_J"], rel=1e-9)

    def test_stabilisation_heals_it_in_a_lap(self) -> None:
        assert measures(STABILISED, CENTIMETRE)["position_error_end_m"] < 1e-6

    @pytest.mark.parametrize(("position", "velocity"), [(4.0, 4.0), (9.0, 1.2), (1.0, 4.0), (0.0, 2.0)])
    def test_error_decays_as_designed(self, position: float, velocity: float) -> None:
        # e'' + velocity e' + position e = 0 from e = (0.01, -0.02), e' = 0: double, complex, real roots, and one zero.
        law = ServoLaw(stabilisation=Stabilisation(position=position, velocity=velocity))
        task = paper_task(5.0, plant=Plant(start_offset=(0.01, -0.02, 0.0)))
        verdict = examine(task, law.solve(task))
        assert verdict.replay is not None
        t = np.linspace(0.0, 5.0, 41)
        error = task.point_motion(verdict.replay.at(t))[0] - task.motion.at(t)[0]
        matrix = np.array([[0.0, 1.0], [-position, -velocity]])
        roots, modes = np.linalg.eig(matrix + 1e-9 * np.array([[0, 0], [1, 0]]))
        share = np.linalg.solve(modes, [1.0, 0.0])
        shape = (modes[0] * share * np.exp(np.outer(t, roots))).sum(axis=1).real
        np.testing.assert_allclose(error, np.outer([0.01, -0.02], shape), atol=1e-9)

    def test_the_stabilised_law_keeps_its_structure(self) -> None:
        # Pi_C = B^T lambda off the program, too: no virtual work along the rotation about B.
        task = paper_task(3.0, plant=Plant(start_offset=(0.02, 0.01, 0.1)))
        verdict = examine(task, STABILISED.solve(task))
        assert verdict.samples is not None
        wrench = np.array(task.dynamics.coefficients.wheel_rates).T @ verdict.samples.torque
        direction = np.array([task.point[1], -task.point[0], 1.0])
        assert np.abs(direction @ wrench).max() < 1e-11 * np.abs(wrench).max()

    def test_any_law_can_be_stabilised(self) -> None:
        law = PrescribedRotation(rate=0.3, stabilisation=STABILISED.stabilisation)
        task = paper_task(12.0, plant=CENTIMETRE)
        verdict = examine(task, law.solve(task))
        assert verdict.record.measures["position_error_end_m"] < 1e-9
        assert verdict.samples is not None
        np.testing.assert_allclose(verdict.samples.state[2], 0.3 * verdict.samples.t, atol=1e-9)


class TestMismatch:
    """One per cent more wheel friction than the controllers know (mathematics, section 6)."""

    def test_reconstructed_velocities(self) -> None:
        found = measures(ServoLaw(), MORE_FRICTION)
        assert found["position_error_end_m"] == pytest.approx(0.003, abs=5e-4)
        assert found["position_error_m"] == pytest.approx(0.013, abs=5e-4)

    def test_measured_velocities(self) -> None:
        assert measures(MeasuredServoLaw(), MORE_FRICTION)["position_error_end_m"] == pytest.approx(0.46, abs=5e-3)

    @pytest.mark.slow
    def test_open_loop_and_its_removal_by_feedback(self) -> None:
        alone = measures(OpenLoop(of=ServoLaw()), MORE_FRICTION)
        assert alone["position_error_end_m"] == pytest.approx(0.028, abs=5e-4)
        errors, works = [], []
        for rate in (2.0, 10.0):
            law = ServoLaw(stabilisation=Stabilisation(position=rate**2, velocity=2 * rate))
            found = measures(law, MORE_FRICTION)
            errors.append(found["position_error_end_m"])
            works.append(found["work_J"])
        # A constant force of friction unknown to the law is held by position e: 25 times stiffer, a 25th.
        assert errors[0] < 0.004
        assert errors[1] == pytest.approx(errors[0] / 25, rel=0.1)
        # Who stays on the program pays for the friction, as much as the law that knows of it.
        knowing = measures(ServoLaw(), None, platform=MORE_FRICTION.platform)["work_J"]
        assert all(work > alone["work_J"] for work in works)
        assert works[1] == pytest.approx(knowing, rel=1e-3)

    def test_errors_are_measures_and_no_bound_covers_them(self) -> None:
        task = paper_task(2.0, plant=MORE_FRICTION)
        record = judge(task, Collocation(objective="torque_squared", intervals=4, tolerance=1e-2).solve(task))
        assert record.status is Status.OK
        assert (record.keep, record.end, record.local_objective) == ("none", "free", None)
        assert record.measures["position_error_m"] > 1e-5
        assert record.measures["energy_residual_J"] == pytest.approx(0.0, abs=1e-9)

    def test_limits_are_verdicts_all_the_same(self) -> None:
        task = paper_task(2.0, plant=MORE_FRICTION, limits=Limits(torque=0.5))
        assert judge(task, ServoLaw().solve(task)).status is Status.INFEASIBLE


class TestSampling:
    """Zero-order hold."""

    def test_discrete_feedback_in_closed_form(self) -> None:
        # Straight ahead, M_i = -c V_X(t_k) held: m V' = -zeta V + 4 M / R is solved exactly from sample to sample.
        platform = youbot(mass_center=(0.0, 0.0))
        mass = 29.94 + 4 * 1.40 + 4 * 5.87e-3 / 0.0475**2
        zeta, gain, rate = 4 * 0.110 / 0.0475**2, 0.7, 20.0
        control = PythonControl(lambda t, x: np.full(4, -gain * x[3]))
        replay = Replay(platform, control, np.array([0, 0, 0, 0.5, 0, 0.0]), 1.03, sample_rate=rate)
        speed = 0.5
        assert len(replay.edges) == 22
        for k, (begin, end) in enumerate(zip(replay.edges[:-1], replay.edges[1:], strict=True)):
            assert begin == pytest.approx(k / rate)
            torque = -gain * speed
            samples = replay.sample(np.array([begin, (begin + end) / 2]))
            np.testing.assert_allclose(samples.torque, torque, rtol=1e-9)
            fade = np.exp(-zeta * (end - begin) / mass)
            speed = speed * fade + 4 * torque / 0.0475 / zeta * (1 - fade)
        assert replay.end_state[3] == pytest.approx(speed, rel=1e-9)

    def test_work_of_held_torques_closes_the_ledger(self) -> None:
        found = measures(ServoLaw(), Plant(sample_rate=25.0), duration=2.0)
        assert found["energy_residual_J"] == pytest.approx(0.0, abs=1e-9)

    def test_error_is_of_first_order_in_the_period(self) -> None:
        errors = [
            measures(ServoLaw(), Plant(sample_rate=rate), duration=2.0)["position_error_end_m"] for rate in (40.0, 80.0)
        ]
        assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
        assert errors[0] > 1e-4

    def test_a_rate_that_is_no_divisor_of_the_horizon(self) -> None:
        replay = Replay(youbot(), PythonControl(lambda t, x: np.zeros(4)), np.zeros(6), 0.25, sample_rate=10.0)
        np.testing.assert_allclose(replay.edges, [0.0, 0.1, 0.2, 0.25])
        replay = Replay(youbot(), PythonControl(lambda t, x: np.zeros(4)), np.zeros(6), 0.3, sample_rate=10.0)
        np.testing.assert_allclose(replay.edges, [0.0, 0.1, 0.2, 0.3])


class TestOpenLoop:
    """Torques as functions of time alone."""

    def test_torque_does_not_look_at_the_state(self) -> None:
        solution = OpenLoop(of=ServoLaw()).solve(paper_task(2.0))
        assert solution.control is not None
        t = np.array([0.3, 1.1])
        one, other = (solution.control.torque(t, state) for state in (np.zeros((6, 2)), np.ones((6, 2))))
        assert np.array_equal(one, other)
        single = solution.control.segment(0.0, 2.0)
        np.testing.assert_allclose(np.column_stack([single(time, np.ones(6)).copy() for time in t]), one, atol=1e-14)

    def test_refusals_and_failures_are_the_controllers_own(self) -> None:
        rotation = OpenLoop(of=PrescribedRotation(rate="program"))
        rotation.check(paper_task())
        with pytest.raises(InputError, match="of"):
            OpenLoop(of="servo")


class TestBadInput:
    """One clear line each."""

    def test_plant_of_another_wheel_set(self) -> None:
        with pytest.raises(InputError, match="plant has 3 wheels; should have the 4"):
            paper_task(plant=Plant(platform=omni3()))

    def test_samples_beyond_number(self) -> None:
        with pytest.raises(InputError, match="sample_rate of 1e\\+06 Hz makes"):
            paper_task(plant=Plant(sample_rate=1e6))

    @pytest.mark.parametrize(
        ("changes", "more", "words"),
        [
            ((), "[plant]\nplatfrom = {}\n", ["plant.platfrom:", "platform"]),
            ((), "[plant]\nplatform = { wheel_frict = 0.1 }\n", ["plant.platform.wheel_frict:", '"wheel_friction"']),
            ((), "[plant]\nplatform = { wheel_friction = -0.1 }\n", ["plant.platform.wheel_friction:", "(-0.1)"]),
            ((), '[plant]\nplatform = { preset = "omni3" }\n', ["plant.platform.preset:", "[platform]"]),
            ((), "[plant]\nplatform = { yaw_inertia = 0.01 }\n", ["plant.platform", "yaw_inertia"]),
            ((), "[plant]\nstart_offset = [0.1, 0.2]\n", ["plant.start_offset"]),
            ((), "[plant]\nsample_rate = 0.0\n", ["plant.sample_rate:", "(0.0)", "greater than 0"]),
            ((), "[plant]\nsample_rate = 1e7\n", ["plant:", "1e+07 Hz", "at most 100000"]),
            (('kind = "servo"', 'kind = "servo"\nstabilisation = { position = 4.0 }'), "", ["stabilisation.velocity"]),
            (
                ('kind = "servo"', 'kind = "servo"\nstabilisation = { position = -1.0, velocity = 1.0 }'),
                "",
                ["servo law.stabilisation.position:", "(-1.0)", "at least 0"],
            ),
            (('kind = "servo"', 'kind = "open_loop"\nof = { kind = "serve" }'), "", ["of.kind:", '("serve")', "servo"]),
            (('kind = "servo"', 'kind = "open_loop"'), "", ["servo law.of:", "missing"]),
        ],
    )
    def test_experiment_files(self, tmp_path: Path, changes: Any, more: str, words: list[str]) -> None:
        path = tmp_path / "a.toml"
        path.write_text(tiny(*([changes] if changes else []), more=more))
        with pytest.raises(ExperimentError) as caught:
            load_experiment(path)
        (line,) = caught.value.lines
        for word in words:
            assert word in line

    def test_a_plant_is_swept_like_any_other_key(self, tmp_path: Path) -> None:
        path = tmp_path / "a.toml"
        path.write_text(tiny(more='[plant]\n[sweep]\n"plant.platform.wheel_friction" = [0.11, 0.12]\n'))
        first, second = (case.task() for case in load_experiment(path).cases)
        assert not first.off_model
        assert second.off_model
        assert second.true_platform.wheels[0].friction == 0.12
        assert second.platform.wheels[0].friction == 0.11
        path.write_text(tiny())
        assert load_experiment(path).cases[0].task().plant is None
