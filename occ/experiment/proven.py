"""Lower bounds that no player has a hand in: exact least values by theory, and certified ones with a proof.

A proven bound is one of the task without limits: limits can only raise the least value, so it counts for limited rows
too.  It says nothing of a plant that differs from the model.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from occ.errors import InputError, Status
from occ.experiment.bounds import Bound, MotionClass
from occ.experiment.case import Case
from occ.motion import Circle
from occ.objectives import COPPER_LOSS, objective
from occ.referee.judge import Tolerances
from occ.referee.reference import servo_end_state
from occ.task import EndClass, Task

if TYPE_CHECKING:
    from occ.certify import Ends
    from occ.certify.running import Cost
    from occ.certify.squares import SquaresCertificate
    from occ.theory.minimum_work import LeastWork

EXACT_ERROR = 1e-11
"""Relative error of an exact least value: rounding."""
BUDGET = 30.0
"""[s] Of the processor's time after which no further proof of the work is looked for; nearly all take less than 3 s."""
SQUARES_BUDGET = 20.0
"""[s] The same for sums of squares, for each class."""
GIVEN = MotionClass("path", "given", "free")
"""The class that contains all others with the given start."""


class Minorant(NamedTuple):
    """An objective is at least so many times a cost that has certified bounds."""

    cost: Cost
    factor: float = 1.0


MINORANTS: dict[str, Minorant] = {
    "torque_squared": Minorant("torque_squared"),
    "copper_loss": Minorant("torque_squared", COPPER_LOSS),
    "electric": Minorant("electric"),
    # What is drawn but never given back is no less than what is drawn less what is given back.
    "electric_drawn": Minorant("electric"),
    "bus_work": Minorant("work"),
    "positive_work": Minorant("work"),
    "absolute_work": Minorant("work"),
}
"""Where the certified bounds of the other objectives come from."""


def proven_bounds(
    case: Case, rows: Iterable[Mapping[str, Any]], name: str, *, task: Task | None = None, certify: bool = False
) -> list[Bound]:
    """The proven bounds of all classes that occur among the rows of one case.

    Args:
        case: whose rows they are.
        rows: of the case.
        name: of the objective.
        task: of the case, where it is at hand.
        certify: whether to look for proofs, too, which takes seconds.

    Returns:
        Bounds; none for an objective or a motion of which nothing is proven.
    """
    if case.tables["motion"]["kind"] != Circle.kind or not (name == "work" or (certify and name in MINORANTS)):
        return []
    task = task or case.task()
    fair = [row for row in rows if row["status"] == Status.OK and row["keep"] == "path"]
    classes = {MotionClass.of(row) for row in fair if row["start"] != "own" and row["end"] != "rest"}
    if task.off_model or not classes:
        return []
    if any(GIVEN.contains(motions) for motions in classes):
        classes.add(GIVEN)
    found: list[Bound] = []
    for motions in sorted(classes, key=lambda item: (item.start, item.end)):
        if name == "work":
            found += _of_work(task, motions, certify=certify)
        else:
            found += _of_minorant(task, motions, name, fair)
    return found


def _of_work(task: Task, motions: MotionClass, *, certify: bool) -> list[Bound]:
    least = _least_work(task, motions)
    if least is None:
        return []
    rounding, slack = EXACT_ERROR * least.scale, _end_slack(motions, least.end_force)
    bounds = [Bound(least.work, "exact", motions, rounding + slack)]
    if not certify:
        return bounds
    from occ.certify import certify_work

    certificate = certify_work(task, _ends(task, motions), budget=BUDGET)
    lower = certificate.lower
    if certificate.word != "certified":
        lower = max(lower, _squares(task, "work", motions, least.work).lower)
    if math.isfinite(lower):
        bounds.append(Bound(lower, "certified", motions, rounding + slack, max(least.work - lower, 0.0)))
    return bounds


def _least_work(task: Task, motions: MotionClass) -> LeastWork | None:
    """The exact least work of a class; None where there is no formula."""
    try:
        # A row may have any winding: the least of all is what holds for it.
        return _ends(task, motions).least(task)
    except InputError:
        return None


def _ends(task: Task, motions: MotionClass) -> Ends:
    from occ.certify import Ends

    state = tuple(float(x) for x in servo_end_state(task)) if motions.end == "law" else None
    return Ends(cast("EndClass", motions.end), state, motions.start == "free")


def _of_minorant(task: Task, motions: MotionClass, name: str, rows: Sequence[Mapping[str, Any]]) -> list[Bound]:
    of = MINORANTS[name]
    least = _least_work(task, motions) if of.cost == "work" else None
    optimum = least.work if least else _best(of.cost, of.cost, motions, rows)
    certificate = _squares(task, of.cost, motions, optimum)
    if not math.isfinite(certificate.lower):
        return []
    value = math.nextafter(of.factor * certificate.lower, -math.inf)
    # Where no optimum is known the last step of the degree tells how loose the bound is.
    best = _best(name, of.cost, motions, rows)
    step = of.factor * certificate.step if math.isfinite(certificate.step) else abs(value)
    rest = max(best - value, 0.0) if math.isfinite(best) else step
    force = of.factor * (least.end_force if least else certificate.end_force)
    return [Bound(value, "certified", motions, _end_slack(motions, force), rest)]


def _best(name: str, cost: str, motions: MotionClass, rows: Sequence[Mapping[str, Any]]) -> float:
    """The least value of an objective among the rows that claim a local optimum of it, or of the cost below it."""
    column = objective(name).column
    optimal = [row for row in rows if row["local_objective"] in (name, cost)]
    return min((row[column] for row in optimal if motions.contains(MotionClass.of(row))), default=math.inf)


@lru_cache(maxsize=8)
def _squares(task: Task, cost: Cost, motions: MotionClass, upper: float) -> SquaresCertificate:
    from occ.certify.squares import certify_squares

    return certify_squares(task, cost, _ends(task, motions), upper=upper, budget=SQUARES_BUDGET)


def _end_slack(motions: MotionClass, force: float) -> float:
    """The referee lets an end pass that is this far from where it should be; the least value moves with it."""
    return Tolerances().end * force if motions.end != "free" else 0.0
