"""The command line.  Thin: each command loads what is heavy by itself."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from occ.errors import BoundViolation, InputError

if TYPE_CHECKING:
    from occ.report.tables import Table


class Commands(TyperGroup):
    """All commands; errors of the user are lines on the error stream and an exit code, never a traceback."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command of a context."""
        try:
            return super().invoke(ctx)
        except InputError as error:
            message, code = str(error), 2
        except BoundViolation as error:
            message, code = str(error), 1
        except KeyboardInterrupt:
            message, code = "interrupted; finished cases are stored and will not be solved again", 130
        typer.echo(message, err=True)
        raise typer.Exit(code)


WIDEST = 10_000
"""Characters of a line that no table reaches."""

app = typer.Typer(
    cls=Commands,
    help="How close is a control law to energy-optimal?  Comparison of control laws of an omnidirectional platform.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Advance = Callable[[str, int], None]
"""Told what was done and how many rows that makes."""
File = Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml", help="The experiment.")]
Settings = Annotated[
    list[str], typer.Option("--set", metavar="KEY=VALUE", help="Override a key, such as motion.radius=0.6; repeatable.")
]
AllowCode = Annotated[
    bool,
    typer.Option("--allow-code", help='Load controllers from your own files (kind = "file.py:Class"): runs that code.'),
]


class Family(StrEnum):
    """What can be listed."""

    PLATFORMS = "platforms"
    MOTIONS = "motions"
    CONTROLLERS = "controllers"
    OBJECTIVES = "objectives"


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"occ {version('occ')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


@app.command()
def run(
    experiment: File,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Output folder; reports/<experiment name>/ by default.")
    ] = None,
    settings: Settings = [],  # noqa: B006  (typer makes a new one for each call)
    allow_code: AllowCode = False,
    workers: Annotated[int, typer.Option("--workers", metavar="N", min=1, help="Processes.")] = 1,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the rows as one JSON object and nothing else.")
    ] = False,
) -> None:
    """Solve an experiment and write its table and report.

    Exit codes: 0 all rows are ok; 1 some row is not, the table says which and why; 2 bad input, nothing solved.
    """
    from occ.experiment.load import load_experiment
    from occ.experiment.run import run as run_experiment

    loaded = load_experiment(experiment, settings, allow_code)
    folder = out or Path("reports") / experiment.stem
    with _progress(sum(len(case.controllers) for case in loaded.cases)) as progress:
        results = run_experiment(loaded, folder, workers, progress)
        _write_outputs(folder, progress)
    if as_json:
        rows = {"title": loaded.title, "question": loaded.question, "folder": str(folder), "rows": results.rows}
        typer.echo(json.dumps(rows, allow_nan=False))
    else:
        _show(folder)
    if not results.all_ok:
        raise typer.Exit(1)


@app.command()
def check(experiment: File, settings: Settings = [], allow_code: AllowCode = False) -> None:  # noqa: B006
    """Validate an experiment: one line per mistake.

    Exit codes: 0 no mistake; 2 mistakes.
    """
    from occ.experiment.load import load_experiment

    loaded = load_experiment(experiment, settings, allow_code)
    cases, controllers = len(loaded.cases), len(loaded.cases[0].controllers)
    typer.echo(f"ok: {cases} case{'s' * (cases != 1)}, {controllers} controller{'s' * (controllers != 1)}")


@app.command()
def schema() -> None:
    """Print the JSON Schema of experiment files."""
    from occ.experiment.json_schema import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


@app.command(name="list")
def list_(family: Annotated[Family | None, typer.Argument(help="All of them by default.")] = None) -> None:
    """List what an experiment can name."""
    from occ.experiment.documentation import listing

    typer.echo("\n\n".join(listing(one.value) for one in ([family] if family else Family)))


@app.command()
def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with stored results.")]) -> None:
    """Write the report again from stored results."""
    from occ.experiment.results import Results

    Results.load(folder)
    _write_outputs(folder, None)
    _show(folder)


def _write_outputs(folder: Path, progress: Advance | None) -> None:
    """Figures and report from stored results."""
    from occ.figures.comparison import drawn, write_figures
    from occ.report.report import write_report

    write_figures(folder, (lambda name: progress(name, 0)) if progress else None)
    write_report(folder, drawn(folder))


def _show(folder: Path) -> None:
    """Title, question, answer tables, reasons of rows that are not ok, and where the files are."""
    from occ.report.contents import answer_tables, not_ok_table
    from occ.report.stored import load

    stored = load(folder)
    problems = not_ok_table(stored)
    for line in (stored.title, stored.question):
        if line:
            typer.echo(line)
    for table in [*answer_tables(stored), *([problems] if problems.rows else [])]:
        typer.echo()
        _print_table(table)
    typer.echo(f"\nTable, report, figures and trajectories are in {folder}{os.sep}")


def _print_table(table: Table) -> None:
    if sys.stdout.isatty():
        from rich.console import Console
        from rich.measure import Measurement

        from occ.report.tables import terminal

        console, shown = Console(), terminal(table)
        if all(column.heading != "message" for column in table.columns):
            # A narrow terminal folds the lines of numbers; squeezed columns would hide some of them.
            unfolded = console.options.update(max_width=WIDEST)
            console.width = max(console.width, Measurement.get(console, unfolded, shown).maximum)
        console.print(shown)
        return
    heads = [f"{column.heading} [{column.unit}]" if column.unit else column.heading for column in table.columns]
    lines = [heads, *table.rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(heads))]
    typer.echo(table.caption)
    for line in lines:
        cells = [
            cell.rjust(width) if column.numeric else cell.ljust(width)
            for cell, width, column in zip(line, widths, table.columns, strict=True)
        ]
        typer.echo("  ".join(cells).rstrip())


@contextmanager
def _progress(rows: int) -> Iterator[Advance | None]:
    """A progress bar over all rows, only where somebody watches the error stream."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=rows)

        def advance(what: str, count: int) -> None:
            bar.update(task, advance=count, description=what)

        yield advance


def main() -> None:
    """Entry point."""
    app(prog_name="occ")


if __name__ == "__main__":
    main()
