"""Loops in machine code: the bits of CasADi, made once for all processes, and not needed where nothing compiles."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from occ import compiler, native
from occ.integration import CompiledStep, IntegrationError, Settings, Steps, integrate
from occ.numeric import evaluate_many

needs_compiler = pytest.mark.skipif(
    not any(shutil.which(name) for name in compiler.COMPILERS), reason="no C compiler on this machine"
)
NEVER, AT_ONCE = np.inf, -1.0
Compile = Callable[[float, float], None]


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiler._compiler.cache_clear()
    return tmp_path / "occ" / "functions"


@pytest.fixture
def after(kept: Path, monkeypatch: pytest.MonkeyPatch) -> Compile:
    """Sets the instructions after which a library is looked for, and made."""

    def set_both(looked_for: float, worth: float) -> None:
        monkeypatch.setattr(native, "LOOKED_FOR", looked_for)
        monkeypatch.setattr(native, "WORTH", worth)

    return set_both


def every_kind() -> ca.Function:
    """Elementary functions, branches, a sparse output, and one that does not depend on the points."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    first = [ca.sin(x[0]) * p[0], ca.cos(x[1]) / x[2], ca.sqrt(ca.fabs(x[2])), ca.atan2(x[0], x[1]), x[0] ** 2 + 0.1]
    second = [ca.fmax(x[0], x[1]), ca.if_else(x[0] > x[1], x[2], p[1]), ca.exp(x[0]) - ca.tan(x[1])]
    sparse = ca.SX(4, 1)
    sparse[2] = x[0] * x[1] * p[1]
    outputs = [ca.densify(ca.vertcat(*first)), ca.vertcat(*second), sparse, 2 * p]
    return ca.Function("every", [x, p], outputs)


@needs_compiler
@pytest.mark.parametrize("count", [1, 7, 300])
def test_many_points_have_the_same_bits(count: int, after: Compile, kept: Path) -> None:
    rng = np.random.default_rng(count)
    x, p = rng.normal(size=(3, count)), rng.normal(size=2)
    after(NEVER, NEVER)
    plain = evaluate_many(every_kind(), x, p, shared=(1,))
    assert not kept.exists()
    after(AT_ONCE, AT_ONCE)
    # Neither order in memory nor type of the numbers matters.
    for given in (x, np.asfortranarray(x)):
        compiled = evaluate_many(every_kind(), given, p, shared=(1,))
        assert list(kept.iterdir())
        for one, other in zip(plain, compiled, strict=True):
            np.testing.assert_array_equal(one, other)
    whole = evaluate_many(every_kind(), np.ones((3, 2), dtype=int), p, shared=(1,))
    np.testing.assert_array_equal(whole[0], evaluate_many(every_kind(), np.ones((3, 2)), p, shared=(1,))[0])


@needs_compiler
def test_arguments_that_do_not_fit_are_no_reason_to_read_beyond_them(after: Compile) -> None:
    after(AT_ONCE, AT_ONCE)
    function = every_kind()
    evaluate_many(function, np.ones((3, 4)), np.ones(2), shared=(1,))
    with pytest.raises(ValueError, match="broadcast"):
        evaluate_many(function, np.ones((2, 4)), np.ones(2), shared=(1,))


@cache
def pushed_pendulum(fault: str) -> ca.Function:
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("p")
    faults = {"": ca.SX(0), "pole": 1 / (t - 3) ** 2, "no number": ca.sqrt(3 - t), "jump": 1e9 * (t > 3)}
    push = p * ca.cos(1.3 * t) + faults[fault]
    return ca.Function("rate", [t, x, p], [ca.vertcat(x[1], push - ca.sin(x[0]))])


def motion(end: float = 12.0, largest: float = 1e6, fault: str = "") -> Steps:
    """Over three pieces with a parameter of their own; a fault at t = 3 s."""
    step = CompiledStep(pushed_pendulum(fault), 1e-12)

    def enter(k: int, state: np.ndarray) -> None:
        step.parameters([0.3 * k])

    edges = end * np.array([0.0, 0.21, 0.4, 1.0])
    return integrate(step, edges, np.array([2.0, 0.1]), Settings(longest=0.7, largest=np.full(2, largest)), enter)


@needs_compiler
@pytest.mark.parametrize("end", [12.0, 200.0])
def test_steps_have_the_same_bits(end: float, after: Compile) -> None:
    pushed_pendulum.cache_clear()
    after(NEVER, NEVER)
    plain = motion(end)
    after(AT_ONCE, AT_ONCE)
    assert len(plain.edges) > 30
    # Compiled after its first piece, and from the beginning.
    for compiled in (motion(end), motion(end)):
        for name in ("edges", "first", "shape", "last"):
            np.testing.assert_array_equal(getattr(plain, name), getattr(compiled, name))


@needs_compiler
@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"largest": 2.001}, "leaves every physical range"),
        ({"fault": "pole"}, "leaves every physical range"),
        ({"fault": "no number"}, "leaves every physical range"),
        ({"fault": "jump"}, "shrinks to nothing"),
    ],
)
def test_steps_fail_at_the_same_time_with_the_same_words(keys: dict[str, Any], words: str, after: Compile) -> None:
    pushed_pendulum.cache_clear()
    said = []
    for bound in (NEVER, AT_ONCE, AT_ONCE):
        after(bound, bound)
        with pytest.raises(IntegrationError, match=words) as caught:
            motion(**keys)
        said.append((str(caught.value), caught.value.t))
    assert said == [said[0]] * 3


@needs_compiler
def test_one_process_makes_a_library_and_the_others_look_for_it(
    after: Compile, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    x, p = np.ones((3, 4)), np.ones(2)
    after(AT_ONCE, NEVER)
    evaluate_many(every_kind(), x, p, shared=(1,))
    assert not kept.exists()
    after(AT_ONCE, AT_ONCE)
    evaluate_many(every_kind(), x, p, shared=(1,))
    made = list(kept.iterdir())
    assert [file.suffix for file in made] == [".so"]

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("compiled again")

    monkeypatch.setattr(subprocess, "run", refuse)
    after(AT_ONCE, NEVER)
    many = native.Many(every_kind(), (1,))
    assert many([x, p], 4) is not None
    assert list(kept.iterdir()) == made


def no_home() -> Path:
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.parametrize("broken", ["none", "cannot be started", "fails", "nowhere to write", "no home", "too long"])
def test_without_a_library_casadi_goes_on(
    broken: str, after: Compile, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if broken == "none":
        monkeypatch.setattr(compiler, "COMPILERS", ("no-such-compiler",))
    elif broken == "cannot be started":
        monkeypatch.setattr(shutil, "which", lambda name: "/no/such/compiler")
    elif broken == "no home":
        monkeypatch.delenv("XDG_CACHE_HOME")
        monkeypatch.setattr(Path, "home", no_home)
    elif broken == "fails":
        monkeypatch.setattr(compiler, "FLAGS", ("--no-such-flag",))
    elif broken == "nowhere to write":
        kept.parent.write_text("a file where the folder should be")
    else:
        monkeypatch.setattr(native, "LONGEST", 10)
    x, p = np.linspace(0.1, 2.0, 12).reshape(3, 4), np.ones(2)
    after(NEVER, NEVER)
    plain = evaluate_many(every_kind(), x, p, shared=(1,))
    after(AT_ONCE, AT_ONCE)
    function = every_kind()
    for _ in range(3):
        np.testing.assert_array_equal(evaluate_many(function, x, p, shared=(1,))[0], plain[0])
    assert not kept.exists() or not list(kept.iterdir())
