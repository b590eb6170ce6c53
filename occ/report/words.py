"""The answer in words, made from the numbers of the table and from nothing else.

No sentence says "optimal" without one of the words certified, local or measured.
"""

from __future__ import annotations

import math
from statistics import median
from typing import Any

from occ.errors import Status
from occ.experiment.bounds import PROVEN
from occ.objectives import Objective
from occ.report.contents import MOST_CASES_APART, is_unresolved, plain_name, plain_unit
from occ.report.stored import Row, Stored
from occ.report.tables import amount, gap, is_missing, markdown_text, peak

KINDS = {
    "certified": "a proof, independent of every controller, says that no controller of its class needs less",
    "exact": "it is the least value of its class without limits by a formula, not by a solver",
    "local": "it is the value of a KKT point, and nothing proves that its class holds no lower value",
}
"""Kinds of bounds, as ends of sentences."""

MEANINGLESS_PEAK = 10.0
"""A peak torque that many times larger than the middle one of its case comes from end layers, not from the motion."""


def answer(stored: Stored) -> list[str]:
    """The answer, a few sentences for each case and objective.

    Args:
        stored: the results.

    Returns:
        Markdown paragraphs.
    """
    law = stored.controllers[0]
    lines = [f"The law in question is the first controller of the experiment, **{markdown_text(law)}**."]
    for item in stored.objectives:
        if len(stored.cases) <= MOST_CASES_APART:
            lines += [_case_answer(stored, case, item, law) for case in stored.cases]
        else:
            lines.append(_sweep_answer(stored, item, law))
    return [*lines, *_limits(stored), *_for_ever(stored)]


def _limits(stored: Stored) -> list[str]:
    """A sentence for each row whose cost was followed to a limit that no row attains."""
    lines = []
    for row in stored.records():
        entry = stored.runs.get(row["case"], {}).get("controllers", {}).get(row["controller"]) or {}
        found = (entry.get("statistics") or {}).get("copper_loss_limit")
        if not found or row["status"] != "ok":
            continue
        limit, uncertainty = found["limit_J"], found["uncertainty_J"]
        begin = f"{markdown_text(row['case'])}: as" if len(stored.cases) > 1 else "As"
        line = (
            f"{begin} the copper loss vanishes the cost of {_name(row)} tends to {limit:.7f} J "
            f"(extrapolated from {len(found['factors'])} solves, uncertain by {uncertainty:.1g} J)"
        )
        if row.get("work_bound_kind") == "exact":
            bound = float(row["work_bound"])
            line += f"; the least work by a formula (*exact*) is {bound:.10f} J, {abs(limit - bound):.1g} J away"
        lines.append(f"{line}.")
    return lines


def _for_ever(stored: Stored) -> list[str]:
    """A sentence for each circle of which the record of the run knows the long run; none where there are many."""
    cases: dict[tuple[Any, ...], list[str]] = {}
    for case in stored.cases:
        found = stored.runs.get(case, {}).get("for_ever") or {}
        law, least = found.get("law_mean_power_W"), found.get("least_mean_power_W")
        if law is not None and least:
            aside = ", limits of the wheels left aside" if stored.runs[case].get("tables", {}).get("limits") else ""
            key = law, least, found["least_mean_power_kind"], found["long_run_gap_percent"], aside
            cases.setdefault(key, []).append(case)
    if len(cases) > MOST_CASES_APART or not any(item.name == "work" for item in stored.objectives):
        return []
    return [
        f"For ever{' in ' + markdown_text('; '.join(names)) if len(cases) > 1 else ''}{aside}: a servo law settles at "
        f"a mean power of {amount(law)} W, and no rotation strategy needs less than {amount(least)} W (*{kind}*); the "
        f"law is {gap(percent)} % above that."
        for (law, least, kind, percent, aside), names in cases.items()
    ]


def _case_answer(stored: Stored, case: str, item: Objective, law: str) -> str:
    rows = stored.records(case)
    own = next((row for row in rows if row["controller"] == law), None)
    where = f"{case}, {plain_name(item)}" if len(stored.cases) > 1 else plain_name(item).capitalize()
    topic = f"{markdown_text(where)}:"
    if own is None or own["status"] != "ok":
        status = "no row" if own is None else f"status {own['status']}"
        return f"{topic} **{markdown_text(law)}** has no result here ({status})."
    if own["keep"] == "none":
        return (
            f"{topic} **{markdown_text(law)}** takes {_quantity(own[item.column], item)} and leaves its program by up "
            f"to {own['position_error_m']:.2g} m; a row that leaves it further may need less only on that account."
        )
    usable = [row for row in rows if row["status"] == "ok" and row["keep"] == own["keep"]]
    peers = [row for row in usable if row["start"] == own["start"]]
    others = [row for row in usable if row["start"] != own["start"] and own["start"] != "own"]
    least = min(float(row[item.column]) for row in peers)
    parts = (topic, _best(peers, own, item), _bound(own, least, item), _others(others, own, item))
    return " ".join(part for part in parts if part)


def _quantity(value: Any, item: Objective) -> str:
    return f"{amount(value)} {plain_unit(item.unit)}"


def _name(row: Row) -> str:
    return f"**{markdown_text(row['controller'])}**"


