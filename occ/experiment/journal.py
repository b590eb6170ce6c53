"""One store for many small results: files that only grow, of records with a key and a checksum.

Each run appends to a file of its own, so that two runs into one folder never write to the same one, and reads all of
them.  A process that is killed leaves half a record at the end of its file at most; half a record is not read.
"""

from __future__ import annotations

import hashlib
import json
import os
import uuid
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple, Self

from occ.errors import InputError

ENDING = ".journal"


class _Place(NamedTuple):
    path: Path
    offset: int
    size: int
    sha256: str


class Journal:
    """The records of a folder; the contents stay on disk, only their places are kept.

    Args:
        folder: made if need be.

    Raises:
        InputError: the folder cannot be written or read.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._file: IO[bytes] | None = None
        self._path = folder / f"{uuid.uuid4().hex[:12]}{ENDING}"
        self._places: dict[str, _Place] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for path in sorted(folder.glob(f"*{ENDING}")):
                self._places |= dict(_records(path))
        except OSError as error:
            raise _cannot(folder, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            # What could not be written has been said by `write`.
            with suppress(OSError):
                self._file.close()

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def open(self) -> None:
        """Make this run's file, so that a folder that cannot be written is known before anything is solved.

        Raises:
            InputError: it cannot be written.
        """
        if self._file is None:
            try:
                self._file = self._path.open("xb")
            except OSError as error:
                raise _cannot(self._path, error) from error

    def write(self, key: str, content: bytes) -> None:
        """Append a record.

        Args:
            key: of what the result belongs to.
            content: any bytes.

        Raises:
            InputError: the folder cannot be written or is full; what was stored before is as it was.
        """
        self.open()
        assert self._file is not None
        sha256 = hashlib.sha256(content).hexdigest()
        head = json.dumps({"key": key, "size": len(content), "sha256": sha256}).encode() + b"\n"
        begin = self._file.tell()
        try:
            self._file.write(head + content)
            self._file.flush()
        except OSError as error:
            raise _cannot(self._path, error) from error
        self._places[key] = _Place(self._path, begin + len(head), len(content), sha256)

    def read(self, key: str) -> bytes | None:
        """The content of the latest record with a key.

        Args:
            key: as it was written.

        Returns:
            What was written; None where there is nothing whole.
        """
        place = self._places.get(key)
        if place is None:
            return None
        try:
            with place.path.open("rb") as file:
                file.seek(place.offset)
                content = file.read(place.size)
        except OSError:
            return None
        return content if hashlib.sha256(content).hexdigest() == place.sha256 else None


def _cannot(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror or error}); --out should name a folder with room")


def _records(path: Path) -> Iterator[tuple[str, _Place]]:
    """Key and place of each whole record of a file."""
    length = path.stat().st_size
    with path.open("rb") as file:
        while head := file.readline():
            try:
                record = json.loads(head)
                place = _Place(path, file.tell(), record["size"], record["sha256"])
                key = record["key"]
            except (ValueError, KeyError, TypeError):
                return
            if place.offset + place.size > length:
                return
            yield key, place
            file.seek(place.offset + place.size, os.SEEK_SET)
