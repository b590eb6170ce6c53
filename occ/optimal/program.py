"""The collocation program with its exact first and second derivatives, put together from those of one node.

    g(y) = A y + s(y),   A constant,   s: -h f at the defects, h at the path conditions, B at the ends.

Everything is one mapped evaluation of the node followed by fixed gathers of nonzeros: no graph is differentiated, and
the time to build grows with the number of nonzeros only.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from occ.numeric import on_rows
from occ.optimal.derivatives import EndDerivatives, NodeDerivatives
from occ.optimal.layout import Layout
from occ.optimal.mesh import Scheme
from occ.optimal.problem import Problem, flat


@dataclass(frozen=True)
class Program:
    """A nonlinear program for `casadi.nlpsol`.

    Args:
        nlp: x, p, f, g.
        functions: under the names by which CasADi's solvers ask for derivatives.
    """

    nlp: dict[str, ca.MX]
    functions: dict[str, ca.Function]


def collocation_program(problem: Problem, scheme: Scheme, layout: Layout, upper: bool) -> Program:
    """min sum_k h_k sum_i w_i g_ki + F  subject to  sum_j D_ji x_kj = h_k f_ki, bounds of h and B.

    Args:
        problem: the optimal control problem.
        scheme: of collocation.
        layout: order of unknowns and conditions.
        upper: the Hessian's upper triangle only.

    Returns:
        The program; its parameter is (widths (N,), data (nd N d,), p).
    """
    return _Assembly(problem, scheme, layout).program(upper)


class _Gather:
    """Nonzeros of a sparse matrix, each taken from a vector of values or a constant."""

    def __init__(self, shape: tuple[int, int], rows: np.ndarray, columns: np.ndarray) -> None:
        keys = columns.astype(np.int64) * shape[0] + rows
        self.keys = np.unique(keys)
        colind = np.searchsorted(self.keys, np.arange(shape[1] + 1, dtype=np.int64) * shape[0])
        self.sparsity = ca.Sparsity(*shape, colind.tolist(), (self.keys % shape[0]).tolist())
        self._rows = shape[0]

    def places(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Position of each (row, column) among the nonzeros."""
        return np.searchsorted(self.keys, columns.astype(np.int64) * self._rows + rows)


def _scattered(values: ca.MX, places: np.ndarray, size: int) -> ca.MX:
    """A vector that holds values at places and zero elsewhere; each place is given once."""
    if not places.size:
        return ca.MX.zeros(size)
    source = np.full(size, places.size)
    source[places] = np.arange(places.size)
    return ca.vertcat(values, ca.MX(0.0))[source.tolist()]


