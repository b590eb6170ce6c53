"""Malformed files: exit code 2, one clear line for each mistake, nothing written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.experiment import tiny
from tests.experiment.conftest import Occ, Write

CIRCLE = 'kind = "circle"\nradius = 0.70\nrate = -0.4\nphase = 1.5707963267948966'
LINE = 'kind = "line"\nvelocity = [0.3, 0.0]'

# id, file, words that the single line must contain
BAD = [
    ("syntax", tiny(("radius = 0.70", "radius 0.70")), ["line 13, column", "not TOML"]),
    ("key twice", tiny(("radius = 0.70", "radius = 0.70\nradius = 0.7")), ["line 14", "not TOML"]),
    ("unknown table", tiny(more="[limit]\ntorque = 1\n"), ["limit:", "unknown key", '"limits"']),
    ("misspelt table", tiny(("[horizon]", "[horizn]")), ["horizn:", "unknown key", '"horizon"']),
    ("missing table", tiny(("[point]\nx = 0.40\ny = 0.05", "")), ["point:", "missing", "[point]"]),
    ("not a table", "limits = 3\n" + tiny(), ["limits:", "wrong type (3)", "a table"]),
    ("misspelt key", tiny(("radius = 0.70", "raduis = 0.70")), ["motion.raduis:", "unknown key", '"radius"']),
    ("unknown key", tiny(("x = 0.40", "x = 0.40\ndepth = 1")), ["point.depth:", "unknown key", "valid: x, y"]),
    ("missing key", tiny(("rate = -0.4\n", "")), ["motion.rate:", "missing", "[rad/s]"]),
    ("text for number", tiny(("0.70", '"0.70"')), ["motion.radius:", 'wrong type ("0.70")', "a number"]),
    ("boolean for number", tiny(("0.70", "true")), ["motion.radius:", "wrong type (true)", "a number"]),
    ("nan", tiny(("0.70", "nan")), ["motion.radius:", "not finite (nan)", "a finite number"]),
    ("too large", tiny(("0.70", "1e300")), ["motion.radius:", "out of range (1e+300)", "at most 1e+09"]),
    ("too small", tiny(("0.70", "1e-320")), ["motion.radius:", "out of range", "at least 1e-100"]),
    (
        "too large in a list",
        tiny(("[platform]", "[platform]\nmass_center = [1e99, 0]")),
        ["platform.mass_center:", "out of range (1e+99)"],
    ),
    (
        "tolerance below rounding",
        tiny(more='[[controller]]\nname = "c"\nkind = "collocation"\nobjective = "work"\ntolerance = 1e-300\n'),
        ["controller.c.tolerance:", "(1e-300)", "at least 1e-12"],
    ),
    ("infinity", tiny(("x = 0.40", "x = -inf")), ["point.x:", "not finite (-inf)"]),
    ("zero radius", tiny(("0.70", "0.0")), ["motion.radius:", "out of range (0.0)", "greater than 0"]),
    (
        "negative mass",
        tiny(("[platform]", "[platform]\nplatform_mass = -1")),
        ["platform.platform_mass:", "out of range (-1)", "greater than 0"],
    ),
    (
        "negative friction",
        tiny(("[platform]", "[platform]\nwheel_friction = -0.1")),
        ["platform.wheel_friction:", "(-0.1)", "at least 0"],
    ),
    (
        "impossible inertia",
        tiny(("[platform]", "[platform]\nyaw_inertia = 0.1")),
        ["platform:", "yaw_inertia 0.1 kg m^2", "should exceed"],
    ),
    ("circle at rest", tiny(("rate = -0.4", "rate = 0")), ["motion:", "rate 0 keeps B at rest"]),
    (
        "three coordinates",
        tiny(("[platform]", "[platform]\nmass_center = [0, 0, 0]")),
        ["platform.mass_center:", "too many", "at most 2"],
    ),
    (
        "boolean coordinate",
        tiny(("[platform]", "[platform]\nmass_center = [0, false]")),
        ["platform.mass_center #2:", "wrong type (false)"],
    ),
    (
        "roller as large as its wheel",
        tiny(("[platform]", "[platform]\nroller_radius = 0.05")),
        ["platform:", "roller_radius should be less than", "0.0475 m", "not 0.05 m"],
    ),
    ("unknown preset", tiny(('"youbot"', '"yubot"')), ["platform.preset:", '("yubot")', '"youbot"']),
    ("unknown motion", tiny(('"circle"', '"circel"')), ["motion.kind:", '("circel")', '"circle"']),
    ("unknown controller", tiny(('"servo"', '"swerve"')), ["controller.servo law.kind:", '("swerve")', '"servo"']),
    (
        "no kind",
        tiny(('kind = "servo"\n', "")),
        ["controller.servo law.kind:", "missing", "servo, servo_measured, prescribed_rotation"],
    ),
    ("no controller", tiny().partition("[[controller]]")[0], ["controller:", "at least one", "[[controller]]"]),
    (
        "controller as a table",
        tiny().partition("[[controller]]")[0] + '[controller]\nname = "a"\nkind = "servo"\n',
        ["controller:", "[[controller]]"],
    ),
    ("same name", tiny(('"translation"', '"servo law"')), ["controller.servo law.name:", "not unique"]),
    ("same file name", tiny(('"translation"', '"Servo_Law"')), ["Servo_Law", "not unique", '"servo law"']),
    ("path in name", tiny(('"translation"', '"../translation"')), ["controller", 'not a name ("../translation")']),
    ("only dots", tiny(('"translation"', '".."')), ["controller", 'not a name ("..")', "not only dots"]),
    ("space at the end", tiny(('"translation"', '"translation "')), ["controller", "without a space at either end"]),
    ("name is a number", tiny(('"translation"', "7")), ["controller #2.name:", "wrong type (7)", "a text"]),
    ("rate is a word", tiny(("rate = 0.0", 'rate = "fast"')), ['("fast")', "a number", '"program"']),
    ("laps and duration", tiny(("duration = 0.5", "duration = 0.5\nlaps = 1")), ["horizon:", "contradict"]),
    ("neither", tiny(("duration = 0.5", "")), ["horizon:", "neither laps nor duration"]),
    ("too long", tiny(("duration = 0.5", "duration = 1000001")), ["horizon.duration:", "(1000001)", "at most 1e+06"]),
    ("too many laps", tiny(("duration = 0.5", "laps = 1e6")), ["horizon.laps:", "too long", "1e+06 s"]),
    ("negative duration", tiny(("duration = 0.5", "duration = -1")), ["horizon.duration:", "(-1)", "greater than 0"]),
    ("laps of a line", tiny((CIRCLE, LINE), ("duration = 0.5", "laps = 1")), ["horizon.laps:", "line", "duration"]),
    (
        "turning rate of a line",
        tiny((CIRCLE, LINE), ("rate = 0.0", 'rate = "program"')),
        ["controller.translation:", "line has none", "rad/s"],
    ),
    ("zero limit", tiny(more="[limits]\ntorque = 0\n"), ["limits.torque:", "(0)", "greater than 0"]),
    (
        "unknown objective",
        tiny(more='[compare]\nobjectives = ["wrok"]\n'),
        ["compare.objectives #1:", '("wrok")', '"work"'],
    ),
    ("no objective", tiny(more="[compare]\nobjectives = []\n"), ["compare.objectives:", "at least 1"]),
    (
        "objective twice",
        tiny(more='[compare]\nobjectives = ["work", "work"]\n'),
        ["compare.objectives:", "more than once"],
    ),
    ("title is a number", tiny(('"Tiny"', "3")), ["title:", "wrong type (3)", "a text"]),
    ("sweep of unknown key", tiny(more='[sweep]\n"motion.raduis" = [1]\n'), ["sweep.motion.raduis:", '"radius"']),
    ("sweep of a bad value", tiny(more='[sweep]\n"motion.radius" = [0.6, -1]\n'), ["sweep.motion.radius:", "(-1)"]),
    ("sweep without values", tiny(more='[sweep]\n"motion.radius" = []\n'), ["sweep.motion.radius:", "at least 1"]),
    ("sweep of one number", tiny(more='[sweep]\n"motion.radius" = 0.6\n'), ["sweep.motion.radius:", "a list"]),
    (
        "sweep twice",
        tiny(more='[sweep]\n"motion.radius" = [0.6, 0.60]\n'),
        ["sweep.motion.radius:", "0.6", "more than once"],
    ),
    (
        "range of one",
        tiny(more='[sweep]\n"motion.radius" = { from = 1, to = 2, count = 1 }\n'),
        ["sweep.motion.radius.count:", "(1)", "at least 2"],
    ),
    (
        "range with a fraction",
        tiny(more='[sweep]\n"motion.radius" = { from = 1, to = 2, count = 2.5 }\n'),
        ["sweep.motion.radius.count:", "(2.5)", "a whole number"],
    ),
    (
        "sweep against sweep",
        tiny(more='[sweep]\nhorizon = [{ laps = 1 }]\n"horizon.duration" = [1.0]\n'),
        ["sweep.horizon.duration:", "contradicts", '"horizon"'],
    ),
    ("sweep of objectives", tiny(more='[sweep]\n"compare.objectives" = [["work"]]\n'), ["cannot be swept"]),
    (
        "sweep of unknown controller",
        tiny(more='[sweep]\n"controller.servo.rate" = [1.0]\n'),
        ["sweep.controller.servo.rate:", "unknown controller", '"servo law"'],
    ),
    (
        "too many cases",
        tiny(more="".join(["[sweep]\n", *(f'"point.{k}" = {{ from = 0, to = 1, count = 400 }}\n' for k in "xy")])),
        ["sweep:", "too many cases (160000)"],
    ),
]


@pytest.mark.parametrize(("text", "words"), [pytest.param(*item[1:], id=item[0]) for item in BAD])
def test_one_clear_line(write: Write, occ: Occ, tmp_path: Path, text: str, words: list[str]) -> None:
    path = write(text)
    for result in (occ("check", path), occ("run", path, "--out", tmp_path / "out")):
        assert result.exit_code == 2
        assert result.stdout == ""
        (line,) = result.stderr.splitlines()
        assert line.startswith(f"{path}: ")
        for word in words:
            assert word in line
    assert [item.name for item in tmp_path.iterdir()] == ["tiny.toml"]


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("motion.raduis=1", ["--set motion.raduis:", '"radius"']),
        ("horison.duration=1", ["--set horison:", '"horizon"']),
        ("motion.radius=wide", ["--set motion.radius:", 'wrong type ("wide")']),
        ("controller.translaton.rate=1", ["--set controller.translaton.rate:", '"translation"']),
        ("controller.translation={}", ["--set controller.translation:", "one of its keys"]),
        ("title.x=1", ["--set title.x:", "title is not a table"]),
        ("motion.radius", ["--set motion.radius:", "KEY=VALUE"]),
        ("=1", ["KEY=VALUE"]),
        ("limits.torque=-2", ["--set limits.torque:", "(-2)"]),
    ],
)
def test_bad_setting_is_one_line(write: Write, occ: Occ, tmp_path: Path, setting: str, words: list[str]) -> None:
    result = occ("run", write(), "--out", tmp_path / "out", "--set", setting)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    for word in words:
        assert word in line
    assert not (tmp_path / "out").exists()


def test_files_that_are_no_text(occ: Occ, tmp_path: Path) -> None:
    (tmp_path / "latin.toml").write_bytes('title = "Größe"\n'.encode("latin-1"))
    for name, words in (("absent.toml", "No such file"), (".", "directory"), ("latin.toml", "not a text in UTF-8")):
        result = occ("check", tmp_path / name)
        assert result.exit_code == 2
        (line,) = result.stderr.splitlines()
        assert words in line


def test_a_mark_of_the_byte_order_is_no_mistake(occ: Occ, tmp_path: Path) -> None:
    path = tmp_path / "notepad.toml"
    path.write_text(tiny(), encoding="utf-8-sig")
    assert occ("check", path).exit_code == 0


def test_a_cluster_that_is_not_there_leaves_nothing(write: Write, occ: Occ, tmp_path: Path) -> None:
    path = write()
    result = occ("run", path, "--out", tmp_path / "out", "--dask", "nonsense")
    assert result.exit_code == 2
    assert (
        result.stderr
        == "--dask nonsense: no scheduler answers there; should be the address that dask-scheduler prints\n"
    )
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("option", ["--time-limit", "--memory-limit", "--patience"])
def test_an_option_of_the_engine_is_named_as_it_was_given(write: Write, occ: Occ, option: str) -> None:
    result = occ("run", write(), option, "-1")
    assert (result.exit_code, result.stderr) == (2, f"{option} should be greater than 0, not -1.0\n")


def test_two_mistakes_are_two_lines(write: Write, occ: Occ) -> None:
    result = occ("check", write(tiny(("x = 0.40", "x = true"), ("radius = 0.70", "radius = -1"))))
    assert result.exit_code == 2
    assert len(result.stderr.splitlines()) == 2


def test_from_outside(write: Write, tmp_path: Path) -> None:
    path = write(tiny(("radius = 0.70", "raduis = 0.70")))
    command = [sys.executable, "-m", "occ.cli", "run", str(path)]
    result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == f'{path}: motion.raduis: unknown key; did you mean "radius"?\n'
    assert [item.name for item in tmp_path.iterdir()] == ["tiny.toml"]
