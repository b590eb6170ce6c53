"""A user's own controllers: only with permission, one clear line for each mistake, a row for whatever they do."""

from __future__ import annotations

import csv
import json
import pickle
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import occ as package
from occ.experiment.load import load_experiment
from occ.experiment.own_code import MODULE_PREFIX
from occ.referee import MEASURES
from tests.experiment import tiny
from tests.experiment.conftest import Occ, Write

HEAD = """\
from __future__ import annotations
from dataclasses import dataclass, field
from typing import Annotated, Any, Callable, ClassVar, Literal
import numpy as np
from annotated_types import Gt
import occ
"""
DATA = "@dataclass(frozen=True, kw_only=True)\n"
LAW = "class Own(occ.PathKeepingLaw):\n"
STILL = "    def yaw_acceleration(self, moment):\n        return 0.0\n"
DAMPED = (
    DATA
    + LAW
    + "    gain: float\n    def yaw_acceleration(self, moment):\n        return -self.gain * moment.yaw_rate\n"
)
FIELDS = f"""\
{DATA}{LAW}    gain: Annotated[float, Gt(0)] = 1.0
    mode: Literal["alpha", "beta"] = "alpha"
    flag: bool = True
    count: int = 3
    pair: tuple[float, float] = (1.0, 2.0)
    word: str = "a"
    hidden: float = field(default=0.0, init=False)
{STILL}"""
PLAIN = """\
class Own:
    def __init__(self, gain, count: int = 3):
        self.gain, self.count = gain, count
    def solve(self, task):
        return occ.PrescribedRotation(rate=self.gain, heading=float(self.count)).solve(task)
"""
OPEN = "class Own:\n    def __init__(self, **keys):\n        pass\n    def solve(self, task):\n        pass\n"


def experiment(keys: str = "", kind: str = "law.py:Own", more: str = "") -> str:
    return tiny(more=f'\n[[controller]]\nname = "own"\nkind = "{kind}"\n{keys}\n{more}')