class _Assembly:
    def __init__(self, problem: Problem, scheme: Scheme, layout: Layout) -> None:
        self.layout = layout
        nx, nu, nd, np_, nh, _ = problem.sizes
        self.nz = nx + nu
        _, count, degree = layout.points.shape
        self.node = NodeDerivatives.of(problem)
        self.ends = EndDerivatives.of(problem, layout.boundary is not None)
        nodes = count * degree
        self.x = ca.MX.sym("x", layout.unknowns)
        self.p = ca.MX.sym("p", count + nd * nodes + np_)
        self.lam_f, self.lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", layout.conditions)
        widths = self.p[:count].T
        # h and w h at every node, interval by interval.
        self.width = ca.reshape(ca.repmat(widths, degree, 1), 1, nodes)
        self.weight = ca.reshape(ca.DM(scheme.weights) @ widths, 1, nodes)
        # Unknowns z = (x, u), defects and path conditions of each node; one column a node.
        self.z = np.concatenate([flat(layout.points), flat(layout.control)])
        self.defects, self.path = flat(layout.defects), flat(layout.path)
        self.end_unknowns = np.concatenate([layout.start, layout.edges[:, -1]])
        parameters = self.p[count + nd * nodes :]
        self.arguments = [
            self._unknowns(self.z[:nx]),
            self._unknowns(self.z[nx:]),
            ca.reshape(self.p[count : count + nd * nodes], nd, nodes),
            parameters,
        ]
        self.end_arguments = [
            self.x[self.end_unknowns[:nx].tolist()],
            self.x[self.end_unknowns[nx:].tolist()],
            parameters,
        ]
        self.nodes = nodes
        self.linear = _linear_part(layout, scheme)
        self.nh = nh

    def _unknowns(self, numbers: np.ndarray) -> ca.MX:
        return ca.reshape(self.x[numbers.ravel(order="F").tolist()], *numbers.shape)

    def program(self, upper: bool) -> Program:
        rate, integrand, path, slope, rate_nonzeros, path_nonzeros = on_rows(
            self.node.gradient, *self.arguments, shared=(3,)
        )
        terminal, boundary, terminal_slope, boundary_nonzeros = self.ends.gradient(*self.end_arguments)
        cost = ca.dot(self.weight, integrand) + terminal
        values = ca.vertcat(ca.vec(-_scaled(rate, self.width)), ca.vec(path), boundary)
        rows = [self.defects.ravel(order="F"), self.path.ravel(order="F")]
        if self.layout.boundary is not None:
            rows.append(self.layout.boundary)
        conditions = ca.mtimes(self.linear, self.x) + _scattered(values, np.concatenate(rows), self.layout.conditions)
        gradient = _scattered(ca.vec(_scaled(slope, self.weight)), self.z.ravel(order="F"), self.layout.unknowns)
        gradient += _scattered(terminal_slope, self.end_unknowns, self.layout.unknowns)
        jacobian = self._jacobian(rate_nonzeros, path_nonzeros, boundary_nonzeros)
        hessian = self._hessian(upper)
        of_lagrangian = gradient * self.lam_f + ca.mtimes(jacobian.T, self.lam_g)
        multipliers = {"x": self.x, "p": self.p, "lam_f": self.lam_f, "lam_g": self.lam_g}
        values = {"f": cost, "g": conditions}

        def function(name: str, inputs: dict[str, ca.MX], outputs: dict[str, ca.MX]) -> tuple[str, ca.Function]:
            return name, ca.Function(name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs))

        plain = {"x": self.x, "p": self.p}
        functions = [
            function("nlp_f", plain, {"f": cost}),
            function("nlp_g", plain, {"g": conditions}),
            function("nlp_jac_g", plain, {"g": conditions, "jac_g_x": jacobian}),
        ]
        if upper:
            functions.append(function("nlp_grad_f", plain, {"f": cost, "grad_f_x": gradient}))
            functions.append(function("nlp_hess_l", multipliers, {"triu_hess_gamma_x_x": hessian}))
        else:
            functions.append(function("nlp_grad_f", plain, {"grad_f_x": gradient}))
            both = {"grad_gamma_x": of_lagrangian, "hess_gamma_x_x": hessian}
            functions.append(function("nlp_hess_l", multipliers, both))
            # Asked for after the solve; multipliers of the parameters are not wanted.
            rest = {"grad_gamma_x": of_lagrangian, "grad_gamma_p": ca.MX.zeros(self.p.numel())}
            functions.append(function("nlp_grad", multipliers, values | rest))
        return Program({"x": self.x, "p": self.p} | values, dict(functions))

    def _jacobian(self, rate: ca.MX, path: ca.MX, boundary: ca.MX) -> ca.MX:
        layout = self.layout
        blocks = [
            (-_scaled(rate, self.width), *_at_nodes(self.node.rate, self.defects, self.z)),
            (path, *_at_nodes(self.node.path, self.path, self.z)),
        ]
        if layout.boundary is not None:
            rows, columns = self.ends.boundary
            blocks.append((boundary, layout.boundary[rows], self.end_unknowns[columns]))
        rows = np.concatenate([block[1] for block in blocks])
        columns = np.concatenate([block[2] for block in blocks])
        constant_rows, constant_columns = (np.array(index) for index in self.linear.sparsity().get_triplet())
        gather = _Gather(
            (layout.conditions, layout.unknowns),
            np.concatenate([rows, constant_rows]),
            np.concatenate([columns, constant_columns]),
        )
        size = len(gather.keys)
        constant = np.zeros(size)
        constant[gather.places(constant_rows, constant_columns)] = self.linear.nonzeros()
        values = ca.vertcat(*(ca.vec(block[0]) for block in blocks))
        return ca.MX(gather.sparsity, ca.DM(constant) + _scattered(values, gather.places(rows, columns), size))

    def _hessian(self, upper: bool) -> ca.MX:
        of_defects = ca.reshape(self.lam_g[self.defects.ravel(order="F").tolist()], *self.defects.shape)
        of_path = ca.reshape(self.lam_g[self.path.ravel(order="F").tolist()], *self.path.shape)
        multipliers = [self.lam_f * self.weight, -_scaled(of_defects, self.width), of_path]
        (nodes,) = on_rows(self.node.hessian, *self.arguments, *multipliers, shared=(3,))
        boundary = self.layout.boundary
        of_boundary = self.lam_g[boundary.tolist()] if boundary is not None else ca.MX(0, 1)
        ends = self.ends.hessian(*self.end_arguments, self.lam_f, of_boundary)
        node_rows, node_columns = _at_nodes(self.node.curvature, self.z, self.z)
        end_rows, end_columns = (self.end_unknowns[index] for index in self.ends.curvature)
        pairs = [_ordered(node_rows, node_columns), _ordered(end_rows, end_columns)]
        rows, columns = (np.concatenate([pair[i] for pair in pairs]) for i in (0, 1))
        shape = (self.layout.unknowns, self.layout.unknowns)
        if upper:
            gather = _Gather(shape, rows, columns)
        else:
            gather = _Gather(shape, np.concatenate([rows, columns]), np.concatenate([columns, rows]))
        total = ca.MX.zeros(len(gather.keys))
        for values, (low, high) in zip((nodes, ends), pairs, strict=True):
            total += _scattered(ca.vec(values), gather.places(low, high), len(gather.keys))
            if not upper:
                off = np.flatnonzero(low != high)
                if off.size:
                    mirrored = gather.places(high[off], low[off])
                    total += _scattered(ca.vec(values)[off.tolist()], mirrored, len(gather.keys))
        return ca.MX(gather.sparsity, total)


