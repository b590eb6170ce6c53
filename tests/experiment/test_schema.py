"""Files become cases: defaults, sweeps, overrides, names; models follow the dataclasses."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest
from annotated_types import Ge, Le
from pydantic import ValidationError

from occ.checks import Positive, Vector2
from occ.experiment.case import Case
from occ.experiment.load import Experiment, ExperimentError, load_experiment, parse_override
from occ.experiment.naming import slug
from occ.experiment.tables import table_model
from occ.laws import PrescribedRotation, ServoLaw
from occ.model.presets import PRESETS, youbot
from occ.motion import MOTIONS, Circle
from occ.players import PLAYERS
from tests.experiment import tiny
from tests.experiment.conftest import Write


def names(experiment: Experiment) -> list[str]:
    return [case.name for case in experiment.cases]


def refused(path: Path, *overrides: str) -> list[str]:
    with pytest.raises(ExperimentError) as caught:
        load_experiment(path, overrides)
    return caught.value.lines


def test_task_and_players_are_what_the_file_says(write: Write) -> None:
    experiment = load_experiment(write(tiny(more="[limits]\ntorque = 2\n[start]\nheading = 1\n")))
    assert (experiment.title, experiment.question) == ("Tiny", "Does it run?")
    assert experiment.objectives == ("work",)
    (case,) = experiment.cases
    assert (case.name, case.swept) == ("base", {})
    task = case.task()
    assert task.platform == youbot()
    assert task.point == (0.40, 0.05)
    assert task.motion == Circle(radius=0.7, rate=-0.4, phase=math.pi / 2)
    assert (task.duration, task.start.heading, task.start.heading_rate) == (0.5, 1.0, 0.0)
    assert (task.limits.torque, task.limits.wheel_speed, task.limits.wheel_power) == (2.0, None, None)
    assert case.players() == {"servo law": ServoLaw(), "translation": PrescribedRotation(rate=0.0)}


def test_platform_overrides_change_only_what_they_name(write: Write) -> None:
    changed = tiny(('preset = "youbot"', 'preset = "youbot"\nwheel_friction = 0\nmass_center = [0, 0.01]'))
    (case,) = load_experiment(write(changed)).cases
    assert case.task().platform == youbot(wheel_friction=0.0, mass_center=(0.0, 0.01))


def test_laps_are_periods_of_the_motion(write: Write) -> None:
    (case,) = load_experiment(write(tiny(("duration = 0.5", "laps = 2")))).cases
    assert case.task().duration == pytest.approx(2 * 2 * math.pi / 0.4)


def test_case_is_plain_data(write: Write) -> None:
    (case,) = load_experiment(write()).cases
    twin: Case = pickle.loads(pickle.dumps(case))
    assert twin == case
    assert twin.key == case.key
    assert twin.task() == case.task()


def test_cross_product_with_the_first_key_slowest(write: Write) -> None:
    sweep = '[sweep]\n"motion.radius" = [0.6, 1]\nhorizon = [{ laps = 1 }, { duration = 30.0 }]\n'
    experiment = load_experiment(write(tiny(more=sweep)))
    assert names(experiment) == [
        "motion.radius=0.6,horizon.laps=1",
        "motion.radius=0.6,horizon.duration=30",
        "motion.radius=1,horizon.laps=1",
        "motion.radius=1,horizon.duration=30",
    ]
    assert experiment.swept == ("motion.radius", "horizon")
    assert experiment.cases[3].swept == {"motion.radius": 1.0, "horizon": "duration=30"}
    assert isinstance(experiment.cases[3].swept["motion.radius"], float)
    assert [round(case.task().duration, 3) for case in experiment.cases] == [15.708, 30, 15.708, 30]
    assert [case.task().motion.values()[0] for case in experiment.cases] == [0.6, 0.6, 1.0, 1.0]
    assert len({case.key for case in experiment.cases}) == 4


def test_sweep_may_supply_a_table_that_the_file_lacks(write: Write) -> None:
    text = tiny(("[horizon]\nduration = 0.5\n", ""), more="[sweep]\nhorizon = [{ laps = 1 }, { laps = 2 }]\n")
    assert names(load_experiment(write(text))) == ["horizon.laps=1", "horizon.laps=2"]


def test_unquoted_dotted_keys_mean_the_same(write: Write) -> None:
    quoted = load_experiment(write(tiny(more='[sweep]\n"motion.radius" = [0.6, 0.7]\n')))
    plain = load_experiment(write(tiny(more="[sweep]\nmotion.radius = [0.6, 0.7]\n")))
    assert plain.cases == quoted.cases


def test_range_is_even_and_exact_at_both_ends(write: Write) -> None:
    sweep = '[sweep]\n"motion.rate" = { from = -1.0, to = 0.5, count = 6 }\n'
    sweep += '"point.x" = { from = 0.1, to = 0.3, count = 3 }\n'
    experiment = load_experiment(write(tiny(more=sweep)))
    rates = [case.swept["motion.rate"] for case in experiment.cases[::3]]
    assert rates == [-1.0, -0.7, -0.4, -0.1, 0.2, 0.5]
    assert [case.swept["point.x"] for case in experiment.cases[:3]] == [0.1, 0.2, 0.3]


def test_range_of_whole_numbers_stays_whole(write: Write) -> None:
    more = '[[controller]]\nname = "min work"\nkind = "collocation"\nobjective = "work"\n'
    more += '[sweep]\n"controller.min work.intervals" = { from = 8, to = 16, count = 3 }\n'
    experiment = load_experiment(write(tiny(more=more)))
    assert [case.tables["controller"][2]["intervals"] for case in experiment.cases] == [8, 12, 16]
    assert names(experiment)[0] == "controller.min work.intervals=8"


def test_controller_of_a_dotted_name_is_swept(write: Write) -> None:
    text = tiny(('"translation"', '"v1.2 law"'), more='[sweep]\n"controller.v1.2 law.heading" = [0.0, 1.0]\n')
    cases = load_experiment(write(text)).cases
    assert [case.players()["v1.2 law"] for case in cases] == [
        PrescribedRotation(rate=0.0),
        PrescribedRotation(rate=0.0, heading=1.0),
    ]


@pytest.mark.parametrize(
    ("text", "parsed"),
    [
        ("motion.radius=0.6", ("motion.radius", 0.6)),
        ("a = true", ("a", True)),
        ("a=[1, 2]", ("a", [1, 2])),
        ("a={laps=1}", ("a", {"laps": 1})),
        ("a='x'", ("a", "x")),
        ("controller.min work.rate=program", ("controller.min work.rate", "program")),
        ("a=1\nb=2", ("a", "1\nb=2")),
        ("title=a=b", ("title", "a=b")),
        ("title=", ("title", "")),
    ],
)
def test_override_is_a_toml_value_or_a_text(text: str, parsed: tuple[str, Any]) -> None:
    assert parse_override(text) == parsed


def test_overrides(write: Write) -> None:
    path = write(tiny(("duration = 0.5", "laps = 1")))
    overrides = ["motion.radius=0.6", "horizon.duration=3", "limits.torque=2", "controller.translation.rate=program"]
    (case,) = load_experiment(path, [*overrides, "controller.translation.heading=0.5", "title=T"]).cases
    task = case.task()
    assert (task.motion.values()[0], task.duration, task.limits.torque) == (0.6, 3.0, 2.0)
    assert case.players()["translation"] == PrescribedRotation(rate="program", heading=0.5)
    (case,) = load_experiment(path, ["horizon.duration=3", "horizon.laps=2"]).cases
    assert case.tables["horizon"] == {"laps": 2.0}


def test_what_is_set_is_not_swept_any_more(write: Write) -> None:
    path = write(tiny(more='[sweep]\n"motion.radius" = [0.6, 0.7]\nhorizon = [{ laps = 1 }, { duration = 3 }]\n'))
    assert names(load_experiment(path, ["motion.radius=0.5"])) == ["horizon.laps=1", "horizon.duration=3"]
    assert names(load_experiment(path, ["horizon.laps=2"])) == ["motion.radius=0.6", "motion.radius=0.7"]
    assert names(load_experiment(path, ["sweep.point.x=[0.1]"]))[0] == "motion.radius=0.6,horizon.laps=1,point.x=0.1"


@pytest.mark.parametrize("cls", [*MOTIONS, *PLAYERS], ids=lambda cls: str(cls.__name__))
def test_every_class_of_a_family_has_its_table(write: Write, cls: type) -> None:
    kind = vars(cls)["kind"]
    old = 'kind = "circle"' if cls in MOTIONS else 'kind = "servo"'
    # One unknown key, so that the file is refused whatever the class needs.
    lines = refused(write(tiny((old, f'kind = "{kind}"\nunheard_of = 1'))))
    assert not any(".kind" in line for line in lines)
    (line,) = [line for line in lines if "unheard_of" in line]
    assert all(field.name in line for field in fields(cls))


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_has_its_table(write: Write, name: str) -> None:
    (case,) = load_experiment(write(tiny(('"youbot"', f'"{name}"')))).cases
    assert case.task().platform == PRESETS[name]().platform()


@dataclass(frozen=True, kw_only=True)
class Spiral:
    """r grows.

    Args:
        pitch: [m] from one turn
            to the next.
        turns: how many.
        points: (n, 2) [m] way-points.
        sense: of rotation.
    """

    kind: ClassVar[str] = "spiral"
    pitch: Positive
    turns: Annotated[int, Ge(1), Le(9)] = 3
    points: tuple[Vector2, ...] = ()
    sense: Literal["left", "right"] | float = "left"


def test_model_follows_the_dataclass() -> None:
    model = table_model(Spiral, tag=("kind", "spiral"))
    table = model.model_validate({"kind": "spiral", "pitch": 1, "points": [[0, 1], [2, 3]]})
    assert table.build() == Spiral(pitch=1.0, points=((0.0, 1.0), (2.0, 3.0)))
    for wrong in (
        {"pitch": 0},
        {"pitch": True},
        {"pitch": "1"},
        {"pitch": math.inf},
        {"pitch": 1, "turns": 10},
        {"pitch": 1, "turns": 2.0},
        {"pitch": 1, "points": [[0, 1, 2]]},
        {"pitch": 1, "points": [[0, math.nan]]},
        {"pitch": 1, "sense": "up"},
        {"pitch": 1, "sense": None},
        {"pitch": 1, "depth": 1},
        {},
    ):
        with pytest.raises(ValidationError):
            model.model_validate({"kind": "spiral"} | wrong)
    assert model.model_json_schema()["properties"]["pitch"]["description"] == "[m] from one turn to the next."


def test_file_names_are_safe() -> None:
    assert slug("min work") == "min_work"
    assert slug("a/../b") == "a_.._b"
    assert slug("motion.radius=0.6,horizon.laps=1") == "motion.radius=0.6,horizon.laps=1"
    long = [slug("x" * 300 + end) for end in "ab"]
    assert max(map(len, long)) <= 120
    assert long[0] != long[1]


def test_all_mistakes_are_reported_at_once(write: Write) -> None:
    text = tiny(
        ("x = 0.40", 'x = "far"'),
        ("radius = 0.70", "raduis = 0.70"),
        ("rate = 0.0\n", "rate = 0.0\nspeed = 1\n"),
        ("duration = 0.5", "duration = 2e6"),
    )
    lines = refused(write(text), "limits.torque=-1")
    assert len(lines) == 5
    for words in (
        "point.x",
        "motion.raduis",
        "horizon.duration",
        "controller.translation.speed",
        "--set limits.torque",
    ):
        assert sum(words in line for line in lines) == 1


def test_wrong_table_hides_no_contradiction_between_others(write: Write) -> None:
    text = tiny(
        ("x = 0.40", "x = nan"),
        ('kind = "circle"\nradius = 0.70\nrate = -0.4\nphase = 1.5707963267948966', 'kind = "line"\nvelocity = [1, 0]'),
        ("duration = 0.5", "laps = 1"),
        ("rate = 0.0", 'rate = "program"'),
        ("[platform]", "[platform]\nyaw_inertia = 0.1"),
    )
    lines = refused(write(text))
    assert [line.split(": ")[1] for line in lines] == ["platform", "point.x", "horizon.laps", "controller.translation"]


def test_sweep_mistakes_name_key_and_value_once(write: Write) -> None:
    sweep = '[sweep]\n"motion.radius" = [0.6, -1, 0]\n"platform.platform_mass" = [20, 5000]\n'
    lines = refused(write(tiny(more=sweep + '"point.x" = { from = 0, to = 1, count = 3 }\n')))
    assert len(lines) == 3
    assert any("sweep.motion.radius: out of range (-1)" in line for line in lines)
    assert any("sweep.motion.radius: out of range (0)" in line for line in lines)
    assert any("platform: yaw_inertia" in line and "[where platform.platform_mass = 5000]" in line for line in lines)
