"""What the user asks for on the command line, checked and turned into modules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from occ.errors import InputError
from occ.experiment.load import read_toml
from occ.experiment.mistakes import ExperimentError, describe, dotted
from occ.experiment.naming import nearest, suggestion
from occ.experiment.schema import MotionTable, PlatformTable
from occ.experiment.tables import DataTable, Table
from occ.export.arguments import motion_size
from occ.export.catalogue import EXPORTS
from occ.export.derive import Wanted, check_variables, module_of
from occ.export.languages import LANGUAGES, Language
from occ.export.languages.c import C
from occ.export.numbers import PlatformNumbers
from occ.export.routine import Module
from occ.export.symbols import GIVEN, Program
from occ.export.words import check_identifier
from occ.model.presets import PRESETS
from occ.motion import MOTIONS, Circle, ProgramMotion

EVERY = "all"
PREFIX = "occ_"
"""Of the names of exported functions where the user gives no other: no language has a word of its own with it."""


class PlatformFile(Table):
    """The tables of a platform's file, or those of an experiment's file that an export takes."""

    platform: PlatformTable
    motion: MotionTable | None = None


@dataclass(frozen=True)
class Request:
    """An export as the user asks for it.

    Args:
        names: of the catalogue, each plain or as ``NAME=OWN`` with a name of one's own; ``all`` for all of them.
        variables: of derivatives.
        languages: names.
        platform: a file with a table [platform], or a preset; the paper's platform by default.
        symbolic: numbers of the platform that stay arguments.
        motion: kind of the program motion, or ``given``; by default the file's, or else the circle.
        second: whether to make second derivatives, too.
        single: whether C is in single precision.
    """

    names: tuple[str, ...]
    variables: tuple[str, ...] = ()
    languages: tuple[str, ...] = ()
    platform: str | None = None
    symbolic: tuple[str, ...] = ()
    motion: str | None = None
    second: bool = False
    single: bool = False

    def modules(self) -> tuple[list[Module], list[str]]:
        """The functions to export, and remarks on derivatives that do not exist.

        Raises:
            InputError: names that cannot be meant; says what would be right.
        """
        chosen = _chosen(self.names)
        platform, table = _platform(self.platform)
        wanted = Wanted(platform, self.symbolic, _motion(self.motion, table), self.variables, 2 if self.second else 1)
        platform.find(self.symbolic)
        check_variables(self.variables, [EXPORTS[name] for name in chosen.values()], wanted)
        modules, remarks, used = [], [], set()
        for own, name in chosen.items():
            module, missing = module_of(EXPORTS[name], own, wanted, self._options)
            modules.append(module)
            used |= set(self.variables) - set(missing)
            remarks += [f"{name} does not depend on {variable}: no derivative" for variable in missing]
        for variable in self.variables:
            if variable not in used:
                raise InputError(f"--wrt {variable}: no export asked for depends on it")
        return modules, remarks

    def printers(self) -> list[Language]:
        """The languages to print.

        Raises:
            InputError: an unknown name, or single precision without C.
        """
        if not self.languages:
            raise InputError(f"--language is missing; should be one or more of {', '.join(LANGUAGES)}")
        for name in self.languages:
            if name not in LANGUAGES:
                raise InputError(
                    f'unknown language "{name}"; {suggestion(nearest(name, list(LANGUAGES)), list(LANGUAGES))}'
                )
        if self.single and C.name not in self.languages:
            raise InputError("--single is for C; should come with --language c")
        names = dict.fromkeys(self.languages)
        printers: list[Language] = []
        for name in names:
            printers.append(C(single=self.single) if name == C.name else LANGUAGES[name]())
        return printers

    def _options(self, own: str, name: str, variables: Sequence[str]) -> tuple[str, ...]:
        """What makes the files of one name again."""
        options = [name if own == PREFIX + name else f"{name}={own}"]
        options += [word for variable in variables for word in ("--wrt", variable)]
        options += ["--second"] if self.second and variables else []
        options += ["--platform", self.platform] if self.platform else []
        options += [word for number in self.symbolic for word in ("--symbolic", number)]
        return (*options, *(["--motion", self.motion] if self.motion else []))


SEVERAL = ("--wrt", "--language", "--symbolic")
"""Options that take more than one value."""


def spread(words: Sequence[str]) -> list[str]:
    """The option's name before each of its values: ``--wrt state torque`` becomes ``--wrt state --wrt torque``.

    Args:
        words: of the command line; a name of an export ends the values of an option.

    Returns:
        Words for a parser that takes one value at a time.
    """
    result: list[str] = []
    option = ""
    for word in words:
        if word.startswith("-"):
            option = word if word in SEVERAL else ""
            result.append(word)
        elif option and (result[-1] == option or word.partition("=")[0] not in (*EXPORTS, EVERY)):
            values = [value for value in word.split(",") if value]
            # The first value stands behind the option itself.
            kept = result[:-1] if result[-1] == option else result
            result = [*kept, *(part for value in values for part in (option, value))]
        else:
            option = ""
            result.append(word)
    return result


def _chosen(names: Sequence[str]) -> dict[str, str]:
    """Export by the name of its function."""
    chosen: dict[str, str] = {}
    taken: dict[str, str] = {}
    if not names:
        raise InputError("no name of an export; should be one or more of those that `occ list exports` shows")
    plain = [part for name in names for part in (EXPORTS if name == EVERY else [name])]
    for text in plain:
        name, sign, own = text.partition("=")
        if name not in EXPORTS:
            raise InputError(f'unknown export "{name}"; {suggestion(nearest(name, list(EXPORTS)), list(EXPORTS))}')
        own = own if sign else PREFIX + name
        check_identifier(own)
        # Some file systems do not tell capital letters.
        if taken.setdefault(own.lower(), name) != name:
            raise InputError(f'"{own}" is the name of two exports; each should have its own')
        chosen[own] = name
    return chosen


def _platform(text: str | None) -> tuple[PlatformNumbers, Any]:
    """The platform of a file or preset, and the file's motion where it has one."""
    if text is None or (text in PRESETS and not Path(text).exists()):
        name = text or "youbot"
        preset = PRESETS[name]()
        return PlatformNumbers(preset.platform(), f'preset "{name}"', preset), None
    path = Path(text)
    data = {key: value for key, value in read_toml(path).items() if key in PlatformFile.model_fields}
    try:
        file = PlatformFile.model_validate(data)
    except ValidationError as error:
        mistakes = describe(error, data, PlatformFile)
        raise ExperimentError([f"{path}: {dotted(one.place, data)}: {one.text}" for one in mistakes]) from error
    return PlatformNumbers(file.platform.build(), text, DataTable.build(file.platform)), file.motion


def _motion(kind: str | None, table: Any) -> Program:
    motion: ProgramMotion | None = table.build() if table is not None else None
    if kind is None and motion is None:
        return _of(Circle, None)
    if motion is not None and kind in (None, motion.kind):
        return _of(type(motion), motion)
    if kind == GIVEN:
        return Program(None)
    kinds = {cls.kind: cls for cls in MOTIONS}
    if kind is None or kind not in kinds:
        valid = [*kinds, GIVEN]
        raise InputError(f'--motion: unknown kind "{kind}"; {suggestion(nearest(kind, valid), valid)}')
    return _of(kinds[kind], None)


def _of(cls: type[ProgramMotion], motion: ProgramMotion | None) -> Program:
    """A kind of motion, with an example of it where there is one."""
    if motion is not None:
        values = motion.values()
        return Program(cls, motion.structure(), len(values), tuple(values.tolist()))
    if cls.values is not ProgramMotion.values:
        raise InputError(
            f"--motion {cls.kind}: how many numbers it has depends on the motion; --platform should be an experiment "
            f'file with a table [motion] of kind = "{cls.kind}"'
        )
    return Program(cls, (), motion_size(cls))
