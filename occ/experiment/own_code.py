"""A user's own controller in the user's own file: `kind = "path/to/file.py:ClassName"`, loaded only with permission.

The keys of its table are the arguments of the class.  A dataclass's annotations are checked as those of occ's own
controllers; a case carries path and content of the file as plain data, and each process loads the file by itself.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import math
import re
import sys
import traceback
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType, UnionType
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, ConfigDict, Field, ValidationError, create_model
from pydantic import model_validator as validator

from occ.errors import InputError
from occ.experiment.documentation import argument_texts, summary
from occ.experiment.naming import nearest, suggestion
from occ.experiment.schema import OWN_KIND, ControllerName
from occ.experiment.tables import DataTable, built, toml_hint
from occ.laws.base import PathKeepingLaw
from occ.task import Player, Task

MODULE_PREFIX = "_occ_own_"
"""Of the names under which the user's files are in `sys.modules`."""
FORM = '"path/to/file.py:ClassName"'
DECORATOR = "@dataclass(frozen=True, kw_only=True)"


@dataclass(frozen=True)
class OwnClass:
    """A class in a file of the user's own that may be loaded: plain data.

    Args:
        kind: as in the experiment file.
        path: of the file, absolute.
        name: of the class.
        sha256: of the file's content.
    """

    kind: str
    path: str
    name: str
    sha256: str

    def table(self) -> type[DataTable]:
        """The model of the controller's table; the file is loaded, once in each process.

        Raises:
            InputError: a file that cannot be loaded, is another one than before, or has no such controller.
        """
        return _table(self)


class OwnCode:
    """Where the user's own classes are looked up.

    Args:
        folder: from which their paths count.
        allowed: whether the user has said that their files may be loaded, that is, run.
    """

    def __init__(self, folder: Path, allowed: bool) -> None:
        self.folder, self.allowed = folder, allowed
        self._known: dict[str, OwnClass | InputError] = {}

    def find(self, kind: str) -> OwnClass:
        """The class that a kind names.

        Raises:
            InputError: no permission, no such file, or a file without such a controller; says what would be right.
        """
        if kind not in self._known:
            try:
                self._known[kind] = self._find(kind)
            except InputError as error:
                self._known[kind] = InputError(one_line(error))
        found = self._known[kind]
        if isinstance(found, InputError):
            raise found
        return found

    def _find(self, kind: str) -> OwnClass:
        if not re.match(OWN_KIND, kind):
            file, _, name = kind.rpartition(":") if ":" in kind else (kind, "", "")
            if not file.endswith(".py"):
                raise InputError(f'not a Python file ("{file}"); should be {FORM}')
            raise InputError(f'no name of a class ("{name}") after the file "{file}"; should be {FORM}')
        if not self.allowed:
            raise InputError(f'own code ("{kind}") is not loaded unasked; the option --allow-code would load it')
        file, _, name = kind.rpartition(":")
        try:
            path = str((self.folder / file).resolve())
            found = OwnClass(kind, path, name, _sha256(Path(path).read_bytes()))
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise InputError(
                f'cannot be read ("{file}": {reason}); should be {FORM}, from the folder of the experiment'
            ) from error
        found.table()
        return found


def is_own(kind: str) -> bool:
    """Whether a kind names code of the user's own, rightly or not."""
    return ":" in kind or "/" in kind or kind.endswith(".py")


def one_line(error: BaseException) -> str:
    """The message of an error on one line."""
    return " ".join(str(error).split())


def check_player(player: Player, task: Task) -> None:
    """Let a player refuse a task; a user's own one may have no `check`.

    Raises:
        InputError: the player refuses, or its own `check` is faulty.
    """
    if not type(player).__module__.startswith(MODULE_PREFIX):
        player.check(task)
    elif hasattr(player, "check"):
        try:
            with redirect_stdout(sys.stderr):
                player.check(task)
        except (Exception, SystemExit) as error:
            raise _refusal(error, "its check") from error


def _refusal(error: BaseException, what: str) -> InputError:
    """What the user's own code has raised as a mistake in the experiment file; a ValueError is a refusal in words."""
    text = one_line(error)
    return InputError(text if isinstance(error, ValueError) and text else f"{what} raised {_named(error)}")


