"""Lower bounds that no player has a hand in: exact least values by theory, and certified ones with a proof.

A proven bound is one of the task without limits: limits can only raise the least value, so it counts for limited rows
too.  It says nothing of a plant that differs from the model.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, cast

from occ.errors import InputError, Status
from occ.experiment.bounds import Bound, MotionClass
from occ.experiment.case import Case
from occ.motion import Circle
from occ.referee.judge import Tolerances
from occ.referee.reference import servo_end_state
from occ.task import EndClass, Task

EXACT_ERROR = 1e-11
"""Relative error of an exact least value: rounding."""
BUDGET = 5.0
"""[s] After which no further proof is tried for a case."""
GIVEN = MotionClass("path", "given", "free")
"""The class that contains all others with the given start."""


def proven_bounds(case: Case, rows: Iterable[Mapping[str, Any]], name: str, *, certify: bool = False) -> list[Bound]:
    """The proven bounds of all classes that occur among the rows of one case.

    Args:
        case: whose rows they are.
        rows: of the case.
        name: of the objective.
        certify: whether to look for proofs, too, which takes seconds.

    Returns:
        Bounds; none for an objective or a motion of which nothing is proven.
    """
    if name != "work" or case.tables["motion"]["kind"] != Circle.kind:
        return []
    task = case.task()
    found: list[Bound] = []
    classes = {MotionClass.of(row) for row in rows if row["status"] == Status.OK and row["keep"] == "path"}
    if task.off_model or not classes:
        return []
    if any(GIVEN.contains(motions) for motions in classes):
        classes.add(GIVEN)
    for motions in sorted(classes, key=lambda item: (item.start, item.end)):
        found += _of_class(task, motions, certify=certify)
    return found


def _of_class(task: Task, motions: MotionClass, *, certify: bool) -> list[Bound]:
    from occ.theory.minimum_work import minimum_work

    if motions.start == "own" or motions.end == "rest":
        return []
    state = servo_end_state(task) if motions.end == "law" else None
    try:
        # A row may have any winding: the least of all is what holds for it.
        end = cast("EndClass", motions.end)
        least = minimum_work(task, end, state, free_start=motions.start == "free")
    except InputError:
        return []
    # The referee lets an end pass that is this far from where it should be; the least work moves with it.
    slack = Tolerances().end * least.end_force if motions.end != "free" else 0.0
    bounds = [Bound(least.work, "exact", motions, EXACT_ERROR * least.scale + slack)]
    if certify and motions == GIVEN:
        from occ.certify import certify_work

        certificate = certify_work(task, least, BUDGET)
        if certificate.word == "certified":
            open_part = max(least.work - certificate.lower, 0.0) + EXACT_ERROR * least.scale
            bounds.append(Bound(certificate.lower, "certified", motions, open_part))
    return bounds
