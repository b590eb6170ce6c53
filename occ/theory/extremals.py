"""All extremals of the integral of Z u^2 + U(psi~) from a given angle in a given time, by their first integral.

Z u^2 - U = h along an extremal, so that each is known by its end point (or h) and by the way it takes.  A minimiser has
at most one turning point: between two turning points u, which solves Jacobi's equation, has two zeros, so that points
beyond them are conjugate.  Two families are left, straight ways and ways with one turning point, and in each the time
needed is a function of one number; where it equals the time given, there is an extremal.

Source: Gelfand, Fomin, Calculus of Variations, sections 26-28 (conjugate points); Fathi, Weak KAM theorem, chapter 3
(existence and smoothness of minimisers, Tonelli).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from occ.theory.quadrature import COARSE, FINE, Rule, Well
from occ.theory.trigonometric import TURN, value, zeros

PER_TURN = 96
"""Points of the search on each turn of the end point."""
BISECTIONS = 54
TIGHT = {"xatol": 0.0, "xrtol": 4e-16, "fatol": 0.0, "frtol": 0.0}
NEAR = 1e-6
"""Relative error of the time at which a bracket holds a root and not the end of a family."""
APART = 1e-12
"""Two points on both sides of a place where a way ends to exist."""
DECADES = np.logspace(-10, -2, 9)
"""Distances of points from a place whose way takes for ever."""


class Extremal(NamedTuple):
    """One extremal.

    Args:
        energy: [W] h.
        places: [rad] start, turning point if there is one, end.
        action: [J] integral of Z u^2 + U over the time given.
        time: [s] that the way takes; less than the time given only where rounding hides how slowly it passes a
            minimum of U.
    """

    energy: float
    places: tuple[float, ...]
    action: float
    time: float


class Problem(NamedTuple):
    """Where and how long: Z and U, psi~(0) [rad], T [s]."""

    well: Well
    start: float
    duration: float


class _Ways(NamedTuple):
    """Time, and the integral of 2 sqrt(Z (U + h)) |dpsi~|, of straight ways (row 0) and ways that turn (row 1)."""

    energy: np.ndarray  # (N,)
    turn: np.ndarray  # (N,) turning points
    time: np.ndarray  # (2, N), infinite where there is no such way
    length: np.ndarray  # (2, N)


def to_free_end(problem: Problem, slope: np.ndarray, cells: np.ndarray) -> list[Extremal]:
    """Extremals whose end is free under an end cost phi: 2 Z u_T + phi'(psi~_T) = 0 (transversality).

    Args:
        problem: Z, U, start and time.
        slope: (5,) [J/rad] phi'.
        cells: (K,) whole turns k: ends in [start + 2 pi k, start + 2 pi (k + 1)] are searched.

    Returns:
        The extremals found, in any order.
    """
    well, start, _ = problem

    def ways(end: np.ndarray, rule: Rule) -> _Ways:
        speed = -value(slope, end) / (2 * well.friction)
        energy = well.friction * speed**2 - value(well.power, end)
        side = np.where(speed > 0, -1.0, 1.0)
        turn = well.turning_point(energy, end, side)
        ahead = (start - end) * side
        passed = ahead <= (turn - end) * side
        turns = passed & np.isfinite(turn)
        (k,) = np.nonzero(turns & (ahead < 0))
        turns[k] = -ahead[k] <= (end[k] - well.turning_point(energy[k], end[k], -side[k])) * side[k]
        exists = np.stack([passed & (ahead > 0), turns])
        level = well.friction * speed**2
        start_level = np.maximum(value(well.power, start) + energy, 0.0)
        return _measured(well, (np.full_like(end, start), end), energy, (start_level, level), turn, exists, rule)

    points = _search_points(well, start, slope, cells)
    return _solved(problem, ways, points, lambda end: end, apart=10 * APART)


def _search_points(well: Well, start: float, slope: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """End points between which the time is continuous: where a way ends to exist there are two, close together."""
    grid = (start + TURN * (cells[:, None] + np.arange(PER_TURN + 1) / PER_TURN)).ravel()
    edges = _places_of_energy(well, -float(value(well.power, start)), slope, grid)
    still = zeros(slope)[:, None]
    rests = still + TURN * (cells + np.ceil((start - still) / TURN))
    edges = np.concatenate([edges, rests.ravel(), [start]])
    width = APART * np.maximum(1.0, np.abs(edges))
    # Where the way passes a minimum of U ever more slowly the time grows like a logarithm: so do the points.
    slow = np.concatenate([_places_of_energy(well, -bottom, slope, grid) for bottom in well.bottoms])
    steps = (DECADES * np.maximum(1.0, np.abs(slow))[:, None]).ravel()
    slow = np.repeat(slow, len(DECADES))
    return np.unique(np.concatenate([grid, edges - width, edges + width, slow - steps, slow + steps]))


def _places_of_energy(well: Well, energy: float, slope: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """End points at which transversality asks for an energy constant h [W], by bisection between those of a grid."""

    def above(x: np.ndarray) -> np.ndarray:
        return value(slope, x) ** 2 / (4 * well.friction) - value(well.power, x) >= energy

    values = above(grid)
    change = np.flatnonzero((values[1:] != values[:-1]) & (np.diff(grid) < TURN / 2))
    low, high, rising = grid[change], grid[change + 1], values[change + 1]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        right = above(middle) == rising
        low, high = np.where(right, low, middle), np.where(right, middle, high)
    return low


def to_fixed_end(problem: Problem, end: float) -> list[Extremal]:
    """Extremals between two angles.

    Args:
        problem: Z, U, start and time.
        end: [rad] psi~(T), on the real line: full turns count.

    Returns:
        The extremals found, in any order.
    """
    well, start, duration = problem
    low, high = min(start, end), max(start, end)
    ends = np.array([start, end])
    between = low + np.mod(well.minima - low, TURN)
    inside = between < high
    floor = min(float(value(well.power, ends).min()), *np.where(inside, well.bottoms, np.inf))
    scale = max(float(np.abs(well.power).sum()), well.friction * ((high - low) / duration) ** 2)
    found = []
    if high - low <= APART and well.is_critical(start):
        rest = float(value(well.power, start))
        found.append(Extremal(-rest, (start, end), rest * duration, duration))
    # Straight ways: the time falls from its largest value as the energy constant rises.
    straight = np.concatenate([[0.0], np.logspace(-15, 6, 43) * scale]) - floor
    ways = _fixed_ways(well, start, end, 0.0)
    found += _solved(problem, ways, straight, lambda h: np.full_like(h, end))
    barriers = np.sort(np.append(-well.bottoms[well.bottoms < floor], -floor))
    share = 1 / (1 + np.exp(-np.linspace(-36, 36, 61)))
    for side in (1.0, -1.0):
        for first, last in pairwise(barriers):
            energies = first + (last - first) * np.concatenate([[0.0], share, [1.0]])
            ways = _fixed_ways(well, start, end, side)
            found += _solved(problem, ways, energies, lambda h: np.full_like(h, end))
    return found


def _fixed_ways(well: Well, start: float, end: float, side: float) -> Callable[[np.ndarray, Rule], _Ways]:
    """Ways between two angles for given energy constants; side 0 is the straight one."""
    outer = max(start, end) if side > 0 else min(start, end)
    between = np.mod(well.minima - min(start, end), TURN) <= abs(end - start)
    lowest = float(np.min(well.bottoms, where=between, initial=np.inf))

    def ways(energy: np.ndarray, rule: Rule) -> _Ways:
        def level(x: float) -> np.ndarray:
            return np.maximum(value(well.power, x) + energy, 0.0)

        sides = np.full_like(energy, side)
        turn = well.turning_point(energy, np.full_like(energy, outer), sides) if side else np.full_like(energy, np.inf)
        # A minimum of U on the way would take for ever at its own level.
        passable = (energy >= -float(value(well.power, np.array([start, end])).min())) & (energy > -lowest)
        exists = np.stack([passable & (side == 0), passable & np.isfinite(turn)])
        places = np.full_like(energy, start), np.full_like(energy, end)
        return _measured(well, places, energy, (level(start), level(end)), turn, exists, rule)

    return ways


def _measured(
    well: Well,
    ends: tuple[np.ndarray, np.ndarray],
    energy: np.ndarray,
    levels: tuple[np.ndarray, np.ndarray],
    turn: np.ndarray,
    exists: np.ndarray,
    rule: Rule,
) -> _Ways:
    time, length = np.full((2, len(energy)), np.inf), np.zeros((2, len(energy)))
    (k,), (j,) = np.nonzero(exists[0]), np.nonzero(exists[1])
    start, end, h = ends[0], ends[1], energy
    zero = np.zeros(len(j))
    # One call for the straight ways and for both legs of the others.
    legs = well.integrals(
        (np.concatenate([start[k], start[j], end[j]]), np.concatenate([end[k], turn[j], turn[j]])),
        np.concatenate([h[k], h[j], h[j]]),
        (
            np.concatenate([levels[0][k], levels[0][j], levels[1][j]]),
            np.concatenate([levels[1][k], zero, zero]),
        ),
        rule,
    )
    for result, values in ((time, legs[0]), (length, legs[1])):
        first, second, third = np.split(values, [len(k), len(k) + len(j)])
        result[0, k], result[1, j] = first, second + third
    return _Ways(energy, turn, time, length)


def _solved(
    problem: Problem,
    ways: Callable[[np.ndarray, Rule], _Ways],
    points: np.ndarray,
    end_of: Callable[[np.ndarray], np.ndarray],
    apart: float = 0.0,
) -> list[Extremal]:
    """The ways that take the time given, from sign changes between the points and bisection."""
    well, start, duration = problem
    early = ways(points, COARSE).time < duration
    rows, columns = np.nonzero((early[:, 1:] != early[:, :-1]) & (np.diff(points) > apart))
    if not rows.size:
        return []
    from scipy.optimize.elementwise import find_root

    def haste(x: np.ndarray, row: np.ndarray) -> np.ndarray:
        # Finite where there is no way, and where a way passes a minimum of U infinitely slowly.
        return 1 / np.take_along_axis(ways(x, FINE).time, row[None, :], axis=0)[0] - 1 / duration

    bracket = (points[columns], points[columns + 1])
    root = find_root(haste, bracket, args=(rows,), tolerances=TIGHT)
    # Of both ends of a bracket the one that comes in time exists for certain; a bracket is not closed around an exact
    # root.
    x = np.where(root.f_x == 0, root.x, np.where(early[rows, columns], *root.bracket))
    count = np.arange(len(rows))
    found = ways(x, FINE)
    time, length = found.time[rows, count], found.length[rows, count]
    places = end_of(x)
    return [
        Extremal(
            energy=float(found.energy[i]),
            places=(start, float(places[i])) if rows[i] == 0 else (start, float(found.turn[i]), float(places[i])),
            action=float(length[i] - found.energy[i] * duration),
            time=float(time[i]),
        )
        for i in count
        if abs(time[i] - duration) <= NEAR * duration or _hidden(well, found.energy[i])
    ]


def _hidden(well: Well, energy: float) -> bool:
    """Whether an extremal passes a minimum of U so slowly that rounding hides the time it takes."""
    return bool(np.abs(well.bottoms + energy).min() <= 1e-8 * np.abs(well.power).sum())
