"""The least work by dynamic programming on (time, heading), for any program motion: a global check of everything else.

V(t, psi) = least dissipation from there to the end, plus what the end costs.  Over one step the heading goes straight,
so that the value on N steps exceeds the infimum by c_2 / N^2 + c_4 / N^4 + ...: one extrapolation makes the order four,
two make it six.  No derivative of the problem is followed, no stationary point is trusted: each step looks at the whole
range of yaw rates first and then sharpens the best of them.

Source: Bellman, Dynamic Programming, chapter IX; Falcone, Ferretti, Semi-Lagrangian Approximation Schemes, chapter 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from occ.checks import check_fields
from occ.errors import InputError
from occ.task import Task
from occ.theory.coefficients import YawCoefficients, yaw_coefficients
from occ.theory.dissipation import CircleEnergy, circle_energy
from occ.theory.trigonometric import TURN, basis, recentred, value

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
NODES, WEIGHTS = (1 + _NODES) / 2, _WEIGHTS / 2
RATES = 17
"""Yaw rates that each step looks at first."""


@dataclass(frozen=True, kw_only=True)
class DynamicProgram:
    """How fine: the value is computed on `steps`, 2 `steps`, 4 `steps`, ... and extrapolated.

    Args:
        steps: of the coarsest level.
        levels: number of levels.
        points: headings in a turn.
        largest_rate: [rad/s] of the yaw rate; a result that touches it says so.
    """

    steps: int = 40
    levels: int = 3
    points: int = 720
    largest_rate: float = 4.0

    def __post_init__(self) -> None:
        check_fields(self)
        if min(self.steps, self.points) < 8 or self.levels < 1:
            raise InputError("DynamicProgram: steps and points should be at least 8, levels at least 1")


@dataclass(frozen=True)
class DynamicProgramResult:
    """Extrapolated least work.

    Args:
        work: [J].
        error: [J] difference of the last two extrapolations.
        levels: [J] least work on each level, not extrapolated.
    """

    work: float
    error: float
    levels: tuple[float, ...]


@dataclass(frozen=True)
class _Instants:
    """D(t, psi, Omega) = Z Omega^2 + 2 d_2 Omega + d_1 at N times, polynomials in the heading."""

    friction: float
    drag: np.ndarray  # (5, N)
    power: np.ndarray  # (5, N)


def least_work(
    task: Task, method: DynamicProgram | None = None, end: tuple[float, float] | None = None
) -> DynamicProgramResult:
    """The least work with B on its program from the task's start.

    Args:
        task: any platform and program motion, without limits.
        method: how fine.
        end: heading [rad], full turns counting, and yaw rate [rad/s] at the end; None for a free end.

    Returns:
        Work and its estimated error.

    Raises:
        InputError: a rotation that nothing resists.
    """
    method = method or DynamicProgram()
    c = yaw_coefficients(task.platform, task.point)
    if not float(c.inertia * c.xi_3) > 0:
        raise InputError("dynamic programming needs friction that resists the rotation; wheel_friction should not be 0")
    ends = _at(task, c, np.array([0.0, task.duration]))
    places = _angle(task, np.array([0.0, task.duration]))
    start_energy = _part(ends, 0).kinetic_energy(task.start.heading + places[0], task.start.heading_rate)
    last = _part(ends, 1)
    grid = _Grid.create(task, method, None if end is None else end[0])
    if end is None:
        final = value(last.rest_of_yaw, grid.points + places[1])
        constant = -float(start_energy)
    else:
        final = None
        constant = float(last.kinetic_energy(end[0] + places[1], end[1]) - start_energy)
    works = []
    for level in range(method.levels):
        steps = method.steps * 2**level
        works.append(_value_at_start(task, c, grid, final, steps) + constant)
    table = [np.array(works)]
    for k in range(1, method.levels):
        before = table[-1]
        table.append(before[1:] + (before[1:] - before[:-1]) / (4.0**k - 1))
    error = abs(float(table[-1][0] - table[-2][-1])) if method.levels > 1 else np.inf
    return DynamicProgramResult(float(table[-1][0]), error, tuple(works))


def _angle(task: Task, t: np.ndarray) -> np.ndarray:
    """psi~ - psi at the times t: V* = v (sin psi~, cos psi~) with v the speed of B on the floor."""
    _, velocity, _ = task.motion.at(t)
    return np.pi / 2 - np.arctan2(velocity[1], velocity[0])


def _at(task: Task, c: YawCoefficients, t: np.ndarray) -> CircleEnergy:
    """The energies in psi~ at the times t; D is the same for every rate that it is expanded about."""
    _, velocity, _ = task.motion.at(t)
    return circle_energy(YawCoefficients(*(np.asarray(x) for x in c)), np.hypot(*velocity), 1.0)


def _part(energy: CircleEnergy, k: int) -> CircleEnergy:
    return CircleEnergy(*(item[..., k] for item in energy))


def _instants(task: Task, c: YawCoefficients, t: np.ndarray) -> _Instants:
    energy, angle = _at(task, c, t), _angle(task, t)
    power = energy.power - 2 * energy.drag * energy.rate
    power[0] -= energy.friction * energy.rate**2
    return _Instants(float(energy.friction.flat[0]), recentred(energy.drag, angle), recentred(power, angle))


@dataclass(frozen=True)
class _Grid:
    """Headings: a turn that closes, or a stretch of the real line where full turns count."""

    points: np.ndarray
    closed: bool
    largest_rate: float
    start: float
    target: float | None

    @classmethod
    def create(cls, task: Task, method: DynamicProgram, target: float | None) -> _Grid:
        start = task.start.heading
        if target is None:
            return cls(start + TURN * np.arange(method.points) / method.points, True, method.largest_rate, start, None)
        # A way may swing beyond both ends, by hardly more than half a turn.
        low, high = min(start, target) - TURN / 2, max(start, target) + TURN / 2
        count = int(method.points * (high - low) / TURN) + 1
        return cls(np.linspace(low, high, count), False, method.largest_rate, start, target)

    def spline(self, values: np.ndarray) -> Any:
        from scipy.interpolate import CubicSpline

        if not self.closed:
            return CubicSpline(self.points, values)
        points = np.append(self.points, self.points[0] + TURN)
        return CubicSpline(points, np.append(values, values[0]), bc_type="periodic")

    def shifted(self, values: np.ndarray, shift: int) -> np.ndarray:
        """values[i + shift], infinite beyond the ends of a stretch."""
        rolled = np.roll(values, -shift)
        if not self.closed and shift:
            rolled[slice(-shift, None) if shift > 0 else slice(None, -shift)] = np.inf
        return rolled


def _value_at_start(task: Task, c: YawCoefficients, grid: _Grid, final: np.ndarray | None, steps: int) -> float:
    """V(0, psi(0)) on so many steps, backwards in time."""
    width = task.duration / steps
    times = width * np.arange(steps)[:, None] + width * NODES
    instants = _instants(task, c, times.ravel())
    values = final
    for k in range(steps - 1, -1, -1):
        part = slice(3 * k, 3 * k + 3)
        step = _Step(instants.friction, instants.drag[:, part, None], instants.power[:, part, None], width)
        if values is None:
            assert grid.target is not None
            values = step.cost(grid.points, grid.target - grid.points)[0]
        else:
            values = _improved(grid, step, values)
    assert values is not None
    return float(grid.spline(values)(grid.start))


@dataclass(frozen=True)
class _Step:
    """Dissipation over one step on which the heading goes straight from y to y + d, by Gauss's rule in time."""

    friction: float
    drag: np.ndarray  # (5, 3, 1)
    power: np.ndarray  # (5, 3, 1)
    width: float  # [s]

    def cost(self, y: np.ndarray, d: np.ndarray) -> np.ndarray:
        """(3, N) The cost and its first two derivatives in d."""
        s = NODES[:, None]
        rate = d / self.width
        _, c_1, s_1, c_2, s_2 = basis(y + s * d)
        a, b = self.drag, self.power
        drag, drag_slope = a[1] * c_1 + a[2] * s_1, a[2] * c_1 - a[1] * s_1
        first, second = b[1] * c_1 + b[2] * s_1, b[3] * c_2 + b[4] * s_2
        slope = b[2] * c_1 - b[1] * s_1 + 2 * (b[4] * c_2 - b[3] * s_2)
        bend = -first - 4 * second
        terms = (
            (self.friction * rate + 2 * drag) * rate + b[0] + first + second,
            2 * (self.friction * rate + drag) / self.width + s * (2 * drag_slope * rate + slope),
            2 * (self.friction / self.width + 2 * s * drag_slope) / self.width + s**2 * (bend - 2 * drag * rate),
        )
        return self.width * np.stack([WEIGHTS @ term for term in terms])

    def rough_cost(self, y: np.ndarray, d: np.ndarray) -> np.ndarray:
        """The cost by the midpoint rule: enough to tell one valley from another."""
        rate = d / self.width
        _, c_1, s_1, c_2, s_2 = basis(y + d / 2)
        a, b = self.drag[:, 1], self.power[:, 1]
        drag = a[1] * c_1 + a[2] * s_1
        power = b[0] + b[1] * c_1 + b[2] * s_1 + b[3] * c_2 + b[4] * s_2
        return self.width * ((self.friction * rate + 2 * drag) * rate + power)


