"""One interval of a problem whose states are integrals of its controls: from its unknowns to the nodes, and back.

State and control at the nodes are a linear map z = Z(h) y of y = (x_k, u_1 .. u_d), so that

    gradient = Z^T dg/dz,   rows = dh/dz Z,   curvature = Z^T (d^2/dz^2) Z.

With the powers of the width taken out of y and z the map is constant, and the same for all intervals.  All is written
for numbers of any kind: matrices of all intervals, column by column, or symbols of one.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from occ.optimal.chains import Chains, integrated
from occ.optimal.derivatives import NodeDerivatives
from occ.optimal.mesh import Scheme
from occ.optimal.problem import PROBLEMS, Problem


class IntervalMaps:
    """The maps, and the functions of a node in its scaled variables.

    Args:
        problem: whose rates are chains of integrators.
        chains: with the powers.
        scheme: of collocation.
    """

    def __init__(self, problem: Problem, chains: Chains, scheme: Scheme) -> None:
        self.node = NodeDerivatives.of(in_scaled_variables(problem, chains))
        self._map, self._weights = integrated(chains, scheme), scheme.weights
        self.degree, self.nz, self.ny = self._map.points.shape
        self.nx, self.nh = len(self._map.end), problem.path.numel()

    def _powers(self, widths: ca.MX | ca.SX) -> ca.MX | ca.SX:
        """(m, N) 1, h, h^2, ..; second derivatives have twice the largest power."""
        powers = [widths / widths]
        for _ in range(2 * int(self._map.powers.max(initial=0))):
            powers.append(powers[-1] * widths)
        return ca.vertcat(*powers)

    @staticmethod
    def _factors(powers: ca.MX | ca.SX, which: np.ndarray) -> ca.MX | ca.SX:
        """(k, N) h^p."""
        most, count = powers.shape
        places = which[:, None] + most * np.arange(count)
        return ca.reshape(powers[places.ravel(order="F").tolist()], len(which), count)

    def nodes(self, y: ca.MX | ca.SX, widths: ca.MX | ca.SX) -> ca.MX | ca.SX:
        """(nz d, N) Scaled states and controls at the nodes from the unknowns (ny, N)."""
        scaled = y * self._factors(self._powers(widths), self._map.powers)
        return _product(self._map.points.reshape(self.degree * self.nz, self.ny), scaled)

    def step(self, y: ca.MX | ca.SX, widths: ca.MX | ca.SX) -> ca.MX | ca.SX:
        """(nx, N) Minus the state at the end."""
        table, powers = self._powers(widths), self._map.powers
        scaled = y * self._factors(table, powers)
        return -_product(self._map.end, scaled) / self._factors(table, powers[: self.nx])

    def step_pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """States and unknowns of the nonzeros of `step_slopes`."""
        row, column = np.nonzero(self._map.end)
        return row, column

    def step_slopes(self, widths: ca.MX | ca.SX) -> ca.MX | ca.SX:
        """(k, N) Derivatives of `step` that are not zero."""
        row, column = self.step_pattern()
        factors = self._factors(self._powers(widths), self._map.powers[column] - self._map.powers[row])
        return factors * ca.repmat(ca.DM(-self._map.end[row, column]), 1, factors.shape[1])

    def pulled_gradient(self, slopes: ca.MX | ca.SX, widths: ca.MX | ca.SX) -> ca.MX | ca.SX:
        """(ny, N) From derivatives of g at the nodes (nz d, N)."""
        weights = ca.DM(np.repeat(self._weights, self.nz)) @ widths
        values = _product(self._map.points.reshape(self.degree * self.nz, self.ny).T, slopes * weights)
        return values * self._factors(self._powers(widths), self._map.powers)

    def pulled_rows(self, slopes: ca.MX | ca.SX, widths: ca.MX | ca.SX) -> ca.MX | ca.SX:
        """(k, N) Nonzeros from those of dh/dz at the nodes (n d, N)."""
        matrix, _, column = self._of_rows
        return _product(matrix, slopes) * self._factors(self._powers(widths), self._map.powers[column])

    def pulled_curvature(self, values: ca.MX | ca.SX, widths: ca.MX | ca.SX) -> ca.MX | ca.SX:
        """(k, N) Nonzeros of the upper triangle from those at the nodes (n d, N)."""
        matrix, row, column = self._of_curvature
        powers = self._map.powers[row] + self._map.powers[column]
        return _product(matrix, values) * self._factors(self._powers(widths), powers)

    def rows_pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Path conditions, point by point, and unknowns of the nonzeros of `pulled_rows`."""
        return self._of_rows[1:]

    def curvature_pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns of the nonzeros of `pulled_curvature`."""
        return self._of_curvature[1:]

    @cached_property
    def _of_rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix from nonzeros at the nodes to those of an interval; rows and columns of the latter."""
        r, a = self.node.path
        matrix = np.zeros((self.degree, self.nh, self.ny, self.degree, len(r)))
        for i in range(self.degree):
            # Entry (condition r at point i, y_b) takes dh_r/dz_a times the map's entry (i, a, b).
            matrix[i, r, :, i, np.arange(len(r))] = self._map.points[i, a]
        return _nonzeros(matrix.reshape(self.degree * self.nh, self.ny, self.degree * len(r)))

    @cached_property
    def _of_curvature(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        pattern = self.node.curvature
        matrix = np.zeros((self.ny, self.ny, self.degree, len(pattern[0])))
        for i in range(self.degree):
            for k, (a, b) in enumerate(zip(*pattern, strict=True)):
                both = np.outer(self._map.points[i, a], self._map.points[i, b])
                matrix[:, :, i, k] = np.triu(both if a == b else both + both.T)
        return _nonzeros(matrix.reshape(self.ny, self.ny, self.degree * len(pattern[0])))


@lru_cache(maxsize=PROBLEMS)
def interval_maps(problem: Problem, chains: Chains, scheme: Scheme) -> IntervalMaps:
    """The maps of a problem and a scheme, made once for meshes of any size."""
    return IntervalMaps(problem, chains, scheme)


def in_scaled_variables(problem: Problem, chains: Chains) -> Problem:
    """Integrand and path conditions of X = h^w x and U = h^v u; the width is the last of the node data.

    Args:
        problem: whose rates are chains.
        chains: with the powers.

    Returns:
        A problem without rates.
    """
    width = ca.SX.sym("width")
    nx = problem.state.numel()
    z = ca.vertcat(problem.state, problem.control)
    real = ca.vertcat(*(z[k] / width ** int(power) if power else z[k] for k, power in enumerate(chains.powers)))
    integrand, path = ca.substitute(
        [problem.integrand, problem.path], [problem.state, problem.control], [real[:nx], real[nx:]]
    )
    return Problem(
        state=problem.state,
        control=problem.control,
        data=ca.vertcat(problem.data, width),
        parameters=problem.parameters,
        start=problem.start,
        end=problem.end,
        rate=ca.SX(0, 1),
        integrand=integrand,
        path=path,
    )


def _product(matrix: np.ndarray, columns: ca.MX | ca.SX) -> ca.MX | ca.SX:
    """A constant matrix, its zeros left out, times columns."""
    return ca.mtimes(ca.sparsify(ca.DM(matrix)), columns)


def _nonzeros(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a matrix (rows, columns, k): rows of k factors for the entries that are not zero by structure, and where."""
    row, column = np.nonzero(matrix.any(axis=2))
    return matrix[row, column], row, column
