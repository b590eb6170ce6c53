"""The command line.  Thin: each command loads what is heavy by itself."""

from __future__ import annotations

import json
import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from occ.commands import (
    AllowCode,
    Commands,
    Dask,
    ExperimentCommand,
    ExportCommand,
    File,
    InProcess,
    MemoryLimit,
    Patience,
    Settings,
    TimeLimit,
    Workers,
)
from occ.progress import Progress, progress_of

if TYPE_CHECKING:
    from occ.report.tables import Table

WIDEST = 10_000
"""Characters of a line that no table reaches."""
FOLDED = {"message", "statement"}
"""Columns of long text, which a narrow terminal folds."""

app = typer.Typer(
    cls=Commands,
    help="How close is a control law to energy-optimal?  Comparison of control laws of an omnidirectional platform.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


class Family(StrEnum):
    """What can be listed."""

    PLATFORMS = "platforms"
    MOTIONS = "motions"
    CONTROLLERS = "controllers"
    OBJECTIVES = "objectives"
    EXPORTS = "exports"


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


@app.command(cls=ExperimentCommand)
def run(
    experiment: File,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Output folder; reports/<experiment name>/ by default.")
    ] = None,
    settings: Settings = [],
    allow_code: AllowCode = False,
    workers: Workers = 1,
    dask: Dask = None,
    time_limit: TimeLimit = None,
    memory_limit: MemoryLimit = None,
    patience: Patience = None,
    in_process: InProcess = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the rows as one JSON object and nothing else.")
    ] = False,
) -> None:
    """Solve an experiment and write its table and report.

    Exit codes: 0 all rows are ok; 1 some row is not, the table says which and why; 2 bad input, nothing solved.
    """
    from occ.experiment.pool import Engine

    engine = Engine(
        workers=workers,
        dask=dask,
        time_limit=time_limit,
        memory_limit=memory_limit,
        patience=patience,
        in_process=in_process,
    )
    folder = out or Path("reports") / experiment.stem
    with engine.kept("occ.experiment.run") as kept:
        # While the first process starts.
        from occ.experiment.load import load_experiment
        from occ.experiment.run import run as run_experiment

        loaded = load_experiment(experiment, settings, allow_code)
        with progress_of(sum(len(case.controllers) for case in loaded.cases)) as progress:
            results = run_experiment(loaded, folder, kept, progress)
            _write_outputs(folder, progress)
    if as_json:
        rows = {"title": loaded.title, "question": loaded.question, "folder": str(folder), "rows": results.rows}
        typer.echo(json.dumps(rows, allow_nan=False))
    else:
        _show(folder)
    if not results.all_ok:
        raise typer.Exit(1)


@app.command(cls=ExperimentCommand)
def atlas(
    experiment: File,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Output folder; reports/<experiment name>/ by default.")
    ] = None,
    settings: Settings = [],
    workers: Workers = 1,
    dask: Dask = None,
    time_limit: TimeLimit = None,
    memory_limit: MemoryLimit = None,
    patience: Patience = None,
    in_process: InProcess = False,
) -> None:
    """Map an experiment's sweep: labelled arrays (atlas.nc), maps and a report.

    Exit codes: 0 all points have their values; 1 some have not, failures.csv says which and why; 2 bad input.
    """
    from occ.experiment.pool import Engine

    engine = Engine(
        workers=workers,
        dask=dask,
        time_limit=time_limit,
        memory_limit=memory_limit,
        patience=patience,
        in_process=in_process,
    )
    folder = out or Path("reports") / experiment.stem
    with engine.kept("occ.atlas.run") as kept:
        # While the first process starts.
        from occ.atlas.dataset import write_atlas, write_failures
        from occ.atlas.grid import load_grid
        from occ.atlas.run import make_atlas

        grid = load_grid(experiment, settings)
        with progress_of(grid.size) as progress:
            found = make_atlas(experiment, grid, folder, kept, progress)
            write_atlas(grid, found, folder)
            failures = write_failures(grid, found, folder)
            tables = _write_atlas_outputs(folder)
    _show_atlas(folder, tables)
    if failures:
        raise typer.Exit(1)


