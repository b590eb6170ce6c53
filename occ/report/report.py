"""The report of an experiment: question, answer, how to read it, details."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from occ.experiment.store import write_text
from occ.report import contents, words
from occ.report.stored import Stored, load
from occ.report.tables import latex, markdown, markdown_text
from occ.templates import render

DETAILS = (
    (
        "Energy",
        "Work = kinetic change + dissipation. Positive work counts no braking energy as returned; electric is work "
        "plus the copper loss of the motors.",
        contents.ENERGY,
    ),
    (
        "Wheels",
        "Largest absolute values over all wheels and all times, between nodes too. The limit excess is relative to its "
        "limit.",
        contents.WHEELS,
    ),
    (
        "Accuracy",
        "Errors of B against its program, residual of the claimed motion in the equations of motion, distance of the "
        "claimed motion from the true one, and what the energy ledger leaves over.",
        contents.ACCURACY,
    ),
)
SETUP = ("platform", "point", "motion", "start", "horizon", "limits", "plant", "sweep")


def write_report(out: Path, figures: Sequence[tuple[str, str]] = ()) -> None:
    """Write ``report.md``, ``table.md`` and ``table.tex`` from stored results.

    Args:
        out: the experiment's folder.
        figures: to embed: path from the folder, and caption.

    Raises:
        InputError: the folder holds no results.
    """
    stored = load(out)
    answers = contents.answer_tables(stored)
    write_text(out / "report.md", report_text(stored, figures))
    write_text(
        out / "table.md", "\n".join(f"**{markdown_text(table.caption)}**\n\n{markdown(table)}" for table in answers)
    )
    write_text(out / "table.tex", "\n".join(latex(table) for table in answers))


def report_text(stored: Stored, figures: Sequence[tuple[str, str]] = ()) -> str:
    """The whole report.

    Args:
        stored: results of an experiment.
        figures: to embed: path from the folder, and caption.

    Returns:
        Markdown without dates and times of run: the same results make the same bytes.
    """
    details = [(heading, text, contents.detail_table(stored, heading, fields)) for heading, text, fields in DETAILS]
    values = {
        "title": markdown_text(stored.title),
        **{f"{label}s": set(stored.rows[label]) for label in ("keep", "start", "end")},
        "question": markdown_text(stored.question),
        "answer_tables": contents.answer_tables(stored),
        "answer": words.answer(stored),
        "peak_notes": words.peak_notes(stored),
        "not_ok": contents.not_ok_table(stored),
        "advice": words.advice(stored),
        "notes": contents.notes_table(stored),
        "details": details,
        "figures": figures,
        "setup": [(name, _setup_text(stored.experiment[name])) for name in SETUP if stored.experiment.get(name)],
    }
    return render(Path(__file__).parent / "report.md.j2", values, {"table": markdown, "text": markdown_text})


def _setup_text(values: dict[str, Any]) -> str:
    return markdown_text(", ".join(f"{name} = {value}" for name, value in values.items() if value is not None))
