"""How the command line is read, and how it fails: options of several commands, lists of values, errors as lines."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from occ.errors import InputError, OccError

ASSIGNMENT = re.compile(r"""[\w."' +-]+=""")
"""How a further ``KEY=VALUE`` after `--set` begins; a key has no slash, as a path may have."""

File = Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml", help="The experiment.")]
Settings = Annotated[
    list[str], typer.Option("--set", metavar="KEY=VALUE ...", help="Override keys, such as motion.radius=0.6.")
]
AllowCode = Annotated[
    bool,
    typer.Option("--allow-code", help='Load controllers from your own files (kind = "file.py:Class"): runs that code.'),
]
Workers = Annotated[int, typer.Option("--workers", metavar="N", min=1, help="Processes on this machine.")]
Dask = Annotated[
    str | None, typer.Option("--dask", metavar="ADDRESS", help="Scheduler of a dask cluster, such as tcp://host:8786.")
]
TimeLimit = Annotated[
    float | None,
    typer.Option(
        "--time-limit",
        metavar="SECONDS",
        help="A case that takes longer is ended, and each of its controllers that is not finished is tried alone for "
        "as long; those that take longer are rows that say so.  No limit by default.",
    ),
]
MemoryLimit = Annotated[
    float | None, typer.Option("--memory-limit", metavar="GB", help="Address space of the process of one case.")
]
Patience = Annotated[
    float | None,
    typer.Option(
        "--patience",
        metavar="SECONDS",
        help="What is not heard of for so long, no row of it finished, is taken for hung: its process is ended, and "
        "its row says so.  An hour by default.",
    ),
]
InProcess = Annotated[
    bool,
    typer.Option(
        "--in-process",
        help="Work in occ's own process, for a debugger or a profiler: a crash ends the run, a hang is waited for.",
    ),
]


class Commands(TyperGroup):
    """All commands; errors of the user are lines on the error stream and an exit code, never a traceback."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command of a context."""
        try:
            return super().invoke(ctx)
        except InputError as error:
            # What the engine says of itself is an option of the command line.
            message, code = re.sub(r"^Engine: (\w+)", _option, str(error)), 2
        except OccError as error:
            message, code = str(error), 1
        except KeyboardInterrupt:
            message, code = "interrupted; finished cases are stored and will not be solved again", 130
        typer.echo(message, err=True)
        raise typer.Exit(code)


def _option(found: re.Match[str]) -> str:
    return "--" + found[1].replace("_", "-")


class ExperimentCommand(TyperCommand):
    """Several values after one option: ``--set a=1 b=2`` means ``--set a=1 --set b=2``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The arguments as the parser takes them."""
        return super().parse_args(ctx, assignments_apart(args))


class ExportCommand(TyperCommand):
    """Options that take several values: ``--wrt state torque`` means ``--wrt state --wrt torque``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The arguments as the parser takes them."""
        from occ.export.request import spread

        return super().parse_args(ctx, spread(args))


def assignments_apart(words: Sequence[str]) -> list[str]:
    """``--set`` before each assignment that follows another one.

    Args:
        words: of the command line; anything else, or a file of that name, ends the assignments.

    Returns:
        Words for a parser that takes one value at a time.
    """
    result: list[str] = []
    for word in words:
        if result[-2:-1] == ["--set"] and ASSIGNMENT.match(word) and word[0] != "-" and not Path(word).is_file():
            result.append("--set")
        result.append(word)
    return result