def _linear_part(layout: Layout, scheme: Scheme) -> ca.DM:
    """A: derivatives of the polynomials at the nodes, ends of the polynomials, and the carried start."""
    values: list[np.ndarray] = []
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []

    def put(value: float, row: np.ndarray, column: np.ndarray) -> None:
        if value:
            values.append(np.full(row.size, value))
            rows.append(row.ravel())
            columns.append(column.ravel())

    at_node = [layout.edges[:, :-1], *np.moveaxis(layout.points, 2, 0)]
    for j, unknown in enumerate(at_node):
        for i, factor in enumerate(scheme.derivative[j]):
            put(factor, layout.defects[:, :, i], unknown)
        if layout.ends is not None:
            put(-_rounded(scheme.end[j]), layout.ends, unknown)
    if layout.ends is not None:
        put(1.0, layout.ends, layout.edges[:, 1:])
    put(-1.0, layout.steps, layout.memory[:, :-1])
    put(1.0, layout.steps, layout.memory[:, 1:])
    for i in range(layout.holds.shape[2] if layout.holds.size else 0):
        put(1.0, layout.holds[:, :, i], layout.control[: len(layout.holds), :, i + 1])
        put(-1.0, layout.holds[:, :, i], layout.control[: len(layout.holds), :, 0])
    if layout.first.size:
        put(1.0, layout.first, layout.memory[:, 0])
        put(-1.0, layout.first, layout.edges[:, 0])
    shape = (layout.conditions, layout.unknowns)
    row, column = np.concatenate(rows), np.concatenate(columns)
    gather = _Gather(shape, row, column)
    nonzeros = np.zeros(len(gather.keys))
    nonzeros[gather.places(row, column)] = np.concatenate(values)
    return ca.DM(gather.sparsity, nonzeros)


def _rounded(value: float) -> float:
    """Zero and one exactly, where the last point is the end of the interval."""
    return float(round(value)) if abs(value - round(value)) < 1e-12 else float(value)


def _scaled(columns: ca.MX, factors: ca.MX) -> ca.MX:
    """Each column times its factor."""
    return columns * ca.repmat(factors, columns.shape[0], 1)


def _at_nodes(
    pattern: tuple[np.ndarray, np.ndarray], rows: np.ndarray, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of a pattern at every node, node by node."""
    return rows[pattern[0]].ravel(order="F"), columns[pattern[1]].ravel(order="F")


def _ordered(rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same entries of a symmetric matrix, in its upper triangle."""
    return np.minimum(rows, columns), np.maximum(rows, columns)
