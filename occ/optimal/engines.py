"""What solves a nonlinear program: arrays are bound to it once, and read and written in place."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any, Protocol

import casadi as ca
import numpy as np

NOT_FINITE = "Invalid_Number_Detected"
"""Return status, in IPOPT's words, where a function or a derivative is not finite."""
BUFFER = 1
"""CasADi counts a function's memories: the first is that of plain calls, the second that of its first buffer."""


class Engine(Protocol):
    """A solver with its program."""

    def bind(self, inputs: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]) -> None:
        """Arrays under CasADi's names; those of the conditions stand behind those of the unknowns."""

    def run(self) -> dict[str, Any]:
        """Solve.

        Returns:
            At least ``success``, ``iter_count`` and ``return_status``.

        Raises:
            RuntimeError: the solver stopped with an error.
            KeyboardInterrupt: somebody wants it to stop.
        """

    def pace(self) -> float:
        """[s] What an iteration takes, about, with what has been written."""


class CasadiEngine:
    """A solver of `casadi.nlpsol`; multipliers are never handed in.

    Args:
        solver: of CasADi.
        functions: that it calls.
        careful: the solver may never come back from what is no number: look at the guess first.
    """

    def __init__(self, solver: ca.Function, functions: Mapping[str, ca.Function], *, careful: bool) -> None:
        self._solver, self._careful = solver, careful
        self._buffer, self._trigger = solver.buffer()
        names = ("nlp_f", "nlp_jac_g", "nlp_grad_f") if careful else ()
        self._first = [_Call(functions[name]) for name in names]
        self._hessian = _Call(functions["nlp_hess_l"])

    def bind(self, inputs: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]) -> None:
        """As of an `Engine`."""
        self._inputs, self._outputs = inputs, outputs
        self._hessian.bind({"lam_f": np.ones(1), "lam_g": np.zeros(inputs["lbg"].size)})
        for call in (*self._first, self._hessian):
            call.bind({"x": inputs["x0"], "p": inputs["p"]})
        for name, array in inputs.items():
            self._buffer.set_arg(self._solver.index_in(name), array.data)
        for name, array in outputs.items():
            self._buffer.set_res(self._solver.index_out(name), array.data)

    def run(self) -> dict[str, Any]:
        """As of an `Engine`; the statistics are CasADi's."""
        if self._careful and not all(call.is_finite() for call in (*self._first, self._hessian)):
            self._outputs["x"][:], self._outputs["f"][:] = self._inputs["x0"], np.nan
            return {"success": False, "iter_count": 0, "return_status": NOT_FINITE}
        try:
            self._trigger()
        except SystemError as error:
            # What a signal's handler raises in the middle of compiled code arrives as the cause of this.
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise KeyboardInterrupt from error
            raise RuntimeError(str(error)) from error
        statistics: dict[str, Any] = self._solver.stats(BUFFER)
        return statistics

    def pace(self) -> float:
        """[s] Second derivatives once, and as long again for everything else."""
        begin = perf_counter()
        self._hessian.is_finite()
        return 2 * (perf_counter() - begin)


class _Call:
    """One function of a program, on the solver's own arrays."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._buffer, self._trigger = function.buffer()
        self._results = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        self._kept: list[np.ndarray] = []
        for i, array in enumerate(self._results):
            self._buffer.set_res(i, array.data)

    def bind(self, inputs: Mapping[str, np.ndarray]) -> None:
        """Arrays under the names of the arguments."""
        for name, array in inputs.items():
            self._kept.append(array)
            self._buffer.set_arg(self._function.index_in(name), array.data)

    def is_finite(self) -> bool:
        """Of all results."""
        self._trigger()
        return all(bool(np.isfinite(array).all()) for array in self._results)
