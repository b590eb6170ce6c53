"""How the command line is read, and how it fails: errors are lines, and an option may take several values."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from occ.errors import InputError, OccError

ASSIGNMENT = re.compile(r"""[\w."' +-]+=""")
"""How a further ``KEY=VALUE`` after `--set` begins; a key has no slash, as a path may have."""


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
