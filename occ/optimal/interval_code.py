"""The functions of an interval in C, several intervals at a time: from its unknowns to costs and derivatives."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from occ.optimal.intervals import IntervalMaps
from occ.optimal.machine_code import Source
from occ.optimal.problem import Problem

PARAMETERS = 2
"""Place of the parameters among the arguments (y, data, parameters, width, multipliers): all intervals share them."""
Pull = Callable[[ca.SX, ca.SX], ca.SX]
"""Values at the nodes and the width -> the interval's."""


class IntervalCode:
    """Writes `static void interval_NAME(a0, a1, .., result)` into a source, for each function of an interval.

    Args:
        maps: of the interval.
        problem: for the sizes of its data and parameters.
        source: to write into.

    Raises:
        NotInC: an operation that is not known in C.
    """

    def __init__(self, maps: IntervalMaps, problem: Problem, source: Source) -> None:
        self._maps, self._source = maps, source
        _, _, self._nd, parameters, self._nh, _ = problem.sizes
        self.sizes: dict[str, list[int]] = {}
        """Of the arguments of each routine."""
        self.results: dict[str, int] = {}
        """Of the result of each routine."""
        degree = maps.degree
        self._plain = [maps.ny, self._nd * degree, parameters, 1]
        # Multipliers of the integrand and the path conditions; there are no rates.
        self._multipliers = [degree, *([self._nh * degree] if self._nh else [])]
        y, h = ca.SX.sym("y", maps.ny), ca.SX.sym("h")
        source.routine(ca.Function("nodes", [y, h], [maps.nodes(y, h)]), "nodes")
        first, second = maps.node.gradient, maps.node.hessian
        self._write("integrand", output(first, 1), None)
        self._write("gradient", output(first, 3), maps.pulled_gradient)
        if self._nh:
            self._write("path", output(first, 2), None)
            self._write("rows", output(first, 5), maps.pulled_rows)
        self._write("curvature", second, maps.pulled_curvature)

    def _write(self, name: str, node: ca.Function, pull: Pull | None) -> None:
        """Unknowns -> nodes -> values at each node -> `pull`."""
        self._source.routine(node, f"{name}_at_node", shared=(3,))
        nx, nz, degree, nd, each = self._maps.nx, self._maps.nz, self._maps.degree, self._nd, node.numel_out(0)
        values = ca.SX.sym("values", degree * each)
        result, last = values.numel(), f"for (int k = 0; k < {values.numel()}; ++k) result[k] = v[k];"
        if pull is not None:
            width = ca.SX.sym("width")
            pulled = ca.densify(pull(values, width))
            self._source.routine(ca.Function("pulled", [values, width], [pulled]), f"{name}_pulled")
            result, last = pulled.numel(), f"{name}_pulled(v, a3, result);"
        sizes, passed = self._plain, [f"z + i * {nz}", f"z + i * {nz} + {nx}", "d", f"a{PARAMETERS}"]
        if node.n_in() > len(passed):
            sizes = sizes + self._multipliers
            passed += ["a4 + i", "0", f"a5 + i * {self._nh}" if self._nh else "0"]
        body = [
            f"lanes z[{degree * nz}], d[{nd + 1}], v[{max(values.numel(), 1)}];",
            "nodes(a0, a3, z);",
            f"d[{nd}] = a3[0];",
            f"for (int i = 0; i < {degree}; ++i) {{",
            f"  for (int k = 0; k < {nd}; ++k) d[k] = a1[i * {nd} + k];",
            f"  {name}_at_node({', '.join(passed)}, v + i * {each});",
            "}",
            last,
        ]
        arguments = [f"const {'double' if i == PARAMETERS else 'lanes'}* a{i}" for i in range(len(sizes))]
        self._source.write(f"static void interval_{name}({', '.join(arguments)}, lanes* result) {{", body, "}")
        self.sizes[name], self.results[name] = sizes, result


def output(function: ca.Function, k: int) -> ca.Function:
    """A function of one output, with the operations that this one needs."""
    inputs = function.sx_in()
    return ca.Function(f"{function.name()}_{k}", inputs, [function.call(inputs)[k]])
