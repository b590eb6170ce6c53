"""`occ circle`: keys, wheel demands, limits, bad input."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from occ.cli import app
from occ.laws import ServoLaw
from occ.model.presets import youbot
from occ.referee import examine, judge
from occ.task import Start
from occ.theory.equation import scaled_equation
from occ.theory.orbits import rotating_orbit
from occ.theory.stability import singular_point
from occ.theory.summary import circle_setting, circle_summary
from tests.tasks import paper_task

Printed = Callable[[str], object]
EXPERIMENTS = Path(__file__).parents[2] / "experiments"
SECTION5 = EXPERIMENTS / "section5.toml"


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["circle", *map(str, arguments)])


def told(*settings: str) -> dict[str, Any]:
    result = run(SECTION5, "--json", *(part for text in settings for part in ("--set", text)))
    assert result.exit_code == 0, result.stderr
    summary = json.loads(result.stdout)
    assert isinstance(summary, dict)
    return summary


class TestJson:
    """Keys and numbers."""

    def test_steady(self, printed: Printed) -> None:
        summary = told()
        assert summary["regime"] == "steady"
        assert summary["critical_radius_m"] == printed("0.647403193343")
        assert summary["critical_speed_m_s"] == printed("26.5482182534")
        assert summary["alpha_rad"] == printed("0.0887386943436")
        assert summary["beta_rad"] == printed("0.124354994547")
        assert summary["epsilon"] == printed("0.0471341483901")
        stable, unstable = summary["steady"]
        assert stable["stable"]
        assert not unstable["stable"]
        assert stable["psi_tilde_rad"] == printed("-0.478863232355")
        assert unstable["psi_tilde_rad"] == printed("0.301385843667")
        assert stable["eigenvalues"] == [printed("-8.35032511858"), printed("-0.167160849869")]
        assert summary["sufficient_conditions"] is True
        assert "period_s" not in summary
        (attractor,) = summary["attractors"]
        assert attractor["kind"] == "steady"
        assert attractor["share"] == 1
        torques = ("1.22530952523", "-0.752096857947", "0.285639685538", "0.187572981747")
        assert attractor["wheel_torque_Nm"] == [printed(text) for text in torques]
        assert attractor["mean_power_W"] == printed("12.4027335158")
        assert summary["settling_time_s"] == pytest.approx(math.log(50) / 0.167160849869, rel=1e-11)

    def test_rotational(self) -> None:
        summary = told("motion.radius=0.6")
        assert summary["regime"] == "rotational"
        assert summary["steady"] == []
        rho = 0.6 / summary["critical_radius_m"]
        assert summary["period_asymptotic_s"] == pytest.approx(2 * math.pi / 0.4 / math.sqrt(1 - rho**2), rel=1e-12)
        assert summary["period_s"] == pytest.approx(summary["period_corrected_s"], rel=1e-5)
        expected = -0.4 + 2 * math.pi / summary["period_s"]
        assert summary["mean_yaw_rate_rad_s"] == pytest.approx(expected, rel=1e-12)

    def test_critical(self) -> None:
        summary = told("motion.radius=0.647403193343105")
        assert summary["regime"] == "critical"
        (root,) = summary["steady"]
        assert not root["stable"]
        assert root["eigenvalues"][1] == 0
        assert summary["settling_time_s"] == math.inf

    def test_complex_eigenvalues_are_pairs(self) -> None:
        summary = told("motion.radius=50.0")
        first, second = summary["steady"][0]["eigenvalues"]
        assert first == [second[0], -second[1]]

    @pytest.mark.parametrize(
        ("settings", "key"),
        [
            (["platform.wheel_spin_inertia=0.0"], "critical_speed_m_s"),
            (["point.x=0.0", "point.y=0.0"], "critical_speed_m_s"),
            ([f"point.{axis}={value!r}" for axis, value in zip("xy", singular_point(youbot(), -0.4), strict=True)],
             "critical_radius_m"),
            (["platform.wheel_friction=0.0", "platform.roller_friction=0.0", "motion.radius=5.0"], "epsilon"),
        ],
    )  # fmt: skip
    def test_infinities_are_infinities(self, settings: list[str], key: str) -> None:
        summary = told(*settings)
        assert summary[key] == math.inf
        assert "NaN" not in json.dumps(summary)

    def test_is_json_without_extensions(self) -> None:
        text = run(SECTION5, "--json", "--set", "platform.wheel_spin_inertia=0.0").stdout

        def refuse(constant: str) -> float:
            raise AssertionError(constant)

        assert json.loads(text, parse_constant=refuse)["critical_speed_m_s"] == math.inf


class TestWheels:
    """What the wheels must deliver, against the referee's samples of the full platform."""

    def test_over_an_exact_period(self) -> None:
        setting = circle_setting(paper_task(1.0, radius=0.5))
        orbit = rotating_orbit(scaled_equation(setting.c, 0.5, -0.4))
        assert orbit is not None
        start = Start(heading=float(orbit.psi_tilde[0]) + math.pi / 2, heading_rate=float(orbit.yaw_rate[0]))
        task = paper_task(float(orbit.orbit.period), radius=0.5, start=start)
        solution = ServoLaw().solve(task)
        measures = judge(task, solution).measures
        (attractor,) = circle_summary(task)["attractors"]
        # Over a period the kinetic energy returns: work is mean power times time.
        assert attractor["mean_power_W"] * task.duration == pytest.approx(measures["work_J"], rel=1e-8)
        samples = examine(task, solution).samples
        assert samples is not None
        found = np.abs(samples.torque).max(axis=1)
        assert attractor["peak_torque_Nm"] == pytest.approx(found, rel=1e-3)
        assert max(attractor["peak_torque_Nm"]) == pytest.approx(measures["peak_torque_Nm"], rel=1e-4)
        assert max(attractor["peak_wheel_speed_rad_s"]) == pytest.approx(measures["peak_wheel_speed_rad_s"], rel=1e-4)
        assert max(attractor["peak_power_W"]) == pytest.approx(measures["peak_power_W"], rel=1e-4)


