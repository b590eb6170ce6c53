"""The law's option `allocation`: as a field, and as a table in an experiment file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from occ.allocation import BoxQp, Copper, Electric, MinMax, MinNorm, Weighted
from occ.errors import InputError
from occ.experiment.load import ExperimentError, load_experiment
from occ.laws import PrescribedRotation, ServoLaw
from tests.experiment import tiny

BOX = ServoLaw(allocation=BoxQp())
ROOT = Path(__file__).parents[2]


class TestOption:
    """As a field and as a table in an experiment file."""

    @pytest.mark.parametrize("wrong", ["box_qp", None, 3, BoxQp])
    def test_wrong_values(self, wrong: Any) -> None:
        with pytest.raises(InputError, match="allocation"):
            ServoLaw(allocation=wrong)

    def test_table(self, tmp_path: Path) -> None:
        path = tmp_path / "a.toml"
        path.write_text(
            tiny(('kind = "servo"', 'kind = "servo"\nallocation = { kind = "box_qp" }'))
            + 'allocation = { kind = "min_norm" }\n'
            + '[sweep]\n"controller.translation.allocation.kind" = ["min_norm", "box_qp"]\n'
        )
        first, second = load_experiment(path).cases
        assert first.players() == {"servo law": BOX, "translation": PrescribedRotation(rate=0.0)}
        assert second.players()["translation"] == PrescribedRotation(rate=0.0, allocation=BoxQp())
        path.write_text(tiny())
        (case,) = load_experiment(path).cases
        assert case.players()["servo law"] == ServoLaw(allocation=MinNorm())

    @pytest.mark.parametrize(
        ("table", "words"),
        [
            ('{ kind = "box_pq" }', ['servo law.allocation.kind: unknown name ("box_pq")', '"box_qp"']),
            ('{ kind = "box_qp", limit = 1.0 }', ["servo law.allocation.limit: unknown key"]),
            ('"box_qp"', ["servo law.allocation: wrong type", "a table"]),
            ("{}", ["servo law.allocation.kind: missing", "min_norm, box_qp, weighted, min_max, copper, electric"]),
            ('{ kind = "min_norm", out_of_reach = "scale" }', ["servo law.allocation:", '"scale"', "box_qp"]),
            (
                '{ kind = "box_qp", out_of_reach = "nearest" }',
                ["allocation.out_of_reach:", '"nearest"', "valid: closest, translation_first"],
            ),
            ('{ kind = "weighted" }', ["allocation.weights: missing"]),
            ('{ kind = "weighted", weights = [1.0, 2.0] }', ["allocation.weights:", "at least 3"]),
            ('{ kind = "weighted", weights = [1.0, 2.0, 0.0, 1.0] }', ["allocation.weights #3:", "(0.0)"]),
            ('{ kind = "weighted", weights = [1.0, 2.0, 3.0] }', ["servo law: allocation.weights should be 4 numbers"]),
            ('{ kind = "copper", losses = [1.0, 2.0, 3.0] }', ["servo law: allocation.losses should be 4 numbers"]),
            ('{ kind = "electric", loss = 0.0 }', ["allocation.loss:", "(0.0)", "greater than 0"]),
        ],
    )
    def test_wrong_tables(self, tmp_path: Path, table: str, words: list[str]) -> None:
        path = tmp_path / "a.toml"
        path.write_text(tiny(('kind = "servo"', f'kind = "servo"\nallocation = {table}')))
        with pytest.raises(ExperimentError) as caught:
            load_experiment(path)
        (line,) = caught.value.lines
        for word in words:
            assert word in line

    @pytest.mark.parametrize(
        ("table", "option"),
        [
            ('{ kind = "box_qp", out_of_reach = "closest" }', BoxQp(out_of_reach="closest")),
            ('{ kind = "min_max", out_of_reach = "scale" }', MinMax(out_of_reach="scale")),
            ('{ kind = "weighted", weights = [1, 2.0, 3.0, 4.0] }', Weighted(weights=(1.0, 2.0, 3.0, 4.0))),
            ('{ kind = "copper" }', Copper()),
            (
                '{ kind = "electric", loss = 2.0, out_of_reach = "rotation_first" }',
                Electric(loss=2.0, out_of_reach="rotation_first"),
            ),
        ],
    )
    def test_every_kind(self, tmp_path: Path, table: str, option: Any) -> None:
        path = tmp_path / "a.toml"
        path.write_text(tiny(('kind = "servo"', f'kind = "servo"\nallocation = {table}')))
        (case,) = load_experiment(path).cases
        assert case.players()["servo law"] == ServoLaw(allocation=option)

    @pytest.mark.parametrize("name", ["limits"])
    def test_shipped_experiments(self, name: str) -> None:
        experiment = load_experiment(ROOT / "experiments" / f"{name}.toml")
        assert experiment.cases
        assert all(case.players()["servo law box"] == BOX for case in experiment.cases)


PARALLEL = """\
preset = "wheels"
platform_mass = 20.0
mass_center = [0.0, 0.0]
yaw_inertia = 3.0
""" + "".join(
    f"""
[[platform.wheels]]
position = [{x}, 0.2]
mounting_angle = 0.0
roller_angle = 0.7853981633974483
radius = 0.05
roller_radius = 0.01
mass = 1.0
spin_inertia = 0.003
friction = 0.05
roller_friction = 0.0
"""
    for x in (-0.2, 0.1, 0.2)
)


class TestBadExperiments:
    """Limits and wheel sets that cannot be meant: one line each, from `occ check` and `occ run` alike."""

    @pytest.mark.parametrize(
        ("limits", "words"),
        [
            ("torque = -1.0", ["limits.torque: out of range (-1.0)", "greater than 0"]),
            ("torque = nan", ["limits.torque: not finite (nan)"]),
            ("torque = [1.0, 2.0]", ["limits.torque: wrong type ([1.0, 2.0])", "a number"]),
            ("wheel_power = 0", ["limits.wheel_power: out of range (0)"]),
            ("stall_torque = 2.0", ["no_load_speed should be given, too"]),
            ("stall_torque = -2.0\nno_load_speed = 9.0", ["limits.stall_torque: out of range (-2.0)"]),
        ],
    )
    def test_limits(self, tmp_path: Path, limits: str, words: list[str]) -> None:
        self.refused(tmp_path, tiny(more=f"\n[limits]\n{limits}\n"), words)

    def test_wheels_that_leave_wrenches_out_of_reach(self, tmp_path: Path) -> None:
        self.refused(tmp_path, tiny(('preset = "youbot"\n', PARALLEL)), ["platform", "rank below 3"])

    @staticmethod
    def refused(folder: Path, text: str, words: list[str]) -> None:
        path = folder / "a.toml"
        path.write_text(text)
        with pytest.raises(ExperimentError) as caught:
            load_experiment(path)
        (line,) = caught.value.lines
        assert "\n" not in line
        for word in words:
            assert word in line
