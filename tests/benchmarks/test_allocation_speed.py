"""Microseconds per sample of an allocation: closed form, exported C, OSQP with updates, CVXPY, CasADi's conic solvers.

10,000 wrenches of the law at a limit of 1.068 N m, which binds on most of them.  Run by `make benchmark`; the last
test is the claim itself, and its numbers are measured in one run, one after the other.
"""

from __future__ import annotations

import ctypes
import subprocess
import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from occ.allocation import LEAST_NORM, Criterion, ElectricPower, LargestTorque, WeightedNorm, allocate
from occ.allocation.osqp_qp import OsqpAllocator
from occ.allocation.reference import Reference
from occ.export.languages.c import C
from tests.allocation.wrenches import law_samples, youbot_map
from tests.export.printing import modules_of

pytestmark = pytest.mark.benchmark

LIMIT = 1.068
COUNT = 10_000
CRITERIA = {
    "norm": LEAST_NORM,
    "weighted": WeightedNorm((1.0, 4.0, 0.3, 2.0)),
    "largest": LargestTorque(),
    "electric": ElectricPower(),
}

PLUGINS: dict[str, dict[str, Any]] = {
    "qrqp": {"print_iter": False, "print_header": False},
    "ipqp": {"print_iter": False, "print_header": False},
    "qpoases": {"printLevel": "none"},
    "daqp": {},
    "osqp": {"osqp": {"verbose": False}},
    "piqp": {},
    "proxqp": {},
    "superscs": {"superscs": {"verbose": 0}},
    "fatrop": {},
    "nlpsol": {"nlpsol": "ipopt", "nlpsol_options": {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}}},
}
"""All that take a quadratic programme of any structure: `clp` and `cbc` are for linear ones, `hpipm` for stages, and
`highs` ends the process where SciPy's own HiGHS is loaded, too."""
LOOP = """
#include "occ_box_torque.h"
void box_torques(int samples, const double *wrench, double limit, double *torque) {
    for (int i = 0; i < samples; ++i) occ_box_torque(wrench + 3 * i, limit, torque + 4 * i);
}
"""


@pytest.fixture(scope="module")
def samples() -> tuple[np.ndarray, np.ndarray]:
    return law_samples(COUNT)


def osqp_alone(wrench: np.ndarray, rates: np.ndarray, criterion: Criterion = LEAST_NORM) -> Callable[[], Any]:
    """OSQP with a reused workspace and nothing around it."""
    from occ.allocation.result import question

    allocator = OsqpAllocator(youbot_map(), criterion)
    asked = question(youbot_map(), wrench, LIMIT, criterion, rates)
    unit = np.abs(asked.min_norm).max(axis=0)
    return lambda: allocator._run(asked, unit)


def conic(plugin: str) -> ca.Function:
    """The same programme for a conic plug-in of CasADi: (p=wrench, bounds) -> x."""
    x = ca.SX.sym("x", 4)
    pi = ca.SX.sym("pi", 3)
    problem = {"x": x, "p": pi, "f": ca.sumsqr(x), "g": ca.DM(youbot_map().wheel_rates).T @ x - pi}
    return ca.qpsol("solver", plugin, problem, {"error_on_fail": False, **PLUGINS[plugin]})


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The C of `occ export box_torque` behind a loop over samples."""
    folder = tmp_path_factory.mktemp("speed")
    (module,) = modules_of("box_torque")
    for name, content in C().files(module).items():
        (folder / name).write_text(content)
    (folder / "loop.c").write_text(LOOP)
    # As a user would compile for his own machine; fmin and fmax become single instructions without NaN and -0.
    flags = ["-std=c99", "-O3", "-march=native", "-ffinite-math-only", "-fno-signed-zeros", "-shared", "-fPIC"]
    command = ["cc", *flags, "loop.c", "occ_box_torque.c", "-lm", "-flto", "-o", "loop.so"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return ctypes.CDLL(str(folder / "loop.so"))


@pytest.mark.parametrize("name", CRITERIA)
def test_closed_form(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray], name: str) -> None:
    wrench, rates = samples
    criterion: Criterion = CRITERIA[name]
    given = rates if criterion.needs_rates else None
    found = benchmark(allocate, youbot_map(), wrench, LIMIT, criterion, given)
    assert found.reachable.all()


def test_osqp(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray]) -> None:
    benchmark.pedantic(osqp_alone(*(part[:, ::10] for part in samples)), rounds=3, warmup_rounds=1)


def test_osqp_with_proofs(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray]) -> None:
    allocator = OsqpAllocator(youbot_map())
    found = benchmark.pedantic(allocator.allocate, (samples[0][:, ::10], LIMIT), rounds=3, warmup_rounds=1)
    assert found.reachable.all()


def test_cvxpy(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray]) -> None:
    written = Reference(youbot_map())
    chosen = samples[0][:, ::200].T
    benchmark.pedantic(lambda: [written.solve(wrench, LIMIT) for wrench in chosen], rounds=3, warmup_rounds=1)


@pytest.mark.parametrize("plugin", PLUGINS)
def test_casadi(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray], plugin: str) -> None:
    if not ca.has_conic(plugin):
        pytest.skip(f"CasADi without {plugin}")
    wrench, solver = samples[0][:, ::50], conic(plugin)

    def run() -> np.ndarray:
        answers = [solver(p=column, lbx=-LIMIT, ubx=LIMIT, lbg=0, ubg=0)["x"].full() for column in wrench.T]
        return np.hstack(answers)

    found = benchmark.pedantic(run, rounds=3, warmup_rounds=1)
    error = float(np.abs(found - allocate(youbot_map(), wrench, LIMIT).torque).max())
    benchmark.extra_info["largest error [N m]"] = error
    # Methods of first order and interior points stop at their own default tolerances.
    assert error < 1e-3


def test_compiled(benchmark: BenchmarkFixture, samples: tuple[np.ndarray, np.ndarray], compiled: ctypes.CDLL) -> None:
    wrench = np.ascontiguousarray(samples[0].T)
    torque = np.empty((COUNT, 4))
    pointers = [array.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for array in (wrench, torque)]
    benchmark(compiled.box_torques, ctypes.c_int(COUNT), pointers[0], ctypes.c_double(LIMIT), pointers[1])
    np.testing.assert_allclose(torque.T, allocate(youbot_map(), samples[0], LIMIT).torque, atol=1e-14)


def per_sample(run: Callable[[], Any], count: int, rounds: int) -> float:
    """[s] The best of several rounds."""
    best = np.inf
    for _ in range(rounds):
        begin = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - begin)
    return best / count


@pytest.mark.parametrize("name", CRITERIA)
def test_claim_closed_form_is_a_hundred_times_faster(samples: tuple[np.ndarray, np.ndarray], name: str) -> None:
    wrench, rates = samples
    wheels, criterion = youbot_map(), CRITERIA[name]
    closed = per_sample(lambda: allocate(wheels, wrench, LIMIT, criterion, rates), COUNT, 30)
    solver = per_sample(osqp_alone(wrench[:, ::10], rates[:, ::10], criterion), COUNT // 10, 3)
    assert solver > 100 * closed, (solver, closed)
    # Twice as slow as on a quiet machine is allowed to a busy one.
    assert closed < 0.4e-6, closed
