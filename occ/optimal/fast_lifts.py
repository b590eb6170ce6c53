"""The intervals of a program in machine code: from an interval's unknowns to its costs and derivatives in one call."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca

from occ.compiler import NotInC
from occ.optimal.chains import Chains
from occ.optimal.gather import Entries
from occ.optimal.interval_code import PARAMETERS, IntervalCode
from occ.optimal.intervals import interval_maps
from occ.optimal.lifts import FromControls, Where
from occ.optimal.machine_code import Source, at_many
from occ.optimal.mesh import Scheme
from occ.optimal.problem import PROBLEMS, Problem


class InMachineCode(FromControls):
    """`FromControls` with all that is done in an interval compiled.

    Raises:
        NotInC: this machine has no working compiler, or the problem an operation that is not known in C.
    """

    def __init__(self, problem: Problem, chains: Chains, where: Where) -> None:
        super().__init__(problem, chains, where)
        self._functions = _functions(problem, chains, where.scheme)

    def _all(self, name: str, multipliers: Sequence[ca.MX] = ()) -> ca.MX:
        """(k, N) From all intervals."""
        where = self._where
        arguments = [self._given, self._by_interval(where.data), where.parameters, where.widths, *multipliers]
        return at_many(self._functions[f"all_{name}"], arguments, (PARAMETERS,))

    def integrand(self) -> ca.MX:
        return self._by_node(self._all("integrand"))

    def path(self) -> ca.MX:
        return self._by_node(self._all("path")) if self._maps.nh else super().path()

    def gradient(self) -> ca.MX:
        return self._spread(self._all("gradient"))

    def rows(self) -> Entries:
        return self._placed_rows(self._all("rows")) if self._maps.nh else super().rows()

    def curvature(self, lam_f: ca.MX, lam_g: ca.MX) -> Entries:
        nh, degree = self._maps.nh, self._degree
        multipliers = [ca.reshape(lam_f * self._where.weight, degree, self._count)]
        if nh:
            numbers = self._path.ravel(order="F")
            multipliers.append(ca.reshape(lam_g[numbers.tolist()], nh * degree, self._count))
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


@lru_cache(maxsize=PROBLEMS)
def _functions(problem: Problem, chains: Chains, scheme: Scheme) -> dict[str, ca.Function]:
    """Of an interval, `all_NAME` of several at a time."""
    source = Source()
    code = IntervalCode(interval_maps(problem, chains, scheme), problem, source)
    for name, result in code.results.items():
        arguments = [f"a{i}" for i in range(len(code.sizes[name]))]
        body = [f"interval_{name}({', '.join(arguments)}, result);"]
        source.external(f"all_{name}", code.sizes[name], (PARAMETERS,), result, body)
    return source.load()
