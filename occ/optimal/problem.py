"""An optimal control problem as plain data: what to minimise, its numbers, and values at the nodes of a mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

PROBLEMS = 64
"""Problems whose derivatives a process keeps."""


@dataclass(frozen=True)
class Row:
    """What one scalar condition or variable is, for a reader.

    Args:
        quantity: "torque", "speed", "heading".
        unit: "N m"; empty where there is none.
        wheel: from 1; None where it belongs to no wheel.
        squared: the condition is one of the quantity's square, whatever the reader is told.
    """

    quantity: str
    unit: str = ""
    wheel: int | None = None
    squared: bool = False

    @property
    def name(self) -> str:
        """ "wheel 1 torque", "heading"."""
        return self.quantity if self.wheel is None else f"wheel {self.wheel} {self.quantity}"


@dataclass(frozen=True)
class Names:
    """Rows in the order of the vectors of a problem; a vector without names is numbered from 1."""

    state: tuple[Row, ...] = ()
    control: tuple[Row, ...] = ()
    path: tuple[Row, ...] = ()
    boundary: tuple[Row, ...] = ()

    def of(self, vector: str, index: int) -> Row:
        """The row of one entry of ``state``, ``control``, ``path`` or ``boundary``."""
        rows: tuple[Row, ...] = getattr(self, vector)
        kind = {"path": "path condition", "boundary": "boundary condition"}.get(vector, vector)
        return rows[index] if rows else Row(f"{kind} {index + 1}")


@dataclass(frozen=True, eq=False)
class Problem:
    """min F(x(0), x(T), p) + integral of g(x, u, d(t), p) dt subject to x' = f(x, u, d(t), p).

    All are CasADi SX: symbols in the first block, expressions of them in the second.

    Args:
        state: (nx,) x.
        control: (nu,) u.
        data: (nd,) d, known functions of time, given at the nodes.
        parameters: (np,) p.
        start: (nx,) x(0), for the terminal cost and the boundary conditions.
        end: (nx,) x(T).
        rate: (nx,) f.
        integrand: g.
        terminal: F.
        path: (nh,) h(x, u, d, p), kept between bounds at the collocation points.
        boundary: (nb,) B(x(0), x(T), p), kept between bounds.
        names: of the entries, for messages.
        held: so many controls, the first ones, are constant in each interval of the mesh.
    """

    state: ca.SX
    control: ca.SX
    data: ca.SX
    parameters: ca.SX
    start: ca.SX
    end: ca.SX
    rate: ca.SX
    integrand: ca.SX
    terminal: ca.SX = field(default_factory=lambda: ca.SX(0))
    path: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    boundary: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    names: Names = field(default_factory=Names)
    held: int = 0

    @property
    def sizes(self) -> tuple[int, int, int, int, int, int]:
        """nx, nu, nd, np, nh, nb."""
        vectors = (self.state, self.control, self.data, self.parameters, self.path, self.boundary)
        return tuple(x.numel() for x in vectors)

    @cached_property
    def controlled(self) -> np.ndarray:
        """(nh,) of booleans: the path condition depends on the control, not on the state alone."""
        return np.array(ca.which_depends(self.path, self.control, 1, True), dtype=bool)

    @cached_property
    def node_function(self) -> ca.Function:
        """CasADi function (x, u, d, p) -> f, g, h."""
        arguments = [self.state, self.control, self.data, self.parameters]
        return ca.Function("node", arguments, [ca.densify(x) for x in (self.rate, self.integrand, self.path)])

    @cached_property
    def couples_ends_in_cost(self) -> bool:
        """F has a term in both x(0) and x(T), which a solver that works stage by stage cannot hold."""
        ends = ca.vertcat(self.start, self.end)
        mixed = ca.hessian(self.terminal, ends)[0][: self.start.numel(), self.start.numel() :]
        return bool(mixed.nnz())

    @cached_property
    def boundary_function(self) -> ca.Function:
        """CasADi function (x(0), x(T), p) -> F, B."""
        arguments = [self.start, self.end, self.parameters]
        return ca.Function("boundary", arguments, [ca.densify(self.terminal), ca.densify(self.boundary)])


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Lower and upper bounds of one quantity, each (k,); infinities are legal."""

    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def free(cls, size: int) -> Bounds:
        """No bounds."""
        return cls(lower=np.full(size, -np.inf), upper=np.full(size, np.inf))

    @classmethod
    def fixed(cls, value: np.ndarray) -> Bounds:
        """Equality."""
        return cls(lower=np.asarray(value, dtype=float), upper=np.asarray(value, dtype=float))

    @property
    def finite(self) -> np.ndarray:
        """(k,) of booleans: where there is a bound on either side."""
        return np.isfinite(self.lower) | np.isfinite(self.upper)

    @property
    def has_room(self) -> bool:
        """Some bound is an inequality."""
        room = self.lower < self.upper
        return bool(room.any()) and bool((room & self.finite).any())


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """Everything that may change between two solves of one structure.

    Args:
        edges: (N + 1,) [s] mesh.
        data: (nd, N, d) at the collocation points.
        parameters: (np,).
        start: of x(0).
        end: of x(T).
        state: of x at all nodes; None is free.
        control: of u, the same at all collocation points (nu,) or point by point (nu, N, d); None is free.
        path: of h, the same at all nodes (nh,) or node by node (nh, N, d); None where there is no h.
        boundary: of B; None where there is no B.
    """

    edges: np.ndarray
    data: np.ndarray
    parameters: np.ndarray
    start: Bounds
    end: Bounds
    state: Bounds | None = None
    control: Bounds | None = None
    path: Bounds | None = None
    boundary: Bounds | None = None


@dataclass(frozen=True)
class Nodes:
    """Values on a mesh: a guess, or a solution.

    Args:
        edges: (nx, N + 1) states at the edges of the intervals.
        points: (nx, N, d) states at the collocation points.
        control: (nu, N, d) controls at the collocation points.
    """

    edges: np.ndarray
    points: np.ndarray
    control: np.ndarray


def flat(values: np.ndarray) -> np.ndarray:
    """(k, N, d) values at nodes as (k, N d), interval by interval."""
    return values.reshape(values.shape[0], values.shape[1] * values.shape[2])