def _named(error: BaseException) -> str:
    return f"{type(error).__name__}: {one_line(error)}".rstrip(": ")


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@cache
def _module(path: str, sha256: str) -> ModuleType:
    """The loaded file, in `sys.modules` under a name of its path: annotations are resolved there.

    Not through Python's import system, which would write a folder of compiled code beside the user's file.
    """
    file = Path(path).name
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read any more ({error.strerror})") from error
    if _sha256(content) != sha256:
        raise InputError(f"{file}: changed while the experiment was running; should be run again")
    try:
        code = compile(content, path, "exec", dont_inherit=True)
    except (SyntaxError, ValueError, OverflowError, RecursionError, MemoryError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) and error.lineno else ""
        raise InputError(f"{file}{line}: not Python ({getattr(error, 'msg', None) or _named(error)})") from error
    module = ModuleType(
        f"{MODULE_PREFIX}{re.sub(r'[^A-Za-z0-9_]', '_', Path(path).stem)}_{_sha256(path.encode())[:12]}"
    )
    module.__file__ = path
    sys.modules[module.__name__] = module
    try:
        # What the file prints is not part of occ's answer, which may be read by a program.
        with redirect_stdout(sys.stderr):
            exec(code, module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[module.__name__]
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
        where = f", line {lines[-1]}" if lines else ""
        raise InputError(f"{file}{where}: raised {_named(error)} while it was loaded") from error
    return module


@cache
def _table(own: OwnClass) -> type[DataTable]:
    file, module = Path(own.path).name, _module(own.path, own.sha256)
    cls = getattr(module, own.name, None)
    classes = [
        name for name, item in vars(module).items() if isinstance(item, type) and item.__module__ == module.__name__
    ]
    if not isinstance(cls, type):
        words = suggestion(nearest(own.name, classes), classes) if classes else "the file has no class"
        raise InputError(f'no class "{own.name}" in {file}; {words}')
    if not callable(getattr(cls, "solve", None)):
        raise InputError(
            f'the class "{own.name}" in {file} has no solve(task); '
            "should be an occ.PathKeepingLaw or have solve(task) -> occ.Solution"
        )
    lacking = sorted(getattr(cls, "__abstractmethods__", ()))
    if lacking:
        raise InputError(f'the class "{own.name}" in {file} lacks {", ".join(lacking)}; should have its own')
    try:
        return _model(cls, own.kind)
    except InputError as error:
        raise InputError(f'the class "{own.name}" in {file}: {error}') from error
    except Exception as error:  # annotations are the user's code, too
        raise InputError(f'the class "{own.name}" in {file}: its arguments raised {_named(error)}') from error


class OwnTable(DataTable):
    """A table that stands for a class of the user's own; a key that is not given keeps the class's own default."""

    @validator(mode="wrap")
    @classmethod
    def _own_errors(cls, data: Any, handler: Any) -> Any:
        # Tables inside this one are built by the user's code, too.
        try:
            return handler(data)
        except (ValidationError, InputError):
            raise
        except (Exception, SystemExit) as error:
            raise _refusal(error, f"{cls.stands_for.__name__}(...)") from error

    def build(self) -> Any:
        """The instance that the table describes; raises as above."""
        given = {name: built(getattr(self, name)) for name in self.model_fields_set - {"name", "kind"}}
        try:
            with redirect_stdout(sys.stderr):
                return self.stands_for(**given)
        except (Exception, SystemExit) as error:
            raise _refusal(error, f"{self.stands_for.__name__}(...)") from error


def _toml_value(value: Any) -> Any:
    """A value that comes back the same from the stored tables, for arguments without an annotation."""
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    for item in items:
        _toml_value(item)
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"not finite ({value}); should be a finite number")
    if not isinstance(value, bool | int | float | str | list | dict):
        raise ValueError(f"wrong type ({value}); should be a number, a text, true, false, a list or a table")
    return value


TomlValue = Annotated[Any, AfterValidator(_toml_value)]


