"""The intervals of a program in machine code: from an interval's unknowns to its costs and derivatives in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from occ.optimal.chains import Chains
from occ.optimal.gather import Entries
from occ.optimal.lifts import FromControls, Where
from occ.optimal.machine_code import NotInC, Source, at_many
from occ.optimal.problem import Problem

PARAMETERS = 2
"""Place of the parameters among the arguments (y, data, parameters, width, multipliers): all intervals share them."""
Pull = Callable[[ca.SX, ca.SX], ca.SX]
"""Values at the nodes and the width -> the interval's."""


class InMachineCode(FromControls):
    """`FromControls` with all that is done in an interval compiled.

    Raises:
        NotInC: this machine has no working compiler, or the problem an operation that is not known in C.
    """

    def __init__(self, problem: Problem, chains: Chains, where: Where) -> None:
        super().__init__(problem, chains, where)
        self._nh, self._nd = len(self._path), where.data.shape[0]
        source = Source()
        y, h = ca.SX.sym("y", self._ny), ca.SX.sym("h")
        source.routine(ca.Function("nodes", [y, h], [self.nodes(y, h)]), "nodes")
        first, second = self._node.gradient, self._node.hessian
        self._external(source, "integrand", _output(first, 1), None)
        self._external(source, "gradient", _output(first, 3), self.pulled_gradient)
        if self._nh:
            self._external(source, "path", _output(first, 2), None)
            self._external(source, "rows", _output(first, 5), self.pulled_rows)
        self._external(source, "curvature", second, self.pulled_curvature)
        self._functions = source.load()

    def _external(self, source: Source, name: str, node: ca.Function, pull: Pull | None) -> None:
        """Unknowns -> nodes -> values at each node -> `pull`."""
        source.routine(node, f"{name}_at_node", shared=(3,))
        each = node.numel_out(0)
        values = ca.SX.sym("values", self._degree * each)
        result, last = values.numel(), "for (int k = 0; k < {0}; ++k) result[k] = v[k];"
        if pull is not None:
            width = ca.SX.sym("width")
            pulled = ca.densify(pull(values, width))
            source.routine(ca.Function("pulled", [values, width], [pulled]), f"{name}_pulled")
            result, last = pulled.numel(), f"{name}_pulled(v, a3, result);"
        sizes = [self._ny, self._nd * self._degree, self._where.parameters.numel(), 1]
        passed = ["z + i * {nz}", "z + i * {nz} + {nx}", "d", f"a{PARAMETERS}"]
        if node.n_in() > len(passed):
            # Multipliers of the integrand and the path conditions; there are no rates.
            sizes += [self._degree, *([self._nh * self._degree] if self._nh else [])]
            passed += ["a4 + i", "0", f"a5 + i * {self._nh}" if self._nh else "0"]
        call = ", ".join(passed).format(nz=self._nz, nx=self._nx)
        body = [
            f"lanes z[{self._degree * self._nz}], d[{self._nd + 1}], v[{max(values.numel(), 1)}];",
            "nodes(a0, a3, z);",
            f"d[{self._nd}] = a3[0];",
            f"for (int i = 0; i < {self._degree}; ++i) {{",
            f"  for (int k = 0; k < {self._nd}; ++k) d[k] = a1[i * {self._nd} + k];",
            f"  {name}_at_node({call}, v + i * {each});",
            "}",
            last.format(result),
        ]
        source.external(f"all_{name}", sizes, (PARAMETERS,), result, body)

    def _all(self, name: str, multipliers: Sequence[ca.MX] = ()) -> ca.MX:
        """(k, N) From all intervals."""
        where = self._where
        arguments = [self._given, self._by_interval(where.data), where.parameters, where.widths, *multipliers]
        return at_many(self._functions[f"all_{name}"], arguments, (PARAMETERS,))

    def integrand(self) -> ca.MX:
        return self._by_node(self._all("integrand"))

    def path(self) -> ca.MX:
        return self._by_node(self._all("path")) if self._nh else ca.MX(0, self._degree * self._count)

    def gradient(self) -> ca.MX:
        return self._spread(self._all("gradient"))

    def rows(self) -> Entries:
        return self._placed_rows(self._all("rows")) if self._nh else super().rows()

    def curvature(self, lam_f: ca.MX, lam_g: ca.MX) -> Entries:
        multipliers = [ca.reshape(lam_f * self._where.weight, self._degree, self._count)]
        if self._nh:
            numbers = self._path.ravel(order="F")
            multipliers.append(ca.reshape(lam_g[numbers.tolist()], self._nh * self._degree, self._count))
        return self._placed_curvature(self._all("curvature", multipliers))


def integrals(problem: Problem, where: Where, compiled: bool) -> FromControls:
    """The lift of a problem whose states are integrals of its controls.

    Args:
        problem: whose rates are chains of integrators.
        where: layout and arguments.
        compiled: in machine code, where this machine has a working compiler.

    Returns:
        The same numbers either way.
    """
    chains = Chains.of(problem)
    assert chains is not None
    if compiled:
        try:
            return InMachineCode(problem, chains, where)
        except NotInC:
            pass
    return FromControls(problem, chains, where)


def _output(function: ca.Function, k: int) -> ca.Function:
    """A function of one output, with the operations that this one needs."""
    inputs = function.sx_in()
    return ca.Function(f"{function.name()}_{k}", inputs, [function.call(inputs)[k]])
