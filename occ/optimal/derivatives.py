"""First and second derivatives of a problem at one node and at its ends, as short dense vectors of nonzeros.

A collocation program couples the nodes by constant matrices only, so that these few expressions are all that has to be
differentiated, whatever the number of intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from occ.optimal.problem import PROBLEMS, Problem

Pattern = tuple[np.ndarray, np.ndarray]
"""Rows and columns of nonzeros, column by column."""


@dataclass(frozen=True)
class NodeDerivatives:
    """Of f, g, h (x, u, d, p) by z = (x, u).

    Args:
        gradient: (x, u, d, p) -> f, g, h, dg/dz (dense), nonzeros of df/dz, nonzeros of dh/dz.
        hessian: (x, u, d, p, a, b, c) -> nonzeros of the upper triangle of d^2(a g + b . f + c . h)/dz^2.
        rate: pattern of df/dz.
        path: pattern of dh/dz.
        curvature: pattern of the upper triangle.
    """

    gradient: ca.Function
    hessian: ca.Function
    rate: Pattern
    path: Pattern
    curvature: Pattern

    @classmethod
    @lru_cache(maxsize=PROBLEMS)
    def of(cls, problem: Problem) -> NodeDerivatives:
        """Differentiated once."""
        z = ca.vertcat(problem.state, problem.control)
        arguments = [problem.state, problem.control, problem.data, problem.parameters]
        rate, path = ca.jacobian(problem.rate, z), ca.jacobian(problem.path, z)
        outputs = [problem.rate, problem.integrand, problem.path, ca.gradient(problem.integrand, z)]
        gradient = ca.Function(
            "node_gradient", arguments, [*map(ca.densify, outputs), _nonzeros(rate), _nonzeros(path)]
        )
        a, b, c = ca.SX.sym("a"), ca.SX.sym("b", problem.rate.numel()), ca.SX.sym("c", problem.path.numel())
        lagrangian = a * problem.integrand + ca.dot(b, problem.rate) + ca.dot(c, problem.path)
        upper = ca.triu(ca.hessian(lagrangian, z)[0])
        hessian = ca.Function("node_hessian", [*arguments, a, b, c], [_nonzeros(upper)])
        return cls(gradient, hessian, _pattern(rate), _pattern(path), _pattern(upper))


@dataclass(frozen=True)
class EndDerivatives:
    """Of F, B (x(0), x(T), p) by e = (x(0), x(T)).

    Args:
        gradient: (x(0), x(T), p) -> F, B, dF/de (dense), nonzeros of dB/de.
        hessian: (x(0), x(T), p, a, c) -> nonzeros of the upper triangle of d^2(a F + c . B)/de^2.
        boundary: pattern of dB/de.
        curvature: pattern of the upper triangle.
    """

    gradient: ca.Function
    hessian: ca.Function
    boundary: Pattern
    curvature: Pattern

    @classmethod
    @lru_cache(maxsize=PROBLEMS)
    def of(cls, problem: Problem, with_boundary: bool) -> EndDerivatives:
        """Differentiated once; without B where the program leaves the boundary conditions out."""
        e = ca.vertcat(problem.start, problem.end)
        arguments = [problem.start, problem.end, problem.parameters]
        conditions = problem.boundary if with_boundary else ca.SX(0, 1)
        boundary = ca.jacobian(conditions, e)
        outputs = [problem.terminal, conditions, ca.gradient(problem.terminal, e)]
        gradient = ca.Function("end_gradient", arguments, [*map(ca.densify, outputs), _nonzeros(boundary)])
        a, c = ca.SX.sym("a"), ca.SX.sym("c", conditions.numel())
        upper = ca.triu(ca.hessian(a * problem.terminal + ca.dot(c, conditions), e)[0])
        hessian = ca.Function("end_hessian", [*arguments, a, c], [_nonzeros(upper)])
        return cls(gradient, hessian, _pattern(boundary), _pattern(upper))


def _nonzeros(matrix: ca.SX) -> ca.SX:
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)


def _pattern(matrix: ca.SX) -> Pattern:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=int), np.array(columns, dtype=int)
