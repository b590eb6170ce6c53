"""Sums of squares with their proof: a Gram matrix, what it leaves of a polynomial, and Cholesky's method on balls.

A series H(tau, x, w, a) is not negative for -1 <= tau <= 1 and all x, w, a if, for vectors z of terms,

    H = z_1^T Q_1 z_1 + (1 - tau^2) z_2^T Q_2 z_2 + r,    Q_1 - R and Q_2 positive definite.

r is what the rounding of the solver's numbers and of the platform's leaves.  Its terms c w^i a^j T_k e_h are at most
|c| |m n| <= |c| (m^2 + n^2) / 2 with monomials m n = w^i a^j of z_1, and each of these stands in z_1 by itself
(T_0 e_0 = 1): the diagonal matrix R of the radii |c| / 2 covers it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from flint import arb

from occ.certify.balls import Ball, Refused
from occ.certify.series import Key, Number, Series, times

Row = tuple[int, int]
"""Powers of yaw rate and yaw acceleration of a monomial."""
Entry = tuple[int, int, Key, float]
"""Place in a Gram matrix, and a term with its factor that stands there."""
WEIGHT = (((0, 0, 0, 0), 0.5), ((0, 0, 2, 0), -0.5))
"""1 - tau^2 = (T_0 - T_2) / 2."""


@dataclass(frozen=True)
class Gram:
    """z^T Q z, or (1 - tau^2) z^T Q z.

    Args:
        basis: (N,) the terms of z, each with coefficient one.
        matrix: (N, N) Q; its lower triangle counts, each number for itself.
        inside: whether it has the weight 1 - tau^2.
    """

    basis: tuple[Key, ...]
    matrix: np.ndarray
    inside: bool = False

    def series(self) -> Series:
        """The polynomial, exactly but for the width of the balls."""
        terms: dict[Key, Number] = {}
        for a, b, key, factor in entries(self.basis, self.inside):
            c = arb(float(self.matrix[a, b])) * factor
            terms[key] = terms[key] + c if key in terms else c
        return Series(terms)

    def prove(self, radii: dict[Row, Ball]) -> None:
        """Q - R is positive definite.

        Args:
            radii: R by monomial.

        Raises:
            Refused: it is not, or this is not to be seen.
        """
        rows = [[arb(float(c)) for c in row[: a + 1]] for a, row in enumerate(self.matrix)]
        for row, radius in radii.items():
            place = self.basis.index((*row, 0, 0))
            rows[place][place] -= radius
        if not positive_definite(rows):
            raise Refused("a Gram matrix is not positive definite, or not by more than the rounding radius")


@lru_cache(maxsize=16)
def entries(basis: tuple[Key, ...], inside: bool) -> tuple[Entry, ...]:
    """The terms at each place of the lower triangle; those off the diagonal count twice.

    Args:
        basis: (N,) terms of z.
        inside: whether the weight 1 - tau^2 stands before.

    Returns:
        Row, column, term, factor.
    """
    found = []
    for a, p in enumerate(basis):
        for b, q in enumerate(basis[: a + 1]):
            for key, factor in times(p, q):
                weighted = [(key, 1.0)]
                if inside:
                    weighted = [(k, c * d) for w, c in WEIGHT for k, d in times(key, w)]
                found += [(a, b, k, c * factor * (1 if a == b else 2)) for k, c in weighted]
    return tuple(found)


def prove_sum_of_squares(series: Series, grams: tuple[Gram, ...]) -> None:
    """A series is a sum of squares of the shape above.

    Args:
        series: H, with balls for coefficients.
        grams: Q_1 and, where there is time, Q_2, which are not trusted.

    Raises:
        Refused: this is not proven.
    """
    if not grams or grams[0].inside:
        raise Refused("there is no Gram matrix without weight")
    rest = Series.sum([series, *(gram.series() * -1 for gram in grams)])
    radii = _radii(rest, {key[:2] for key in grams[0].basis if key[2:] == (0, 0)})
    for gram in grams:
        gram.prove(radii if not gram.inside else {})


def _radii(rest: Series, rows: set[Row]) -> dict[Row, Ball]:
    """R by monomial; |T_k| and |e_h| are at most one."""
    radii = dict.fromkeys(rows, arb(0))
    for (i, j, *_), c in rest.terms.items():
        size = arb(abs(c).upper())
        if size == 0:
            continue
        pair = next(((m, (i - m[0], j - m[1])) for m in sorted(rows) if (i - m[0], j - m[1]) in rows), None)
        if pair is None:
            raise Refused(f"the term w^{i} a^{j} is no product of the monomials of the Gram matrix")
        for row in pair:
            radii[row] += size / 2
    return radii


def positive_definite(rows: list[list[Ball]]) -> bool:
    """Cholesky's method in balls: whether every matrix inside is positive definite, as far as it is to be seen.

    Args:
        rows: lower triangle, row by row.

    Returns:
        True only if it is certain.
    """
    lower: list[list[Ball]] = []
    for a, row in enumerate(rows):
        new: list[Ball] = []
        for b in range(a):
            rest = row[b]
            for x, y in zip(new, lower[b], strict=False):
                rest -= x * y
            new.append(rest / lower[b][b])
        pivot = row[a]
        for x in new:
            pivot -= x * x
        if not pivot > 0:
            return False
        new.append(pivot.sqrt())
        lower.append(new)
    return True