class OpenOwnTable(OwnTable):
    """The same for a class that takes any key."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, TomlValue]


def _model(cls: type, kind: str) -> type[DataTable]:
    """The model of the table of a class, by the arguments with which it is made."""
    parameters = list(inspect.signature(cls).parameters.values())
    declared = cls if dataclasses.is_dataclass(cls) else cls.__init__  # type: ignore[misc]  # the class's, of no instance
    hints = get_type_hints(declared, include_extras=True)
    named = [item for item in parameters if item.kind in (item.POSITIONAL_OR_KEYWORD, item.KEYWORD_ONLY)]
    open_ended = any(item.kind is item.VAR_KEYWORD for item in parameters)
    _check_declaration(cls, [item.name for item in named])
    texts = argument_texts(cls)
    keys: dict[str, Any] = {
        "kind": (Literal[kind], Field(description=summary(cls))),
        "name": (ControllerName, ...),
    }
    for item in named:
        hint = hints.get(item.name, TomlValue)
        hint = hint.type if isinstance(hint, dataclasses.InitVar) else hint
        if item.name in keys or item.name.startswith("_") or hasattr(OwnTable, item.name):
            raise InputError(f"{item.name} cannot be a key of a controller; should have another name")
        # Laws are compared by their fields, so that these must not change: lists become tuples.
        containers = (tuple,) if issubclass(cls, PathKeepingLaw) else (tuple, list, dict)
        if hint is not TomlValue and not _writable(hint, containers):
            raise InputError(
                f"{item.name}: {inspect.formatannotation(hint)} cannot be the type of a key; should be float, int, "
                f"bool, str, a Literal, a dataclass, or a {' or '.join(kind.__name__ for kind in containers)} of them"
            )
        default = ... if item.default is item.empty else None
        keys[item.name] = (toml_hint(hint), Field(default, description=texts.get(item.name) or _words(hint)))
    base = OpenOwnTable if open_ended else OwnTable
    model = create_model(cls.__name__, __base__=base, __doc__=summary(cls), **keys)
    model.stands_for, model.tag = cls, kind
    return model


def _check_declaration(cls: type, keys: list[str]) -> None:
    """Refuse classes whose keys would not be what their author means."""
    if "__dataclass_fields__" not in vars(cls) and "__init__" not in vars(cls):
        hints = get_type_hints(cls)
        meant = [name for name in inspect.get_annotations(cls) if get_origin(hints[name]) is not ClassVar]
        if meant:
            raise InputError(f"{', '.join(meant)}: annotated, but not in a dataclass; should have {DECORATOR} above it")
    if issubclass(cls, PathKeepingLaw):
        # Laws that are equal share their CasADi functions, so that every key must count in that comparison.
        compared = {field.name for field in dataclasses.fields(cls) if field.init and field.compare}
        hidden = [name for name in keys if name not in compared]
        if hidden:
            raise InputError(
                f"{', '.join(hidden)}: not a field of the law; should be, with {DECORATOR} above the class"
            )


def _writable(hint: Any, containers: tuple[type, ...]) -> bool:
    """Whether values of an annotation can be written in TOML and come back the same from the stored tables."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _writable(arguments[0], containers)
    if origin in (Union, UnionType) or (origin is tuple and tuple in containers):
        return all(item is Ellipsis or item is type(None) or _writable(item, containers) for item in arguments)
    if origin in containers:
        inner = arguments[-1]
        plain_inner = not (isinstance(inner, type) and dataclasses.is_dataclass(inner)) and _writable(inner, containers)
        return plain_inner and (origin is list or arguments[0] is str)
    return (
        hint in (float, int, bool, str)
        or origin is Literal
        or (isinstance(hint, type) and dataclasses.is_dataclass(hint))
    )


def _words(hint: Any) -> str:
    """What an argument without a description should be."""
    if get_origin(hint) is Annotated:
        return _words(get_args(hint)[0])
    if get_origin(hint) is Literal:
        return " or ".join(f'"{item}"' for item in get_args(hint))
    return {float: "a number", int: "a whole number", bool: "true or false", str: "a text in quotes"}.get(
        hint, "a value"
    )
