"""CasADi functions on NumPy arrays: one point fast, or many points at once."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from occ.native import Many


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
MANY = 8192
"""Points from which on NumPy's arrays, whose elementary functions may round otherwise, do the work.  The number of the
points alone decides, so that no result depends on what is compiled."""


def _mapped(function: ca.Function, count: int, shared: tuple[int, ...]) -> BufferedFunction:
    return BufferedFunction(function.map("many", "serial", count, list(shared), []))


class _Calls(threading.local):
    """Mapped functions of one thread: threads may not share the arrays of a call."""

    def __init__(self) -> None:
        self.of = lru_cache(maxsize=512)(_mapped)
        self.compiled = lru_cache(maxsize=512)(Many)


_CALLS = _Calls()


def evaluate_many(function: ca.Function, *arguments: np.ndarray, shared: tuple[int, ...] = ()) -> list[np.ndarray]:
    """f at N points in one call.

    Args:
        function: whose arguments are dense columns.
        arguments: (k, N) each, one column a point; those in `shared` (k,), the same for all points.
        shared: places of the arguments that all points share.

    Returns:
        Each output, (m, N).
    """
    count = next(a.shape[-1] for i, a in enumerate(arguments) if i not in shared)
    if count >= MANY and _by_arrays(function):
        return on_arrays(function, *(tuple(a) if i in shared else a for i, a in enumerate(arguments)))
    results = _CALLS.compiled(function, shared)(arguments, count)
    if results is not None:
        return results
    # Making a map takes longer than calling it: few sizes, the powers of two up to a chunk, serve all calls.
    size = min(1 << max(count - 1, 0).bit_length(), CHUNK)
    call = _CALLS.of(function, size, shared)
    rows = [function.sparsity_out(i).find() for i in range(function.n_out())]
    results = [np.zeros((function.size1_out(i), count)) for i in range(function.n_out())]
    for i in shared:
        call.inputs[i][:] = arguments[i]
    points = [(call.inputs[i].reshape(size, -1), a.T) for i, a in enumerate(arguments) if i not in shared]
    for start in range(0, count, size):
        end = min(start + size, count)
        for target, source in points:
            target[: end - start] = source[start:end]
            target[end - start :] = source[end - 1]
        call()
        for result, places, output in zip(results, rows, call.outputs, strict=True):
            result[places, start:end] = output[: size * len(places)].reshape(size, -1)[: end - start].T
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


BLOCK = 4096
"""Points that each operation of `on_arrays` is done on before the next one: all values stay in a core's cache."""
UFUNCS: dict[int, Callable[..., np.ndarray]] = {
    ca.OP_ASSIGN: np.positive,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQRT: np.sqrt,
    ca.OP_FABS: np.fabs,
    ca.OP_SIGN: np.sign,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_HYPOT: np.hypot,
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NOT: np.logical_not,
    ca.OP_IF_ELSE_ZERO: lambda condition, x: np.where(condition, x, 0.0),
    ca.OP_FMAX: np.fmax,
    ca.OP_FMIN: np.fmin,
}
"""Operations of CasADi on numbers, by NumPy on arrays."""
_KNOWN = {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, *UFUNCS}


@lru_cache(maxsize=64)
def operations(function: ca.Function) -> list[tuple[int, list[int], list[int], float]]:
    """Operation, places of results and arguments, and constant of each instruction."""
    found = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        constant = float(function.instruction_constant(k)) if operation == ca.OP_CONST else 0.0
        found.append((operation, function.instruction_output(k), function.instruction_input(k), constant))
    return found


@lru_cache(maxsize=512)
def _by_arrays(function: ca.Function) -> bool:
    """Whether `on_arrays` takes the function."""
    if not function.is_a("SXFunction"):
        return False
    dense = all(function.sparsity_out(i).is_dense() and function.size2_out(i) == 1 for i in range(function.n_out()))
    return dense and all(operation in _KNOWN for operation, *_ in operations(function))


def on_arrays(function: ca.Function, *arguments: Sequence[np.ndarray | float] | np.ndarray) -> list[np.ndarray]:
    """f at N points by NumPy: each operation of f is done on many values before the next one.

    The operations are those of f in the same order, and so are the results up to the rounding of the elementary
    functions; five to twenty times faster than a map.  What is the same at all points is worked out once.

    Args:
        function: of SX, whose arguments and outputs are dense columns, made of the operations in `UFUNCS`.
        arguments: the rows of each, numbers or arrays; all of them broadcast.

    Returns:
        Each output, (m, ..) with the common shape of the rows.
    """
    shape = np.broadcast_shapes(*(np.shape(row) for rows in arguments for row in rows))
    packed = [[_flat(row, shape) for row in rows] for rows in arguments]
    results = [np.empty((function.size1_out(i), math.prod(shape))) for i in range(function.n_out())]
    # Infinities and NaN are values like any other, as in CasADi.
    with np.errstate(all="ignore"):
        for first in range(0, math.prod(shape), BLOCK):
            part = slice(first, first + BLOCK)
            work: dict[int, np.ndarray] = {}
            for operation, into, of, constant in operations(function):
                if operation == ca.OP_CONST:
                    work[into[0]] = np.asarray(constant)
                elif operation == ca.OP_INPUT:
                    row = packed[of[0]][of[1]]
                    work[into[0]] = row[part] if row.ndim else row
                elif operation == ca.OP_OUTPUT:
                    results[into[0]][into[1], part] = work[of[0]]
                else:
                    work[into[0]] = UFUNCS[operation](*(work[place] for place in of))
    return [result.reshape(-1, *shape) for result in results]


def _flat(row: np.ndarray | float, shape: tuple[int, ...]) -> np.ndarray:
    """The one number that a row consists of, or all of its numbers one after the other."""
    row = np.asarray(row, dtype=float)
    return np.broadcast_to(row, shape).ravel() if any(row.strides) else row.reshape(-1)[:1].reshape(())
