"""The values of an atlas on disk, so that memory does not grow with the number of points."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from tempfile import TemporaryFile, gettempdir
from typing import IO

import numpy as np

from occ.errors import InputError


class Columns(Mapping[str, np.ndarray]):
    """Named columns of one length in scratch files without a name, which go with the process whatever ends it.

    Args:
        size: number of points.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._open = ExitStack()
        weakref.finalize(self, self._open.close)
        self._files: dict[str, IO[bytes]] = {}
        self._types: dict[str, np.dtype] = {}

    def put(self, first: int, values: Mapping[str, np.ndarray]) -> None:
        """Store a part of each column.

        Args:
            first: number of the first point.
            values: (n,) of each name, always of the same type.

        Raises:
            InputError: there is no room for scratch files.
        """
        try:
            for name, part in values.items():
                if name not in self._files:
                    scratch = self._open.enter_context(TemporaryFile())  # noqa: SIM115 - closed with this object
                    self._files[name], self._types[name] = scratch, part.dtype
                self._files[name].seek(first * part.itemsize)
                self._files[name].write(np.ascontiguousarray(part).tobytes())
        except OSError as error:
            raise InputError(
                f"{gettempdir()}: cannot be written ({error.strerror or error}); TMPDIR should name a folder with room"
            ) from error

    def part(self, name: str, first: int, last: int) -> np.ndarray:
        """The values first <= i < last of a column."""
        file, kind = self._files[name], self._types[name]
        file.seek(first * kind.itemsize)
        return np.frombuffer(file.read((last - first) * kind.itemsize), kind)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.part(name, 0, self.size)

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)
