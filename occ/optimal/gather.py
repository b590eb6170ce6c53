"""Large sparse matrices of a program as fixed gathers: which number goes to which nonzero is known before the solve."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np


class Entries(NamedTuple):
    """Values (k,) and where they stand in a matrix; each place at most once."""

    values: ca.MX
    rows: np.ndarray
    columns: np.ndarray


class Gather:
    """Nonzeros of a sparse matrix, each taken from a vector of values or a constant.

    Args:
        shape: of the matrix.
        rows: of the nonzeros, in any order and repeated at will.
        columns: of the same.
    """

    def __init__(self, shape: tuple[int, int], rows: np.ndarray, columns: np.ndarray) -> None:
        keys = columns.astype(np.int64) * shape[0] + rows
        self.keys = np.unique(keys)
        colind = np.searchsorted(self.keys, np.arange(shape[1] + 1, dtype=np.int64) * shape[0])
        self.sparsity = ca.Sparsity(*shape, colind.tolist(), (self.keys % shape[0]).tolist())
        self._rows = shape[0]

    def places(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Position of each (row, column) among the nonzeros."""
        return np.searchsorted(self.keys, columns.astype(np.int64) * self._rows + rows)

    def spread(self, entries: Entries) -> ca.MX:
        """Nonzeros of a matrix that holds the entries, and zeros at its other places."""
        return scattered(entries.values, self.places(entries.rows, entries.columns), len(self.keys))


def scattered(values: ca.MX, places: np.ndarray, size: int) -> ca.MX:
    """A vector that holds values at places and zero elsewhere.

    Args:
        values: (k,).
        places: (k,) each given once.
        size: of the result.

    Returns:
        (size,).
    """
    if not places.size:
        return ca.MX.zeros(size)
    source = np.full(size, places.size)
    source[places] = np.arange(places.size)
    if (source < places.size).all():
        return values if (places == np.arange(size)).all() else values[source.tolist()]
    return ca.vertcat(values, ca.MX(0.0))[source.tolist()]


def ordered(rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same entries of a symmetric matrix, in its upper triangle."""
    return np.minimum(rows, columns), np.maximum(rows, columns)


def columns_scaled(columns: ca.MX, factors: ca.MX) -> ca.MX:
    """Each column times its factor."""
    return columns * ca.repmat(factors, columns.shape[0], 1)
