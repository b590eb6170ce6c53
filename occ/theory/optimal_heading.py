"""The optimal heading over time, with its jumps at the ends: what `occ.theory.minimum_work` has found, as a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.task import Task
from occ.theory.dissipation import circle_of, energy_of
from occ.theory.extremals import Extremal
from occ.theory.quadrature import FINE, Well
from occ.theory.trigonometric import TURN, value

SPREAD = 24.0
"""Places on a piece reach within e^-24 of its ends, where an extremal may dwell."""


@dataclass(frozen=True)
class OptimalHeading:
    """psi(t) of the infimum; the yaw rate jumps at both ends.

    Args:
        t: (N,) [s].
        heading: (N,) [rad] psi.
        yaw_rate: (N,) [rad/s] Omega between the jumps.
        jump_at_start: [rad/s] from the given Omega(0) to the first yaw rate.
        jump_at_end: [rad/s] from the last yaw rate to the one after the end.
    """

    t: np.ndarray
    heading: np.ndarray
    yaw_rate: np.ndarray
    jump_at_start: float
    jump_at_end: float


def optimal_heading(
    task: Task, extremal: Extremal, end_rate: float | None = None, per_piece: int = 81
) -> OptimalHeading:
    """psi(t), Omega(t) of an extremal, by quadrature.

    Args:
        task: on a circle.
        extremal: of its least work.
        end_rate: [rad/s] yaw rate after the end; None for the one of least kinetic energy (a free end).
        per_piece: places between neighbouring extrema of U.

    Returns:
        The motion between the jumps, and the jumps.
    """
    circle = circle_of(task)
    energy = energy_of(task.platform, task.point, circle)
    well = Well(float(energy.friction), energy.power)
    times, places, speeds = [np.zeros(1)], [np.array(extremal.places[:1])], []
    before = 0.0
    for k, (a, b) in enumerate(zip(extremal.places[:-1], extremal.places[1:], strict=True)):
        x = _places(well, a, b, per_piece)
        # Times are counted from the end of the leg that is not a turning point.
        turns_at_end = k == 0 and len(extremal.places) == 3
        base = a if turns_at_end or len(extremal.places) == 2 else b
        time = _time_from(well, extremal.energy, base, x)
        whole = _time_from(well, extremal.energy, base, np.array([b if base == a else a]))[0]
        times.append(before + (time if base == a else whole - time))
        places.append(x)
        speeds.append(np.sign(b - a))
        before += whole
    t, x = np.concatenate(times), np.concatenate(places)
    level = np.maximum(value(well.power, x) + extremal.energy, 0.0)
    direction = np.concatenate([[speeds[0]], *(np.full(len(p), s) for p, s in zip(places[1:], speeds, strict=True))])
    # Rounding hides how long an extremal dwells at the slowest place; the total is known.
    slowest = int(np.argmin(level))
    t = np.maximum.accumulate(t + np.where(np.arange(len(t)) > slowest, task.duration - t[-1], 0.0))
    yaw_rate = circle.rate + direction * np.sqrt(level / well.friction)
    final = end_rate
    if final is None:
        final = -float(value(energy.coupling, x[-1]) / energy.inertia)
    return OptimalHeading(
        t,
        x + circle.phase + circle.rate * t,
        yaw_rate,
        jump_at_start=float(yaw_rate[0] - task.start.heading_rate),
        jump_at_end=float(final - yaw_rate[-1]),
    )


def _places(well: Well, a: float, b: float, count: int) -> np.ndarray:
    """From a to b, without a, dense at the extrema of U where time passes without way."""
    low, high = min(a, b), max(a, b)
    cuts = np.concatenate([well.minima, well.maxima])
    turns = np.arange(np.ceil((high - low) / TURN) + 1)
    inside = (low + np.mod(cuts - low, TURN)[:, None] + TURN * turns).ravel()
    edges = np.unique(np.concatenate([[low], inside[(inside > low) & (inside < high)], [high]]))
    share = 1 / (1 + np.exp(-np.linspace(-SPREAD, SPREAD, count)))
    pieces = edges[:-1, None] + np.diff(edges)[:, None] * share
    x = np.unique(np.concatenate([pieces.ravel(), edges]))
    return x[1:] if b > a else x[-2::-1]


def _time_from(well: Well, energy: float, base: float, x: np.ndarray) -> np.ndarray:
    """[s] From the angle `base` to each of the angles x on the same leg."""
    h = np.full_like(x, energy)
    start = np.full_like(x, base)
    levels = (np.maximum(value(well.power, y) + energy, 0.0) for y in (start, x))
    first, last = levels
    return well.integrals((start, x), h, (first, last), FINE)[0]