class TestLines:
    """About ten lines for a reader."""

    @pytest.mark.parametrize("radius", [0.7, 0.6, 0.647403193343105])
    def test_few_lines(self, radius: float) -> None:
        result = run(SECTION5, "--set", f"motion.radius={radius}")
        assert result.exit_code == 0
        lines = result.stdout.splitlines()
        assert 8 <= len(lines) <= 12
        for word in ("regime", "critical radius", "(4.8)", "stable radii", "ends in", "torques", "N m", "W on average"):
            assert word in result.stdout

    def test_the_law_stands_beside_the_least_possible(self) -> None:
        (line,) = [line for line in run(SECTION5).stdout.splitlines() if line.startswith("long run:")]
        assert "the law settles at 12.4027 W" in line
        assert "the least possible is 12.3828 W (exact, a steady rotation)" in line
        assert "0.1611 % above" in line
        assert "limits of the wheels left aside" in run(SECTION5, "--set", "limits.torque=2.1").stdout
        # A law that settles at nothing has no mean to compare.
        assert "long run:" not in run(SECTION5, "--set", "platform.friction_scale=0").stdout

    def test_limits_are_compared(self) -> None:
        kept = run(SECTION5, "--set", "limits.torque=2.1").stdout
        passed = run(SECTION5, "--set", "limits.torque=1.2").stdout
        assert "limit 2.1: kept" in kept
        assert "limit 1.2: passed" in passed

    def test_coexistence_is_told_with_shares(self) -> None:
        weak = ("platform.wheel_friction=0.0011", "platform.roller_friction=5.78e-5", "motion.radius=0.3")
        text = run(SECTION5, *(part for setting in weak for part in ("--set", setting))).stdout
        assert "a rotating motion from 70" in text
        assert "the steady rotation from 29" in text


class TestBadInput:
    """One clear line, exit code 2."""

    @pytest.mark.parametrize(
        ("file", "settings", "words"),
        [
            ("section5", ["motion.radius=0"], "motion.radius"),
            ("section5", ["motion.radius=-0.7"], "motion.radius"),
            ("section5", ["motion.rate=0.0"], "rate 0"),
            ("section5", ["motion.radius=nan"], "motion.radius"),
            ("section5", ['point.x="left"'], "point.x"),
            ("section5", ["sweep.motion.radius=[0.6, 0.7]"], "different circles"),
            ("ellipse", [], "not a circle"),
            ("nowhere", [], "cannot be read"),
        ],
    )
    def test_one_line(self, file: str, settings: list[str], words: str) -> None:
        result = run(EXPERIMENTS / f"{file}.toml", *(part for text in settings for part in ("--set", text)))
        assert result.exit_code == 2
        assert result.stdout == ""
        assert words in result.stderr
        assert len(result.stderr.splitlines()) == 1
