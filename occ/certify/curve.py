"""From local to global along a curve: a quadratic S about psi~*(t) that proves a lower bound inside a window.

With e = psi~ - psi~*(t), S = a + b e + c e^2 / 2, a' = -(Z psi~*'^2 + U), b = -2 Z psi~*', completing the squares in e'
and in e gives, wherever sigma = c' - c^2 / (2 Z) + m is positive,

    Z u^2 + U(psi~) + dS/dt >= eps e + sigma e^2 / 2 >= -eps^2 / (2 sigma),    eps = U'(psi~*) - 2 Z psi~*'',

where m(t) <= 2 [U(psi~* + e) - U(psi~*) - U'(psi~*) e] / e^2 for all psi~* + e in the window.  At the end phi takes
the place of U: sigma_T = m_T - c(T) > 0 and tau = phi' + 2 Z psi~*'.  So each motion that stays in the window needs at
least J[psi~*] + phi(psi~*_T) - integral eps^2 / (2 sigma) dt - tau^2 / (2 sigma_T).  Motions that leave the window have
the floors of `occ.certify.floors`.

The curve is a double integral of a piecewise linear acceleration, c is piecewise linear: both are plain numbers, found
in floating point and trusted in nothing.  `lower_bound` encloses everything that the proof needs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from flint import arb

from occ.certify.balls import Ball, EnclosedTask, Polynomial, Refused, integral, square
from occ.certify.floors import CELLS, Floors
from occ.task import Task
from occ.theory.dissipation import circle_of, energy_of
from occ.theory.minimum_work import LeastWork
from occ.theory.optimal_heading import optimal_heading
from occ.theory.trigonometric import derivative, value

BOXES = 24
"""Boxes over the window, and over the curve, on which the curvature m is enclosed."""
STRICT, SLACK = 0.3, 0.01
"""sigma as a share of the curvature, and of the swing of U."""


@dataclass(frozen=True)
class CurveProof:
    """The numbers of the construction.

    Args:
        times: (N + 1,) [s] from 0 to T.
        acceleration: (N + 1,) [rad/s^2] of psi~*, linear in between.
        speed: [rad/s] psi~*'(0).
        curvature: (N + 1,) [J/rad^2] c, linear in between.
        window: edges of the window in cells of `occ.certify.floors`, counted from the start.
    """

    times: tuple[float, ...]
    acceleration: tuple[float, ...]
    speed: float
    curvature: tuple[float, ...]
    window: tuple[int, int]


def propose(task: Task, enclosed: EnclosedTask, least: LeastWork, margin: int, pieces: int = 320) -> CurveProof:
    """Numbers for a proof about the optimal heading; nothing here needs to be right.

    Args:
        task: on a circle, with a free end.
        enclosed: the same task.
        least: its optimum.
        margin: cells between the curve and the edges of the window.
        pieces: of the curve.

    Returns:
        To be checked by `lower_bound`.
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
        math.floor((float(angle.min()) - start) / cell) - margin,
        math.ceil((float(angle.max()) - start) / cell) + margin,
    )
    proof = CurveProof(tuple(times), tuple(fitted(times, 2)), float(fitted(0.0, 1)), (), window)
    return replace(proof, curvature=tuple(_curvature(enclosed, proof)))


def _curvature(task: EnclosedTask, proof: CurveProof) -> np.ndarray:
    """c backwards from the end, with a share of m left as sigma."""
    from scipy.integrate import solve_ivp

    edges = _edges(task, proof)
    curve = _Curve.follow(task, proof, [arb(t) for t in proof.times])
    bends = _Bends.create(task.power, curve, edges)
    each = np.array([float(bends.least(curve.piece(k).range())) for k in range(len(proof.times) - 1)])
    # On both sides of a time the smaller of both.
    at_times = np.minimum(np.append(each, each[-1]), np.insert(each, 0, each[0]))
    swing = float(sum(abs(c) for c in task.power.coefficients[1:]))
    sigma = STRICT * np.abs(at_times) + SLACK * swing
    end_bend = float(_Bends.at(task.of_end, curve.places[-1], edges))
    of_end = float(sum(abs(c) for c in task.of_end.coefficients[1:]))
    last = end_bend - STRICT * abs(end_bend) - SLACK * of_end
    t, z = np.array(proof.times), float(task.friction)

    def backwards(s: float, c: np.ndarray) -> np.ndarray:
        return np.asarray(np.interp(t[-1] - s, t, at_times - sigma) - c**2 / (2 * z))

    found = solve_ivp(backwards, (0, t[-1]), [last], rtol=1e-8, atol=1e-8, dense_output=True)
    if not found.success:
        raise Refused("the curvature has no solution over the whole horizon: another extremal may be better")
    return np.asarray(found.sol(t[-1] - t)[0])


def _edges(task: EnclosedTask, proof: CurveProof) -> list[Ball]:
    return [task.start + 2 * arb.pi() * k / CELLS for k in proof.window]


