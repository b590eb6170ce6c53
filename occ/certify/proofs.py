"""Proofs as data: plain numbers that a construction has found and that `occ.certify.checker` trusts in nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from occ.certify.lengths import Place
from occ.certify.series import Key

Axis = Literal["end", "left", "right"]
"""Where a motion ends, and how far it goes to the left and to the right of its start."""


class Level(NamedTuple):
    """V is a potential at one level: V_t = h, V_psi~ = -+ 2 sqrt(Z (U + h)) towards the places that are reached next.

    Args:
        level: [W] h; raised by the checker to the least that is allowed.
    """

    level: float = -np.inf


@dataclass(frozen=True)
class CurveProof:
    """V = a + b e + c e^2 / 2 about a curve, e = psi~ - psi~*(t), for the motions that stay in the family's window.

    Args:
        times: (N + 1,) [s] from 0 to T.
        acceleration: (N + 1,) [rad/s^2] of psi~*, linear in between.
        speed: [rad/s] psi~*'(0).
        curvature: (N + 1,) [J/rad^2] c, linear in between.
    """

    times: tuple[float, ...]
    acceleration: tuple[float, ...]
    speed: float
    curvature: tuple[float, ...]


class Split(NamedTuple):
    """A family of motions is cut in two, each with a proof of its own.

    Args:
        axis: by what they are told apart.
        place: where; a motion that is on the edge may be counted to either part.
        below: of the motions whose end, or whose furthest place to one side, is not to the right of it.
        above: of those for which it is not to the left of it.
    """

    axis: Axis
    place: Place
    below: Tree
    above: Tree


Tree = Level | CurveProof | Split
"""A proof about a family of motions in one angle."""


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


@dataclass(frozen=True)
class SquaresProof:
    """V is a polynomial, and what must not be negative is a sum of squares.

    Args:
        value: V, coefficients by term.
        level: c, for cycles and for ever.
        flow: Gram matrices of Bellman's inequality.
        end: Gram matrix of the condition at the ends, where there is one.
        slope: [1/rad] of a term of V that is linear in psi~, so that full turns of the end count.
    """

    value: dict[Key, float]
    level: float
    flow: tuple[Gram, ...]
    end: Gram | None = None
    slope: float = 0.0


@dataclass(frozen=True)
class TurnsProof:
    """Motions to a given end are told apart by its full turns.

    Args:
        turns: added to the end as it is given.
        upto: a proof for the ends with no more turns.
        above: one for all others.
    """

    turns: int
    upto: SquaresProof
    above: SquaresProof


Proof = Tree | SquaresProof | TurnsProof


def leaves(tree: Tree) -> list[Level | CurveProof]:
    """The pieces of a proof, from left to right."""
    return [*leaves(tree.below), *leaves(tree.above)] if isinstance(tree, Split) else [tree]