@app.command(cls=ExperimentCommand)
def check(experiment: File, settings: Settings = [], allow_code: AllowCode = False) -> None:
    """Validate an experiment: one line per mistake.

    Exit codes: 0 no mistake; 2 mistakes.
    """
    from occ.experiment.load import load_experiment

    loaded = load_experiment(experiment, settings, allow_code)
    cases, controllers = len(loaded.cases), len(loaded.cases[0].controllers)
    typer.echo(f"ok: {cases} case{'s' * (cases != 1)}, {controllers} controller{'s' * (controllers != 1)}")


@app.command(cls=ExperimentCommand)
def circle(
    experiment: File,
    settings: Settings = [],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    certify: Annotated[
        bool, typer.Option("--certify", help="Prove the least means of the long run, too, which takes seconds.")
    ] = False,
    allow_code: AllowCode = False,
) -> None:
    """Tell what the platform will do on a circle: regime, steady rotations, periods, wheels.

    Exit codes: 0 told; 2 bad input, such as another motion than a circle.
    """
    from occ.experiment.circle import circle_task
    from occ.report.circle import circle_json, circle_lines
    from occ.theory.summary import circle_summary

    task = circle_task(experiment, settings, allow_code)
    summary = circle_summary(task)
    if certify:
        from occ.certify.endless import endless_section

        summary |= endless_section(task)
    typer.echo(circle_json(summary) if as_json else "\n".join(circle_lines(task, summary)))


@app.command()
def schema() -> None:
    """Print the JSON Schema of experiment files."""
    from occ.experiment.json_schema import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


@app.command(name="list")
def list_(family: Annotated[Family | None, typer.Argument(help="All of them by default.")] = None) -> None:
    """List what an experiment or an export can name."""
    from occ.experiment.documentation import listing
    from occ.export.catalogue import listing as exports

    families = [family] if family else list(Family)
    typer.echo("\n\n".join(exports() if one is Family.EXPORTS else listing(one.value) for one in families))


@app.command()
def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with stored results.")]) -> None:
    """Write tables, figures and report again from stored results, those of an atlas, too."""
    from occ.atlas.dataset import FILE

    if (folder / FILE).is_file():
        _show_atlas(folder, _write_atlas_outputs(folder))
        return
    _write_outputs(folder, None)
    _show(folder)


@app.command()
def paper(
    figures: Annotated[
        list[str], typer.Option("--figure", metavar="N ...", help="Figures from 3 to 10; all of them by default.")
    ] = [],
    more: Annotated[list[str], typer.Argument(metavar="N ...", hidden=True)] = [],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Output folder.")] = Path("reports/paper"),
) -> None:
    """Write the paper's figures 3 to 10 as SVG, and the data behind each as CSV."""
    from occ.figures.paper import draw
    from occ.paper.data import figure_numbers, write_data

    numbers = figure_numbers([*figures, *more])
    with progress_of(len(numbers)) as progress:
        for number in numbers:
            progress(f"Fig. {number}", 0)
            write_data(out, number)
            draw(out, number)
            progress(f"Fig. {number}", 1)
    typer.echo("\n".join(str(out / f"fig{number:02d}.svg") for number in numbers))


@app.command()
def audit(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Output folder.")] = Path("reports/audit"),
) -> None:
    """Put the paper's printed numbers and formulas beside computed ones: audit.csv and audit.md."""
    from occ.paper.audit import PARTS, write_audit
    from occ.paper.audit import audit as run_audit
    from occ.report.audit import audit_tables, write_audit_report

    with progress_of(PARTS) as progress:
        rows = run_audit(progress=lambda name: progress(name, 1))
    write_audit(out, rows)
    write_audit_report(out, rows)
    for table in audit_tables(rows):
        _print_table(table)
        typer.echo()
    typer.echo(f"Table and report are in {out}{os.sep}")


