"""What the copper loss that settles an objective costs, and how much less of it does.

With e times the copper loss C the optimum is x(e), and R(e) = min (J + e C) is its value: dR/de = C(x(e)), and

    J(x(e)) - J_0 = integral of s (-dC/ds) ds from 0 to e,   J_0 = lim J(x(e)).

Torques that stay bounded as e vanishes leave a share that falls like e or faster; jumps of the velocity become layers
as wide as e^(1/2), and C grows like e^(-1/2).  So J(x(e)) - J_0 = a e^p with p = 1/2 where there are jumps, and p > 1/2
elsewhere, so that

    J(x(e)) - J_0 <= (J(x(r e)) - J(x(e))) / (r^(1/2) - 1)

to leading order, with equality where there are jumps.  For r = 4 that is what the objective loses from 4 e to e.

Source: Kokotovic, Khalil, O'Reilly, Singular Perturbation Methods in Control, chapter 6 (cheap control).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from occ.errors import Status
from occ.optimal.attempt import Attempt, Method
from occ.optimal.cost import Aim
from occ.optimal.formulation import Formulation
from occ.optimal.problem import flat
from occ.optimal.search import Search

RATIO = 4.0
"""Factor from one copper loss to the next."""
LEVELS = 3
"""Times that the copper loss is lowered at most: where there are jumps, each halves what it costs."""
AFFORDABLE = 40
"""Iterations of the last solve on one level from which on the next level is not tried: wheels that brake in ever
shorter pulses need hundreds."""
FINE = 64
"""Intervals of one level from which on the next level is not tried; that may have twice as many."""
BEARABLE = 0.01
"""Share of the objective above which the next level is tried all the same: what is printed should be the objective and
not its copper loss."""
UTMOST_LEVELS = 8
"""The same as `LEVELS` then."""
UTMOST_FINE = 100
"""The same as `FINE` then."""


@dataclass(frozen=True)
class Settled:
    """A solution with as little added copper loss as is affordable.

    Args:
        search: that found it.
        attempt: the solution.
        factor: of the copper loss that it has [1 or N m/J].
        share: [unit of the objective] J(x(e)) - J_0 from 4 e and e; NaN where there is no solution for 4 e.
        effort: iterations of the last solve.
    """

    search: Search
    attempt: Attempt
    factor: float
    share: float
    effort: int

    @property
    def objective(self) -> float:
        """J without the copper loss."""
        return objective_of(self.search.formulation, self.attempt)

    @property
    def statistics(self) -> dict[str, float | None]:
        """For the record of the run."""
        share = self.share if math.isfinite(self.share) else None
        limit = self.objective - share if share is not None else None
        return {"copper_loss_factor": self.factor, "copper_loss_share": share, "without_copper_loss": limit}

    def words(self, unit: str) -> str:
        """The added copper loss and what it costs, in a sentence.

        Args:
            unit: of the objective.

        Returns:
            Text with numbers and units.
        """
        added = f"with {self.factor:.3g} times the copper loss to settle what the objective leaves open"
        if not math.isfinite(self.share):
            return f"{added}; what that costs is not known"
        percent = 100 * self.share / max(abs(self.objective), 1e-12)
        raised = f"{added}, which raises the objective by about {self.share:.2g} {unit} ({percent:.2g} %)"
        if percent < 100 * BEARABLE:
            return raised
        # Two digits of the share: it is right to leading order.
        digits = 1 - math.floor(math.log10(self.share))
        return f"{raised}; without any the limit is about {self.objective - self.share:.{max(digits, 0)}f} {unit}"


def settled(search: Search, attempt: Attempt) -> Settled:
    """The solution with less and less of the added copper loss, until what it costs is below the tolerance.

    Args:
        search: whose problem has a copper loss as its last term.
        attempt: its solution, fine enough.

    Returns:
        The last one that is fine enough, and what its copper loss costs.
    """
    first, *lower = _levels(search, attempt)
    for level in reversed(lower):
        if not search.method.doubled:
            return level
        confirming = _at(search, level.factor, search.method)
        confirmed, reason = confirming.run(level.attempt)
        search.rounds.extend(confirming.rounds)
        if confirmed.outcome.status is Status.OK and not reason:
            return replace(level, search=confirming, attempt=confirmed)
    return first


def _first(search: Search, attempt: Attempt) -> Settled:
    """What the copper loss costs, from a solve with `RATIO` times as much."""
    factor = search.formulation.settings.aim.weights[-1]
    more = _at(search, RATIO * factor, search.method)
    softer = more.attempt(attempt.grid, attempt, restart=True)
    share = math.nan
    if softer.outcome.status is Status.OK:
        # Below zero by the solver's errors only.
        share = abs(objective_of(more.formulation, softer) - objective_of(search.formulation, attempt))
    effort = search.rounds[-1]["iterations"]
    search.rounds.extend(more.rounds)
    return Settled(search, attempt, factor, share, effort)


def _levels(search: Search, attempt: Attempt) -> list[Settled]:
    """The solution, and those with less and less of the copper loss down to the last affordable one."""
    found = [_first(search, attempt)]
    for level in range(UTMOST_LEVELS):
        best = found[-1]
        relative = best.share / max(1.0, abs(best.objective))
        # Nothing is known of the share where it is not a number.
        bearable = not relative > BEARABLE
        finest = FINE if bearable else UTMOST_FINE
        enough = not relative > search.method.tolerance or (bearable and (level >= LEVELS or best.effort > AFFORDABLE))
        if enough or best.attempt.grid.intervals > finest:
            break
        less = _at(search, best.factor / RATIO, replace(search.method, doubled=False))
        less.most_intervals = 2 * finest
        lower, reason = less.run(less.attempt(best.attempt.grid, best.attempt, restart=True))
        search.rounds.extend(less.rounds)
        if lower.outcome.status is not Status.OK or reason:
            break
        share = abs(best.objective - objective_of(less.formulation, lower))
        found.append(Settled(less, lower, best.factor / RATIO, share, less.rounds[-1]["iterations"]))
    return found


def _at(search: Search, factor: float, method: Method) -> Search:
    """The search of the same problem with another factor of the last term."""
    settings = search.formulation.settings
    settings = replace(settings, aim=settings.aim.with_last(factor))
    return Search(replace(search.formulation, settings=settings), method)


def objective_of(formulation: Formulation, attempt: Attempt) -> float:
    """J = R - e C: the claimed value without the copper loss, which is the last term.

    Args:
        formulation: of the problem.
        attempt: a solution.

    Returns:
        In the objective's unit.
    """
    settings = formulation.settings
    aim = settings.aim
    alone = Aim(aim.terms, (*[0.0] * (len(aim.terms) - 1), aim.weights[-1]))
    parameters = replace(formulation, settings=replace(settings, aim=alone)).parameters()
    nodes, numbers = attempt.outcome.nodes, attempt.numbers
    integrand = attempt.transcription.evaluate(flat(nodes.points), flat(nodes.control), flat(numbers.data), parameters)[
        1
    ]
    weights = attempt.transcription.scheme.weights
    loss = np.diff(numbers.edges) @ (integrand.reshape(len(numbers.edges) - 1, -1) @ weights)
    return float(attempt.outcome.cost - loss)
