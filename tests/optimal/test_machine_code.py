"""Compiled functions: the bits of CasADi, found again by the next process, and not needed where nothing compiles."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from occ import compiler, native
from occ.compiler import NotInC
from occ.errors import InputError, Status
from occ.optimal.collocation import Collocation
from occ.optimal.formulation import Formulation
from occ.optimal.machine_code import Source, at_many
from occ.optimal.mesh import graded_mesh
from occ.optimal.solvers import SolverOptions
from occ.optimal.starts import starts_of
from occ.optimal.transcription import Outcome, Transcription
from occ.task import Limits
from tests.tasks import paper_task

needs_compiler = pytest.mark.skipif(
    not any(shutil.which(name) for name in compiler.COMPILERS), reason="no C compiler on this machine"
)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    # What has been used often by then is not compiled in the middle of these tests.
    monkeypatch.setattr(native, "WORTH", np.inf)
    compiler._compiler.cache_clear()
    return tmp_path / "occ" / "functions"


def every_operation() -> ca.Function:
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    values = [x[0] + x[1], x[0] - x[1], x[0] * p[0], x[0] / p[1], x[0] ** 2, -x[2], 2 * x[1], 1 / x[0], ca.fabs(x[2])]
    values += [ca.sin(x[0]), ca.cos(x[1]), ca.tan(x[2]), ca.sqrt(x[0]), ca.exp(x[1]), ca.log(x[0]), ca.SX(0.1), p[0]]
    return ca.Function("every", [x, p], [ca.densify(ca.vertcat(*values))])


@needs_compiler
@pytest.mark.parametrize("count", [1, 4])
def test_every_operation_gives_the_same_bits(count: int) -> None:
    function, source, rng = every_operation(), Source(), np.random.default_rng(count)
    source.routine(function, "every", shared=(1,))
    source.external("all_every", [3, 2], (1,), 17, ["every(a0, a1, result);"])
    x, p = rng.uniform(0.1, 2.0, (3, count)), rng.normal(size=2)
    symbols = ca.MX.sym("x", 3, count), ca.MX.sym("p", 2)
    many = ca.Function("many", symbols, [at_many(source.load()["all_every"], symbols, shared=(1,))])
    expected = np.column_stack([np.array(function(x[:, k], p)) for k in range(count)])
    np.testing.assert_array_equal(np.array(many(x, p)), expected)


def test_an_operation_that_is_not_known_in_c() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(NotInC):
        Source().routine(ca.Function("f", [x], [ca.asinh(x)]), "f")


def solved(compiled: bool, intervals: int = 5) -> Outcome:
    """A problem with limits, an odd number of intervals, and everything that is compiled."""
    task = paper_task(limits=Limits(torque=1.1))
    formulation = Collocation(objective="torque_squared").posed(task)
    assert isinstance(formulation, Formulation)
    options = SolverOptions(solver="fatrop", compiled=compiled)
    transcription = Transcription(formulation.problem(), intervals, 3, options=options)
    edges = graded_mesh(intervals, 0.05) * task.duration
    guess = formulation.guess(transcription, edges, starts_of(task, 1, None)[0].rotation)
    return transcription.solve(formulation.numbers(transcription, edges), guess)


@needs_compiler
def test_a_solve_gives_the_same_bits_and_is_compiled_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = solved(compiled=False)
    assert not cache.exists()
    fast = solved(compiled=True)
    assert plain.status is fast.status is Status.OK
    assert plain.cost == fast.cost
    np.testing.assert_array_equal(plain.nodes.control, fast.nodes.control)
    np.testing.assert_array_equal(plain.nodes.points, fast.nodes.points)
    libraries = list(cache.iterdir())
    assert [library.suffix for library in libraries] == [".so"]
    compiler._compiler()

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("compiled again")

    # Another number of intervals needs the same functions.
    monkeypatch.setattr(subprocess, "run", refuse)
    assert solved(compiled=True, intervals=6).status is Status.OK
    assert list(cache.iterdir()) == libraries


@needs_compiler
def test_the_key_of_an_experiment_compiles(cache: Path) -> None:
    plain, fast = (
        Collocation(objective="torque_squared", solver="fatrop", compiled=compiled, intervals=4).solve(paper_task())
        for compiled in (False, True)
    )
    assert list(cache.iterdir())
    assert plain.statistics["claimed_cost"] == fast.statistics["claimed_cost"]


def test_the_key_is_refused_where_it_would_do_nothing() -> None:
    with pytest.raises(InputError, match="compiled should be left out where solver is 'ipopt'"):
        Collocation(objective="work", compiled=True)


@pytest.mark.parametrize("broken", ["none", "fails", "nowhere to write"])
def test_without_a_working_compiler_the_functions_stay_as_they_are(
    broken: str, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if broken == "none":
        monkeypatch.setattr(compiler, "COMPILERS", ("no-such-compiler",))
    elif broken == "fails":
        monkeypatch.setattr(compiler, "FLAGS", ("--no-such-flag",))
    else:
        cache.parent.write_text("a file where the folder should be")
    assert solved(compiled=True, intervals=2).status is Status.OK
    assert not cache.exists() or not list(cache.iterdir())
