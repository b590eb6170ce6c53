"""Least work as the limit of least work plus copper loss, when the copper loss goes to zero.

The least signed work is an infimum that no bounded torque attains.  With k times the copper loss the optimum is
attained and regular: its jumps are smooth layers whose width, like their cost, goes with the square root of k.  So

    J(k) = J_0 + a k^(1/2) + b k + ..,

and J_0 follows from a few k by Richardson's extrapolation in k^(1/2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occ.errors import Status
from occ.optimal.collocation import Collocation
from occ.optimal.cost import Weights
from occ.task import Task

LARGEST = 1e-2
"""Factor of the copper loss at the start."""
RATIO = 4.0
"""Factor by which it falls from one solve to the next."""


@dataclass(frozen=True)
class CopperLossLimit:
    """J(k) for several k and its limit.

    Args:
        factors: (n,) k, falling.
        costs: (n,) [J] J(k), each above the limit.
        limit: [J] J_0.
        uncertainty: [J] change of the limit by the last k.
    """

    factors: np.ndarray
    costs: np.ndarray
    limit: float
    uncertainty: float


def copper_loss_limit(task: Task, player: Collocation, count: int = 6) -> CopperLossLimit | str:
    """Solve for falling k and extrapolate.

    Args:
        task: what to do.
        player: of objective ``work``; its other keys are kept.
        count: of the k.

    Returns:
        The limit, or why one of the problems has no solution.

    Source: Kokotovic, Khalil, O'Reilly, Singular Perturbation Methods in Control, chapter 6 (cheap control).
    """
    factors = LARGEST * RATIO ** -np.arange(count, dtype=float)
    costs = []
    for factor in factors:
        weights = Weights(work=1.0, copper_loss=float(factor))
        solution = replace(player, objective="weighted", weights=weights).solve(task)
        if solution.status is not Status.OK:
            return f"with {factor:.3g} times the copper loss: {solution.message}"
        costs.append(float(solution.statistics["claimed_cost"]))
    table = [np.array(costs)]
    for order in range(1, count):
        ratio = RATIO ** (order / 2)
        table.append((ratio * table[-1][1:] - table[-1][:-1]) / (ratio - 1))
    # The error of the solves is amplified from column to column: the entry that changed least is the best.
    changes = [abs(column[-1] - column[-2]) for column in table if len(column) > 1]
    best = int(np.argmin(changes))
    return CopperLossLimit(factors, np.array(costs), float(table[best][-1]), float(changes[best]))
