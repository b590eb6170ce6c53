"""How far a collocation solution is from the differential equation between its nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from occ.optimal.mesh import gauss_legendre
from occ.optimal.problem import Nodes, Numbers, flat
from occ.optimal.transcription import Transcription
from occ.trajectory import lagrange_basis


@dataclass(frozen=True)
class ErrorEstimate:
    """How far the polynomials are from the differential equation, between the nodes too.

    Args:
        state: (N,) largest running integral of x' - f in each interval, relative to max(1, largest |x|).
        cost: (N,) difference between the claimed cost and a finer quadrature, relative to max(1, |J|).
    """

    state: np.ndarray
    cost: np.ndarray

    @property
    def total(self) -> float:
        """One number to compare with a tolerance: the larger of the sums over all intervals."""
        return float(max(self.state.sum(), abs(self.cost.sum())))

    @property
    def each(self) -> np.ndarray:
        """(N,) what each interval contributes."""
        return np.maximum(self.state, np.abs(self.cost))


def estimate_error(
    transcription: Transcription, nodes: Nodes, numbers: Numbers, fine_data: np.ndarray, cost: float
) -> ErrorEstimate:
    """r(t) = integral of (f(x, u) - x') from the interval's start, on a Gauss rule twice as fine as the nodes.

    Args:
        transcription: the structure.
        nodes: the solution.
        numbers: with which it was found.
        fine_data: (nd, N, m) node data at `fine_points` of each interval.
        cost: the claimed objective, for scale.

    Returns:
        The estimate, interval by interval.

    Source: Betts, Practical Methods for Optimal Control and Estimation, section 4.7.4.
    """
    s, weights = fine_points(transcription.degree)
    widths = np.diff(numbers.edges)
    state, derivative, control = transcription.interpolate(nodes, s)
    shape = state.shape
    rate, integrand, _ = transcription.evaluate(flat(state), flat(control), flat(fine_data), numbers.parameters)
    residual = widths[:, None] * rate.reshape(shape) - derivative
    # Running integral at the Gauss points: integrate the residual's interpolation polynomial.
    running = np.abs(residual @ _integration_matrix(len(s))).max(axis=2)
    whole = np.abs(residual @ weights)
    scale = np.maximum(1.0, np.abs(nodes.edges).max(axis=1))[:, None]
    state_error = (np.maximum(running, whole) / scale).max(axis=0)
    at_nodes = transcription.evaluate(flat(nodes.points), flat(nodes.control), flat(numbers.data), numbers.parameters)[
        1
    ]
    coarse = at_nodes.reshape(shape[1], -1) @ transcription.scheme.weights
    fine = integrand.reshape(shape[1], -1) @ weights
    return ErrorEstimate(state_error, widths * (fine - coarse) / max(1.0, abs(cost)))


def fine_points(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points and weights on [0, 1] on which errors between nodes are looked for; (2 d + 2,) each."""
    return gauss_legendre(2 * degree + 2)


@cache
def _integration_matrix(count: int) -> np.ndarray:
    """(count, count) integrals of the Lagrange polynomials of the Gauss points from 0 to each Gauss point."""
    points, weights = gauss_legendre(count)
    columns = [lagrange_basis(points, end * points) @ (end * weights) for end in points]
    return np.array(columns).T
