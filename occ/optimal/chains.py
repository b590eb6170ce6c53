"""Chains of integrators: states whose rates are constant combinations of states and controls.

    x' = A x + B u   has   x_i = h^(-w_i) X_i,   u_j = h^(-v_j) U_j,   dX/ds = A X + B U   on every interval,

where w rises by one from each state to its rate: with X and U an interval of any width is the same.  The collocation
equations can then be solved once and for all, and the states between the edges are no unknowns any more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from occ.optimal.mesh import Scheme
from occ.optimal.problem import PROBLEMS, Problem


@dataclass(frozen=True, eq=False)
class Chains:
    """x' = A x + B u.

    Args:
        of_state: (nx, nx) A.
        of_control: (nx, nu) B.
        powers: (nx + nu,) of the width: w, then v.
    """

    of_state: np.ndarray
    of_control: np.ndarray
    powers: np.ndarray

    @classmethod
    @lru_cache(maxsize=PROBLEMS)
    def of(cls, problem: Problem) -> Chains | None:
        """None where the rates are anything else, or no powers fit."""
        nx = problem.state.numel()
        z = ca.vertcat(problem.state, problem.control)
        jacobian = ca.jacobian(problem.rate, z)
        others = ca.vertcat(problem.data, problem.parameters)
        if ca.symvar(jacobian) or ca.depends_on(problem.rate, others):
            return None
        matrix = np.array(ca.evalf(jacobian))
        if np.array(ca.evalf(ca.substitute(problem.rate, z, ca.DM.zeros(z.numel())))).any():
            return None
        powers = _powers(matrix)
        return None if powers is None else cls(matrix[:, :nx], matrix[:, nx:], powers)


def _powers(matrix: np.ndarray) -> np.ndarray | None:
    """Whole numbers with w_b = w_a + 1 wherever row a has an entry in column b; the least of each chain is zero."""
    links = [(int(a), int(b)) for a, b in zip(*np.nonzero(matrix), strict=True)]
    steps = [(a, b, 1) for a, b in links] + [(b, a, -1) for a, b in links]
    powers: dict[int, int] = {}
    for begin in range(matrix.shape[1]):
        if begin in powers:
            continue
        chain, waiting = {begin: 0}, [begin]
        while waiting:
            here = waiting.pop()
            for one, other, step in steps:
                if one == here and other not in chain:
                    chain[other] = chain[here] + step
                    waiting.append(other)
        least = min(chain.values())
        powers |= {index: power - least for index, power in chain.items()}
    fits = all(powers[b] == powers[a] + 1 for a, b in links)
    return np.array([powers[k] for k in range(matrix.shape[1])]) if fits else None


@dataclass(frozen=True)
class Integrated:
    """The solution of the collocation equations on an interval of unit width, y = (X_k, U_1 .. U_d).

    Args:
        points: (d, nx + nu, ny) (X, U) at collocation point i as a linear map of y.
        end: (nx, ny) X at the end of the interval.
        powers: (ny,) of the width in y.
    """

    points: np.ndarray
    end: np.ndarray
    powers: np.ndarray

    def states(self, y: np.ndarray, widths: np.ndarray) -> np.ndarray:
        """States at the collocation points from those at the edges and the controls.

        Args:
            y: (ny, N) x_k, u_1 .. u_d of each interval.
            widths: (N,) of the intervals.

        Returns:
            (nx, N, d).
        """
        nx, degree, count = len(self.end), len(self.points), len(widths)
        factors = widths ** self.powers[:, None]
        states = self.points[:, :nx].reshape(degree * nx, len(self.powers)) @ (y * factors)
        return (states.reshape(degree, nx, count) / factors[:nx]).transpose(1, 2, 0)


def integrated(chains: Chains, scheme: Scheme) -> Integrated:
    """Solve sum_j D_ji X_j = A X_i + B U_i for the X_i.

    Args:
        chains: A and B.
        scheme: of collocation.

    Returns:
        The maps; what is zero by structure is zero exactly.
    """
    nx, nu = chains.of_control.shape
    degree = len(scheme.points)
    size = nx + degree * nu
    start = np.eye(nx, size)
    controls = np.zeros((degree, nu, size))
    for i in range(degree):
        controls[i, :, nx + i * nu : nx + (i + 1) * nu] = np.eye(nu)
    matrix = np.kron(scheme.derivative[1:].T, np.eye(nx)) - np.kron(np.eye(degree), chains.of_state)
    right = np.concatenate([chains.of_control @ controls[i] - scheme.derivative[0, i] * start for i in range(degree)])
    states = np.linalg.solve(matrix, right).reshape(degree, nx, size)
    states[:, ~_reached(chains, degree)] = 0.0
    end = np.tensordot(scheme.end, np.concatenate([start[None], states]), axes=1)
    if scheme.ends_on_point:
        end = states[-1]
    powers = np.concatenate([chains.powers[:nx], np.tile(chains.powers[nx:], degree)])
    return Integrated(np.concatenate([states, controls], axis=1), end, powers)


def _reached(chains: Chains, degree: int) -> np.ndarray:
    """(nx, ny) Which of y can have a part in which state."""
    nx = len(chains.of_state)
    direct = (chains.of_state != 0).astype(int)
    among = np.linalg.matrix_power(np.eye(nx, dtype=int) + direct, nx) > 0
    by_control = among.astype(int) @ (chains.of_control != 0).astype(int) > 0
    return np.concatenate([among, np.tile(by_control, degree)], axis=1)
