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
from occ.experiment.bounds import PROVEN, Bound, MotionClass, bound_columns, local_bounds
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


class Proven(NamedTuple):
    """Bounds, and why a class has none although one was looked for."""

    bounds: list[Bound]
    missing: list[tuple[MotionClass, str]]


def with_bounds(
    case: Case,
    rows: Iterable[Mapping[str, Any]],
    objectives: Iterable[str],
    *,
    task: Task | None = None,
    certify: bool = False,
) -> list[dict[str, Any]]:
    """The rows of one case with the bounds of each objective, proven ones and local ones.

    Args:
        case: whose rows they are.
        rows: of the case, with its name.
        objectives: by name.
        task: of the case, where it is at hand.
        certify: whether to look for proofs, too, which takes seconds.

    Returns:
        The same rows and `occ.experiment.bounds.BOUND_COLUMNS` of each objective; the message of a row without a proven
        bound says why there is none where one was looked for.

    Raises:
        BoundViolation: a feasible row below a proven bound of its class.
    """
    own = [dict(row) for row in rows]
    for name in objectives:
        proven = proven_bounds(case, own, name, task=task, certify=certify)
        bounds = [*proven.bounds, *local_bounds(own, name)]
        for row in own:
            row |= bound_columns(row, name, bounds)
            words = [
                f"no proven bound of {name}: {reason}"
                for motions, reason in proven.missing
                if _lacks(row, name, motions)
            ]
            row["message"] = "; ".join(filter(None, [row["message"], *words[:1]]))
    return own


def without_proof(rows: Iterable[Mapping[str, Any]], objectives: Iterable[str], reason: str) -> list[dict[str, Any]]:
    """The rows of one case with local bounds alone, as the search for proven ones gave no answer.

    Args:
        rows: of the case, with its name.
        objectives: by name.
        reason: why there is none.

    Returns:
        Rows as of `with_bounds`; the message of each that could have had a proven bound says why it has none.
    """
    own = [dict(row) for row in rows]
    for name in objectives:
        bounds = local_bounds(own, name)
        for row in own:
            row |= bound_columns(row, name, bounds)
    for row in own:
        if row["status"] == Status.OK:
            row["message"] = "; ".join(filter(None, [row["message"], f"no proven bound: {reason}"]))
    return own


def _lacks(row: Mapping[str, Any], name: str, motions: MotionClass) -> bool:
    """Whether a row has no proven bound although it is of a class that should have one."""
    fair = row["status"] == Status.OK and row[f"{name}_bound_kind"] not in PROVEN
    return fair and motions.contains(MotionClass.of(row))


def proven_bounds(
    case: Case, rows: Iterable[Mapping[str, Any]], name: str, *, task: Task | None = None, certify: bool = False
) -> Proven:
    """The proven bounds of all classes that occur among the rows of one case.

    Args:
        case: whose rows they are.
        rows: of the case.
        name: of the objective.
        task: of the case, where it is at hand.
        certify: whether to look for proofs, too, which takes seconds.

    Returns:
        Bounds; none for an objective or a motion of which nothing is proven, with the reason where a search failed.
    """
    if case.tables["motion"]["kind"] != Circle.kind or not (name == "work" or (certify and name in MINORANTS)):
        return Proven([], [])
    task = task or case.task()
    fair = [row for row in rows if row["status"] == Status.OK and row["keep"] == "path"]
    classes = {MotionClass.of(row) for row in fair if row["start"] != "own" and row["end"] != "rest"}
    if task.off_model or not classes:
        return Proven([], [])
    if any(GIVEN.contains(motions) for motions in classes):
        classes.add(GIVEN)
    found = []
    for motions in sorted(classes, key=lambda item: (item.start, item.end)):
        if name == "work":
            found.append(_of_work(task, motions, certify=certify))
        else:
            found.append(_of_minorant(task, motions, name, fair))
    return Proven([bound for item in found for bound in item.bounds], [why for item in found for why in item.missing])


def _of_work(task: Task, motions: MotionClass, *, certify: bool) -> Proven:
    least = _least_work(task, motions)
    if isinstance(least, str):
        return Proven([], [(motions, least)] if least else [])
    rounding, slack = EXACT_ERROR * least.scale, _end_slack(motions, least.end_force)
    bounds = [Bound(least.work, "exact", motions, rounding + slack)]
    if not certify:
        return Proven(bounds, [])
    from occ.certify import certify_work

    certificate = certify_work(task, _ends(task, motions))
    lower = certificate.lower
    if certificate.word != "certified":
        lower = max(lower, _squares(task, "work", motions, least.work).lower)
    if math.isfinite(lower):
        bounds.append(Bound(lower, "certified", motions, rounding + slack, max(least.work - lower, 0.0)))
    return Proven(bounds, [])


def _least_work(task: Task, motions: MotionClass) -> LeastWork | str:
    """The exact least work of a class, or why the search for it fails; nothing where there is no formula."""
    from occ.theory.extremals import NoExtremal

    try:
        # A row may have any winding: the least of all is what holds for it.
        return _ends(task, motions).least(task)
    except InputError:
        return ""
    except NoExtremal as error:
        return str(error)


def _ends(task: Task, motions: MotionClass) -> Ends:
    from occ.certify import Ends

    state = tuple(float(x) for x in servo_end_state(task)) if motions.end == "law" else None
    return Ends(cast("EndClass", motions.end), state, motions.start == "free")


def _of_minorant(task: Task, motions: MotionClass, name: str, rows: Sequence[Mapping[str, Any]]) -> Proven:
    of = MINORANTS[name]
    found = _least_work(task, motions) if of.cost == "work" else ""
    least = None if isinstance(found, str) else found
    optimum = least.work if least else _best(of.cost, of.cost, motions, rows)
    certificate = _squares(task, of.cost, motions, optimum)
    if not math.isfinite(certificate.lower):
        return Proven([], [(motions, certificate.reason)])
    value = math.nextafter(of.factor * certificate.lower, -math.inf)
    # Where no optimum is known the last step of the degree tells how loose the bound is.
    best = _best(name, of.cost, motions, rows)
    step = of.factor * certificate.step if math.isfinite(certificate.step) else abs(value)
    rest = max(best - value, 0.0) if math.isfinite(best) else step
    force = of.factor * (least.end_force if least else certificate.end_force)
    return Proven([Bound(value, "certified", motions, _end_slack(motions, force), rest)], [])


def _best(name: str, cost: str, motions: MotionClass, rows: Sequence[Mapping[str, Any]]) -> float:
    """The least value of an objective among the rows that claim a local optimum of it, or of the cost below it."""
    column = objective(name).column
    optimal = [row for row in rows if row["local_objective"] in (name, cost)]
    return min((row[column] for row in optimal if motions.contains(MotionClass.of(row))), default=math.inf)


@lru_cache(maxsize=8)
def _squares(task: Task, cost: Cost, motions: MotionClass, upper: float) -> SquaresCertificate:
    from occ.certify.squares import certify_squares

    return certify_squares(task, cost, _ends(task, motions), upper=upper)


def _end_slack(motions: MotionClass, force: float) -> float:
    """The referee lets an end pass that is this far from where it should be; the least value moves with it."""
    return Tolerances().end * force if motions.end != "free" else 0.0
