"""Meshes and collocation schemes: where the nodes are, and the weights that belong to them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from occ.trajectory import lagrange_basis

SchemeName = Literal["radau", "legendre"]


@dataclass(frozen=True, eq=False)
class Scheme:
    """x(s) = sum_j x_j l_j(s) on the nodes 0, c_1 .. c_d; x'(c_i) = h f_i; J = h sum w_i g_i.

    Args:
        points: (d,) collocation points c_i in (0, 1].
        derivative: (d + 1, d) l_j'(c_i).
        end: (d + 1,) l_j(1).
        weights: (d,) of the quadrature on the points.
    """

    points: np.ndarray
    derivative: np.ndarray
    end: np.ndarray
    weights: np.ndarray

    @property
    def nodes(self) -> np.ndarray:
        """(d + 1,) 0 and the collocation points."""
        return np.concatenate([[0.0], self.points])

    @property
    def ends_on_point(self) -> bool:
        """The last collocation point is the end of the interval (Radau)."""
        return bool(self.points[-1] == 1.0)


@cache
def scheme(name: SchemeName, degree: int) -> Scheme:
    """Points, derivative matrix and quadrature weights of a collocation scheme.

    Args:
        name: ``radau`` (order 2 d - 1 at the ends of the intervals) or ``legendre`` (order 2 d).
        degree: d >= 2.

    Returns:
        The scheme.

    Source: Hairer and Wanner, Solving Ordinary Differential Equations II, IV.5.
    """
    if name == "radau":
        from scipy.special import roots_jacobi

        # P_d - P_{d-1} = (x - 1) P^(1,0)_{d-1} up to a factor.
        points = np.append((roots_jacobi(degree - 1, 1, 0)[0] + 1) / 2, 1.0)
    else:
        points = gauss_legendre(degree)[0]
    nodes = np.concatenate([[0.0], points])
    basis = [np.polynomial.Polynomial.fromroots(np.delete(nodes, j)) for j in range(degree + 1)]
    basis = [p / p(nodes[j]) for j, p in enumerate(basis)]
    # Interpolatory weights integrate every polynomial of degree d - 1; this Gauss rule is exact for the basis.
    gauss, gauss_weights = gauss_legendre(degree)
    weights = lagrange_basis(points, gauss) @ gauss_weights
    derivative = np.array([p.deriv()(points) for p in basis])
    return Scheme(points, derivative, np.array([p(1.0) for p in basis]), weights)


@cache
def gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of the Gauss-Legendre rule on [0, 1].

    Args:
        count: of the nodes; exact to degree 2 count - 1.

    Returns:
        Nodes (count,), weights (count,).
    """
    x, w = np.polynomial.legendre.leggauss(count)
    return (x + 1) / 2, w / 2


def graded_mesh(intervals: int, first: float) -> np.ndarray:
    """Edges 0 = s_0 < .. < s_N = 1 whose widths grow geometrically from both ends to the middle.

    Args:
        intervals: N >= 2.
        first: width of the first and of the last interval; 1 / N and above give the uniform mesh.

    Returns:
        (N + 1,) edges, symmetric about 1/2.
    """
    if first >= 1.0 / intervals or intervals < 4:
        return np.linspace(0.0, 1.0, intervals + 1)
    rank = np.minimum(np.arange(intervals), np.arange(intervals)[::-1])

    def excess(growth: float) -> float:
        return float(first * np.sum(growth**rank)) - 1.0

    low, high = 1.0, 2.0
    while excess(high) < 0.0:
        low, high = high, 2 * high
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    widths = low**rank
    edges = np.concatenate([[0.0], np.cumsum(widths / widths.sum())])
    edges[-1] = 1.0
    return edges


def bisect(edges: np.ndarray, marked: np.ndarray) -> np.ndarray:
    """Edges with a new one in the middle of every marked interval.

    Args:
        edges: (N + 1,).
        marked: (N,) of booleans.

    Returns:
        (N + 1 + number of marked,) edges.
    """
    middles = (edges[:-1] + edges[1:]) / 2
    return np.sort(np.concatenate([edges, middles[marked]]))
