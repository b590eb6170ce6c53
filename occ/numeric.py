"""CasADi functions on NumPy arrays: one point fast, or many points at once."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np


class BufferedFunction:
    """Calls a CasADi function at one point without making CasADi matrices: a few microseconds a call.

    Args:
        function: with dense inputs and outputs, all real; matrices are taken column by column.
    """

    def __init__(self, function: ca.Function) -> None:
        self._buffer, self._trigger = function.buffer()
        self.inputs = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        self.outputs = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
        for i, array in enumerate(self.inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self.outputs):
            self._buffer.set_res(i, array.data)

    def __call__(self) -> None:
        """Evaluate at what `inputs` hold; the results are in `outputs`."""
        self._trigger()


CHUNK = 256
"""Points that one call of a mapped function evaluates."""


@lru_cache(maxsize=512)
def _mapped(function: ca.Function, count: int, shared: tuple[int, ...]) -> ca.Function:
    return function.map("many", "serial", count, list(shared), [])


def evaluate_many(function: ca.Function, *arguments: np.ndarray, shared: tuple[int, ...] = ()) -> list[np.ndarray]:
    """f at N points in one call.

    Args:
        function: whose arguments are columns.
        arguments: (k, N) each, one column a point; those in `shared` (k,), the same for all points.
        shared: places of the arguments that all points share.

    Returns:
        Each output, (m, N).
    """
    count = next(a.shape[-1] for i, a in enumerate(arguments) if i not in shared)
    # Making a map takes longer than calling it: few sizes, the powers of two up to a chunk, serve all calls.
    size = min(1 << max(count - 1, 0).bit_length(), CHUNK)
    mapped = _mapped(function, size, shared)
    results = [np.empty((function.size1_out(i), count)) for i in range(function.n_out())]
    for start in range(0, count, size):
        columns = np.minimum(np.arange(start, start + size), count - 1)
        inputs = [a if i in shared else a[:, columns] for i, a in enumerate(arguments)]
        end = min(start + size, count)
        for result, output in zip(results, mapped.call(inputs), strict=True):
            result[:, start:end] = np.array(output)[:, : end - start]
    return results


def on_rows(function: ca.Function, *arguments: ca.MX, shared: tuple[int, ...] = ()) -> list[ca.MX]:
    """f at N points as an expression: each operation of f is done on all N values before the next one.

    The results are those of a map, operation by operation; the interpreter is entered once for N values and not once
    for each, and the loops inside are vectorised: five to twenty times faster, and still a graph of N-independent size.

    Args:
        function: of SX, whose arguments are dense columns.
        arguments: (k, N) each, one column a point; those in `shared` (k,), the same for all points.
        shared: places of the arguments that all points share.

    Returns:
        Each output, dense and column by column, (m, N).
    """
    count = next(a.shape[1] for i, a in enumerate(arguments) if i not in shared)
    rows = [[a[j, :] for j in range(a.shape[0])] for a in arguments]
    work: dict[int, ca.MX] = {}
    outputs = [[ca.MX.zeros(1, count)] * function.numel_out(i) for i in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        into, of = function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_CONST:
            work[into[0]] = ca.MX(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            work[into[0]] = rows[of[0]][of[1]]
        elif operation == ca.OP_OUTPUT:
            value = work[of[0]]
            outputs[into[0]][into[1]] = value if value.shape[1] == count else ca.repmat(value, 1, count)
        elif len(of) == 2:
            work[into[0]] = ca.MX.binary(operation, work[of[0]], work[of[1]])
        else:
            work[into[0]] = ca.MX.unary(operation, work[of[0]])
    return [ca.vertcat(*output) if output else ca.MX(0, count) for output in outputs]
