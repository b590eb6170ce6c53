"""The answer in words, made from the numbers of the table and from nothing else.

No sentence says "optimal" without one of the words certified, local or measured.
"""

from __future__ import annotations

from typing import Any

import pandas as pd

from occ.objectives import Objective
from occ.report.contents import MOST_CASES_APART, plain_name, plain_unit
from occ.report.stored import Stored
from occ.report.tables import amount, gap, is_missing, markdown_text, peak

KINDS = {
    "certified": "a proof, independent of every controller, says that no controller of its class needs less",
    "exact": "it is the least value of its class by a formula, not by a solver",
    "local": "it is the value of a KKT point, and nothing proves that its class holds no lower value",
}
"""Kinds of bounds, as ends of sentences."""

MEANINGLESS_PEAK = 10.0
"""A peak torque that many times larger than the middle one of its case comes from end layers, not from the motion."""


def answer(stored: Stored) -> list[str]:
    """The answer, one sentence or two for each finding.

    Args:
        stored: the results.

    Returns:
        Markdown paragraphs.
    """
    law = stored.controllers[0]
    lines = [f"The law in question is the first controller of the experiment, **{markdown_text(law)}**."]
    apart = len(stored.cases) <= MOST_CASES_APART
    for item in stored.objectives:
        if apart:
            lines += [_case_answer(stored, case, item, law) for case in stored.cases]
        else:
            lines.append(_sweep_answer(stored, item, law))
    return lines


def _case_answer(stored: Stored, case: str, item: Objective, law: str) -> str:
    rows = stored.of_case(case)
    own = rows[rows["controller"] == law].iloc[0]
    where = f"{markdown_text(case)}, {plain_name(item)}: " if len(stored.cases) > 1 else f"{plain_name(item)}: "
    where = where[0].upper() + where[1:]
    if own["status"] != "ok":
        return f"{where}**{markdown_text(law)}** has no result here ({own['status']}); its reason stands below."
    usable = rows[(rows["status"] == "ok") & (rows["keep"] == own["keep"])]
    parts = [_best(usable, own, item), _bound(own, item), _others(usable, own, item)]
    return where + " ".join(part for part in parts if part)


def _quantity(value: Any, item: Objective) -> str:
    return f"{amount(value)} {plain_unit(item.unit)}"


def _name(row: pd.Series[Any]) -> str:
    return f"**{markdown_text(str(row['controller']))}**"


def _percent(value: float) -> str:
    return f"{gap(value)} %"


def _above(value: float, reference: float) -> float:
    """[%] value over reference."""
    return 100.0 * (value - reference) / abs(reference) if reference else float("nan")


def _best(usable: pd.DataFrame, own: pd.Series[Any], item: Objective) -> str:
    """Who of the law's own start needs least, and how much more the law needs."""
    peers = usable[usable["start"] == own["start"]]
    best = peers.loc[peers[item.column].idxmin()]
    law, least = float(own[item.column]), float(best[item.column])
    if len(peers) == 1:
        return f"{_name(own)} needs {_quantity(law, item)}; no other controller shares its start."
    if best["controller"] == own["controller"]:
        return f"of the controllers with its start, {_name(own)} itself needs least, {_quantity(law, item)}."
    more = _percent(_above(law, least))
    return (
        f"of the controllers with the law's start, {_name(best)} needs least, {_quantity(least, item)} "
        f"(end class {best['end']}); {_name(own)} needs {_quantity(law, item)}, {more} more."
    )


def _bound(own: pd.Series[Any], item: Objective) -> str:
    """How far the law is above the bound of its class, and what sort of bound that is."""
    bound, kind = own[f"{item.name}_bound"], own[f"{item.name}_bound_kind"]
    if is_missing(kind) or kind == "none" or is_missing(bound):
        return "For its class there is no bound, so this compares controllers and says nothing of what is possible."
    percent = float(own[f"{item.name}_gap_percent"])
    side = "above" if percent >= 0 else "below"
    meaning = KINDS.get(kind, "its meaning is not known to this report")
    return (
        f"{_name(own)} is {_percent(abs(percent))} {side} the best known value of its class, "
        f"{_quantity(bound, item)}; this bound is *{kind}*: {meaning}."
    )


def _others(usable: pd.DataFrame, own: pd.Series[Any], item: Objective) -> str:
    """Rows with a start of their own, which the bound does not cover."""
    others = usable[usable["start"] != own["start"]]
    if others.empty or own["start"] == "own":
        return ""
    law = float(own[item.column])
    less = others[others[item.column] < law]
    if less.empty:
        return "No controller with a start of its own needs less than the law."
    named = ", ".join(
        f"{_name(row)} ({_quantity(row[item.column], item)}, {_percent(-_above(row[item.column], law))} less)"
        for _, row in less.iterrows()
    )
    return (
        f"With a start of their own, which costs them nothing and which the bound does not cover, "
        f"these need less than the law: {named}."
    )


def _sweep_answer(stored: Stored, item: Objective, law: str) -> str:
    rows = stored.rows
    own = rows[(rows["controller"] == law)]
    fine = own[own["status"] == "ok"]
    text = f"{plain_name(item)[0].upper()}{plain_name(item)[1:]}: {_name(own.iloc[0])} is ok in {len(fine)} of {len(own)} cases."
    gaps = fine.dropna(subset=[f"{item.name}_gap_percent"])
    if gaps.empty:
        return f"{text} No bound is known for any of them."
    ends = gaps[f"{item.name}_gap_percent"]
    low, high = gaps.loc[ends.idxmin()], gaps.loc[ends.idxmax()]
    kinds = ", ".join(f"*{kind}*" for kind in dict.fromkeys(gaps[f"{item.name}_bound_kind"]))
    return (
        f"{text} Its gap to the best known value of its class runs from {_percent(ends.min())} "
        f"({markdown_text(low['case'])}) to {_percent(ends.max())} ({markdown_text(high['case'])}); "
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
        rows = stored.of_case(case)
        rows = rows[rows["status"] == "ok"]
        middle = rows["peak_torque_Nm"].median()
        for _, row in rows[rows["peak_torque_Nm"] > MEANINGLESS_PEAK * middle].iterrows():
            found.setdefault(row["controller"], []).append(f"{peak(row['peak_torque_Nm'])} N m in {markdown_text(case)}")
    return [
        f"The peak torque of **{markdown_text(name)}** ({'; '.join(places)}) is not meaningful: without torque limits "
        "the least work is an infimum, approached with ever larger and ever shorter torques at the ends of the horizon, "
        "so a finer mesh raises the peak and hardly lowers the work."
        for name, places in found.items()
    ]
