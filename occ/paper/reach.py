"""The interval that a quantity reaches over a box of parameters, found by optimisation and not by sampling."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import casadi as ca
import numpy as np

from occ.numeric import evaluate_many

STATIONARY = 1e-6
"""What a first-order model may still gain at an optimum, relative to the largest slope in the middle of the box."""


class Reach(NamedTuple):
    """What a quantity reaches over the box |u_k| <= 1."""

    nominal: float
    low: float
    high: float
    stationary: bool  # both ends satisfy the optimality conditions, and no vertex of the box lies beyond them

    def scaled(self, factor: float) -> Reach:
        """The same in another unit.

        Args:
            factor: positive.

        Returns:
            All three numbers times the factor.
        """
        return Reach(self.nominal * factor, self.low * factor, self.high * factor, self.stationary)


def reach(quantity: ca.SX, u: ca.SX) -> Reach:
    """min and max of g(u) over the box -1 <= u <= 1, by IPOPT with derivatives from CasADi.

    Two starts each: the middle of the box, and the best of its vertices, where a monotone quantity has its extremes.

    Args:
        quantity: g, a scalar expression.
        u: (n,) its only symbol.

    Returns:
        The nominal value g(0) and both ends.

    Source: Waechter and Biegler, Mathematical Programming 106 (2006), 25-57 (IPOPT).
    """
    value = ca.Function("g", [u], [quantity])
    slope = ca.Function("slope", [u], [ca.gradient(quantity, u)])
    vertices = np.array(list(product((-1.0, 1.0), repeat=u.numel()))).T
    at_vertices = evaluate_many(value, vertices)[0][0]
    middle = np.zeros(u.numel())
    scale = float(np.abs(np.array(slope(middle))).max()) or 1.0
    ends, stationary = [], True
    for sign in (1.0, -1.0):
        solver = _solver(sign * quantity / scale, u)
        best = vertices[:, np.argmin(sign * at_vertices)]
        candidates = [best, *(_solved(solver, start) for start in (middle, best))]
        values = [sign * float(value(point)) for point in candidates]
        first = int(np.argmin(values))
        ends.append(sign * values[first])
        gradient = sign * np.array(slope(candidates[first])).ravel() / scale
        # What a first-order model could still gain inside the box (Frank-Wolfe gap): zero if stationary.
        gain = np.maximum(gradient * (candidates[first] + 1), gradient * (candidates[first] - 1)).sum()
        stationary &= bool(gain <= STATIONARY)
    return Reach(float(value(middle)), ends[0], ends[1], stationary)


def _solver(objective: ca.SX, u: ca.SX) -> ca.Function:
    silent = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}
    return ca.nlpsol(
        "reach", "ipopt", {"x": u, "f": objective}, silent | {"ipopt.tol": 1e-10, "ipopt.bound_relax_factor": 0.0}
    )


def _solved(solver: ca.Function, start: np.ndarray) -> np.ndarray:
    """IPOPT's point; an interior-point method stops beside an active bound, and the last step goes onto it."""
    point = np.array(solver(x0=start, lbx=-1, ubx=1)["x"]).ravel()
    return np.where(np.abs(point) > 1 - 1e-6, np.sign(point), point)
