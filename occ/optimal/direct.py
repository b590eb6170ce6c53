"""FATROP without CasADi in between: costs, conditions and derivatives of the intervals are compiled, and so is all
that stands between them and the solver.

CasADi's interface keeps a table of all blocks of the program, which takes a time to make that grows with the square of
the number of intervals, and its functions are interpreted.  Here nothing is made for an interval but its memory.  The
answers are the same to the last bit: the same numbers in the same order.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from occ import compiler
from occ.compiler import NotInC
from occ.optimal.chains import Chains
from occ.optimal.derivatives import EndDerivatives
from occ.optimal.engines import NOT_FINITE
from occ.optimal.interval_code import IntervalCode, output
from occ.optimal.intervals import interval_maps
from occ.optimal.machine_code import LANES, Source
from occ.optimal.mesh import Scheme
from occ.optimal.problem import PROBLEMS, Problem

FRAME = Path(__file__).with_name("direct.c")
HEADER = "fatrop/ocp/OCPCInterface.h"
LIBRARIES = ("libfatrop.so.*", "libfatrop.*.dylib", "libfatrop.so", "libfatrop.dylib")
"""Names of FATROP's library in CasADi's folder; the first that is there is the one that CasADi loads itself."""
INVALID = -2
"""What the frame returns where something is not finite."""
FUNCTIONS = (
    "fatrop_ocp_c_create",
    "fatrop_ocp_c_solve",
    "fatrop_ocp_c_destroy",
    "fatrop_ocp_c_set_option_double",
    "fatrop_ocp_c_set_option_int",
    "fatrop_ocp_c_get_primal",
    "fatrop_ocp_c_get_stats",
    "blasfeo_pack_dmat",
)
"""In the order of the frame."""


class DirectCode:
    """The compiled functions of one problem and scheme, for any number of intervals.

    Args:
        problem: whose rates are chains of integrators, without controls that are held and with ends that nothing
            couples.
        chains: of the problem.
        scheme: of collocation.

    Raises:
        NotInC: this machine has no working compiler, no headers of FATROP, or the problem an operation that is not
            known in C.
    """

    def __init__(self, problem: Problem, chains: Chains, scheme: Scheme) -> None:
        folder = Path(ca.__file__).parent
        fatrop = _fatrop(folder)
        source = Source()
        # The headers that the library is compiled with are those of this version.
        source.write(f"/* CasADi {ca.__version__} */", "#include <stdlib.h>", "#include <string.h>")
        source.write(f'#include "{HEADER}"')
        _write_functions(problem, chains, scheme, source)
        source.write(FRAME.read_text())
        library = compiler.library(source.text, headers=folder / "include")
        try:
            self._library = ctypes.CDLL(str(library))
            pointers = [ctypes.cast(getattr(fatrop, name), ctypes.c_void_p) for name in FUNCTIONS]
        except (OSError, AttributeError) as error:
            raise NotInC(str(error)) from error
        self._library.occ_create.restype = ctypes.c_void_p
        self._library.occ_create.argtypes = [ctypes.c_int, *[ctypes.c_void_p] * 6]
        for name in ("occ_free", "occ_evaluate"):
            getattr(self._library, name).argtypes = [ctypes.c_void_p]
        self._library.occ_solve.argtypes = [
            *(ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.POINTER(ctypes.c_char_p)),
            *(ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int)),
        ]
        self._library.occ_bind((ctypes.c_void_p * len(pointers))(*pointers))

    @property
    def library(self) -> ctypes.CDLL:
        """With `occ_create`, `occ_solve`, `occ_evaluate` and `occ_free`."""
        return self._library


@lru_cache(maxsize=PROBLEMS)
def direct_code(problem: Problem, chains: Chains, scheme: Scheme) -> DirectCode | None:
    """The code of a problem, made once for meshes of any size; None where it cannot be had."""
    try:
        return DirectCode(problem, chains, scheme)
    except NotInC:
        return None


class DirectSolver:
    """FATROP on a program of so many intervals.

    Args:
        code: of its problem.
        intervals: N.
        settings: of FATROP, by its names.
    """

    def __init__(self, code: DirectCode, intervals: int, settings: Mapping[str, float]) -> None:
        self._library, self._intervals = code.library, intervals
        self._iterations = ctypes.c_int()
        ordered = sorted(settings.items(), key=lambda item: not isinstance(item[1], int))
        count = len(ordered)
        self._settings = (
            sum(isinstance(value, int) for value in settings.values()),
            count,
            (ctypes.c_char_p * count)(*(name.encode() for name, _ in ordered)),
            (ctypes.c_double * count)(*(float(value) for _, value in ordered)),
            ctypes.byref(self._iterations),
        )
        self._program: int | None = None

    def bind(self, inputs: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]) -> None:
        """As of an `Engine`."""
        arrays = (inputs["x0"], inputs["p"], inputs["lbx"], inputs["ubx"], outputs["x"], outputs["f"])
        self._kept = arrays
        program = self._library.occ_create(self._intervals, *(array.ctypes.data for array in arrays))
        if program is None:
            raise MemoryError
        self._program = program
        # At the end of the process nobody needs the memory.
        weakref.finalize(self, self._library.occ_free, program).atexit = False

    def run(self) -> dict[str, Any]:
        """As of an `Engine`; of CasADi's statistics those that count.  An interrupt waits for FATROP's answer."""
        told = self._library.occ_solve(self._program, *self._settings)
        status = NOT_FINITE if told == INVALID else str(told)
        return {"iter_count": self._iterations.value, "return_status": status, "success": told == 0}

    def pace(self) -> float:
        """[s] What an iteration evaluates, once, and four times as long for everything else."""
        begin = perf_counter()
        self._library.occ_evaluate(self._program)
        return 5 * (perf_counter() - begin)


def _fatrop(folder: Path) -> ctypes.CDLL:
    for pattern in LIBRARIES:
        for path in sorted(folder.glob(pattern)):
            try:
                return ctypes.CDLL(str(path))
            except OSError as error:
                raise NotInC(str(error)) from error
    raise NotInC("no library of FATROP")


def _write_functions(problem: Problem, chains: Chains, scheme: Scheme, source: Source) -> None:
    """Sizes, patterns and functions that the frame asks for."""
    maps = interval_maps(problem, chains, scheme)
    IntervalCode(maps, problem, source)
    y, h = ca.SX.sym("y", maps.ny), ca.SX.sym("h")
    source.routine(ca.Function("step", [y, h], [ca.densify(maps.step(y, h))]), "interval_step")
    source.routine(ca.Function("step_slopes", [h], [ca.densify(maps.step_slopes(h))]), "interval_step_slopes")
    ends = EndDerivatives.of(problem, with_boundary=False)
    source.routine(output(ends.gradient, 0), "end_cost", shared=(2,))
    source.routine(output(ends.gradient, 2), "end_gradient", shared=(2,))
    # There are no boundary conditions, and no multipliers of them.
    *arguments, none = ends.hessian.sx_in()
    source.routine(
        ca.Function("end_curvature", arguments, ends.hessian.call([*arguments, none])), "end_curvature", shared=(2,)
    )
    _, _, data, _, paths, _ = problem.sizes
    for name, size in (("NX", maps.nx), ("NY", maps.ny), ("DEGREE", maps.degree), ("ND", data), ("NH", paths)):
        source.write(f"#define {name} {size}")
    for name, pattern in (
        ("STEP", maps.step_pattern()),
        ("ROWS", maps.rows_pattern()),
        ("CURVE", maps.curvature_pattern()),
        ("END", ends.curvature),
    ):
        source.write(f"#define N{name} {len(pattern[0])}")
        for which, places in zip(("ROW", "COLUMN"), pattern, strict=True):
            source.write(f"static const int {name}_{which}[] = {_listed([str(place) for place in places])};")
    source.write(f"#define LANES {LANES}")
    source.write(f"static const double WEIGHTS[] = {_listed([float(w).hex() for w in scheme.weights])};")


def _listed(values: Sequence[str]) -> str:
    # C has no arrays without entries.
    return "{" + ", ".join(values or ["0"]) + "}"
