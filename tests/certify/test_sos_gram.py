"""Series and Gram matrices: what they stand for, number by number, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import arb

from occ.certify.balls import Refused, positive_definite
from occ.certify.checker import absorbed, prove_sum_of_squares
from occ.certify.proofs import Gram
from occ.certify.series import Key, Series, entries

PLACE = (0.37, -1.3, 0.8, 1.9)
"""tau, x, w, a."""


def value(series: Series, tau: float, x: float, w: float, a: float) -> float:
    """Term by term, with the polynomials of the mathematical library."""
    waves = {0: np.ones_like, 1: np.cos, -1: np.sin}
    return float(
        sum(
            float(c) * w**i * a**j * np.cos(k * np.arccos(tau)) * waves[np.sign(h)](abs(h) * np.float64(x))
            for (i, j, k, h), c in series.terms.items()
        )
    )


def random_series(seed: int, rates: int = 2) -> Series:
    random = np.random.default_rng(seed)
    keys = [(i, j, k, h) for i in range(rates + 1) for j in (0, 1) for k in range(4) for h in range(-3, 4)]
    return Series({keys[n]: float(random.normal()) for n in random.choice(len(keys), 25, replace=False)})


def test_products_and_sums_are_those_of_the_functions() -> None:
    p, q = random_series(1), random_series(2)
    assert value(p * q, *PLACE) == pytest.approx(value(p, *PLACE) * value(q, *PLACE), rel=1e-12)
    assert value(p - q * 3.0, *PLACE) == pytest.approx(value(p, *PLACE) - 3 * value(q, *PLACE), rel=1e-12)


@pytest.mark.parametrize(("slope", "place"), [("by_time", 0), ("by_angle", 1), ("by_rate", 2), ("by_acceleration", 3)])
def test_slopes_are_difference_quotients(slope: str, place: int) -> None:
    p, step = random_series(3), 1e-5
    before, after = ([c + s * step * (i == place) for i, c in enumerate(PLACE)] for s in (-1, 1))
    quotient = (value(p, *after) - value(p, *before)) / (2 * step)
    assert value(getattr(p, slope)(), *PLACE) == pytest.approx(quotient, rel=1e-7, abs=1e-7)


def test_ends_of_the_horizon_and_turns_of_the_angle() -> None:
    p, turn, (_, x, w, a) = random_series(4), 0.7, PLACE
    for tau in (-1, 1):
        assert value(p.at_time(tau), 0.2, x, w, a) == pytest.approx(value(p, tau, x, w, a), rel=1e-12)
    shift = {h: np.cos(h * turn) if h >= 0 else np.sin(-h * turn) for h in range(-3, 4)}
    assert value(p.turned(shift), *PLACE) == pytest.approx(value(p, PLACE[0], x + turn, w, a), rel=1e-12)


@pytest.mark.parametrize("inside", [False, True])
def test_gram_matrix_is_the_quadratic_form_of_its_terms(inside: bool) -> None:
    basis: tuple[Key, ...] = ((0, 0, 0, 0), (0, 0, 1, 1), (1, 0, 2, -1), (0, 1, 0, 0), (2, 0, 1, 2))
    half = np.random.default_rng(6).normal(size=(5, 5))
    matrix = half + half.T
    z = np.array([value(Series({key: 1.0}), *PLACE) for key in basis])
    weight = 1 - PLACE[0] ** 2 if inside else 1.0
    terms = [Series({key: factor * matrix[a, b]}) for a, b, key, factor in entries(basis, inside)]
    assert value(Series.sum(terms), *PLACE) == pytest.approx(weight * z @ matrix @ z, rel=1e-12)


def test_cholesky_on_balls_is_certain_or_says_no() -> None:
    def rows(matrix: list[list[float]], radius: float = 0.0) -> list[list[arb]]:
        return [[arb(c, radius) for c in row[: i + 1]] for i, row in enumerate(matrix)]

    assert positive_definite(rows([[2.0, 1.0], [1.0, 2.0]]))
    # Singular, indefinite, and positive definite in the middle of its balls only.
    assert not positive_definite(rows([[1.0, 1.0], [1.0, 1.0]]))
    assert not positive_definite(rows([[1.0, 2.0], [2.0, 1.0]]))
    assert not positive_definite(rows([[2.0, 1.0], [1.0, 2.0]], radius=0.6))


# w^2 + 2 w cos x + 2 = (w + cos x)^2 + 2 - cos^2 x, at least 1.
POSITIVE = {(2, 0, 0, 0): 1.0, (1, 0, 0, 1): 2.0, (0, 0, 0, 0): 2.0}
BASIS: tuple[Key, ...] = ((0, 0, 0, 0), (0, 0, 0, 1), (0, 0, 0, -1), (1, 0, 0, 0))
# 1 + sin^2 x + (w + cos x)^2, where 0.2 (1 - cos^2 x - sin^2 x) makes all pivots positive.
MATRIX = np.diag([0.8, 1.2, 1.2, 1.0])
MATRIX[3, 1] = MATRIX[1, 3] = 1.0


def enclosed(terms: dict[Key, float], radius: float = 0.0) -> Series:
    return Series({key: arb(c, radius) for key, c in terms.items()})


def test_sum_of_squares_is_accepted_up_to_its_least_value() -> None:
    gram = Gram(BASIS, MATRIX)
    prove_sum_of_squares(enclosed(POSITIVE), (gram,))
    # What the matrix does not say exactly is moved into it, as long as it is positive definite by more than that.
    prove_sum_of_squares(enclosed(POSITIVE | {(0, 0, 0, 0): 1.9}), (gram,))
    for least in (1.0 - 1e-9, 0.5):
        # POSITIVE - 1 has a zero: nothing below is a sum of squares.
        with pytest.raises(Refused, match="not positive definite"):
            prove_sum_of_squares(enclosed(POSITIVE | {(0, 0, 0, 0): least}), (gram,))


def test_what_is_left_is_moved_into_the_matrix_exactly() -> None:
    # Every number is a dyadic rational and no operation is rounded: the identity holds with balls of radius zero.
    basis = tuple((i, 0, k, h) for i in (0, 1) for k in range(3) for h in (0, 1, -1))
    keys = sorted({key for _, _, key, _ in entries(basis, False)})
    random = np.random.default_rng(11)
    rest = {key: arb(float(random.integers(-99, 99))) / 2**40 for key in keys}
    added: dict[Key, arb] = {}
    change = absorbed(rest, basis)
    for a, b, key, factor in entries(basis, False):
        added[key] = added.get(key, arb(0)) + change.get((a, b), arb(0)) * factor
    assert all(added[key].is_exact() and added[key] == rest[key] for key in keys)
    # With balls whatever they hold is in the balls of the matrix.
    wide = absorbed({key: c + arb(0, 1e-3) for key, c in rest.items()}, basis)
    assert all(wide[place].contains(c) for place, c in change.items())
    other = absorbed({key: c + arb(float(random.uniform(-1e-3, 1e-3))) for key, c in rest.items()}, basis)
    assert all(wide[place].contains(c) for place, c in other.items())


def test_rounding_counts() -> None:
    gram = Gram(BASIS, MATRIX)
    prove_sum_of_squares(enclosed(POSITIVE, radius=1e-6), (gram,))
    with pytest.raises(Refused, match="rounding radius"):
        prove_sum_of_squares(enclosed(POSITIVE, radius=0.2), (gram,))


def test_terms_that_no_square_could_pay_for_are_refused() -> None:
    with pytest.raises(Refused, match=r"\(3, 0, 0, 0\)"):
        prove_sum_of_squares(enclosed(POSITIVE | {(3, 0, 0, 0): 1e-30}), (Gram(BASIS, MATRIX),))
    with pytest.raises(Refused, match="without weight"):
        prove_sum_of_squares(enclosed(POSITIVE), (replace(Gram(BASIS, MATRIX), inside=True),))
