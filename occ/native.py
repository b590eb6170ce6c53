"""CasADi functions that are used often, as loops in machine code: the same operations in the same order, the same bits.

A function that has taken long enough is compiled by this machine's C compiler, once for all later processes.  Whether
that has happened changes no result: CasADi evaluates the function itself before, and where there is no compiler.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Sequence
from functools import partial

import casadi as ca
import numpy as np

from occ.compiler import NotInC, library

LOOKED_FOR = 1e7
"""Instructions, interpreted in some 50 ms, after which a library that an earlier process has made is looked for."""
WORTH = 2e8
"""Instructions, interpreted in about a second, after which one is made."""
LONGEST = 20_000
"""Instructions of a function that is compiled in a second or two; longer ones are left alone."""


class Often:
    """Counts what a function is used for, and compiles a loop over it when that is worth it.

    Args:
        function: of SX.
        loop: makes the C code behind the function's, which is called by ``evaluate(arg, res)``, arrays of pointers.
    """

    def __init__(self, function: ca.Function, loop: Callable[[], str]) -> None:
        self._function, self._loop = function, loop
        self._cost = function.n_instructions() if function.is_a("SXFunction") else LONGEST + 1
        self._waits = self._cost <= LONGEST
        self._looked = False
        self._used = 0.0
        self._lock = threading.Lock()
        self._library: ctypes.CDLL | None = None

    @property
    def compiled(self) -> ctypes.CDLL | None:
        """The library, once there is one."""
        return self._library

    def used(self, times: int) -> ctypes.CDLL | None:
        """Count some uses, and compile when there have been enough.

        Args:
            times: that the function has been evaluated, or is going to be.

        Returns:
            The library as soon as there is one.
        """
        if self._waits:
            self._used += float(times) * self._cost
            worth = self._used > WORTH
            if worth or (self._used > LOOKED_FOR and not self._looked):
                with self._lock:
                    self._load(make=worth)
        return self._library

    def _load(self, *, make: bool) -> None:
        if not self._waits:
            return
        self._looked = True
        try:
            file = library(f"{_c_code(self._function)}{self._loop()}", effort="-O1", make=make)
            self._library = ctypes.CDLL(str(file))
        except (NotInC, OSError):
            self._waits = not make
        else:
            self._waits = False


def _c_code(function: ca.Function) -> str:
    """CasADi's own C code of a function, and ``evaluate``."""
    generator = ca.CodeGenerator("function", {"casadi_int": "long long"})
    generator.add(function)
    sizes = {"arg": function.sz_arg(), "res": function.sz_res(), "iw": function.sz_iw(), "w": function.sz_w()}
    return generator.dump() + EVALUATE.format(**{name: max(size, 1) for name, size in sizes.items()})


EVALUATE = """
static void evaluate(const double** arg, double** res) {{
  const double* a[{arg}];
  double* r[{res}];
  long long iw[{iw}];
  double w[{w}];
  for (int i = 0; i < {arg}; ++i) a[i] = arg[i];
  for (int i = 0; i < {res}; ++i) r[i] = res[i];
  casadi_f0(a, r, iw, w, 0);
}}
"""


class Many:
    """f at N points, one after the other in machine code.

    Args:
        function: whose arguments are dense columns.
        shared: places of the arguments that all points share.
    """

    def __init__(self, function: ca.Function, shared: tuple[int, ...]) -> None:
        self._sizes = [function.numel_in(i) for i in range(function.n_in())]
        self._shared = shared
        self._rows = [function.size1_out(i) for i in range(function.n_out())]
        self._whole = all(function.sparsity_out(i).is_dense() for i in range(function.n_out()))
        self._often = Often(function, partial(_loop_over_points, function, self._sizes, shared))

    def __call__(self, arguments: Sequence[np.ndarray], count: int) -> list[np.ndarray] | None:
        """All outputs (m, N); None while there is no library, or where the arguments do not fit.

        Args:
            arguments: (k, N) each; those that are shared (k,).
            count: N.
        """
        compiled = self._often.used(count)
        if compiled is None:
            return None
        given = [np.ascontiguousarray(a, dtype=float) for a in arguments]
        shapes = [(size,) if i in self._shared else (size, count) for i, size in enumerate(self._sizes)]
        if [a.shape for a in given] != shapes:
            return None
        make = np.empty if self._whole else np.zeros
        results = [make((rows, count)) for rows in self._rows]
        compiled.occ_many(ctypes.c_longlong(count), pointers(given), pointers(results))
        return results


def pointers(arrays: Sequence[np.ndarray]) -> ctypes.Array[ctypes.c_void_p]:
    """Where the numbers of contiguous arrays are."""
    return (ctypes.c_void_p * max(len(arrays), 1))(*map(_address, arrays))


def _address(array: np.ndarray) -> int:
    # Four times faster than asking the array, where it lets others write.
    if array.flags.writeable and array.size:
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return int(array.ctypes.data)


def _loop_over_points(function: ca.Function, sizes: Sequence[int], shared: Sequence[int]) -> str:
    """``occ_many(count, in, out)``: row by row, as NumPy's arrays are."""
    places = [function.sparsity_out(i).row() for i in range(function.n_out())]
    lines = ["", "void occ_many(long long count, const double** in, double** out) {"]
    lines += [f"  const double* arg[{max(function.sz_arg(), 1)}] = {{0}};"]
    lines += [f"  double* res[{max(function.sz_res(), 1)}] = {{0}};"]
    for i, size in enumerate(sizes):
        lines.append(f"  double a{i}[{max(size, 1)}];")
        lines.append(f"  arg[{i}] = {f'in[{i}]' if i in shared else f'a{i}'};")
    for i, rows in enumerate(places):
        listed = ", ".join(map(str, rows)) or "0"
        lines += [f"  double r{i}[{max(len(rows), 1)}];", f"  res[{i}] = r{i};"]
        lines.append(f"  static const int rows{i}[{max(len(rows), 1)}] = {{{listed}}};")
    lines.append("  for (long long k = 0; k < count; ++k) {")
    for i, size in enumerate(sizes):
        if i not in shared:
            lines.append(f"    for (int j = 0; j < {size}; ++j) a{i}[j] = in[{i}][j * count + k];")
    lines.append("    evaluate(arg, res);")
    for i, rows in enumerate(places):
        lines.append(f"    for (int j = 0; j < {len(rows)}; ++j) out[{i}][rows{i}[j] * count + k] = r{i}[j];")
    return "\n".join([*lines, "  }", "}", ""])
