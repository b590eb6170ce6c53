"""The switching function of a solution, from its costates, and Kelley's condition on singular arcs.

    H = g + p . f,   phi = dH/du.

Where a control enters linearly, phi vanishes on singular arcs, and elsewhere the control is on a limit that keeps it
from going against phi.  The multipliers of the defects are -w p at the collocation points, so that nothing but the
solver's own answer is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from occ.numeric import evaluate_many
from occ.optimal.problem import Nodes, Numbers, Problem, flat


@dataclass(frozen=True)
class Switching:
    """phi at the collocation points.

    Args:
        values: (nu, N, d) phi = dH/du.
        kelley: (nu, N, d) -d/du (d^2/dt^2 phi), which is not negative on an optimal singular arc of order one; NaN
            where phi depends on time by itself.
    """

    values: np.ndarray
    kelley: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """(N, d) Largest |phi| of all controls; what no cost and no motion sees has none."""
        return np.asarray(np.abs(self.values).max(axis=0))

    def kelley_holds(self, intervals: np.ndarray) -> bool | None:
        """Whether Kelley's expression is positive on some intervals.

        Args:
            intervals: (N,) of booleans: the singular ones.

        Returns:
            None where it says nothing.
        """
        seen = np.abs(self.kelley).max(axis=(1, 2)) != 0.0
        # One expression for each control is the whole condition only where there is one control.
        if seen.sum() != 1 or not intervals.any() or not np.isfinite(self.kelley[seen]).all():
            return None
        return bool((self.kelley[seen][:, intervals] > 0.0).all())


def switching(problem: Problem, nodes: Nodes, numbers: Numbers, costates: np.ndarray) -> Switching:
    """phi and Kelley's expression along a solution.

    Args:
        problem: that was solved.
        nodes: the solution.
        numbers: with which it was found.
        costates: (nx, N, d) at the collocation points.

    Returns:
        Both, for each control.

    Source: Bryson and Ho, Applied Optimal Control, sections 8.2 and 8.3.
    """
    arguments = flat(nodes.points), flat(nodes.control), flat(numbers.data), flat(costates)
    values, kelley = evaluate_many(_functions(problem), *arguments, numbers.parameters, shared=(4,))
    return Switching(values.reshape(nodes.control.shape), kelley.reshape(nodes.control.shape))


@lru_cache(maxsize=64)
def _functions(problem: Problem) -> ca.Function:
    """CasADi function (x, u, d, p, parameters) -> phi, Kelley's expression, (nu,) each."""
    x, u = problem.state, problem.control
    costate = ca.SX.sym("costate", x.numel())
    hamiltonian = problem.integrand + ca.dot(costate, problem.rate)
    values = ca.gradient(hamiltonian, u)
    along = ca.vertcat(problem.rate, -ca.gradient(hamiltonian, x))
    both = ca.vertcat(x, costate)
    kelley = []
    for j in range(u.numel()):
        first = ca.jtimes(values[j], both, along)
        kelley.append(
            -ca.jacobian(ca.jtimes(first, both, along), u[j]) if not _depends(values[j], problem.data) else np.nan
        )
    arguments = [x, u, problem.data, costate, problem.parameters]
    return ca.Function("switching", arguments, [ca.densify(values), ca.densify(ca.vertcat(*kelley))])


def _depends(value: ca.SX, data: ca.SX) -> bool:
    return bool(data.numel()) and bool(ca.depends_on(value, data))