def lower_bound(task: EnclosedTask, proof: CurveProof, floors: Floors) -> Ball:
    """A proven lower bound of work plus kinetic energy at the start, from numbers that need not be trusted.

    Args:
        task: enclosed.
        proof: the numbers.
        floors: of the same task.

    Returns:
        A ball [J]; its lower end holds for every motion from the start with a free end.

    Raises:
        Refused: a step of the proof fails.
    """
    times = [arb(t) for t in proof.times]
    if len({len(times), len(proof.acceleration), len(proof.curvature)}) != 1 or len(times) < 2:
        raise Refused("times, accelerations and curvatures should be as many")
    if not (times[0] == 0 and times[-1] == task.duration):
        raise Refused(f"the proof covers 0 to {proof.times[-1]!r} s, the horizon is {task.duration.str(12)} s")
    edges = _edges(task, proof)
    curve = _Curve.follow(task, proof, times)
    bends = _Bends.create(task.power, curve, edges)
    action, loss = arb(0), arb(0)
    for k in range(len(times) - 1):
        piece = curve.piece(k)
        c = arb(proof.curvature[k]), arb(proof.curvature[k + 1])
        largest = max(abs(c[0]), abs(c[1]), key=lambda ball: float(ball.upper()))
        sigma = (c[1] - c[0]) / piece.width - square(largest) / (2 * task.friction) + bends.least(piece.range())
        if not sigma > 0:
            raise Refused(f"the curvature is not positive between {proof.times[k]:.6g} and {proof.times[k + 1]:.6g} s")
        action += integral(lambda s, _, p=piece: p.running_cost(task, s), 0, piece.width)
        loss += integral(lambda s, _, p=piece: square(p.defect(task, s)), 0, piece.width) / (2 * sigma)
    end, speed = curve.places[-1], curve.speeds[-1]
    tau = 2 * task.friction * (task.rate + speed) + task.of_end.derivative()(end)
    sigma = _Bends.at(task.of_end, end, edges) - arb(proof.curvature[-1])
    if not sigma > 0:
        raise Refused("the curvature at the end is not positive")
    inside = action + task.end_cost(end) - loss - square(tau) / (2 * sigma)
    outside = _floor_of_leaving(task, proof, floors)
    return arb.min(inside, outside)


def _floor_of_leaving(task: EnclosedTask, proof: CurveProof, floors: Floors) -> Ball:
    low, high = proof.window
    if not low < 0 < high:
        raise Refused("the window does not hold the start")
    return arb(min(floors.work(via) for via in (low, high)))


@dataclass(frozen=True)
class _Piece:
    """psi~* = x + v s + a s^2 / 2 + j s^3 / 6 on one interval."""

    x: Ball
    v: Ball
    a: Ball
    j: Ball
    width: Ball

    def place(self, s: Ball) -> Ball:
        return self.x + s * (self.v + s * (self.a / 2 + s * self.j / 6))

    def speed(self, s: Ball) -> Ball:
        return self.v + s * (self.a + s * self.j / 2)

    def running_cost(self, task: EnclosedTask, s: Ball) -> Ball:
        return task.friction * square(self.speed(s)) + task.power(self.place(s))

    def defect(self, task: EnclosedTask, s: Ball) -> Ball:
        return task.power.derivative()(self.place(s)) - 2 * task.friction * (self.a + s * self.j)

    def range(self) -> Ball:
        return self.place(arb(0).union(self.width))


@dataclass(frozen=True)
class _Curve:
    """Places and speeds at the times of the proof, as balls."""

    places: list[Ball]
    speeds: list[Ball]
    proof: CurveProof
    times: list[Ball]

    @classmethod
    def follow(cls, task: EnclosedTask, proof: CurveProof, times: list[Ball]) -> _Curve:
        curve = cls([task.start], [arb(proof.speed)], proof, times)
        for k in range(len(times) - 1):
            if not times[k + 1] > times[k]:
                raise Refused("the times should increase")
            piece = curve.piece(k)
            curve.places.append(piece.place(piece.width))
            curve.speeds.append(piece.speed(piece.width))
        return curve

    def piece(self, k: int) -> _Piece:
        width = self.times[k + 1] - self.times[k]
        first, last = arb(self.proof.acceleration[k]), arb(self.proof.acceleration[k + 1])
        return _Piece(self.places[k], self.speeds[k], first, (last - first) / width, width)


@dataclass(frozen=True)
class _Bends:
    """Lower bounds m of the curvature for places of the curve in each of a row of boxes."""

    boxes: list[Ball]
    bends: list[Ball]

    @classmethod
    def create(cls, p: Polynomial, curve: _Curve, edges: list[Ball]) -> _Bends:
        ranges = [curve.piece(k).range() for k in range(len(curve.times) - 1)]
        low = min((r.lower() for r in ranges), key=float)
        high = max((r.upper() for r in ranges), key=float)
        if not (edges[0] < low and high < edges[1]):
            raise Refused("the curve leaves the window")
        step = (high - low) / BOXES
        boxes = [(low + k * step).union(low + (k + 1) * step) for k in range(BOXES)]
        return cls(boxes, [cls.at(p, box, edges) for box in boxes])

    @staticmethod
    def at(p: Polynomial, x: Ball, edges: list[Ball]) -> Ball:
        """m for all x in one box."""
        low, high = (edges[0] - x).lower(), (edges[1] - x).upper()
        step = (high - low) / (4 * BOXES)
        values = [p.remainder_on(x, (low + k * step).union(low + (k + 1) * step)).lower() for k in range(4 * BOXES)]
        return min(values, key=float)

    def least(self, x: Ball) -> Ball:
        """m for all x in a box on the curve."""
        return min((m for box, m in zip(self.boxes, self.bends, strict=True) if box.overlaps(x)), key=float)