def _improved(grid: _Grid, step: _Step, values: np.ndarray) -> np.ndarray:
    """min over d of cost(psi, d) + V(t + width, psi + d), at all headings."""
    spacing = grid.points[1] - grid.points[0]
    reach = max(2, round(grid.largest_rate * step.width / spacing))
    shifts = np.unique(np.round(np.linspace(-reach, reach, RATES)).astype(int))
    y = np.tile(grid.points, len(shifts))
    jumps = np.repeat(shifts * spacing, len(grid.points))
    ahead = np.concatenate([grid.shifted(values, int(shift)) for shift in shifts])
    totals = (step.rough_cost(y, jumps) + ahead).reshape(len(shifts), -1)
    d = shifts[np.argmin(totals, axis=0)] * spacing
    spline = grid.spline(values)
    first, second = spline.derivative(1), spline.derivative(2)
    low, high = -grid.largest_rate * step.width, grid.largest_rate * step.width
    if not grid.closed:
        low, high = np.maximum(low, grid.points[0] - grid.points), np.minimum(high, grid.points[-1] - grid.points)
    for _ in range(5):
        _, slope, bend = step.cost(grid.points, d)
        slope, bend = slope + first(grid.points + d), bend + second(grid.points + d)
        move = np.where(bend > 0, slope / np.where(bend > 0, bend, 1.0), np.sign(slope) * spacing)
        d = np.clip(d - move, low, high)
        if np.abs(move).max() <= 1e-9 * spacing:
            break
    return step.cost(grid.points, d)[0] + spline(grid.points + d)
