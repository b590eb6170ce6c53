"""Sampled motions of the platform, and piecewise polynomial signals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occ.errors import InputError


@dataclass(frozen=True)
class Trajectory:
    """x(t_k) and x'(t_k): a motion of the platform at sampled times.

    Args:
        t: (N,) [s], increasing.
        state: (6, N) (x_O, y_O, psi, V_X, V_Y, Omega) [m, m, rad, m/s, m/s, rad/s].
        state_rate: (6, N) its derivative in time, as claimed by whoever made the trajectory.

    Raises:
        InputError: shapes that do not fit, or times that do not increase.
    """

    t: np.ndarray
    state: np.ndarray
    state_rate: np.ndarray

    def __post_init__(self) -> None:
        if self.t.ndim != 1 or len(self.t) < 2 or not np.all(np.diff(self.t) > 0):
            raise InputError("Trajectory: t should be a vector of at least two increasing times")
        for name in ("state", "state_rate"):
            shape = getattr(self, name).shape
            if shape != (6, len(self.t)):
                raise InputError(f"Trajectory: {name} should have the shape (6, {len(self.t)}), not {shape}")


@dataclass(frozen=True)
class PiecewisePolynomial:
    """u(t) = sum_j u_kj l_j((t - t_k) / h_k) on the k-th interval, by values at nodes in each interval.

    Args:
        edges: (K + 1,) [s] ends of the intervals.
        nodes: (d,) places of the values in each interval, in [0, 1].
        values: (m, K, d) m signals.
    """

    edges: np.ndarray
    nodes: np.ndarray
    values: np.ndarray

    @cached_property
    def powers(self) -> np.ndarray:
        """(m, K, d) Coefficients of the powers of 2 s - 1: for single times, where speed counts."""
        vandermonde = (2 * self.nodes[:, None] - 1) ** np.arange(len(self.nodes))
        return np.asarray(np.linalg.solve(vandermonde, self.values[..., None])[..., 0])

    def interval(self, t: float) -> int:
        """Number of the interval that holds a time inside it."""
        return int(np.clip(np.searchsorted(self.edges, t) - 1, 0, len(self.edges) - 2))

    def basis(self, s: np.ndarray) -> np.ndarray:
        """l_j(s): Lagrange basis on the nodes.

        Args:
            s: (N,) places in the interval, in [0, 1].

        Returns:
            (d, N).
        """
        return lagrange_basis(self.nodes, s)

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """The signals at the times t (N,); result (m, N).  An inner edge belongs to the interval on its right."""
        k = np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, len(self.edges) - 2)
        s = (t - self.edges[k]) / (self.edges[k + 1] - self.edges[k])
        return np.einsum("mnd,dn->mn", self.values[:, k, :], self.basis(s))

    def within(self, k: int, t: float) -> np.ndarray:
        """The signals (m,) at one time, by the polynomial of interval k, also at that interval's right end."""
        middle, half = (self.edges[k] + self.edges[k + 1]) / 2, (self.edges[k + 1] - self.edges[k]) / 2
        return np.asarray(self.powers[:, k] @ ((t - middle) / half) ** np.arange(len(self.nodes)))


def lagrange_basis(nodes: np.ndarray, s: np.ndarray) -> np.ndarray:
    """l_j(s) = prod_i (s - s_i) / (s_j - s_i), i != j.

    Args:
        nodes: (d,) the s_j.
        s: (N,) where to evaluate.

    Returns:
        (d, N).
    """
    # The same products in the same order above and below: exactly one at its own node.
    return _of_others(s - nodes[:, None]) / np.diag(_of_others(nodes - nodes[:, None]))[:, None]


def _of_others(factors: np.ndarray) -> np.ndarray:
    """(d, N) prod_i f_i, i != j, of the factors (d, N); none is divided out, so that they may vanish."""
    before, behind = np.ones_like(factors), np.ones_like(factors)
    np.multiply.accumulate(factors[:-1], axis=0, out=before[1:])
    np.multiply.accumulate(factors[:0:-1], axis=0, out=behind[-2::-1])
    return before * behind
