"""From local to global along a curve: numbers for a quadratic V about the optimal heading.

c is a solution of Riccati's equation c' = c^2 / (2 Z) - m + sigma backwards from the end, with a share of the curvature
left as sigma.  What it proves is up to `occ.certify.checker`; motions that leave the window need another proof.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from occ.certify.angle import CELLS, OneAngle
from occ.certify.balls import Refused
from occ.certify.checker import Bends, follow, least_bend
from occ.certify.proofs import CurveProof
from occ.task import Task
from occ.theory.dissipation import circle_of, energy_of
from occ.theory.minimum_work import LeastWork
from occ.theory.optimal_heading import optimal_heading
from occ.theory.trigonometric import derivative, value

STRICT, SLACK = 0.3, 0.01
"""sigma as a share of the curvature, and of the swing of U."""
Window = tuple[float, float]
"""Edges, in cells from the start."""


def propose(
    task: Task, problem: OneAngle, least: LeastWork, margin: int, pieces: int = 320
) -> tuple[CurveProof, Window]:
    """Numbers for a proof about the optimal heading; nothing here needs to be right.

    Args:
        task: on a circle, with a free end.
        problem: the same task.
        least: its optimum.
        margin: cells between the curve and the edges of the window.
        pieces: of the curve.

    Returns:
        To be checked for the motions that stay in the window.

    Raises:
        Refused: there is no such V.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    assert least.extremal is not None
    energy = energy_of(task.platform, task.point, circle_of(task))
    motion = optimal_heading(task, least.extremal, per_piece=401)
    keep = np.insert(np.diff(motion.t) > 1e-7 * task.duration, 0, True)
    start = least.extremal.places[0]
    rate = float(energy.rate)
    angle = motion.heading - motion.heading[0] + start - rate * motion.t
    spline = CubicHermiteSpline(motion.t[keep], angle[keep], motion.yaw_rate[keep] - rate)
    times = np.linspace(0, task.duration, pieces + 1)
    z = float(energy.friction)
    # The acceleration of an extremal by its own equation; the curve is then the spline's, with such ends.
    ends = value(derivative(energy.power), spline(times[[0, -1]])) / (2 * z)
    fitted = CubicSpline(times, spline(times), bc_type=((2, ends[0]), (2, ends[1])))
    cell = 2 * math.pi / CELLS
    window = (
        math.floor((float(angle.min()) - start) / cell) - float(margin),
        math.ceil((float(angle.max()) - start) / cell) + float(margin),
    )
    proof = CurveProof(tuple(times), tuple(fitted(times, 2)), float(fitted(0.0, 1)), ())
    return replace(proof, curvature=tuple(_curvature(problem, proof, window))), window


def _curvature(problem: OneAngle, proof: CurveProof, window: Window) -> np.ndarray:
    """c backwards from the end, with a share of m left as sigma."""
    from scipy.integrate import solve_ivp

    task = problem.task
    edges = problem.lengths.place(window[0]), problem.lengths.place(window[1])
    curve, end, _ = follow(task.start, proof)
    bends = Bends.create(task.power, curve, edges)
    each = np.array([float(bends.least(piece.range())) for piece in curve])
    # On both sides of a time the smaller of both.
    at_times = np.minimum(np.append(each, each[-1]), np.insert(each, 0, each[0]))
    swing = float(sum(abs(c) for c in task.power.coefficients[1:]))
    sigma = STRICT * np.abs(at_times) + SLACK * swing
    end_bend = float(least_bend(task.of_end, end, edges))
    of_end = float(sum(abs(c) for c in task.of_end.coefficients[1:]))
    last = end_bend - STRICT * abs(end_bend) - SLACK * of_end
    t, z = np.array(proof.times), float(task.friction)

    def backwards(s: float, c: np.ndarray) -> np.ndarray:
        return np.asarray(np.interp(t[-1] - s, t, at_times - sigma) - c**2 / (2 * z))

    found = solve_ivp(backwards, (0, t[-1]), [last], rtol=1e-8, atol=1e-8, dense_output=True)
    if not found.success:
        raise Refused("the curvature has no solution over the whole horizon: another extremal may be better")
    return np.asarray(found.sol(t[-1] - t)[0])
