"""Least work as the limit of least work plus copper loss, when the copper loss goes to zero.

The least signed work is an infimum that no bounded torque attains.  With k times the copper loss the optimum is
attained and regular: its jumps are smooth layers whose width, like their cost, goes with the square root of k.  So

    J(k) = J_0 + a k^(1/2) + b k + ..,

and J_0 follows from a few k by Richardson's extrapolation in k^(1/2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from occ.errors import Status
from occ.optimal.cost import Weights
from occ.task import Solution

LARGEST = 1e-2
"""Factor of the copper loss at the start."""
RATIO = 4.0
"""Factor by which it falls from one solve to the next."""
COUNT = 6
"""Solves."""
TOLERANCE = 1e-8
"""Of each solve: the extrapolation amplifies their errors."""


@dataclass(frozen=True)
class CopperLossLimit:
    """J(k) for several k and its limit.

    Args:
        factors: (n,) k, falling.
        costs: (n,) [J] J(k), each above the limit.
        limit: [J] J_0.
        uncertainty: [J] change of the limit by the last k, and the errors of the solves as they reach it.
        solution: of the last k.
    """

    factors: np.ndarray
    costs: np.ndarray
    limit: float
    uncertainty: float
    solution: Solution

    @property
    def words(self) -> str:
        """The limit in a sentence."""
        digits = int(np.clip(np.ceil(-np.log10(max(self.uncertainty, 1e-10))), 0, 10))
        return (
            f"least work as the copper loss vanishes: {self.limit:.{digits}f} J (uncertain by {self.uncertainty:.1g} "
            f"J), from {self.factors[0]:.2g} to {self.factors[-1]:.2g} times the copper loss; this row has the last"
        )

    @property
    def statistics(self) -> dict[str, Any]:
        """The same for the record of the run."""
        return {
            "factors": self.factors.tolist(),
            "costs_J": self.costs.tolist(),
            "limit_J": self.limit,
            "uncertainty_J": self.uncertainty,
        }


def copper_loss_limit(solve: Callable[[Weights], Solution], count: int = COUNT) -> CopperLossLimit | Solution:
    """Solve for falling k and extrapolate.

    Args:
        solve: least work plus copper loss by the factors of both, to `TOLERANCE` or better.
        count: of the k.

    Returns:
        The limit, or the first solve that gave no solution, with the reason.

    Source: Kokotovic, Khalil, O'Reilly, Singular Perturbation Methods in Control, chapter 6 (cheap control).
    """
    factors = LARGEST * RATIO ** -np.arange(count, dtype=float)
    costs, errors = [], []
    for factor in factors:
        solution = solve(Weights(work=1.0, copper_loss=float(factor)))
        if solution.status is not Status.OK:
            return replace(solution, message=f"with {factor:.3g} times the copper loss: {solution.message}")
        costs.append(float(solution.statistics["claimed_cost"]))
        errors.append((solution.statistics.get("doubled_mesh") or 0.0) * max(1.0, abs(costs[-1])))
    table, amplified = [np.array(costs)], [max(errors)]
    for order in range(1, count):
        ratio = RATIO ** (order / 2)
        table.append((ratio * table[-1][1:] - table[-1][:-1]) / (ratio - 1))
        amplified.append(amplified[-1] * (ratio + 1) / (ratio - 1))
    # The errors of the solves grow from column to column: the entry that changed least is the best.
    changes = [abs(column[-1] - column[-2]) for column in table if len(column) > 1]
    best = int(np.argmin(changes))
    uncertainty = float(changes[best] + amplified[best])
    return CopperLossLimit(factors, np.array(costs), float(table[best][-1]), uncertainty, solution)
