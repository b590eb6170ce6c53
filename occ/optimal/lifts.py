"""What the intervals give a program: costs, conditions and their derivatives, from those of one node.

States at the nodes are unknowns, or integrals of the controls.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from occ.numeric import on_rows
from occ.optimal.chains import Chains
from occ.optimal.derivatives import NodeDerivatives, Pattern
from occ.optimal.gather import Entries, columns_scaled, ordered, scattered
from occ.optimal.intervals import interval_maps
from occ.optimal.layout import Layout
from occ.optimal.mesh import Scheme
from occ.optimal.problem import Problem, flat


@dataclass(frozen=True)
class Where:
    """What a lift is made for.

    Args:
        layout: order of unknowns and conditions.
        scheme: of collocation.
        x: the unknowns.
        widths: (1, N) of the intervals.
        data: (nd, N d) at the nodes.
        parameters: (np,).
    """

    layout: Layout
    scheme: Scheme
    x: ca.MX
    widths: ca.MX
    data: ca.MX
    parameters: ca.MX

    @property
    def weight(self) -> ca.MX:
        """(1, N d) w h at every node, interval by interval."""
        return ca.reshape(ca.DM(self.scheme.weights) @ self.widths, 1, self.data.shape[1])

    @property
    def width(self) -> ca.MX:
        """(1, N d) h at every node."""
        return ca.reshape(ca.repmat(self.widths, len(self.scheme.points), 1), 1, self.data.shape[1])

    def unknowns(self, numbers: np.ndarray) -> ca.MX:
        """Those with the given numbers, in the shape of these."""
        return ca.reshape(self.x[numbers.ravel(order="F").tolist()], *numbers.shape)


class Lift(Protocol):
    """Costs and conditions of all intervals."""

    def integrand(self) -> ca.MX:
        """(1, N d) g."""

    def path(self) -> ca.MX:
        """(nh, N d) h."""

    def dynamics(self) -> tuple[ca.MX, np.ndarray, Entries]:
        """The motion's part of the conditions: values, their rows, and their derivatives."""

    def gradient(self) -> ca.MX:
        """(unknowns,) Of the integral of g."""

    def rows(self) -> Entries:
        """Derivatives of the path conditions."""

    def curvature(self, lam_f: ca.MX, lam_g: ca.MX) -> Entries:
        """Second derivatives of the Lagrangian, upper triangle."""


class AtNodes:
    """z_i is among the unknowns; sum_j D_ji x_j = h f_i are conditions."""

    def __init__(self, problem: Problem, where: Where) -> None:
        layout = where.layout
        assert layout.points is not None
        self._where, self._node = where, NodeDerivatives.of(problem)
        points, control = flat(layout.points), flat(layout.control)
        self._z = np.concatenate([points, control])
        self._defects, self._path = flat(layout.defects), flat(layout.path)
        self._arguments = [where.unknowns(points), where.unknowns(control), where.data, where.parameters]
        outputs = on_rows(self._node.gradient, *self._arguments, shared=(3,))
        self._rate, self._integrand, self._h, self._slope, self._rate_slopes, self._path_slopes = outputs

    def integrand(self) -> ca.MX:
        return self._integrand

    def path(self) -> ca.MX:
        return self._h

    def dynamics(self) -> tuple[ca.MX, np.ndarray, Entries]:
        width = self._where.width
        values = ca.vec(-columns_scaled(self._rate, width))
        slopes = ca.vec(-columns_scaled(self._rate_slopes, width))
        return values, self._defects.ravel(order="F"), Entries(slopes, *_at(self._node.rate, self._defects, self._z))

    def gradient(self) -> ca.MX:
        slopes = ca.vec(columns_scaled(self._slope, self._where.weight))
        return scattered(slopes, self._z.ravel(order="F"), self._where.layout.unknowns)

    def rows(self) -> Entries:
        return Entries(ca.vec(self._path_slopes), *_at(self._node.path, self._path, self._z))

    def curvature(self, lam_f: ca.MX, lam_g: ca.MX) -> Entries:
        where = self._where
        of_rate = -columns_scaled(_taken(lam_g, self._defects), where.width)
        multipliers = [lam_f * where.weight, of_rate, _taken(lam_g, self._path)]
        (values,) = on_rows(self._node.hessian, *self._arguments, *multipliers, shared=(3,))
        return Entries(ca.vec(values), *ordered(*_at(self._node.curvature, self._z, self._z)))