def _percent(value: float) -> str:
    return f"{gap(value)} %"


def _above(value: float, reference: float) -> float:
    """[%] value over reference; NaN where the reference is zero."""
    return 100.0 * (value - reference) / abs(reference) if reference else math.nan


def _best(peers: list[Row], own: Row, item: Objective) -> str:
    """Who of the law's own start needs least, and how much more the law needs."""
    best = min(peers, key=lambda row: float(row[item.column]))
    law, least = own[item.column], best[item.column]
    if len(peers) == 1:
        return f"{_name(own)} needs {_quantity(law, item)}; no other controller shares its start."
    if best["controller"] == own["controller"]:
        return f"of the controllers with its start, {_name(own)} itself needs least, {_quantity(law, item)}."
    return (
        f"of the controllers with the law's start, {_name(best)} needs least, {_quantity(least, item)} "
        f"(end class {best['end']}); {_name(own)} needs {_quantity(law, item)}, {_percent(_above(law, least))} more."
    )


def _bound(own: Row, least: float, item: Objective) -> str:
    """How far the law is above the bound of its class, and what sort of bound that is."""
    bound, kind = own[f"{item.name}_bound"], own[f"{item.name}_bound_kind"]
    if kind in ("", "none") or is_missing(bound):
        return "For its class there is no bound, so this compares controllers and says nothing of what is possible."
    percent = own[f"{item.name}_gap_percent"]
    if math.isclose(bound, least, rel_tol=1e-12):
        return f"That least value is the bound of the law's class, too, and it is *{kind}*: {KINDS[kind]}."
    reference = "the lower bound" if kind in PROVEN else "the best known value"
    if is_unresolved(own, item):
        return (
            f"The gap of {_name(own)} to {reference} of its class, {_quantity(bound, item)}, is not resolved: it is "
            f"below its own uncertainty of {_percent(own[f'{item.name}_gap_uncertainty_percent'])}; "
            f"this bound is *{kind}*: {KINDS[kind]}."
        )
    side = "above" if percent >= 0 else "below"
    return (
        f"{_name(own)} is {_percent(abs(percent))} {side} {reference} of its class, "
        f"{_quantity(bound, item)}; this bound is *{kind}*: {KINDS[kind]}."
    )


def _others(others: list[Row], own: Row, item: Objective) -> str:
    """Rows with a start of their own, which the bound does not cover."""
    if not others:
        return ""
    law = own[item.column]
    less = [row for row in others if row[item.column] < law]
    if not less:
        return "No controller with a start of its own needs less than the law."
    named = ", ".join(
        f"{_name(row)} ({_quantity(row[item.column], item)}, {_percent(-_above(row[item.column], law))} less)"
        for row in less
    )
    return (
        "With a start of their own, which costs them nothing and which the bound does not cover, "
        f"these need less than the law: {named}."
    )


def _sweep_answer(stored: Stored, item: Objective, law: str) -> str:
    rows = [row for row in stored.records() if row["controller"] == law]
    fine = [row for row in rows if row["status"] == "ok"]
    name = plain_name(item).capitalize()
    text = f"{name}: **{markdown_text(law)}** is ok in {len(fine)} of {len(rows)} cases."
    column = f"{item.name}_gap_percent"
    gaps = sorted((row for row in fine if not is_missing(row[column])), key=lambda row: float(row[column]))
    if not gaps:
        return f"{text} No bound is known for any of them."
    low, high = gaps[0], gaps[-1]
    kinds = ", ".join(f"*{kind}*" for kind in sorted({row[f"{item.name}_bound_kind"] for row in gaps}))
    return (
        f"{text} Its gap to the best known value of its class runs from {_percent(low[column])} "
        f"({markdown_text(low['case'])}) to {_percent(high[column])} ({markdown_text(high['case'])}); "
        f"kinds of bounds: {kinds}."
    )


def peak_notes(stored: Stored) -> list[str]:
    """A warning for each controller whose peak torque tells nothing about its motion.

    Args:
        stored: the results.

    Returns:
        Markdown sentences; none where no peak stands out.
    """
    found: dict[str, list[str]] = {}
    for case in stored.cases:
        rows = [row for row in stored.records(case) if row["status"] == "ok"]
        for row in rows:
            if row["peak_torque_Nm"] > MEANINGLESS_PEAK * median(other["peak_torque_Nm"] for other in rows):
                place = f"{peak(row['peak_torque_Nm'])} N m in {markdown_text(case)}"
                found.setdefault(row["controller"], []).append(place)
    return [
        f"The peak torque of **{markdown_text(name)}** ({'; '.join(places)}) is not meaningful: without torque limits "
        "the least work is an infimum, approached with ever larger and ever shorter torques at the ends of the "
        "horizon, so a finer mesh raises the peak and hardly lowers the work."
        for name, places in found.items()
    ]


def advice(stored: Stored) -> list[str]:
    """What a user can do about the rows that are not ok.

    Args:
        stored: the results.

    Returns:
        A sentence for each status among them.
    """
    found = set(stored.rows["status"]) - {Status.OK}
    return [f"{status.capitalize()}: {status.advice}." for status in Status if status in found]
