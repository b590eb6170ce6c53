"""Microseconds per sample of an allocation: closed form, OSQP with updates, CVXPY, CasADi's conic solvers.

10,000 wrenches of the law at a limit of 1.068 N m, which binds on most of them.  Run by `make benchmark`; the last
test is the claim itself, and its numbers are measured in one run, one after the other.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from occ.allocation import LEAST_NORM, Criterion, ElectricPower, LargestTorque, WeightedNorm, closed_form
from occ.allocation.osqp_qp import OsqpAllocator
from occ.allocation.reference import Reference
from tests.allocation.wrenches import law_samples, youbot_map

pytestmark = pytest.mark.benchmark

LIMIT = 1.068
COUNT = 10_000
CRITERIA = {
    "norm": LEAST_NORM,
    "weighted": WeightedNorm((1.0, 4.0, 0.3, 2.0)),
    "largest": LargestTorque(),
    "electric": ElectricPower(),
}


@pytest.fixture(scope="module")
def samples() -> tuple[np.ndarray, np.ndarray]:
    return law_samples(COUNT)


def osqp_alone(wrench: np.ndarray) -> Callable[[], Any]:
    """OSQP with a reused workspace and nothing around it."""
    from occ.allocation.result import question

    allocator = OsqpAllocator(youbot_map())
    asked = question(youbot_map(), wrench, LIMIT, LEAST_NORM)
    unit = np.abs(asked.min_norm).max(axis=0)
    return lambda: allocator._run(asked, unit)


def conic(plugin: str, wrench: np.ndarray) -> Callable[[], None]:
    """The same programme by a conic plug-in of CasADi."""
    x = ca.SX.sym("x", 4)
    pi = ca.SX.sym("pi", 3)
    problem = {"x": x, "p": pi, "f": ca.sumsqr(x), "g": ca.DM(youbot_map().wheel_rates).T @ x - pi}
    quiet = {"osqp": {"osqp": {"verbose": False}}, "qrqp": {"print_iter": False, "print_header": False}}
    options = {"printLevel": "none"} if plugin == "qpoases" else quiet.get(plugin, {})
    solver = ca.qpsol("solver", plugin, problem, {"error_on_fail": False, **options})
    bounds = {"lbx": -LIMIT, "ubx": LIMIT, "lbg": 0, "ubg": 0}

    def run() -> None:
        for column in wrench.T:
            solver(p=column, **bounds)

    return run


@pytest.mark.parametrize("name", CRITERIA)
def test_closed_form(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray], name: str) -> None:
    wrench, rates = samples
    criterion: Criterion = CRITERIA[name]
    given = rates if criterion.needs_rates else None
    found = benchmark(closed_form.allocate, youbot_map(), wrench, LIMIT, criterion, given)
    assert found.reachable.all()


def test_osqp(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray]) -> None:
    benchmark.pedantic(osqp_alone(samples[0][:, ::10]), rounds=3, warmup_rounds=1)


def test_osqp_with_proofs(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray]) -> None:
    allocator = OsqpAllocator(youbot_map())
    found = benchmark.pedantic(allocator.allocate, (samples[0][:, ::10], LIMIT), rounds=3, warmup_rounds=1)
    assert found.reachable.all()


def test_cvxpy(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray]) -> None:
    written = Reference(youbot_map())
    chosen = samples[0][:, ::200].T
    benchmark.pedantic(lambda: [written.solve(wrench, LIMIT) for wrench in chosen], rounds=3, warmup_rounds=1)


@pytest.mark.parametrize("plugin", ["qrqp", "osqp", "qpoases"])
def test_casadi(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray], plugin: str) -> None:
    if not ca.has_conic(plugin):
        pytest.skip(f"CasADi without {plugin}")
    benchmark.pedantic(conic(plugin, samples[0][:, ::50]), rounds=3, warmup_rounds=1)


def per_sample(run: Callable[[], Any], count: int, rounds: int) -> float:
    """[s] The best of several rounds."""
    best = np.inf
    for _ in range(rounds):
        begin = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - begin)
    return best / count


def test_claim_closed_form_is_a_hundred_times_faster(samples: tuple[np.ndarray, np.ndarray]) -> None:
    wrench, _ = samples
    wheels = youbot_map()
    closed = per_sample(lambda: closed_form.allocate(wheels, wrench, LIMIT), COUNT, 30)
    solver = per_sample(osqp_alone(wrench[:, ::10]), COUNT // 10, 3)
    assert solver > 100 * closed, (solver, closed)
    # Half as fast as it should be on a quiet machine is allowed to a busy one.
    assert closed < 0.4e-6, closed
