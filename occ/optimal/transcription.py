"""Direct collocation of an optimal control problem: polynomials, defects, quadrature, and the nonlinear program.

The transcription knows nothing of platforms.  It is built once for a structure (problem, number of intervals, degree,
scheme); widths, node data, parameters and bounds are numbers that are written into it at each solve.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from occ.errors import Status
from occ.numeric import evaluate_many
from occ.optimal.mesh import Scheme, SchemeName, scheme
from occ.trajectory import lagrange_basis


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

    def node_function(self) -> ca.Function:
        """CasADi function (x, u, d, p) -> f, g, h."""
        arguments = [self.state, self.control, self.data, self.parameters]
        return ca.Function("node", arguments, [ca.densify(x) for x in (self.rate, self.integrand, self.path)])

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
        control: of u at all collocation points; None is free.
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


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What the solver returned.

    Args:
        status: ``OK`` where it converged.
        message: the solver's own words otherwise.
        cost: claimed value of the objective.
        nodes: the solution.
        statistics: iterations and times.
    """

    status: Status
    message: str
    cost: float
    nodes: Nodes
    statistics: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """Of IPOPT.

    Args:
        tolerance: of the optimality conditions.
        iterations: at most.
        seconds: at most, of wall time.
    """

    tolerance: float = 1e-10
    iterations: int = 500
    seconds: float = 60.0


