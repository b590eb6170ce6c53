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

from occ.errors import OccError
from occ.theory.quadrature import COARSE, FINE, Legs, Rule, Well
from occ.theory.roots import Bracket, closed
from occ.theory.trigonometric import TURN, crossing, derivative, value, value_and_slope, zeros

PER_TURN = 96
"""Points of the search on each turn of the end point."""
NEAR = 1e-6
"""Relative error of the time at which a bracket holds a root and not the end of a family."""
BETWEEN = 16
"""Finer steps where two extremals may be close together."""
NOISE = 1e-15
"""Relative differences of times by the fine rule that are rounding errors."""
UNSURE = 1e-4
"""Relative difference of times that the coarse rule may get wrong."""
APART = 1e-12
"""Two points on both sides of a place where a way ends to exist."""
DECADES = np.logspace(-10, -2, 9)
"""Distances of points from a place whose way takes for ever."""


class NoExtremal(OccError):
    """No extremal was found although there is one: the least work is not known; the message says of which ends."""


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
    """Energy constant, turning point, time, and the integral of 2 sqrt(Z (U + h)) |dpsi~|."""

    energy: np.ndarray  # (N,) [W]
    turn: np.ndarray  # (N,) [rad], infinite where the way is straight
    time: np.ndarray  # (N,) [s], infinite where there is no such way
    length: np.ndarray  # (N,) [J]


class _Asked(NamedTuple):
    """Ways from the well's first cut that are to be measured, straight or with one turning point."""

    end: np.ndarray  # (2, N) places
    energy: np.ndarray  # (N,) [W] h
    start_level: np.ndarray  # (N,) [W] U + h at the start
    end_level: np.ndarray  # (N,) [W]
    side: np.ndarray  # (N,) to which the turning point lies, +1 or -1; 0 where the way is straight


class _Family(NamedTuple):
    """Ways that depend on one number x, with the row (N,) of the family that each belongs to."""

    ways: Callable[[np.ndarray, np.ndarray, Rule], _Ways]
    end: Callable[[np.ndarray, np.ndarray], np.ndarray]


def to_free_end(problem: Problem, slope: np.ndarray, cells: np.ndarray) -> list[Extremal]:
    """Extremals whose end is free under an end cost phi: 2 Z u_T + phi'(psi~_T) = 0 (transversality).

    Args:
        problem: Z, U, start and time; the well has a cut at the start.
        slope: (5,) [J/rad] phi'.
        cells: (K,) whole turns k: ends in [start + 2 pi k, start + 2 pi (k + 1)] are searched.

    Returns:
        The extremals found, in any order.
    """
    well, start, _ = problem
    # Straight ways to all cells; ways that turn do not leave the two cells beside the start.
    beside = cells[(cells == 0) | (cells == -1)]
    cell = np.concatenate([cells, beside]).astype(float)
    turns = np.arange(len(cell)) >= len(cells)

    def ways(offset: np.ndarray, row: np.ndarray, rule: Rule) -> _Ways:
        return _ways_to(problem, slope, np.array([cell[row], offset]), turns[row], rule)

    offset = _search_points(well, start, slope)
    energy, _, speed = _transversal(problem, slope, offset)
    first = np.where(speed > 0, 0.0, -1.0)
    nearest = _ways_to(problem, slope, np.array([first, offset]), np.zeros(len(offset), dtype=bool), COARSE).time
    around = np.full(len(offset), np.inf)
    (k,) = np.nonzero(energy > -well.bottom)
    level = value(well.power, start) + energy[k]
    once = np.zeros((2, 2, len(k)))
    once[1, 0] = 1.0
    around[k] = well.measured(Legs(once[0], once[1], energy[k], level, level), COARSE)[0]
    more = np.abs(cells[:, None] - first)
    with np.errstate(invalid="ignore"):
        times = nearest + np.where(more > 0, more * around, 0.0)
    times = np.where((speed > 0) == (cells[:, None] >= 0), times, np.inf)
    if beside.size:
        row = np.repeat(np.arange(len(cells), len(cell)), len(offset))
        curved = ways(np.tile(offset, len(beside)), row, COARSE).time
        times = np.concatenate([times, curved.reshape(len(beside), -1)])
    points = np.broadcast_to(offset, times.shape)
    family = _Family(ways, lambda x, row: start + (TURN * cell[row] + x))
    return _solved(problem, family, points, times, apart=10 * APART * max(1.0, abs(start)))


