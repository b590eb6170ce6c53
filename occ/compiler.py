"""This machine's C compiler: a library from its C code, kept for every later process.

No result needs it: what is compiled is what CasADi evaluates itself, to the same bits.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=gnu99", "-ffp-contract=off", "-fPIC", "-shared", "-w")
"""A fused multiply-add would round once where CasADi rounds twice."""
LONGEST = 120.0
"""[s] A compiler that takes longer is stopped."""


class NotInC(Exception):
    """A function has an operation that cannot be written in C, or there is no working compiler."""


def library(source: str, *, effort: str = "-O2", make: bool = True, headers: Path | None = None) -> Path:
    """The library of a C source, compiled now if it is the first time on this machine.

    Args:
        source: which is the key, together with the compiler's version.
        effort: of its optimisation.
        make: whether to compile; otherwise only what is there already will do.
        headers: folder of headers; the source names their version.

    Returns:
        Where it is.

    Raises:
        NotInC: no working compiler, nowhere to write, or nothing there and nothing to be made.
    """
    path, version = _compiler()
    flags = (*FLAGS, effort)
    key = hashlib.sha256("\0".join((version, *flags, source)).encode()).hexdigest()[:32]
    try:
        file = folder() / f"{key}.so"
        if file.exists():
            return file
        if not make:
            raise NotInC("not compiled yet")
        file.parent.mkdir(parents=True, exist_ok=True)
        # In a place of its own first: nobody ever finds half a library.
        with tempfile.TemporaryDirectory(dir=file.parent) as place:
            (Path(place) / "code.c").write_text(source)
            places = [] if headers is None else [f"-I{headers}"]
            command = [path, *flags, *places, "code.c", "-lm", "-o", "code.so"]
            subprocess.run(command, cwd=place, capture_output=True, check=True, timeout=LONGEST)
            (Path(place) / "code.so").replace(file)
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        raise NotInC(str(error)) from error
    return file


def folder() -> Path:
    """Where compiled functions are kept: `occ/functions` in `XDG_CACHE_HOME`, or in `~/.cache`.

    Raises:
        RuntimeError: neither is known.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "occ" / "functions"


@cache
def _compiler() -> tuple[str, str]:
    """Path and version of the C compiler."""
    for name in COMPILERS:
        path = shutil.which(name)
        if path is None:
            continue
        try:
            told = subprocess.run([path, "--version"], capture_output=True, text=True, check=True, timeout=LONGEST)
        except (OSError, subprocess.SubprocessError):
            continue
        return path, told.stdout.splitlines()[0]
    raise NotInC("no C compiler")
