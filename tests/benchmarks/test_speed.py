"""Timings, run by `make benchmark`: build, cold solve and re-solve of an optimum; a law; the referee; the model.

Each states the error at which it was measured, so that a fast wrong answer is not a good one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from occ.laws import ServoLaw
from occ.model import appell, coefficients
from occ.model.dynamics import Dynamics
from occ.optimal.collocation import Collocation
from occ.optimal.problem import Nodes, Numbers
from occ.optimal.solvers import SolverName, SolverOptions
from occ.optimal.starts import starts_of
from occ.optimal.transcription import Transcription
from occ.referee import judge
from occ.task import Task
from tests.tasks import paper_task

pytestmark = pytest.mark.benchmark

PLAYER = Collocation(objective="torque_squared", intervals=8, degree=5, tolerance=1e-4)
LEAST = 29.1715677318
"""[N^2 m^2 s] Least integral of sum M_i^2 in one lap, from the check values of the errata."""


def built(solver: SolverName) -> Transcription:
    formulation = PLAYER.posed(paper_task())
    assert formulation is not None
    options = SolverOptions(solver=solver)
    return Transcription(formulation.problem(), PLAYER.intervals, PLAYER.degree, PLAYER.scheme, options)


def posed(task: Task, transcription: Transcription) -> tuple[Numbers, Nodes]:
    formulation, edges = PLAYER.posed(task), PLAYER.first_mesh(task)
    assert formulation is not None
    rotation = starts_of(task, 1, None)[0].rotation
    return formulation.numbers(transcription, edges), formulation.guess(transcription, edges, rotation)


both_solvers = pytest.mark.parametrize("solver", ["ipopt", "fatrop"])


@pytest.fixture(autouse=True)
def _the_replayed_error_is_below_1e_6(request: pytest.FixtureRequest) -> Iterator[None]:
    yield
    if "solve" in request.node.name:
        task = paper_task()
        found = judge(task, PLAYER.solve(task)).measures["torque_squared_N2m2s"]
        assert found == pytest.approx(LEAST, rel=1e-6)


@both_solvers
def test_build_min_torque_squared(benchmark: BenchmarkFixture, solver: SolverName) -> None:
    benchmark.pedantic(built, (solver,), rounds=7, warmup_rounds=1)


@both_solvers
def test_cold_solve_min_torque_squared(benchmark: BenchmarkFixture, solver: SolverName) -> None:
    """The first solve of a new program, without its build."""
    task = paper_task()

    def setup() -> tuple[tuple[Transcription, Numbers, Nodes], dict[str, object]]:
        transcription = built(solver)
        return (transcription, *posed(task, transcription)), {}

    benchmark.pedantic(lambda program, numbers, guess: program.solve(numbers, guess), setup=setup, rounds=7)


@both_solvers
def test_resolve_min_torque_squared_with_another_radius(benchmark: BenchmarkFixture, solver: SolverName) -> None:
    transcription = built(solver)
    problems = [posed(paper_task(radius=radius), transcription) for radius in (0.69, 0.7, 0.71)]
    turn = iter(range(10**9))

    def solve() -> float:
        return transcription.solve(*problems[next(turn) % 3]).cost

    benchmark(solve)


def test_min_work_with_refinement(benchmark: BenchmarkFixture) -> None:
    task = paper_task()
    player = Collocation(objective="work")
    benchmark(player.solve, task)


def test_law(benchmark: BenchmarkFixture) -> None:
    task = paper_task()
    benchmark(ServoLaw().solve, task)


def test_referee_on_the_law(benchmark: BenchmarkFixture) -> None:
    task = paper_task()
    solution = ServoLaw().solve(task)
    benchmark(judge, task, solution)


def test_referee_on_an_optimum(benchmark: BenchmarkFixture) -> None:
    task = paper_task()
    solution = Collocation(objective="work").solve(task)
    benchmark(judge, task, solution)


def test_model_from_nothing(benchmark: BenchmarkFixture) -> None:
    """Appell's equations derived and all named functions made."""
    platform = paper_task().platform

    def derive() -> Dynamics:
        appell.derive.cache_clear()
        coefficients.coefficient_function.cache_clear()
        return Dynamics(platform)

    assert np.isfinite(float(benchmark(derive).kinetic_energy(np.ones(6))))
