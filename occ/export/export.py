"""Print modules in languages, run what was printed, and write all files or none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from occ.errors import ExportError, InputError
from occ.export.about import about
from occ.export.languages import Checked, Language
from occ.export.request import Request
from occ.export.routine import Module
from occ.export.table import SAMPLES, table_of, table_text
from occ.export.write import staged


class Exported(NamedTuple):
    """What an export has done.

    Args:
        files: that were written.
        lines: for people: what was run and how well it agrees, and remarks.
    """

    files: list[Path]
    lines: list[str]


def export(request: Request, out: Path, check: bool = True) -> Exported:
    """Write functions in some languages.

    Args:
        request: what to export.
        out: folder of the files.
        check: whether to run what was printed.

    Returns:
        The files, and a line on each language.

    Raises:
        InputError: a request that cannot be meant, or a folder that cannot be written; nothing was written.
        ExportError: what was printed disagrees with CasADi; nothing was written.
    """
    printers = request.printers()
    modules, lines = request.modules()
    files = printed(modules, printers)
    with staged(out, files) as folder:
        for language in printers:
            lines.append(_checked(language, folder, modules) if check else f"{language.name}: not run, as asked for")
    return Exported([out / name for name in files], lines)


def printed(modules: Sequence[Module], printers: Sequence[Language], samples: int = SAMPLES) -> dict[str, str]:
    """Content of all files by name.

    Args:
        modules: to print.
        printers: languages.
        samples: in the table of each function.

    Returns:
        The languages' files and a table for each function.

    Raises:
        InputError: two files of one name.
    """
    files: dict[str, str] = {}
    owners: dict[str, str] = {}
    for module in modules:
        own = {f"{routine.name}.csv": "" for routine in module.routines}
        for language in printers:
            own |= language.files(module)
        for name in own:
            if owners.setdefault(name.lower(), module.name) != module.name:
                raise InputError(
                    f"{owners[name.lower()]} and {module.name} both make the file {name}; one should have another name"
                )
        own |= {f"{routine.name}.csv": _table(module, k, samples) for k, routine in enumerate(module.routines)}
        files |= own
    return files


def _table(module: Module, place: int, samples: int) -> str:
    routine = module.routines[place]
    head = [
        *about(module, "python"),
        "",
        f"Table of {routine.name}: random inputs and CasADi's results; first row: scale of each result.",
    ]
    comments = "\n".join(f"# {line}".rstrip() for line in head)
    return f"{comments}\n{table_text(routine, table_of(routine, samples))}"


def _checked(language: Language, folder: Path, modules: Sequence[Module]) -> str:
    """One line on what came of running the files of a language."""
    done: Checked = language.check(folder, modules)
    count = sum(len(module.routines) for module in modules)
    what = f"{count} function{'s' * (count != 1)}"
    if not done.tool:
        return f"{language.name}: not run, since no tool for it is on this machine ({what})"
    worst = max(done.errors.values(), default=0.0)
    if done.reason or not worst <= language.tolerance:
        wrong = max(done.errors, key=lambda name: done.errors[name]) if done.errors else ""
        reason = (
            done.reason if worst <= language.tolerance else f"{wrong} differs from CasADi by {worst:.2g} (relative)"
        )
        raise ExportError(f"{language.name}: {reason} ({done.tool}); nothing was written")
    if not done.errors:
        return f"{language.name}: {what} compiled by {done.tool}"
    return (
        f"{language.name}: {what} run by {done.tool}, {SAMPLES} random inputs each: "
        f"largest difference from CasADi {worst:.2g} (relative, at most {language.tolerance:g})"
    )