class FromControls:
    """States at the nodes are integrals of the controls; x_{k+1} = the end of interval k is the only condition left."""

    def __init__(self, problem: Problem, chains: Chains, where: Where) -> None:
        layout = where.layout
        assert layout.ends is not None
        self._where, self._maps = where, interval_maps(problem, chains, where.scheme)
        self._steps, self._path = layout.ends, flat(layout.path)
        self._degree = self._maps.degree
        self._nx, self._count = layout.ends.shape
        self._y = layout.of_intervals
        self._given = where.unknowns(self._y)

    def _arguments(self) -> list[ca.MX]:
        z = self._by_node(self._maps.nodes(self._given, self._where.widths))
        data = ca.vertcat(self._where.data, self._where.width)
        return [z[: self._nx, :], z[self._nx :, :], data, self._where.parameters]

    def _by_interval(self, values: ca.MX) -> ca.MX:
        """(k, N d) -> (k d, N)."""
        return ca.reshape(values, values.shape[0] * self._degree, self._count)

    def _by_node(self, values: ca.MX) -> ca.MX:
        """(k d, N) -> (k, N d)."""
        return ca.reshape(values, values.shape[0] // self._degree, self._degree * self._count)

    def _first(self, output: int) -> ca.MX:
        return on_rows(self._maps.node.gradient, *self._arguments(), shared=(3,))[output]

    def integrand(self) -> ca.MX:
        return self._first(1)

    def path(self) -> ca.MX:
        return self._first(2)

    def dynamics(self) -> tuple[ca.MX, np.ndarray, Entries]:
        values, slopes = self._maps.step(self._given, self._where.widths), self._maps.step_slopes(self._where.widths)
        row, column = self._maps.step_pattern()
        return ca.vec(values), self._steps.ravel(order="F"), self._entries(slopes, self._steps[row], column)

    def gradient(self) -> ca.MX:
        values = self._maps.pulled_gradient(self._by_interval(self._first(3)), self._where.widths)
        return self._spread(values)

    def rows(self) -> Entries:
        return self._placed_rows(self._maps.pulled_rows(self._by_interval(self._first(5)), self._where.widths))

    def curvature(self, lam_f: ca.MX, lam_g: ca.MX) -> Entries:
        multipliers = [lam_f * self._where.weight, ca.MX(0, self._degree * self._count), _taken(lam_g, self._path)]
        (values,) = on_rows(self._maps.node.hessian, *self._arguments(), *multipliers, shared=(3,))
        return self._placed_curvature(self._maps.pulled_curvature(self._by_interval(values), self._where.widths))

    def _spread(self, gradient: ca.MX) -> ca.MX:
        return scattered(ca.vec(gradient), self._y.ravel(order="F"), self._where.layout.unknowns)

    def _placed_rows(self, values: ca.MX) -> Entries:
        row, column = self._maps.rows_pattern()
        by_point = self._where.layout.path.transpose(2, 0, 1).reshape(self._degree * len(self._path), self._count)
        return self._entries(values, by_point[row], column)

    def _placed_curvature(self, values: ca.MX) -> Entries:
        row, column = self._maps.curvature_pattern()
        placed = self._entries(values, self._y[row], column)
        return Entries(placed.values, *ordered(placed.rows, placed.columns))

    def _entries(self, values: ca.MX, rows: np.ndarray, column: np.ndarray) -> Entries:
        return Entries(ca.vec(values), rows.ravel(order="F"), self._y[column].ravel(order="F"))


def _taken(lam_g: ca.MX, numbers: np.ndarray) -> ca.MX:
    """Multipliers of conditions, in the shape of their numbers."""
    return ca.reshape(lam_g[numbers.ravel(order="F").tolist()], *numbers.shape)


def _at(pattern: Pattern, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of a pattern at every node, node by node."""
    return rows[pattern[0]].ravel(order="F"), columns[pattern[1]].ravel(order="F")
