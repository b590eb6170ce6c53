"""What a language is, and what checking its files can say."""

from __future__ import annotations

import shutil
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from occ.export.routine import Module
from occ.export.table import TOLERANCE

LONGEST_RUN = 300.0
"""[s] After which a tool that checks an export is stopped."""


@dataclass(frozen=True)
class Checked:
    """What came of running exported files.

    Args:
        tool: that ran them; empty where there is none on this machine.
        errors: of each function, relative to CasADi; empty where the tool only reads the files.
        reason: why the files are wrong; empty where they are right.
    """

    tool: str
    errors: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""


class Language(ABC):
    """A language: how it prints modules, and how what it printed is run."""

    name: ClassVar[str]

    @property
    def tolerance(self) -> float:
        """Largest relative difference from CasADi."""
        return TOLERANCE

    @abstractmethod
    def files(self, module: Module) -> dict[str, str]:
        """Content of each file of a module, by name."""

    @abstractmethod
    def check(self, folder: Path, modules: Sequence[Module]) -> Checked:
        """Run what `files` and the tables have been written into a folder."""


def run(command: Sequence[str], folder: Path) -> tuple[int, str, str]:
    """Run a tool in a folder.

    Args:
        command: program and arguments.
        folder: to run in.

    Returns:
        Exit code, what it printed, and what it complained.
    """
    try:
        done = subprocess.run(
            list(command),
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=LONGEST_RUN,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 1, "", f"no end after {LONGEST_RUN:g} s"
    except OSError as error:
        return 1, "", error.strerror or str(error)
    return done.returncode, done.stdout, done.stderr


def printed_errors(tool: str, code: int, output: str, complaint: str) -> Checked:
    """What a check has printed: a line ``NAME ERROR`` for each function."""
    errors: dict[str, float] = {}
    for line in output.splitlines():
        name, _, number = line.strip().rpartition(" ")
        try:
            errors[name.strip()] = float(number)
        except ValueError:
            continue
    reason = "" if code == 0 else (complaint.strip() or output.strip() or f"exit code {code}").splitlines()[-1]
    return Checked(tool, errors, reason)


def first_tool(names: Sequence[str]) -> str | None:
    """Path of the first of these programs that is on this machine."""
    return next((path for name in names if (path := shutil.which(name))), None)