def rows_of(out: Path) -> list[dict[str, str]]:
    with (out / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def law(tmp_path: Path) -> Any:
    """Write a file of the user's; returns its path."""

    def _law(text: str, name: str = "law.py", head: str = HEAD) -> Path:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(head + text, encoding="utf-8")
        return path

    return _law


def test_nothing_is_loaded_without_permission(write: Write, occ: Occ, law: Any, tmp_path: Path) -> None:
    law(f"open({str(tmp_path / 'trace')!r}, 'w').close()\n" + LAW + STILL)
    path = write(experiment())
    for arguments in (("check", path), ("run", path, "--out", tmp_path / "out")):
        result = occ(*arguments)
        assert result.exit_code == 2
        assert result.stdout == ""
        (line,) = result.stderr.splitlines()
        assert line.startswith(f"{path}: controller.own.kind: ")
        assert '("law.py:Own")' in line
        assert line.endswith("the option --allow-code would load it")
        assert sorted(item.name for item in tmp_path.iterdir()) == ["law.py", "tiny.toml"]
    # The file does leave its trace when it is loaded, and nothing else: no compiled code beside it.
    assert occ("check", path, "--allow-code").stdout == "ok: 1 case, 3 controllers\n"
    assert sorted(item.name for item in tmp_path.iterdir()) == ["law.py", "tiny.toml", "trace"]


@pytest.mark.usefixtures("no_figures")
def test_two_workers_from_another_folder(
    write: Write, occ: Occ, occ_as_it_is: Occ, law: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two files with one class name, swept keys, spawned processes: the same as in this process and as in Python."""
    law(DAMPED)
    law(PLAIN.replace("class Own", "class Own(object)"), "other/law.py")
    sweep = '[sweep]\n"controller.own.gain" = [1.0, 2.5]\n'
    second = '[[controller]]\nname = "second"\nkind = "other/law.py:Own"\ngain = 0.3\n'
    path = write(experiment(more=second + "[start]\nheading_rate = 0.5\n" + sweep))
    options = ("--json", "--allow-code")
    assert occ("run", path, "--out", tmp_path / "1", *options).exit_code == 0
    monkeypatch.chdir("/")
    result = occ_as_it_is("run", path, "--out", tmp_path / "2", *options, "--workers", "2")
    assert (result.exit_code, result.stderr) == (0, "")
    table = (tmp_path / "2" / "results.csv").read_bytes()
    assert table == (tmp_path / "1" / "results.csv").read_bytes()
    rows = json.loads(result.stdout)["rows"]

    class Damped(package.PathKeepingLaw):
        def yaw_acceleration(self, moment: Any) -> Any:
            return -gain * moment.yaw_rate

    cases = load_experiment(path, allow_code=True).cases
    assert [row["controller"] for row in rows] == ["servo law", "translation", "own", "second"] * 2
    for case, gain, own, other in zip(cases, (1.0, 2.5), rows[2::4], rows[3::4], strict=True):
        task = case.task()
        # A class of its own for each gain: laws that are equal share their functions.
        twin = type("Twin", (Damped,), {})()
        rotation = package.PrescribedRotation(rate=0.3, heading=3.0)
        for row, player in ((own, twin), (other, rotation)):
            assert {name: row[name] for name in MEASURES} == package.judge(task, player.solve(task)).measures
        assert own["controller.own.gain"] == gain
        assert (own["status"], own["start"], other["start"]) == ("ok", "given", "own")
    assert rows[2]["work_J"] != rows[6]["work_J"]
    # No path of this machine is stored.
    record = (tmp_path / "2" / "run.json").read_text()
    assert "law.py:Own" in record
    assert str(tmp_path) not in record + table.decode()


def test_case_stays_plain_data_and_carries_the_permission(write: Write, law: Any) -> None:
    law(DAMPED)
    law(DAMPED, "other/law.py")
    second = '[[controller]]\nname = "second"\nkind = "other/law.py:Own"\ngain = 3\n'
    (case,) = load_experiment(write(experiment("gain = 2", more=second)), allow_code=True).cases
    twin = pickle.loads(pickle.dumps(case))
    assert (twin, twin.key) == (case, case.key)
    own: list[Any] = list(twin.players().values())[2:]
    assert [(player.gain, type(player.gain)) for player in own] == [(2.0, float), (3.0, float)]
    for player in own:
        # Annotations are resolved in the class's own module.
        assert type(player).__module__.startswith(MODULE_PREFIX)
        assert sys.modules[type(player).__module__].Own is type(player)
    json.dumps(dict(case.tables))


@pytest.mark.usefixtures("no_figures")
def test_edited_file_is_solved_again(write: Write, occ: Occ, law: Any, tmp_path: Path) -> None:
    path, out = write(experiment("gain = 1.0", more="[start]\nheading_rate = 0.5\n")), tmp_path / "out"
    command = ("run", path, "--out", out, "--allow-code")
    law(DAMPED)
    assert occ(*command).exit_code == 0
    first = rows_of(out)
    stored = {item: item.stat().st_mtime_ns for item in (out / ".store").glob("*.json")}
    assert occ(*command).exit_code == 0
    assert {item: item.stat().st_mtime_ns for item in (out / ".store").glob("*.json")} == stored
    law(DAMPED.replace("-self.gain", "-3.0 * self.gain"))
    assert occ(*command).exit_code == 0
    second = rows_of(out)
    assert len(list((out / ".store").glob("*.json"))) == 2
    assert second[0] == first[0]
    assert second[2]["work_J"] != first[2]["work_J"]


def test_file_that_changes_in_between_is_refused(write: Write, law: Any) -> None:
    law(DAMPED)
    (case,) = load_experiment(write(experiment("gain = 1.0")), allow_code=True).cases
    law(DAMPED + "# edited\n")
    code = f"import pickle; pickle.loads({pickle.dumps(case)!r}).players()"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "law.py: changed while the experiment was running" in result.stderr.splitlines()[-1]


def test_paths_count_from_the_experiment_or_are_absolute(write: Write, occ: Occ, law: Any, tmp_path: Path) -> None:
    absolute = law(LAW + STILL, "laws/law.py")
    path = write(experiment(kind="laws/law.py:Own"))
    assert occ("check", path, "--allow-code").exit_code == 0
    assert occ("check", path, "--allow-code", "--set", f"controller.own.kind={absolute}:Own").exit_code == 0
    assert occ("check", path, "--allow-code", "--set", "controller.own.kind=law.py:Own").exit_code == 2


# id, file, further keys, words that the single line must contain
BAD = [
    ("syntax", "x = = 3\n", "", ["own.kind: law.py, line 7: not Python (invalid syntax)"]),
    ("error", "x = 1\ny = 1 / 0\n", "", ["own.kind: law.py, line 8: raised ZeroDivisionError: division by zero"]),
    ("exit", "raise SystemExit('a\\n b')\n", "", ["own.kind: law.py, line 7: raised SystemExit: a b"]),
    ("import", "import not_there\n", "", ["law.py, line 7: raised ModuleNotFoundError"]),
    ("thawed", "@dataclass\n" + LAW + "    a: float = 0\n" + STILL, "", ["law.py, line 7", "frozen"]),
    ("no such class", (LAW + STILL).replace("Own", "Owm"), "", ["own.kind:", 'no class "Own"', '"Owm"?']),
    ("no class at all", "Own = 3\n", "", ["own.kind:", 'no class "Own"', "the file has no class"]),
    ("no solve", "class Own:\n    pass\n", "", ["own.kind:", "has no solve(task)", "occ.PathKeepingLaw"]),
    ("abstract", LAW + "    pass\n", "", ["own.kind:", "lacks yaw_acceleration"]),
    ("no dataclass", LAW + "    gain: float = 1.0\n" + STILL, "gain = 2.0", ["gain: annotated", "@dataclass(frozen"]),
    (
        "hidden key",
        LAW + "    def __init__(self, gain=1.0):\n        object.__setattr__(self, 'gain', gain)\n" + STILL,
        "gain = 2.0",
        ["own.kind:", "gain: not a field of the law", "@dataclass(frozen"],
    ),
    ("type", DATA + LAW + "    a: Callable[[], int] = None\n" + STILL, "", ["own.kind:", "a: Callable", "float, int"]),
    ("array", DATA + LAW + "    a: np.ndarray = None\n" + STILL, "", ["own.kind:", "a: numpy.ndarray"]),
    ("list of a law", DATA + LAW + "    a: list[float] = None\n" + STILL, "", ["a: list[float]", "a tuple of them"]),
    ("annotation", DATA + LAW + "    a: Nothing = None\n" + STILL, "", ["own.kind:", "NameError", "Nothing"]),
    ("reserved key", PLAIN.replace("gain", "name"), "", ["own.kind:", "name cannot be a key"]),
    ("unknown key", FIELDS, "gian = 1.0", ["own.gian: unknown key", '"gain"']),
    ("no key", FIELDS, "hidden = 1.0", ["own.hidden: unknown key"]),
    ("boolean", FIELDS, "gain = true", ["own.gain: wrong type (true); should be a number"]),
    ("text", FIELDS, 'gain = "1"', ['own.gain: wrong type ("1"); should be a number']),
    ("nan", FIELDS, "gain = nan", ["own.gain: not finite (nan)"]),
    ("range", FIELDS, "gain = -1", ["own.gain: out of range (-1); should be greater than 0"]),
    ("literal", FIELDS, 'mode = "alpa"', ["own.mode:", '"alpha"?']),
    ("flag", FIELDS, "flag = 1", ["own.flag: wrong type (1); should be true or false"]),
    ("fraction", FIELDS, "count = 1.5", ["own.count: wrong type (1.5); should be a whole number"]),
    ("boolean coordinate", FIELDS, "pair = [1, true]", ["own.pair #2: wrong type (true)"]),
    ("missing", DAMPED, "", ["own.gain: missing; needed: a number"]),
    ("missing of a plain class", PLAIN, "", ["own.gain: missing"]),
    ("unknown of a plain class", PLAIN, "gain = 1\ncuont = 2", ["own.cuont: unknown key", '"count"']),
    ("type of a plain class", PLAIN, 'gain = 1\ncount = "2"', ['own.count: wrong type ("2")']),
    ("nan of a plain class", PLAIN, "gain = [nan]", ["own.gain: not finite (nan)"]),
    ("date of a plain class", PLAIN, "gain = 2020-01-01", ["own.gain: wrong type (2020-01-01)"]),
    ("nan of an open class", OPEN, "other = nan", ["own.other: not finite (nan)"]),
    (
        "constructor",
        PLAIN.replace("self.gain, self.count = gain, count", "{}['key']"),
        "gain = 1",
        ["controller.own: Own(...) raised KeyError: 'key'"],
    ),
    (
        "refusal",
        PLAIN.replace("self.gain, self.count = gain, count", "raise ValueError('gain\\n  too high')"),
        "gain = 1",
        ["controller.own: gain too high"],
    ),
    (
        "check",
        PLAIN + "    def check(self, task):\n        1 / 0\n",
        "gain = 1",
        ["its check raised ZeroDivisionError"],
    ),
    (
        "check refuses",
        PLAIN + "    def check(self, task):\n        raise occ.InputError(f'not for {task.duration:g} s')\n",
        "gain = 1",
        ["controller.own: not for 0.5 s"],
    ),
]


@pytest.mark.parametrize(("text", "keys", "words"), [pytest.param(*item[1:], id=item[0]) for item in BAD])
def test_one_clear_line(
    write: Write, occ: Occ, law: Any, tmp_path: Path, text: str, keys: str, words: list[str]
) -> None:
    law(text)
    path = write(experiment(keys))
    for arguments in (("check", path), ("run", path, "--out", tmp_path / "out")):
        result = occ(*arguments, "--allow-code")
        assert result.exit_code == 2
        assert result.stdout == ""
        (line,) = result.stderr.splitlines()
        assert line.startswith(f"{path}: controller.own")
        for word in words:
            assert word in line
    assert sorted(item.name for item in tmp_path.iterdir()) == ["law.py", "tiny.toml"]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("absent.py:Own", ['("absent.py": No such file or directory)', "from the folder of the experiment"]),
        ("folder.py:Own", ['("folder.py": Is a directory)']),
        ("law.txt:Own", ['not a Python file ("law.txt")', '"path/to/file.py:ClassName"']),
        ("law.py", ['no name of a class ("")', '"path/to/file.py:ClassName"']),
        ("law.py:1x", ['no name of a class ("1x")']),
        ("servo:x", ['not a Python file ("servo")']),
        ("swerve", ['unknown name ("swerve")', '"servo"?']),
    ],
)
def test_kind_that_names_no_file_is_one_line(
    write: Write, occ: Occ, tmp_path: Path, kind: str, words: list[str]
) -> None:
    (tmp_path / "folder.py").mkdir()
    path = write(experiment(kind=kind))
    result = occ("run", path, "--out", tmp_path / "out", "--allow-code")
    assert (result.exit_code, result.stdout) == (2, "")
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"{path}: controller.own.kind: ")
    for word in words:
        assert word in line
    assert not (tmp_path / "out").exists()


def test_mistake_elsewhere_is_said_too(write: Write, occ: Occ, law: Any) -> None:
    law(DAMPED)
    text = experiment("gain = true").replace("radius = 0.70", "radius = -1")
    result = occ("check", write(text), "--allow-code")
    first, second = sorted(result.stderr.splitlines())
    assert "controller.own.gain" in first
    assert "motion.radius" in second


def test_keys_reach_the_class(write: Write, law: Any) -> None:
    law(FIELDS)
    keys = 'gain = 2\nmode = "beta"\nflag = false\ncount = 5\npair = [3, 4]\nword = "b"'
    (case,) = load_experiment(write(experiment(keys)), allow_code=True).cases
    player = case.players()["own"]
    names = ("gain", "mode", "flag", "count", "pair", "word", "hidden")
    assert [getattr(player, name) for name in names] == [2.0, "beta", False, 5, (3.0, 4.0), "b", 0.0]
    law(OPEN.replace("pass", "self.keys = keys", 1), "open.py")
    keys = 'a = 1\nb = [1.5, "x"]\nc = { d = true }'
    (case,) = load_experiment(write(experiment(keys, "open.py:Own")), allow_code=True).cases
    assert case.players()["own"].keys == {"a": 1, "b": [1.5, "x"], "c": {"d": True}}


def test_what_a_class_prints_is_no_part_of_the_answer(write: Write, occ: Occ, law: Any, tmp_path: Path) -> None:
    law("print('loaded')\n" + PLAIN.replace("        return", "        print('solved')\n        return"))
    result = occ("run", write(experiment("gain = 0.1")), "--out", tmp_path / "out", "--json", "--allow-code")
    assert [row["status"] for row in json.loads(result.stdout)["rows"]] == ["ok"] * 3
    assert set(result.stderr.split()) == {"loaded", "solved"}


CONTROL = "        start = task.state_on_program(0.0, 0.0, 0.0)\n"
SOLVE = "class Own:\n    def solve(self, task):\n" + CONTROL
RETURN = "        return occ.Solution(start_state=start, control=occ.PythonControl(lambda t, x: {}))\n"
YAW = LAW + "    def yaw_acceleration(self, moment):\n        return {}\n"
# id, file, status, pattern of the message
ROWS = [
    ("raises", SOLVE + "        return 1 / 0\n", "crashed", "^ZeroDivisionError: division by zero$"),
    ("exits", SOLVE + "        raise SystemExit(3)\n", "crashed", "^SystemExit: 3$"),
    ("nothing returned", SOLVE, "crashed", "^the player returned None, not a Solution$"),
    ("text returned", SOLVE + "        return 'ok'\n", "crashed", "^the player returned a str, not a Solution$"),
    ("one torque for all", SOLVE + RETURN.format("0.1"), "crashed", r"a float of the shape \(\) .* not of \(4,\)$"),
    ("three torques", SOLVE + RETURN.format("np.zeros(3)"), "crashed", r"the shape \(3,\) .* not of \(4,\)$"),
    ("a column", SOLVE + RETURN.format("np.zeros((4, 1))"), "crashed", r"the shape \(4, 1\) .* not of \(4,\)$"),
    ("no torque", SOLVE + RETURN.format("None"), "crashed", "^the control gives None"),
    ("complex torques", SOLVE + RETURN.format("np.zeros(4) * 1j"), "crashed", "complex128, not real numbers$"),
    ("torques that are not numbers", SOLVE + RETURN.format("np.full(4, np.nan)"), "unstable", "physical range"),
    ("torques that do nothing", SOLVE + RETURN.format("np.zeros(4)"), "failed", "B leaves its program"),
    (
        "status without a motion",
        SOLVE + "        return occ.Solution(start_state=None, control=None, status='ok')\n",
        "failed",
        "no control",
    ),
    (
        "verdict of its own",
        SOLVE + RETURN.format("np.zeros(4)").replace("start_state=start", "start_state=start, status='ok'"),
        "failed",
        "B leaves its program",
    ),
    (
        "unknown status",
        SOLVE + RETURN.format("np.zeros(4)").replace("start_state=start", "start_state=start, status='great'"),
        "crashed",
        "the status 'great', not one of ok, infeasible",
    ),
    (
        "unknown claim",
        SOLVE + RETURN.format("np.zeros(4)").replace("=start,", "=start, claim=occ.Claim(start='mine'),"),
        "crashed",
        "claims the start 'mine', not one of given, own, free",
    ),
    (
        "short start state",
        SOLVE + RETURN.format("np.zeros(4)").replace("=start,", "=start[:5],"),
        "crashed",
        r"a start state of the shape \(5,\), not \(6,\)",
    ),
    (
        "claimed motion of another horizon",
        f"{SOLVE}        import dataclasses\n        told = occ.ServoLaw().solve(task)\n        c = told.claimed\n"
        "        return dataclasses.replace(told, claimed=occ.Trajectory(c.t * 0.5, c.state, c.state_rate))\n",
        "failed",
        "^the claimed motion covers 0 s to 0.25 s, not the whole horizon$",
    ),
    (
        "claimed motion that is none",
        f"{SOLVE}        import dataclasses\n"
        "        return dataclasses.replace(occ.ServoLaw().solve(task), claimed=np.zeros((6, 2)))\n",
        "crashed",
        "an ndarray as its claimed motion, not a Trajectory$",
    ),
    ("no yaw acceleration", YAW.format("None"), "crashed", "."),
    ("two yaw accelerations", YAW.format("[1.0, 2.0]"), "crashed", "."),
    ("a row of yaw accelerations", YAW.format("np.array([[1.0, 2.0]])"), "crashed", "."),
    ("text as yaw acceleration", YAW.format("'fast'"), "crashed", "."),
    ("yaw acceleration that is not a number", YAW.format("float('nan')"), "unstable", "."),
    ("yaw acceleration that raises", YAW.format("moment.nothing"), "crashed", "AttributeError: .*nothing"),
]


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(("text", "status", "message"), [pytest.param(*item[1:], id=item[0]) for item in ROWS])
def test_whatever_it_does_is_a_row(
    write: Write, occ: Occ, law: Any, tmp_path: Path, text: str, status: str, message: str
) -> None:
    law(text)
    result = occ("run", write(experiment()), "--out", tmp_path / "out", "--allow-code")
    assert result.exit_code == 1, result.output
    *others, row = rows_of(tmp_path / "out")
    assert [item["status"] for item in others] == ["ok", "ok"]
    assert row["status"] == status
    assert re.search(message, row["message"]), row["message"]
    assert "\n" not in row["message"]
    assert "Traceback" not in result.output


def test_schema_allows_own_kinds(occ: Occ) -> None:
    schema = json.loads(occ("schema").stdout)
    assert {"$ref": "#/$defs/OwnController"} in schema["properties"]["controller"]["items"]["oneOf"]
    table = schema["$defs"]["OwnController"]
    assert set(table["required"]) == {"kind", "name"}
    assert table.get("additionalProperties", True) is True
    assert table["properties"]["name"]["pattern"]
    pattern = table["properties"]["kind"]["pattern"]
    for kind in ("law.py:Own", "../laws/my-law.py:Own_2", "/abs/law.py:Own"):
        assert re.search(pattern, kind)
    for kind in ("servo", "law.py", "law.txt:Own", "law.py:1", ".py:Own", "law.py:Own.x"):
        assert not re.search(pattern, kind)
