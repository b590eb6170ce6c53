"""Optimal control problems with published or closed-form answers, for the same transcription as the platform's.

A free final time is a state of zero rate: with s = t / T the equations are dx/ds = T f, dT/ds = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import casadi as ca
import numpy as np

from occ.optimal.problem import Bounds, Names, Nodes, Numbers, Problem, Row
from occ.optimal.solvers import SolverOptions
from occ.optimal.transcription import Outcome, Transcription

INF = np.inf


@dataclass(frozen=True, eq=False)
class Posed:
    """A problem with its horizon, its bounds and a straight line to start from.

    Args:
        problem: to solve.
        horizon: [s] or 1 where the final time is a state.
        start: lower and upper bounds of x(0).
        end: of x(T).
        state: of x between.
        control: of u.
        path: of the path conditions.
        first: where the first guess starts.
        last: and where it ends.
        held: the control of the first guess.
    """

    problem: Problem
    horizon: float
    start: Bounds
    end: Bounds
    first: list[float]
    last: list[float]
    held: list[float]
    state: Bounds | None = None
    control: Bounds | None = None
    path: Bounds | None = None
    knots: list[float] = field(default_factory=list)

    def numbers(self, transcription: Transcription, edges: np.ndarray) -> Numbers:
        shape = transcription.intervals, transcription.degree
        return Numbers(
            edges=edges,
            data=np.zeros((0, *shape)),
            parameters=np.zeros(0),
            start=self.start,
            end=self.end,
            state=self.state,
            control=self.control,
            path=self.path,
        )

    def data(self, edges: np.ndarray, s: np.ndarray) -> np.ndarray:
        return np.zeros((0, len(edges) - 1, s.shape[-1]))

    def guess(self, transcription: Transcription, edges: np.ndarray) -> Nodes:
        def line(t: np.ndarray) -> np.ndarray:
            share = t / self.horizon
            first, last = (np.array(v).reshape(-1, *[1] * t.ndim) for v in (self.first, self.last))
            return first + (last - first) * share

        points = transcription.node_times(edges)
        control = np.array(self.held)[:, None, None] * np.ones(points.shape)
        return Nodes(line(edges), line(points), control)

    def mesh(self, intervals: int) -> np.ndarray:
        """Uniform between the knots, which are edges."""
        corners = [0.0, *self.knots, self.horizon]
        each = intervals // (len(corners) - 1)
        pieces = [np.linspace(a, b, each + 1)[:-1] for a, b in pairwise(corners)]
        return np.append(np.concatenate(pieces), self.horizon)

    def solve(
        self, edges: np.ndarray, degree: int, scheme: str = "radau", options: SolverOptions | None = None
    ) -> tuple[Transcription, Numbers, Outcome]:
        transcription = Transcription(self.problem, len(edges) - 1, degree, scheme, options)
        numbers = self.numbers(transcription, edges)
        return transcription, numbers, transcription.solve(numbers, self.guess(transcription, edges))


def between(lower: list[float], upper: list[float]) -> Bounds:
    return Bounds(lower=np.array(lower, dtype=float), upper=np.array(upper, dtype=float))


def at(*values: float) -> Bounds:
    return Bounds.fixed(np.array(values))


def posed(
    nx: int, nu: int, equations: Callable[[ca.SX, ca.SX], dict[str, ca.SX]], names: Names | None = None
) -> Problem:
    """equations(x, u) gives rate, integrand, and where wanted path; ``terminal`` is a function of x(T)."""
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", nu)
    start, end = ca.SX.sym("start", nx), ca.SX.sym("end", nx)
    given = equations(x, u)
    terminal = given.pop("terminal", None)
    return Problem(
        state=x,
        control=u,
        data=ca.SX(0, 1),
        parameters=ca.SX(0, 1),
        start=start,
        end=end,
        terminal=ca.substitute(terminal, x, end) if terminal is not None else ca.SX(0),
        names=names or Names(),
        **given,
    )


def double_integrator() -> Posed:
    """x'' = u from rest to rest over unit distance in unit time, least integral of u^2: 12, with x = 3 t^2 - 2 t^3.

    Bryson and Ho, Applied Optimal Control (1975), section 5.2: cubic between given ends.
    """
    problem = posed(2, 1, lambda x, u: {"rate": ca.vertcat(x[1], u), "integrand": u**2})
    return Posed(problem, 1.0, at(0, 0), at(1, 0), [0, 0], [1, 0], [0])


def brachistochrone(across: float = 2.0, down: float = 2.0, gravity: float = 9.81) -> Posed:
    """x' = v sin a, y' = v cos a, v' = g cos a from rest at the origin, least time.

    Johann Bernoulli (1696): the cycloid x = r (q - sin q), y = r (1 - cos q), T = q_T sqrt(r / g); Bryson and Ho,
    section 2.7.
    """

    def equations(x: ca.SX, u: ca.SX) -> dict[str, ca.SX]:
        rate = ca.vertcat(x[2] * ca.sin(u), x[2] * ca.cos(u), gravity * ca.cos(u))
        return {"rate": ca.vertcat(x[3] * rate, 0), "integrand": ca.SX(0), "terminal": x[3]}

    return Posed(
        posed(4, 1, equations),
        1.0,
        between([0, 0, 0, 0.05], [0, 0, 0, 10]),
        between([across, down, -INF, 0.05], [across, down, INF, 10]),
        [0, 0, 0.1, 1],
        [across, down, 5, 1],
        [0.8],
        control=between([0.0], [np.pi]),
    )


def brachistochrone_time(across: float = 2.0, down: float = 2.0, gravity: float = 9.81) -> float:
    from scipy.optimize import brentq

    q = brentq(lambda q: down * (q - np.sin(q)) - across * (1 - np.cos(q)), 1e-3, 2 * np.pi - 1e-3, xtol=1e-15)
    return float(q * np.sqrt(down / (1 - np.cos(q)) / gravity))


def bryson_denham(limit: float = 1 / 9) -> Posed:
    """x'' = u, x <= l, from (0, 1) to (0, -1) in unit time, least integral of u^2 / 2: 4 / (9 l) for l <= 1/6.

    Bryson and Ho, section 3.11: on the limit from t = 3 l to 1 - 3 l.
    """
    names = Names(state=(Row("position", "m"), Row("velocity", "m/s")), path=(Row("position", "m"),))
    problem = posed(2, 1, lambda x, u: {"rate": ca.vertcat(x[1], u), "integrand": u**2 / 2, "path": x[0]}, names)
    return Posed(
        problem,
        1.0,
        at(0, 1),
        at(0, -1),
        [0, 1],
        [0, -1],
        [0],
        path=between([-INF], [limit]),
        knots=[3 * limit, 1 - 3 * limit],
    )


def bang_bang(distance: float = 1.0, limit: float = 1.0) -> Posed:
    """x'' = u, |u| <= a, rest to rest in least time: T = 2 sqrt(d / a), u = a in the first half and -a in the second.

    Pontryagin et al., The Mathematical Theory of Optimal Processes (1962), section 5.
    """

    def equations(x: ca.SX, u: ca.SX) -> dict[str, ca.SX]:
        return {"rate": ca.vertcat(x[2] * x[1], x[2] * u, 0), "integrand": ca.SX(0), "terminal": x[2]}

    return Posed(
        posed(3, 1, equations),
        1.0,
        between([0, 0, 0.01], [0, 0, 100]),
        between([distance, 0, 0.01], [distance, 0, 100]),
        [0, 0, 3],
        [distance, 0, 3],
        [0],
        control=between([-limit], [limit]),
        knots=[0.5],
    )


def van_der_pol() -> Posed:
    """x_1' = (1 - x_2^2) x_1 - x_2 + u, x_2' = x_1, -0.3 <= u <= 1, x(0) = (0, 1), integral of x^2 + u^2 over 5 s.

    Vassiliadis, Sargent and Pantelides (1994); Balsa-Canto et al. (2002), case study 6.1; the PROPT manual prints
    2.86725953808.
    """

    def equations(x: ca.SX, u: ca.SX) -> dict[str, ca.SX]:
        rate = ca.vertcat((1 - x[1] ** 2) * x[0] - x[1] + u, x[0])
        return {"rate": rate, "integrand": ca.sumsqr(x) + u**2}

    free = Bounds.free(2)
    return Posed(posed(2, 1, equations), 5.0, at(0, 1), free, [0, 1], [0, 0], [0], control=between([-0.3], [1.0]))


def hypersensitive(horizon: float = 40.0, start: float = 1.5, end: float = 1.0) -> Posed:
    """x' = -x^3 + u, least integral of (x^2 + u^2) / 2 between given ends over a long horizon.

    Rao and Mease, Optimal Control Applications and Methods 21 (2000).  For T to infinity the Hamiltonian is zero along
    the stable and the unstable manifold of the origin, and J is the sum of two integrals.
    """
    problem = posed(1, 1, lambda x, u: {"rate": -(x**3) + u, "integrand": (x**2 + u**2) / 2})
    return Posed(problem, horizon, at(start), at(end), [start], [end], [0])


def hypersensitive_cost(start: float = 1.5, end: float = 1.0) -> float:
    """Integral of sqrt(x^6 + x^2) -+ x^3 from 0 to |x(0)| and |x(T)|; the rest is of size exp(-T)."""

    def manifold(x: float, sign: float) -> float:
        return (sign * x**4 + x**2 * np.sqrt(x**4 + 1) + np.arcsinh(x**2)) / 4

    return float(manifold(start, -1.0) + manifold(end, 1.0))


def catalyst_mixing(knots: list[float] | None = None) -> Posed:
    """x_1' = u (10 x_2 - x_1), x_2' = u (x_1 - 10 x_2) - (1 - u) x_2, 0 <= u <= 1, most 1 - x_1(1) - x_2(1).

    Gunn and Thomas (1965); Jackson, J. Optim. Theory Appl. 2 (1968): u = 1, then a singular arc with constant u, then
    u = 0.  Dolan, More and Munson, COPS 3.0 (2004): 0.048055.
    """

    def equations(x: ca.SX, u: ca.SX) -> dict[str, ca.SX]:
        rate = ca.vertcat(u * (10 * x[1] - x[0]), u * (x[0] - 10 * x[1]) - (1 - u) * x[1])
        return {"rate": rate, "integrand": ca.SX(0), "terminal": x[0] + x[1] - 1}

    return Posed(
        posed(2, 1, equations),
        1.0,
        at(1, 0),
        Bounds.free(2),
        [1, 0],
        [0.9, 0.05],
        [0.3],
        control=between([0.0], [1.0]),
        knots=knots or [],
    )


def catalyst_arcs() -> tuple[float, np.ndarray]:
    """Best cost and (t_1, t_2, u_s) over controls 1, u_s, 0 on three arcs: products of matrix exponentials."""
    from scipy.linalg import expm
    from scipy.optimize import minimize

    def system(u: float) -> np.ndarray:
        return np.array([[-u, 10 * u], [u, -10 * u - (1 - u)]])

    def cost(z: np.ndarray) -> float:
        x = expm(system(0.0) * (1 - z[1])) @ expm(system(z[2]) * (z[1] - z[0])) @ expm(system(1.0) * z[0])
        return float(x[:, 0].sum() - 1)

    found = minimize(cost, [0.14, 0.72, 0.23], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-15})
    return float(found.fun), found.x
