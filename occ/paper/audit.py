"""The audit: every number and formula that the paper prints, beside what (2.17) gives."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import casadi as ca

from occ.experiment.store import write_text
from occ.model.presets import YouBot
from occ.paper.circle_formulas import circle_checks
from occ.paper.claims import claims
from occ.paper.degenerate_formulas import degenerate_checks
from occ.paper.formula import Check, Judgement
from occ.paper.model_formulas import model_checks
from occ.paper.numbers import PRINTED_NUMBERS, PrintedNumber
from occ.paper.printed import PARAMETERS, Box, Printed
from occ.paper.reach import Reach, reach

COLUMNS = ("equation", "quantity", "printed", "computed", "reachable_low", "reachable_high", "verdict")
FILE = "audit.csv"
PARTS = 5
"""Steps of which the caller is told: numbers, and four groups of formulas and sentences."""


@dataclass(frozen=True)
class Row:
    """One printed item.

    Args:
        equation: and section, where it is printed.
        quantity: what it is, with its unit; for a formula or a sentence what is printed and, after "right:", the right
            form.
        verdict: of the audit.
        printed: the digits; empty for a formula or a sentence.
        computed: from (2.17) as printed, in the printed unit; None likewise.
        reachable_low: the least value over the rounding box of (2.17); None likewise.
        reachable_high: the largest; None likewise.
        evidence: of a formula: the errors that decide.
    """

    equation: str
    quantity: str
    verdict: Judgement
    printed: str = ""
    computed: float | None = None
    reachable_low: float | None = None
    reachable_high: float | None = None
    evidence: str = ""


def audit(
    parameters: Mapping[str, Printed] = PARAMETERS, progress: Callable[[str], None] | None = None
) -> tuple[Row, ...]:
    """Judge all that the paper prints.

    Args:
        parameters: eq. (2.17) with its digits, by the keys of `PARAMETERS`.
        progress: told what has been done, `PARTS` times.

    Returns:
        Numbers first, then formulas, then sentences, each in the order of the paper.
    """
    preset = preset_of(parameters)
    parts: dict[str, Callable[[], list[Row]]] = {
        "printed numbers": lambda: audit_numbers(parameters),
        "sections 2 and 3": lambda: [_of_check(check) for check in model_checks(preset)],
        "section 4": lambda: [_of_check(check) for check in circle_checks(preset)],
        "degenerate problem": lambda: [_of_check(check) for check in degenerate_checks()],
        "sentences": lambda: [_of_check(check) for check in claims(preset)],
    }
    rows: list[Row] = []
    for name, part in parts.items():
        rows += part()
        if progress:
            progress(name)
    return tuple(rows)


def preset_of(parameters: Mapping[str, Printed]) -> YouBot:
    """The platform's preset with the numbers as printed.

    Args:
        parameters: by the keys of `PARAMETERS`.

    Returns:
        Numbers in SI.
    """
    numbers = {key: item.si for key, item in parameters.items()}
    center = numbers.pop("mass_center_x"), numbers.pop("mass_center_y")
    return YouBot(mass_center=center, **numbers)


def audit_numbers(parameters: Mapping[str, Printed] = PARAMETERS) -> list[Row]:
    """The derived numbers with the intervals that they reach over the rounding box of (2.17).

    Args:
        parameters: by the keys of `PARAMETERS`.

    Returns:
        A row for each of `PRINTED_NUMBERS`.
    """
    box = Box(parameters)
    u = ca.SX.sym("u", len(parameters))
    numbers = box.platform_numbers(u)
    # Some numbers are printed more than once.
    reached = {value: reach(value(numbers), u) for value in dict.fromkeys(item.value for item in PRINTED_NUMBERS)}
    return [_of_number(item, reached[item.value]) for item in PRINTED_NUMBERS]


def _of_number(item: PrintedNumber, found_si: Reach) -> Row:
    found = found_si.scaled(1 / item.printed.unit)
    if item.printed.holds(found.nominal):
        verdict = Judgement.AGREES
    elif item.printed.meets(found.low, found.high):
        verdict = Judgement.ROUNDING
    else:
        verdict = Judgement.UNEXPLAINED
    doubt = "" if found.stationary else "; the interval is not proven to be widest: no optimum was reached"
    return Row(item.equation, item.quantity + doubt, verdict, item.printed.text, found.nominal, found.low, found.high)


def _of_check(check: Check) -> Row:
    return Row(check.equation, check.statement, check.verdict, evidence=check.evidence)


def write_audit(folder: Path, rows: tuple[Row, ...]) -> Path:
    """Write ``audit.csv``.

    Args:
        folder: where.
        rows: of `audit`.

    Returns:
        The file.

    Raises:
        InputError: the folder cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(_cells(row) for row in rows)
    path = folder / FILE
    write_text(path, text.getvalue())
    return path


def _cells(row: Row) -> Iterator[str]:
    for name in COLUMNS:
        value = getattr(row, name)
        yield "" if value is None else f"{value:.12g}" if isinstance(value, float) else str(value)