def _transversal(problem: Problem, slope: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Energy constant [W], U + h there [W] and u [rad/s] with which a way may end at so many radians from the start."""
    well, start, _ = problem
    end = start + offset
    speed = -value(slope, end) / (2 * well.friction)
    level = well.friction * speed**2
    return level - value(well.power, end), level, speed


def _ways_to(problem: Problem, slope: np.ndarray, place: np.ndarray, turns: np.ndarray, rule: Rule) -> _Ways:
    """The ways to ends (N,) that transversality lets end there."""
    well, start, _ = problem
    energy, level, speed = _transversal(problem, slope, place[1])
    side = np.where(turns, np.where(speed > 0, -1.0, 1.0), 0.0)
    # A straight way arrives from the side where the start is.
    wrong = ~turns & ((speed > 0) != (place[0] >= 0))
    start_level = np.where(wrong, -np.inf, value(well.power, start) + energy)
    return _measured(well, _Asked(place, energy, start_level, level, side), rule)


def _search_points(well: Well, start: float, slope: np.ndarray) -> np.ndarray:
    """End points, from the start, between which the time is continuous on every turn.

    Where a way ends to exist there are two, close together.
    """
    energies = -np.append(value(well.power, start), well.bottoms)
    place, which = _places_of_energy(well, energies, slope, start)
    rests = np.mod(zeros(slope) - start, TURN)
    edges = np.concatenate([place[which == 0], rests])
    width = APART * max(1.0, abs(start))
    # Where the way passes a minimum of U ever more slowly the time grows like a logarithm: so do the points.
    slow = place[which > 0, None] + np.concatenate([-DECADES, DECADES]) * max(1.0, abs(start))
    grid = np.arange(PER_TURN + 1) * (TURN / PER_TURN)
    points = np.concatenate([grid, edges - width, edges + width, slow.ravel(), [width, TURN - width]])
    return np.unique(points[(points >= 0) & (points <= TURN)])


def _places_of_energy(
    well: Well, energies: np.ndarray, slope: np.ndarray, start: float
) -> tuple[np.ndarray, np.ndarray]:
    """End points, from the start, at which transversality asks for one of several h [W], and for which of them."""
    bend = derivative(slope)

    def energy(offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = start + offset
        push, (power, rise) = value(slope, x), value_and_slope(well.power, x)
        return push**2 / (4 * well.friction) - power, push * value(bend, x) / (2 * well.friction) - rise

    grid = np.arange(PER_TURN + 1) * (TURN / PER_TURN)
    above = energy(grid)[0] >= energies[:, None]
    which, cell = np.nonzero(above[:, 1:] != above[:, :-1])

    def excess(offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        level, rise = energy(offset)
        return level - energies[which], rise

    return crossing(excess, (grid[cell], grid[cell + 1]), ~above[which, cell]), which


def to_fixed_end(problem: Problem, end: float) -> list[Extremal]:
    """Extremals between two angles.

    Args:
        problem: Z, U, start and time; the well has cuts at the start and at the end.
        end: [rad] psi~(T), on the real line: full turns count.

    Returns:
        The extremals found, in any order.
    """
    well, start, duration = problem
    here, last = well.places(np.array([start])), well.places(np.array([end]))
    order = (here, last) if start <= end else (last, here)
    levels = value(well.power, np.array([start, end]))
    # A minimum of U on the way would take for ever at its own level.
    floor = min(float(levels.min()), float(well.lowest_between(*order)[0]))
    found = []
    if abs(end - start) <= APART and well.is_critical(start):
        rest = float(levels[0])
        found.append(Extremal(-rest, (start, end), rest * duration, duration))
    # Straight ways: the time falls from its largest value as the energy constant rises.
    scale = max(float(np.abs(well.power).sum()), well.friction * ((end - start) / duration) ** 2)
    families = [(0.0, np.concatenate([[0.0], np.logspace(-15, 6, 43) * scale]) - floor)]
    barriers = np.sort(np.append(-well.bottoms[well.bottoms < floor], -floor))
    share = np.append(0.0, 1 / (1 + np.exp(-np.linspace(-36, 36, 61))))
    # The last one bars the way: not even rounding may let it be below.
    families += [
        (side, np.append(low + (high - low) * share, high)) for side in (1.0, -1.0) for low, high in pairwise(barriers)
    ]
    side = np.array([family[0] for family in families])

    def ways(h: np.ndarray, row: np.ndarray, rule: Rule) -> _Ways:
        return _measured(
            well, _Asked(np.repeat(last, len(h), axis=1), h, levels[0] + h, levels[1] + h, side[row]), rule
        )

    # The shorter families repeat their last point.
    count = max(len(energies) for _, energies in families)
    points = np.array([np.pad(energies, (0, count - len(energies)), mode="edge") for _, energies in families])
    row = np.repeat(np.arange(len(side)), count)
    times = ways(points.ravel(), row, COARSE).time.reshape(points.shape)
    return _solved(problem, _Family(ways, lambda h, row: np.full_like(h, end)), points, times)


def _measured(well: Well, asked: _Asked, rule: Rule) -> _Ways:
    end, energy, start_level, end_level, side = asked
    upward = end[0] >= 0
    ends = np.array([np.where(upward, 0.0, end), np.where(upward, end, 0.0)])
    levels = np.array([start_level, end_level])
    exists = (levels.min(axis=0) >= 0) & (well.lowest_between(*ends) + energy > 0)
    levels = np.where(upward, levels, levels[::-1])
    (j,) = np.nonzero(exists & (side != 0))
    # The way to the turning point begins at the upper or at the lower of the two ends.
    upper = (side[j] > 0).astype(np.int64)
    outer = ends[upper, :, j].T
    way = well.way_to_turning_point(energy[j], outer, side[j])
    turns = np.isfinite(way)
    exists[j] = turns
    j, upper, outer, way = j[turns], upper[turns], outer[:, turns], way[turns]
    bend = well.moved(outer, side[j] * way)
    (k,) = np.nonzero(exists)
    ahead = upper > 0
    level = levels[upper, j]
    legs = Legs(
        np.concatenate([ends[0][:, k], np.where(ahead, outer, bend)], axis=1),
        np.concatenate([ends[1][:, k], np.where(ahead, bend, outer)], axis=1),
        np.concatenate([energy[k], energy[j]]),
        np.concatenate([levels[0, k], np.where(ahead, level, 0.0)]),
        np.concatenate([levels[1, k], np.where(ahead, 0.0, level)]),
    )
    time, length = np.full(len(exists), np.inf), np.zeros(len(exists))
    for result, parts in zip((time, length), well.measured(legs, rule), strict=True):
        result[k] = parts[: len(k)]
        # There and back.
        result[j] += 2 * parts[len(k) :]
    turn = np.full(len(exists), np.inf)
    turn[j] = well.angles(bend)
    return _Ways(energy, turn, time, length)


def _solved(
    problem: Problem, family: _Family, points: np.ndarray, times: np.ndarray, apart: float = 0.0
) -> list[Extremal]:
    """The ways that take the time given, from sign changes between the points and bisection.

    Args:
        problem: with the time given.
        family: of the ways.
        points: (R, P) x, increasing along the rows of the family.
        times: (R, P) [s] by the coarse rule.
        apart: width of brackets that hold no root.

    Returns:
        The extremals found.
    """
    well, start, duration = problem
    row = np.arange(len(points))
    between, column = np.nonzero(_turning_back(times, duration) & (np.diff(points, axis=1) > apart))
    brackets = [_brackets(problem, family, row, points, times, apart)]
    if between.size:
        first, last = points[between, column], points[between, column + 1]
        finer = first[:, None] + (last - first)[:, None] * np.linspace(0, 1, BETWEEN + 1)
        again = np.repeat(between, BETWEEN + 1)
        closer = family.ways(finer.ravel(), again, COARSE).time.reshape(finer.shape)
        brackets.append(_brackets(problem, family, between, finer, closer, apart))
    row, ends, values = (np.concatenate(parts, axis=-1) for parts in zip(*brackets, strict=True))
    if not row.size:
        return []

    def haste(x: np.ndarray, which: np.ndarray) -> np.ndarray:
        # Finite where there is no way, and where a way passes a minimum of U infinitely slowly.
        early = 1 / family.ways(x, row[which], FINE).time - 1 / duration
        return np.where(np.abs(early) * duration <= NOISE, 0.0, early)

    # The side on which a way comes in time exists for certain.
    x = closed(haste, Bracket(ends, values))
    found, place = family.ways(x, row, FINE), family.end(x, row)
    return [
        Extremal(
            energy=float(found.energy[i]),
            places=(start, *([float(found.turn[i])] if np.isfinite(found.turn[i]) else []), float(place[i])),
            action=float(found.length[i] - found.energy[i] * duration),
            time=float(found.time[i]),
        )
        for i in range(len(row))
        if abs(found.time[i] - duration) <= NEAR * duration or _hidden(well, found.energy[i])
    ]


def _brackets(
    problem: Problem, family: _Family, row: np.ndarray, points: np.ndarray, times: np.ndarray, apart: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row (N,), ends (2, N) and the values there, 1/time - 1/duration, where the time given is passed."""
    duration = problem.duration
    # Where the coarse rule may be wrong about who is early the fine one decides.
    near = np.nonzero(np.abs(times - duration) <= UNSURE * duration)
    if near[0].size:
        times = times.copy()
        times[near] = family.ways(points[near], row[near[0]], FINE).time
    early = times < duration
    place, column = np.nonzero((early[:, 1:] != early[:, :-1]) & (np.diff(points, axis=1) > apart))
    ends = np.array([column, column + 1])
    with np.errstate(divide="ignore"):
        return row[place], points[place, ends], 1 / times[place, ends] - 1 / duration


def _turning_back(times: np.ndarray, duration: float) -> np.ndarray:
    """(R, P - 1) The steps beside a point where the time is extreme and so near the one given that it may pass it."""
    with np.errstate(invalid="ignore"):
        step, missing = np.diff(times, axis=1), np.abs(times[:, 1:-1] - duration)
        largest = np.maximum(np.abs(step[:, 1:]), np.abs(step[:, :-1]))
        extreme = (step[:, 1:] * step[:, :-1] <= 0) & (missing <= largest) & np.isfinite(largest)
    early = times < duration
    extreme &= (early[:, 1:-1] == early[:, 2:]) & (early[:, 1:-1] == early[:, :-2])
    steps = np.zeros(step.shape, dtype=bool)
    steps[:, 1:] |= extreme
    steps[:, :-1] |= extreme
    return steps


def _hidden(well: Well, energy: float) -> bool:
    """Whether an extremal passes a minimum of U so slowly that rounding hides the time it takes."""
    return bool(np.abs(well.bottoms + energy).min() <= 1e-8 * np.abs(well.power).sum())
