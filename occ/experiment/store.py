"""Files that are whole or not there, and the finished cases of a folder."""

from __future__ import annotations

import hashlib
import json
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from occ.errors import InputError

PARTIAL = ".partial"
"""Ending of a file that is being written; nothing reads such files."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary file beside `path` that takes its place, all at once, when the block ends without an error.

    Args:
        path: of the file to write; its folder is made if need be.

    Yields:
        Where to write.

    Raises:
        InputError: the folder cannot be written or is full; `path` is as before.
    """
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}{PARTIAL}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({reason}); --out should name a folder with room") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a whole file at once, UTF-8.

    Args:
        path: of the file.
        text: its content; line ends stay as they are.

    Raises:
        InputError: the folder cannot be written or is full; a file that was there is as before.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a whole file at once.

    Args:
        path: of the file.
        content: of the file.

    Raises:
        InputError: the folder cannot be written or is full; a file that was there is as before.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def stamp(content: bytes) -> dict[str, Any]:
    """Size and sha256 of a file's content, to know it again.

    Args:
        content: of the file.

    Returns:
        ``size`` [bytes] and ``sha256``.
    """
    return {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}


class Store:
    """The finished cases of an output folder, one file for each: FOLDER/.store/KEY.json.

    Args:
        folder: of the experiment.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def prepare(self) -> None:
        """Make the folder and see that it can be written.

        Raises:
            InputError: it cannot.
        """
        probe = self.folder / ".store" / "writable"
        write_text(probe, "")
        # Another run into the same folder may have been faster.
        probe.unlink(missing_ok=True)

    @contextmanager
    def tidied(self) -> Iterator[None]:
        """A block after which a folder with nothing in it is removed: a cluster that is not there leaves nothing."""
        try:
            yield
        finally:
            with suppress(OSError):
                (self.folder / ".store").rmdir()
                self.folder.rmdir()

    def path(self, key: str) -> Path:
        """The file of a case."""
        return self.folder / ".store" / f"{key}.json"

    def write(self, key: str, rows: list[dict[str, Any]]) -> None:
        """Store the rows of a finished case.

        Args:
            key: of the case's content.
            rows: plain data; ``trajectory`` is None or the ``path`` in the folder with its `stamp`.

        Raises:
            InputError: the folder cannot be written.
        """
        body = json.dumps(rows, sort_keys=True)
        write_text(self.path(key), json.dumps({"sha256": hashlib.sha256(body.encode()).hexdigest(), "rows": body}))

    def read(self, key: str) -> list[dict[str, Any]] | None:
        """The rows of a finished case.

        Args:
            key: of the case's content.

        Returns:
            What `write` got; None where nothing whole is stored or a trajectory is not the one that was stored.
        """
        try:
            content = json.loads(self.path(key).read_bytes())
            body = content["rows"].encode()
            if hashlib.sha256(body).hexdigest() != content["sha256"]:
                return None
            rows: list[dict[str, Any]] = json.loads(body)
            whole = all(self._has(row["trajectory"]) for row in rows)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        return rows if whole else None

    def _has(self, trajectory: dict[str, Any] | None) -> bool:
        if trajectory is None:
            return True
        path = self.folder / trajectory["path"]
        # The size first: it tells most damages without reading the file.
        if path.stat().st_size != trajectory["size"]:
            return False
        return stamp(path.read_bytes()) == {"size": trajectory["size"], "sha256": trajectory["sha256"]}