class Transcription:
    """One nonlinear program for one structure: D^T x = h f(x, u) at every collocation point of every interval.

    Args:
        problem: the optimal control problem.
        intervals: N.
        degree: d, of the state's polynomial in each interval.
        name: of the collocation scheme.
        options: of the solver.

    Source: Betts, Practical Methods for Optimal Control and Estimation, chapter 4; Biegler, Nonlinear Programming,
        chapter 10.
    """

    def __init__(
        self,
        problem: Problem,
        intervals: int,
        degree: int,
        name: SchemeName = "radau",
        options: SolverOptions | None = None,
    ) -> None:
        self.problem, self.intervals, self.degree = problem, intervals, degree
        self.scheme: Scheme = scheme(name, degree)
        self.options = options or SolverOptions()
        self._node = problem.node_function()
        self._boundary = problem.boundary_function()
        self._solver = self._build()

    @property
    def sizes(self) -> tuple[int, int, int, int, int, int]:
        """nx, nu, nd, np, nh, nb."""
        p = self.problem
        return tuple(x.numel() for x in (p.state, p.control, p.data, p.parameters, p.path, p.boundary))

    def _build(self) -> ca.Function:
        nx, nu, nd, np_, _, _ = self.sizes
        count, degree, s = self.intervals, self.degree, self.scheme
        free_points = degree - 1 if s.ends_on_point else degree
        edges = ca.MX.sym("edges", nx, count + 1)
        inner = ca.MX.sym("inner", nx, count * free_points)
        control = ca.MX.sym("control", nu, count * degree)
        widths = ca.MX.sym("widths", 1, count)
        data = ca.MX.sym("data", nd, count * degree)
        parameters = ca.MX.sym("parameters", np_)

        # States at all collocation points, interval by interval.
        blocks = []
        for k in range(count):
            blocks.append(inner[:, k * free_points : (k + 1) * free_points])
            if s.ends_on_point:
                blocks.append(edges[:, k + 1])
        points = ca.horzcat(*blocks)
        node = self._node.map("nodes", "serial", count * degree, [3], [])
        rate, integrand, path = node(points, control, data, parameters)

        # This is the key line: the polynomial's derivative is the rate at each collocation point.
        defects, ends, cost = [], [], ca.MX(0)
        for k in range(count):
            chosen = slice(k * degree, (k + 1) * degree)
            values = ca.horzcat(edges[:, k], points[:, chosen])
            defects.append(ca.vec(values @ ca.DM(s.derivative) - widths[k] * rate[:, chosen]))
            if not s.ends_on_point:
                ends.append(edges[:, k + 1] - values @ ca.DM(s.end))
            cost += widths[k] * (integrand[:, chosen] @ ca.DM(s.weights))
        terminal, boundary = self._boundary(edges[:, 0], edges[:, -1], parameters)
        nlp = {
            "x": ca.veccat(edges, inner, control),
            "p": ca.veccat(widths, data, parameters),
            "f": cost + terminal,
            "g": ca.vertcat(*defects, *ends, ca.vec(path), boundary),
        }
        self._equalities = sum(x.numel() for x in (*defects, *ends))
        options = {
            # Small programs run faster as one flat expression; large ones would take long to flatten.
            "expand": count * degree <= 600,
            "print_time": False,
            "record_time": True,
            # Multipliers of the parameters would cost as much as the solution, and nobody asks for them.
            "calc_lam_p": False,
            "no_nlp_grad": True,
            "error_on_fail": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": self.options.tolerance,
                "constr_viol_tol": self.options.tolerance,
                "max_iter": self.options.iterations,
                "max_wall_time": self.options.seconds,
                "fixed_variable_treatment": "make_parameter",
            },
        }
        return ca.nlpsol("collocation", "ipopt", nlp, options)

    def solve(self, numbers: Numbers, guess: Nodes) -> Outcome:
        """Solve with these numbers; nothing is built.

        Args:
            numbers: mesh, data, parameters and bounds.
            guess: to start from.

        Returns:
            The outcome, also where the solver fails.
        """
        try:
            result = self._solver(**self._arguments(numbers, guess))
            statistics = self._solver.stats()
        except RuntimeError as error:
            return Outcome(
                status=Status.FAILED, message=f"the solver stopped: {error}", cost=np.nan, nodes=guess, statistics={}
            )
        status, message = _read_status(statistics)
        return Outcome(
            status=status,
            message=message,
            cost=float(result["f"]),
            nodes=self._unpack(np.array(result["x"])[:, 0]),
            statistics={
                "iterations": int(statistics["iter_count"]),
                "seconds": float(statistics.get("t_wall_total", np.nan)),
                "return_status": statistics["return_status"],
            },
        )

    def _arguments(self, numbers: Numbers, guess: Nodes) -> dict[str, np.ndarray]:
        nx, nu, _, _, nh, nb = self.sizes
        count, degree = self.intervals, self.degree
        state, control = numbers.state or Bounds.free(nx), numbers.control or Bounds.free(nu)
        path, boundary = numbers.path or Bounds.free(nh), numbers.boundary or Bounds.free(nb)
        inner = count * (degree - 1 if self.scheme.ends_on_point else degree)

        def variables(side: str) -> np.ndarray:
            bound, extreme = getattr(state, side), np.maximum if side == "lower" else np.minimum
            edges = np.repeat(bound[:, None], count + 1, axis=1)
            edges[:, 0] = extreme(edges[:, 0], getattr(numbers.start, side))
            edges[:, -1] = extreme(edges[:, -1], getattr(numbers.end, side))
            return np.concatenate(
                [edges.ravel(order="F"), np.tile(bound, inner), np.tile(getattr(control, side), count * degree)]
            )

        def constraints(side: str) -> np.ndarray:
            bound = getattr(path, side)
            nodes = np.tile(bound, count * degree) if bound.ndim == 1 else flat(bound).ravel(order="F")
            return np.concatenate([np.zeros(self._equalities), nodes, getattr(boundary, side)])

        widths = np.diff(numbers.edges)
        data = flat(numbers.data).ravel(order="F")
        return {
            "x0": self._pack(guess),
            "p": np.concatenate([widths, data, numbers.parameters]),
            "lbx": variables("lower"),
            "ubx": variables("upper"),
            "lbg": constraints("lower"),
            "ubg": constraints("upper"),
        }

    def _pack(self, nodes: Nodes) -> np.ndarray:
        inner = nodes.points[:, :, :-1] if self.scheme.ends_on_point else nodes.points
        blocks = [nodes.edges, flat(inner), flat(nodes.control)]
        return np.concatenate([block.ravel(order="F") for block in blocks])

    def _unpack(self, x: np.ndarray) -> Nodes:
        nx, nu, *_ = self.sizes
        count, degree = self.intervals, self.degree
        inner_degree = degree - 1 if self.scheme.ends_on_point else degree
        cut = nx * (count + 1), nx * (count + 1) + nx * count * inner_degree
        edges = x[: cut[0]].reshape(nx, count + 1, order="F")
        inner = x[cut[0] : cut[1]].reshape(nx, count * inner_degree, order="F").reshape(nx, count, inner_degree)
        if self.scheme.ends_on_point:
            inner = np.concatenate([inner, edges[:, 1:, None]], axis=2)
        control = x[cut[1] :].reshape(nu, count * degree, order="F").reshape(nu, count, degree)
        return Nodes(edges, inner, control)

    def node_times(self, edges: np.ndarray) -> np.ndarray:
        """(N, d) [s] times of the collocation points on a mesh (N + 1,)."""
        return edges[:-1, None] + np.diff(edges)[:, None] * self.scheme.points

    def interpolate(self, nodes: Nodes, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """State, its derivative in the interval's own variable, and control at places s in every interval.

        Args:
            nodes: values on the mesh.
            s: (m,) in [0, 1].

        Returns:
            (nx, N, m), (nx, N, m), (nu, N, m).
        """
        values = np.concatenate([nodes.edges[:, :-1, None], nodes.points], axis=2)
        state = values @ lagrange_basis(self.scheme.nodes, s)
        # The derivative has degree d - 1, so its values at the collocation points determine it.
        derivative = values @ self.scheme.derivative @ lagrange_basis(self.scheme.points, s)
        return state, derivative, nodes.control @ lagrange_basis(self.scheme.points, s)

    def at_places(self, nodes: Nodes, interval: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """State and control at single places.

        Args:
            nodes: values on the mesh.
            interval: (m,) number of the interval of each place.
            s: (m,) in [0, 1].

        Returns:
            (nx, m), (nu, m).
        """
        values = np.concatenate([nodes.edges[:, :-1, None], nodes.points], axis=2)
        state = np.einsum("xmj,jm->xm", values[:, interval], lagrange_basis(self.scheme.nodes, s))
        control = np.einsum("umj,jm->um", nodes.control[:, interval], lagrange_basis(self.scheme.points, s))
        return state, control

    def evaluate(
        self, state: np.ndarray, control: np.ndarray, data: np.ndarray, parameters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """f, g and h at many points at once.

        Args:
            state: (nx, M).
            control: (nu, M).
            data: (nd, M).
            parameters: (np,).

        Returns:
            (nx, M), (M,), (nh, M).
        """
        rate, integrand, path = evaluate_many(self._node, state, control, data, parameters, shared=(3,))
        return rate, integrand[0], path


def flat(values: np.ndarray) -> np.ndarray:
    """(k, N, d) values at nodes as (k, N d), interval by interval."""
    return values.reshape(values.shape[0], values.shape[1] * values.shape[2])


def _read_status(statistics: dict[str, Any]) -> tuple[Status, str]:
    if statistics["success"]:
        return Status.OK, ""
    words = {
        "Infeasible_Problem_Detected": (Status.INFEASIBLE, "the solver found the constraints to contradict each other"),
        "Maximum_Iterations_Exceeded": (Status.FAILED, "the solver used all its iterations"),
        "Maximum_WallTime_Exceeded": (Status.FAILED, "the solver used all its time"),
        "Invalid_Number_Detected": (Status.FAILED, "a function of the problem is not finite"),
    }
    reason = statistics["return_status"]
    return words.get(reason, (Status.FAILED, f"the solver stopped with {reason}"))
