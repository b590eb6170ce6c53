"""Nanoseconds per call of the exported law and of its Jacobian, beside CasADi's virtual machine and CasADi's own C."""

from __future__ import annotations

import ctypes
import subprocess
import time
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from occ.export.languages.c import FLAGS, C
from occ.export.routine import Routine
from occ.numeric import BufferedFunction
from tests.export.printing import modules_of

pytestmark = pytest.mark.benchmark

CALLS = 10_000
ROUNDS = 40
SLACK = 1.05
"""What the clock of a busy machine may add to the better of many rounds."""
HARNESS = """
#include "occ_servo_torque.h"
#define casadi_int long long int
static double state[6] = {{0.1, 0.2, 0.3, 0.4, 0.5, -0.4}}, point[2] = {{0.4, 0.05}}, motion[3] = {{0.7, -0.4, 1.5}};
static double result[64], w[100000];
{loops}
"""
LOOP = """
int {name}(const double **, double **, casadi_int *, double *, int);
double exported_{name}(int calls) {{
    double sum = 0.0;
    for (int i = 0; i < calls; ++i) {{ {exported}(1e-4 * i, state, point, motion, result); sum += result[0]; }}
    return sum;
}}
double generated_{name}(int calls) {{
    double sum = 0.0, t;
    const double *arg[16] = {{&t, state, point, motion}};
    double *res[16] = {{result}};
    for (int i = 0; i < calls; ++i) {{ t = 1e-4 * i; {name}(arg, res, 0, w, 0); sum += result[0]; }}
    return sum;
}}
"""
WHAT = {"law": 0, "law_jacobian": 1}


@pytest.fixture(scope="module")
def routines() -> tuple[Routine, ...]:
    (module,) = modules_of("servo_torque", wrt=("state",))
    return module.routines


@pytest.fixture(scope="module")
def library(routines: tuple[Routine, ...], tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Exported and generated C behind loops of calls, all with the same compiler and options."""
    folder = tmp_path_factory.mktemp("speed")
    (module,) = modules_of("servo_torque", wrt=("state",))
    for name, content in C().files(module).items():
        (folder / name).write_text(content)
    generator = ca.CodeGenerator("generated.c")
    loops = []
    for name, place in WHAT.items():
        function = routines[place].function
        symbols = function.sx_in()
        generator.add(ca.Function(name, symbols, [ca.densify(function.call(symbols)[0])]))
        loops.append(LOOP.format(name=name, exported=routines[place].name))
    generator.generate(f"{folder}/")
    (folder / "harness.c").write_text(HARNESS.format(loops="".join(loops)))
    shared = [flag for flag in FLAGS if flag not in ("-pedantic", "-Werror", "-Wextra")]
    sources = ["harness.c", "generated.c", "occ_servo_torque.c"]
    command = ["cc", *shared, "-O2", "-shared", "-fPIC", "-I.", *sources, "-lm", "-o", "speed.so"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    loaded = ctypes.CDLL(str(folder / "speed.so"))
    for name in WHAT:
        for kind in ("exported", "generated"):
            getattr(loaded, f"{kind}_{name}").restype = ctypes.c_double
    return loaded


def nanoseconds(loop: Callable[[int], float]) -> float:
    begin = time.perf_counter()
    loop(CALLS)
    return (time.perf_counter() - begin) / CALLS * 1e9


def per_call(benchmark: BenchmarkFixture, loop: Callable[[int], float]) -> None:
    benchmark.extra_info["ns_per_call"] = min(nanoseconds(loop) for _ in range(ROUNDS))
    benchmark.pedantic(loop, args=(CALLS,), rounds=ROUNDS)


@pytest.mark.parametrize("what", WHAT)
def test_exported_c(benchmark: BenchmarkFixture, library: ctypes.CDLL, what: str) -> None:
    per_call(benchmark, getattr(library, f"exported_{what}"))


@pytest.mark.parametrize("what", WHAT)
def test_casadi_c(benchmark: BenchmarkFixture, library: ctypes.CDLL, what: str) -> None:
    per_call(benchmark, getattr(library, f"generated_{what}"))


@pytest.mark.parametrize("what", WHAT)
def test_casadi_virtual_machine(benchmark: BenchmarkFixture, routines: tuple[Routine, ...], what: str) -> None:
    """Many points in one call, so that Python's share is small."""
    function = routines[WHAT[what]].function
    count = 1000
    symbols = function.sx_in()
    dense = ca.Function("dense", symbols, [ca.densify(function.call(symbols)[0])])
    call = BufferedFunction(dense.map(count))
    for place, values in enumerate(([0.5], [0.1, 0.2, 0.3, 0.4, 0.5, -0.4], [0.4, 0.05], [0.7, -0.4, 1.5])):
        call.inputs[place][:] = np.tile(values, count)

    def loop(calls: int) -> float:
        for _ in range(calls // count):
            call()
        return float(call.outputs[0][0])

    per_call(benchmark, loop)


@pytest.mark.parametrize("what", WHAT)
def test_the_exported_c_is_no_slower_than_casadis(
    library: ctypes.CDLL, what: str, request: pytest.FixtureRequest
) -> None:
    """The same results and, where times are measured, in no more time: the better of many rounds in turn."""
    exported, generated = (getattr(library, f"{kind}_{what}") for kind in ("exported", "generated"))
    assert exported(CALLS) == pytest.approx(generated(CALLS), rel=1e-12)
    if not request.config.getoption("benchmark_enable"):
        return  # Beside other tests a comparison of times says nothing.
    times = np.array([[nanoseconds(exported), nanoseconds(generated)] for _ in range(ROUNDS)])
    best = times.min(axis=0)
    print(f"{what}: exported {best[0]:.0f} ns, CasADi's C {best[1]:.0f} ns")
    assert best[0] <= SLACK * best[1]