@app.command(cls=ExportCommand)
def export(
    names: Annotated[list[str], typer.Argument(metavar="NAME...", help="What; NAME=OWN names the function. Or all.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Output folder.")],
    language: Annotated[
        list[str], typer.Option(metavar="LANG...", help="c, python, matlab, latex, json, casadi; several at once.")
    ],
    wrt: Annotated[
        list[str], typer.Option(metavar="VAR...", help="Derivatives: an argument, parameters, or one of the platform.")
    ] = [],
    symbolic: Annotated[
        list[str], typer.Option(metavar="PARAM...", help="Numbers of the platform that stay arguments; or parameters.")
    ] = [],
    platform: Annotated[
        str | None, typer.Option(metavar="FILE", help="TOML file with a table [platform], or a preset.")
    ] = None,
    motion: Annotated[
        str | None, typer.Option(metavar="KIND", help="Program motion; given: its velocity and acceleration.")
    ] = None,
    second: Annotated[bool, typer.Option("--second", help="Hessians and Hessian-vector products, too.")] = False,
    single: Annotated[bool, typer.Option("--single", help="C in single precision.")] = False,
    no_check: Annotated[bool, typer.Option("--no-check", help="Do not run what was written.")] = False,
) -> None:
    """Write expressions of the model and their derivatives for other tools, and run them against CasADi.

    Exit codes: 0 written; 1 a file disagrees with CasADi, nothing written; 2 bad input, nothing written.
    """
    from occ.export.export import export as write
    from occ.export.request import Request

    request = Request(tuple(names), tuple(wrt), tuple(language), platform, tuple(symbolic), motion, second, single)
    done = write(request, out, check=not no_check)
    for line in done.lines:
        typer.echo(line)
    typer.echo(f"{len(done.files)} files are in {out}{os.sep}")


def _write_outputs(folder: Path, progress: Progress | None) -> None:
    """Figures and report from stored results."""
    from occ.figures.comparison import drawn, write_figures
    from occ.report.report import write_report

    write_figures(folder, (lambda name: progress(name, 0)) if progress else None)
    write_report(folder, drawn(folder))


def _write_atlas_outputs(folder: Path) -> list[Table]:
    """Maps and report from stored arrays; the tables of the report."""
    from occ.atlas.dataset import open_atlas, read_failures
    from occ.figures.maps import write_maps
    from occ.report.atlas import atlas_tables, write_atlas_report

    with open_atlas(folder) as data:
        tables = atlas_tables(data)
        write_atlas_report(data, folder, tables, write_maps(data, folder), read_failures(folder))
    return tables


def _show_atlas(folder: Path, tables: list[Table]) -> None:
    for table in tables:
        _print_table(table)
        typer.echo()
    typer.echo(f"Arrays, maps and report are in {folder}{os.sep}")


def _show(folder: Path) -> None:
    """Title, question, answer tables, reasons of rows that are not ok, and where the files are."""
    from occ.report.contents import answer_tables, not_ok_table
    from occ.report.stored import load
    from occ.report.words import advice

    stored = load(folder)
    problems = not_ok_table(stored)
    for line in (stored.title, stored.question):
        if line:
            typer.echo(line)
    for table in [*answer_tables(stored), *([problems] if problems.rows else [])]:
        typer.echo()
        _print_table(table)
    for line in advice(stored):
        typer.echo(line)
    typer.echo(f"\nTable, report, figures and trajectories are in {folder}{os.sep}")


def _print_table(table: Table) -> None:
    from occ.report.tables import parts, plain_lines, terminal

    if not sys.stdout.isatty() or os.environ.get("TERM") == "dumb":
        typer.echo("\n".join(plain_lines(table)))
        return
    from rich.console import Console
    from rich.measure import Measurement

    console = Console()
    folded = FOLDED & {column.heading for column in table.columns}
    for part in [table] if folded else parts(table, console.width):
        shown = terminal(part)
        if not folded:
            # Squeezed columns would hide some of the numbers.
            unfolded = console.options.update(max_width=WIDEST)
            console.width = max(console.width, Measurement.get(console, unfolded, shown).maximum)
        console.print(shown)


def main() -> None:
    """Entry point."""
    app(prog_name="occ")


if __name__ == "__main__":
    main()
