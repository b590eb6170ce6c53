"""The collocation program with its exact first and second derivatives, put together from those of one node.

    g(y) = A y + s(y),   A constant,   s: the motion (-h f at the defects), h at the path conditions, B at the ends.

Everything is one mapped evaluation of the node followed by fixed gathers of nonzeros: no graph is differentiated, and
the time to build grows with the number of nonzeros only.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from occ.optimal.derivatives import EndDerivatives
from occ.optimal.fast_lifts import integrals
from occ.optimal.gather import Entries, Gather, ordered, scattered
from occ.optimal.layout import Layout
from occ.optimal.lifts import AtNodes, Lift, Where
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


def collocation_program(
    problem: Problem, scheme: Scheme, layout: Layout, *, upper: bool, compiled: bool = False
) -> Program:
    """min sum_k h_k sum_i w_i g_ki + F  subject to  sum_j D_ji x_kj = h_k f_ki, bounds of h and B.

    Args:
        problem: the optimal control problem.
        scheme: of collocation.
        layout: order of unknowns and conditions; without points the states at the nodes are integrals of the controls.
        upper: the Hessian's upper triangle only.
        compiled: functions of the nodes in machine code, where there is a compiler.

    Returns:
        The program; its parameter is (widths (N,), data (nd N d,), p).
    """
    return _Assembly(problem, scheme, layout, compiled).program(upper)


class _Assembly:
    def __init__(self, problem: Problem, scheme: Scheme, layout: Layout, compiled: bool) -> None:
        self.layout = layout
        nx, _, nd, np_, _, _ = problem.sizes
        _, count, degree = layout.control.shape
        nodes = count * degree
        self.x = ca.MX.sym("x", layout.unknowns)
        self.p = ca.MX.sym("p", count + nd * nodes + np_)
        self.lam_f, self.lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", layout.conditions)
        data, parameters = self.p[count : count + nd * nodes], self.p[count + nd * nodes :]
        self.where = Where(layout, scheme, self.x, self.p[:count].T, ca.reshape(data, nd, nodes), parameters)
        self.lift = _lift(problem, self.where, compiled)
        self.ends = EndDerivatives.of(problem, layout.boundary is not None)
        self.end_unknowns = np.concatenate([layout.start, layout.edges[:, -1]])
        start, end = (self.x[part.tolist()] for part in (self.end_unknowns[:nx], self.end_unknowns[nx:]))
        self.end_arguments = [start, end, parameters]
        self.linear = _linear_part(layout, scheme)

    def program(self, upper: bool) -> Program:
        terminal, boundary, terminal_slope, boundary_nonzeros = self.ends.gradient(*self.end_arguments)
        cost = ca.dot(self.where.weight, self.lift.integrand()) + terminal
        motion, motion_rows, motion_entries = self.lift.dynamics()
        rows = [motion_rows, flat(self.layout.path).ravel(order="F")]
        if self.layout.boundary is not None:
            rows.append(self.layout.boundary)
        values = ca.vertcat(motion, ca.vec(self.lift.path()), boundary)
        conditions = ca.mtimes(self.linear, self.x) + scattered(values, np.concatenate(rows), self.layout.conditions)
        gradient = self.lift.gradient() + scattered(terminal_slope, self.end_unknowns, self.layout.unknowns)
        jacobian = self._jacobian([motion_entries, self.lift.rows()], boundary_nonzeros)
        return self._named({"f": cost, "g": conditions}, gradient, jacobian, self._hessian(upper), upper)

    def _named(
        self, values: dict[str, ca.MX], gradient: ca.MX, jacobian: ca.MX, hessian: ca.MX, upper: bool
    ) -> Program:
        of_lagrangian = gradient * self.lam_f + ca.mtimes(jacobian.T, self.lam_g)
        plain = {"x": self.x, "p": self.p}
        multipliers = plain | {"lam_f": self.lam_f, "lam_g": self.lam_g}

        def function(name: str, inputs: dict[str, ca.MX], outputs: dict[str, ca.MX]) -> tuple[str, ca.Function]:
            return name, ca.Function(name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs))

        functions = [
            function("nlp_f", plain, {"f": values["f"]}),
            function("nlp_g", plain, {"g": values["g"]}),
            function("nlp_jac_g", plain, {"g": values["g"], "jac_g_x": jacobian}),
        ]
        if upper:
            functions.append(function("nlp_grad_f", plain, {"f": values["f"], "grad_f_x": gradient}))
            functions.append(function("nlp_hess_l", multipliers, {"triu_hess_gamma_x_x": hessian}))
        else:
            functions.append(function("nlp_grad_f", plain, {"grad_f_x": gradient}))
            both = {"grad_gamma_x": of_lagrangian, "hess_gamma_x_x": hessian}
            functions.append(function("nlp_hess_l", multipliers, both))
            # Asked for after the solve; multipliers of the parameters are not wanted.
            rest = {"grad_gamma_x": of_lagrangian, "grad_gamma_p": ca.MX.zeros(self.p.numel())}
            functions.append(function("nlp_grad", multipliers, values | rest))
        return Program(plain | values, dict(functions))

    def _jacobian(self, blocks: list[Entries], boundary: ca.MX) -> ca.MX:
        if self.layout.boundary is not None:
            rows, columns = self.ends.boundary
            blocks.append(Entries(boundary, self.layout.boundary[rows], self.end_unknowns[columns]))
        entries = _joined(blocks)
        constant_rows, constant_columns = (np.array(index) for index in self.linear.sparsity().get_triplet())
        gather = Gather(
            (self.layout.conditions, self.layout.unknowns),
            np.concatenate([entries.rows, constant_rows]),
            np.concatenate([entries.columns, constant_columns]),
        )
        constant = np.zeros(len(gather.keys))
        constant[gather.places(constant_rows, constant_columns)] = self.linear.nonzeros()
        return ca.MX(gather.sparsity, ca.DM(constant) + gather.spread(entries))

    def _hessian(self, upper: bool) -> ca.MX:
        boundary = self.layout.boundary
        of_boundary = self.lam_g[boundary.tolist()] if boundary is not None else ca.MX(0, 1)
        ends = self.ends.hessian(*self.end_arguments, self.lam_f, of_boundary)
        end_rows, end_columns = (self.end_unknowns[index] for index in self.ends.curvature)
        blocks = [self.lift.curvature(self.lam_f, self.lam_g), Entries(ends, *ordered(end_rows, end_columns))]
        if not upper:
            blocks = [_mirrored(block) for block in blocks]
        gather = Gather(
            (self.layout.unknowns, self.layout.unknowns),
            np.concatenate([block.rows for block in blocks]),
            np.concatenate([block.columns for block in blocks]),
        )
        total = ca.MX.zeros(len(gather.keys))
        for block in blocks:
            total += gather.spread(block)
        return ca.MX(gather.sparsity, total)


def _lift(problem: Problem, where: Where, compiled: bool) -> Lift:
    if where.layout.points is not None:
        return AtNodes(problem, where)
    return integrals(problem, where, compiled)


def _joined(blocks: list[Entries]) -> Entries:
    return Entries(
        ca.vertcat(*(block.values for block in blocks)),
        np.concatenate([block.rows for block in blocks]),
        np.concatenate([block.columns for block in blocks]),
    )


def _mirrored(block: Entries) -> Entries:
    """Both triangles from the upper one."""
    off = np.flatnonzero(block.rows != block.columns)
    return Entries(
        ca.vertcat(block.values, block.values[off.tolist()]) if off.size else block.values,
        np.concatenate([block.rows, block.columns[off]]),
        np.concatenate([block.columns, block.rows[off]]),
    )


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

    at_node = [] if layout.points is None else [layout.edges[:, :-1], *np.moveaxis(layout.points, 2, 0)]
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
    gather = Gather(shape, row, column)
    nonzeros = np.zeros(len(gather.keys))
    nonzeros[gather.places(row, column)] = np.concatenate(values)
    return ca.DM(gather.sparsity, nonzeros)


def _rounded(value: float) -> float:
    """Zero and one exactly, where the last point is the end of the interval."""
    return float(round(value)) if abs(value - round(value)) < 1e-12 else float(value)
