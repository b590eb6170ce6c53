"""Polynomials of a heading's motion: powers of yaw rate and acceleration, Chebyshev in time, trigonometric in angle.

A series is a sum of terms  c w^i a^j T_k(tau) e_h(x),  -1 <= tau <= 1, with e_0 = 1, e_h = cos h x for h > 0 and
e_h = sin |h| x for h < 0.  The coefficients c are floats where a solver is fed and balls where a bound is proven: the
operations are the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cache, lru_cache
from typing import Any

from occ.certify.balls import Polynomial

Number = Any
"""A float or a ball."""
Key = tuple[int, int, int, int]
"""i, j, k, h as above."""
Entry = tuple[int, int, Key, float]
"""Place in a Gram matrix, and a term with its factor that stands there."""
WEIGHT = (((0, 0, 0, 0), 0.5), ((0, 0, 2, 0), -0.5))
"""1 - tau^2 = (T_0 - T_2) / 2."""


class Series:
    """A sum of terms, immutable.

    Args:
        terms: coefficients by key.
    """

    def __init__(self, terms: Mapping[Key, Number]) -> None:
        self.terms = dict(terms)

    @classmethod
    def of(cls, p: Polynomial) -> Series:
        """A trigonometric polynomial of degree two."""
        return cls({(0, 0, 0, h): c for h, c in zip((0, 1, -1, 2, -2), p.coefficients, strict=True)})

    @classmethod
    def sum(cls, parts: Iterable[Series]) -> Series:
        """The sum of many."""
        terms: dict[Key, Number] = {}
        for part in parts:
            for key, c in part.terms.items():
                terms[key] = terms[key] + c if key in terms else c
        return cls(terms)

    def __add__(self, other: Series) -> Series:
        return Series.sum((self, other))

    def __sub__(self, other: Series) -> Series:
        return Series.sum((self, other * -1))

    def __mul__(self, other: Series | Number) -> Series:
        if not isinstance(other, Series):
            return Series({key: c * other for key, c in self.terms.items()})
        products = (
            Series({key: a * b * factor for key, factor in times(p, q)})
            for p, a in self.terms.items()
            for q, b in other.terms.items()
        )
        return Series.sum(products)

    @property
    def degree(self) -> int:
        """The highest harmonic."""
        return max((abs(h) for *_, h in self.terms), default=0)

    def cleared(self) -> Series:
        """A series of balls without the terms that are exactly zero."""
        return Series({key: c for key, c in self.terms.items() if not c.is_zero()})

    def by_angle(self) -> Series:
        """d/dx."""
        return Series({(i, j, k, -h): -h * c for (i, j, k, h), c in self.terms.items() if h})

    def by_rate(self) -> Series:
        """d/dw."""
        return Series({(i - 1, j, k, h): i * c for (i, j, k, h), c in self.terms.items() if i})

    def by_acceleration(self) -> Series:
        """d/da."""
        return Series({(i, j - 1, k, h): j * c for (i, j, k, h), c in self.terms.items() if j})

    def by_time(self) -> Series:
        """d/dtau: T_k' = 2 k (T_{k-1} + T_{k-3} + ...), where T_0 counts half."""
        parts = (
            Series({(i, j, low, h): (k if low == 0 else 2 * k) * c for low in range(k - 1, -1, -2)})
            for (i, j, k, h), c in self.terms.items()
        )
        return Series.sum(parts)

    def at_time(self, tau: int) -> Series:
        """The series at tau = 1 or -1, where T_k = tau^k."""
        return Series.sum(Series({(i, j, 0, h): c * tau**k}) for (i, j, k, h), c in self.terms.items())

    def turned(self, cosines: Mapping[int, Number]) -> Series:
        """x -> x + d; `cosines` holds cos h d for h > 0 and sin |h| d for h < 0, by h."""
        parts = []
        for (i, j, k, h), c in self.terms.items():
            n, sign = abs(h), 1 if h > 0 else -1
            # cos n (x + d) = cos nx cos nd - sin nx sin nd; sin n (x + d) = sin nx cos nd + cos nx sin nd.
            turned: dict[Key, Number] = {(i, j, k, h): c * cosines[n] if h else c}
            if h:
                turned[i, j, k, -h] = -sign * c * cosines[-n]
            parts.append(Series(turned))
        return Series.sum(parts)

    def at(self, place: Mapping[int, Number], rate: Number, acceleration: Number = 0.0) -> Number:
        """The value of a series without time, T_k = 1; `place` holds e_h(x) by h."""
        return sum(c * rate**i * acceleration**j * place[h] for (i, j, _, h), c in self.terms.items())


@cache
def times(p: Key, q: Key) -> tuple[tuple[Key, float], ...]:
    """The terms of a product of two terms with coefficient one, and their factors."""
    i, j = p[0] + q[0], p[1] + q[1]
    return tuple(((i, j, k, h), c * s) for k, c in _chebyshev(p[2], q[2]) for h, s in _trigonometric(p[3], q[3]))


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


def _chebyshev(k: int, n: int) -> Iterator[tuple[int, float]]:
    """T_k T_n = (T_{k+n} + T_{|k-n|}) / 2."""
    yield from [(k + n, 0.5), (abs(k - n), 0.5)] if k and n else [(k + n, 1.0)]


def _trigonometric(h: int, g: int) -> Iterator[tuple[int, float]]:
    """Products of cosines and sines by the sum and the difference of their angles."""
    if not h or not g:
        yield h + g, 1.0
        return
    m, n = abs(h), abs(g)
    if (h > 0) == (g > 0):
        # Two cosines or two sines.
        yield m + n, 0.5 if h > 0 else -0.5
        yield abs(m - n), 0.5
        return
    sine, cosine = (m, n) if h < 0 else (n, m)
    yield -(m + n), 0.5
    if sine != cosine:
        # sin(s - c), which is -sin(c - s).
        yield -abs(m - n), 0.5 if sine > cosine else -0.5
