"""Several files at once: all of them are written, or none."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from occ.errors import InputError
from occ.experiment.store import PARTIAL


@contextmanager
def staged(out: Path, files: Mapping[str, str]) -> Iterator[Path]:
    """Files in a folder of their own beside their place, into which they move when the block ends without an error.

    Args:
        out: folder of the files; it is made if need be.
        files: content by name.

    Yields:
        Where the files are, to be tried out.

    Raises:
        InputError: the folder cannot be written; it is as before.
    """
    made = _missing(out)
    try:
        try:
            out.mkdir(parents=True, exist_ok=True)
            stage = Path(tempfile.mkdtemp(prefix=".export-", suffix=PARTIAL, dir=out))
        except OSError as error:
            raise _unwritable(out, error) from error
        try:
            try:
                for name, content in files.items():
                    (stage / name).write_bytes(content.encode())
            except OSError as error:
                raise _unwritable(out, error) from error
            yield stage
            _move(stage, out, list(files))
        finally:
            shutil.rmtree(stage, ignore_errors=True)
    except BaseException:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
        raise


def _missing(out: Path) -> list[Path]:
    """The folders that have to be made, the innermost first."""
    return [folder for folder in (out, *out.parents) if not folder.exists()]


def _move(stage: Path, out: Path, names: list[str]) -> None:
    """Move all files; what was there before comes back if one of them cannot be moved."""
    kept = stage / "before"
    done: list[str] = []
    try:
        kept.mkdir()
        for name in names:
            if (out / name).is_dir():
                raise IsADirectoryError(21, f"{name} is a folder")
            if (out / name).exists():
                shutil.copy2(out / name, kept / name)
        for name in names:
            os.replace(stage / name, out / name)
            done.append(name)
    except OSError as error:
        for name in done:
            if (kept / name).exists():
                os.replace(kept / name, out / name)
            else:
                (out / name).unlink()
        raise _unwritable(out, error) from error


def _unwritable(out: Path, error: OSError) -> InputError:
    reason = error.strerror or str(error)
    return InputError(f"{out}: cannot be written ({reason}); --out should name a folder that can be written")
