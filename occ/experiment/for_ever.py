"""What the servo law and the best rotation strategy need on the circle of a case when the motion goes on for ever."""

from __future__ import annotations

from typing import Any

from occ.experiment.case import Case
from occ.laws import ServoLaw
from occ.motion import Circle
from occ.task import Task


def for_ever(case: Case, *, certify: bool) -> dict[str, Any]:
    """Mean powers of the long run, for the record of a run.

    Args:
        case: of an experiment.
        certify: whether the least mean power is to be proven in ball arithmetic.

    Returns:
        The long-run quantities of `occ circle`, and as ``least_mean_power_kind`` how the least mean power is known:
        ``exact`` or ``certified``.  Nothing where no servo law goes round a circle, and where the plant is not what the
        law knows.
    """
    kinds = {table["kind"] for table in case.tables["controller"]}
    if case.tables["motion"]["kind"] != Circle.kind or ServoLaw.kind not in kinds:
        return {}
    task = case.task()
    if task.off_model:
        return {}
    from occ.theory.law_power import long_run_section
    from occ.theory.summary import circle_setting

    found = long_run_section(circle_setting(task)) | {"least_mean_power_kind": "exact"}
    return found | _certified(task, found["law_mean_power_W"]) if certify else found


def _certified(task: Task, law: float | None) -> dict[str, Any]:
    from occ.certify.balls import Refused
    from occ.certify.long_run import least_mean_power

    try:
        least = least_mean_power(task)
    except Refused:
        return {}
    gap = 100 * (law - least) / least if law is not None and least > 0 else None
    return {"least_mean_power_W": least, "long_run_gap_percent": gap, "least_mean_power_kind": "certified"}
