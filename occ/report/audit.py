"""The audit as tables and as a report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from occ.experiment.store import write_text
from occ.paper.audit import Row
from occ.paper.formula import TOLERANCE, Judgement
from occ.report.tables import Column, Table, markdown, significant

FILE = "audit.md"
DIGITS = 5

_HEAD = f"""# What the paper prints, and what its parameters give

* Computed: from the parameters (2.17) exactly as printed.
* Reachable: the interval over which the value moves when each parameter of (2.17) moves within half a unit of its last
  printed digit, found by optimisation with exact derivatives; all other inputs (b, omega_B, R_B, phi_B) are exact.
* `agrees`: the computed value rounds to the printed one. `explained by rounding`: it does not, but some value of the
  interval does. `not explained`: none does. `misprint`: the printed form fails a numerical check and the right form
  passes it.
* Evidence of a formula: its largest relative error against the equations of motion that occ derives from the energy of
  accelerations, or against numerical integration; < {TOLERANCE:g} is rounding.
"""


def audit_tables(rows: Sequence[Row]) -> list[Table]:
    """The printed numbers, and the formulas and sentences.

    Args:
        rows: of the audit.

    Returns:
        Two tables.
    """
    numbers = [row for row in rows if row.printed]
    formulas = [row for row in rows if not row.printed]
    return [
        Table(
            f"Printed numbers: {_counts(numbers)}",
            (
                Column("equation"),
                Column("quantity"),
                Column("printed", numeric=True),
                Column("computed", numeric=True),
                Column("reachable", numeric=True),
                Column("verdict"),
            ),
            tuple(
                (
                    row.equation,
                    row.quantity,
                    row.printed,
                    significant(row.computed, DIGITS),
                    f"{significant(row.reachable_low, DIGITS)} to {significant(row.reachable_high, DIGITS)}",
                    row.verdict,
                )
                for row in numbers
            ),
        ),
        Table(
            f"Formulas and sentences: {_counts(formulas)}",
            (Column("equation"), Column("verdict"), Column("evidence"), Column("statement")),
            tuple((row.equation, row.verdict, row.evidence, row.quantity) for row in formulas),
        ),
    ]


def _counts(rows: Sequence[Row]) -> str:
    found = {verdict: sum(row.verdict is verdict for row in rows) for verdict in Judgement}
    return ", ".join(f"{count} {verdict}" for verdict, count in found.items() if count)


def write_audit_report(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``audit.md``.

    Args:
        folder: where.
        rows: of the audit.

    Raises:
        InputError: the folder cannot be written.
    """
    parts = [_HEAD, *(f"## {table.caption}\n\n{markdown(table)}" for table in audit_tables(rows))]
    write_text(folder / FILE, "\n".join(parts))
