"""The least work of the control forces on a circle, exactly: the best of all extremals.

With the energies of `occ.theory.dissipation` the work is

    W = integral of (Z u^2 + U) dt + [2 Z omega_B psi~ + 2 G]_0^T + T(psi~_T, Omega_T) - T(psi~_0, Omega_0).

The torques enter through the kinetic energy only: without limits on them Omega jumps at both ends at the price of
kinetic energy alone, so that the least work is an infimum, which ever larger and shorter torques approach.  What is
left is a problem of the calculus of variations in psi~, and all its extremals are known from their first integral.
Where the end is free, the last jump is to the yaw rate of least kinetic energy, T_min(psi~_T).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occ.errors import InputError
from occ.task import EndClass, Task
from occ.theory.dissipation import CircleEnergy, circle_of, energy_of
from occ.theory.extremals import Extremal, NoExtremal, Problem, to_fixed_end, to_free_end
from occ.theory.quadrature import COARSE, Well
from occ.theory.trigonometric import TURN, derivative, least, value

MOST_TURNS = 200_000
"""Full turns beyond which an end is not searched for."""


@dataclass(frozen=True)
class LeastWork:
    """The infimum of the work over all motions from one start to one class of ends.

    Args:
        work: [J].
        extremal: the optimal way in psi~; None where nothing resists the rotation, so that it costs no time.
        start_kinetic_energy: [J] before the jump at the start.
        end_kinetic_energy: [J] after the jump at the end.
        candidates: number of extremals that were compared.
        end_force: by how much the infimum changes with the end state, per rad and per rad/s; 0 where the end is free.
    """

    work: float
    extremal: Extremal | None
    start_kinetic_energy: float
    end_kinetic_energy: float
    candidates: int
    end_force: float = 0.0

    @property
    def scale(self) -> float:
        """[J] Size of the terms of which the infimum is the sum: its rounding error is relative to this."""
        action = abs(self.extremal.action) if self.extremal else 0.0
        return abs(self.work) + 2 * action + self.start_kinetic_energy + self.end_kinetic_energy


def least_work_free_end(energy: CircleEnergy, start: float, start_energy: float, duration: float) -> LeastWork:
    """inf W over all motions with B on its program from a given start, the end free.

    Args:
        energy: of one platform on one circle.
        start: [rad] psi~(0).
        start_energy: [J] kinetic energy at the start.
        duration: [s] T.

    Returns:
        The global infimum.

    Raises:
        InputError: more turns than are searched for.
        NoExtremal: the search found none.
    """
    rest = energy.rest_of_yaw
    if not _resists(energy):
        bottom = _least(rest)
        return LeastWork(_idle(energy, duration) + bottom - start_energy, None, start_energy, bottom, 0)
    well = Well(float(energy.friction), energy.power, (start,))
    slope = derivative(rest) + 2 * energy.drag
    slope[0] += 2 * energy.friction * energy.rate

    def total(extremal: Extremal) -> float:
        return float(_from_end_points(energy, extremal.places) + extremal.action + value(rest, extremal.places[-1]))

    problem = Problem(well, start, duration)
    cells = _Cells(well, energy, duration).worth_searching(start, rest)
    found = to_free_end(problem, slope, cells)
    winner = _winner(found, total, problem, "a free end")
    end_energy = float(value(rest, winner.places[-1]))
    return LeastWork(total(winner) - start_energy, winner, start_energy, end_energy, len(found))


def least_work_fixed_end(
    energy: CircleEnergy, start: float, end: float, kinetic_energies: tuple[float, float], duration: float
) -> LeastWork:
    """inf W over all motions with B on its program between two states.

    Args:
        energy: of one platform on one circle.
        start: [rad] psi~(0).
        end: [rad] psi~(T), on the real line: full turns count.
        kinetic_energies: [J] at the start and at the end.
        duration: [s] T.

    Returns:
        The global infimum.

    Raises:
        NoExtremal: the search found none.
    """
    change = kinetic_energies[1] - kinetic_energies[0]
    if not _resists(energy):
        return LeastWork(_idle(energy, duration) + change, None, *kinetic_energies, 0)
    problem = Problem(Well(float(energy.friction), energy.power, (start, end)), start, duration)
    found = to_fixed_end(problem, end)
    winner = _winner(found, lambda item: item.action, problem, f"psi~ = {end:.6g} rad")
    work = winner.action + float(_from_end_points(energy, winner.places)) + change
    return LeastWork(work, winner, *kinetic_energies, len(found), _end_force(energy, winner, kinetic_energies[1]))


def least_work_of_a_cycle(energy: CircleEnergy, turn: float, duration: float) -> LeastWork:
    """inf W over all motions whose start is chosen and is their end again, psi~ being `turn` further.

    Without a turn it is best to stand where U is least.  With one, the cycle goes round steadily: by symmetry in time
    it may start anywhere.

    Args:
        energy: of one platform on one circle.
        turn: [rad] psi~(T) - psi~(0), full turns.
        duration: [s] T.

    Returns:
        The global infimum; kinetic energy cancels.

    Raises:
        NoExtremal: the search found none.
    """
    if not _resists(energy):
        return LeastWork(_idle(energy, duration), None, 0.0, 0.0, 0)
    well = Well(float(energy.friction), energy.power)
    bottom = float(well.minima[np.argmin(well.bottoms)])
    well = Well(float(energy.friction), energy.power, (bottom,))
    if turn == 0:
        winner = Extremal(-well.bottom, (bottom, bottom), well.bottom * duration, duration)
        return LeastWork(winner.action, winner, 0.0, 0.0, 1)
    # From one bottom to the next the straight way is the only one that keeps its energy constant above all of U.
    problem, end = Problem(well, bottom, duration), bottom + turn
    straight = [way for way in to_fixed_end(problem, end) if len(way.places) == 2]
    winner = _winner(straight, lambda item: item.action, problem, f"psi~ = {end:.6g} rad")
    work = winner.action + float(_from_end_points(energy, winner.places))
    return LeastWork(work, winner, 0.0, 0.0, len(straight), _end_force(energy, winner, 0.0))


def _winner(found: list[Extremal], cost: Callable[[Extremal], float], problem: Problem, end: str) -> Extremal:
    """The extremal of least cost.

    Raises:
        NoExtremal: there is none among those found.
    """
    if not found:
        raise NoExtremal(
            f"least work: no extremal was found from psi~ = {problem.start:.6g} rad to {end} in "
            f"{problem.duration:.6g} s, although there is one; a slightly different start or duration may tell"
        )
    return min(found, key=cost)


def _end_force(energy: CircleEnergy, extremal: Extremal, kinetic_energy: float) -> float:
    """An upper bound of |dW/dpsi~| + |dW/dOmega| at the end, which is small wherever the motion is slow."""
    end = extremal.places[-1]
    level = max(float(value(energy.power, end)) + extremal.energy, 0.0)
    force = 2 * math.sqrt(float(energy.friction) * level) + 2 * float(
        abs(energy.friction * energy.rate) + np.hypot(energy.drag[1], energy.drag[2])
    )
    # T is a quadratic form of the velocities: its slope in Omega is at most sqrt(2 J_a T), its terms in psi~ small.
    coupling = float(np.abs(energy.coupling).sum() + 2 * np.abs(energy.translation).sum())
    return force + math.sqrt(2 * float(energy.inertia) * kinetic_energy) + coupling


def _resists(energy: CircleEnergy) -> bool:
    return bool(energy.friction > 1e-12 * max(float(energy.inertia), 1e-12))


def _idle(energy: CircleEnergy, duration: float) -> float:
    """[J] Without friction against the rotation the heading goes at once where translation costs least."""
    return duration * _least(energy.power)


def _from_end_points(energy: CircleEnergy, places: tuple[float, ...]) -> np.ndarray:
    return energy.of_end_points(places[-1]) - energy.of_end_points(places[0])


def _least(p: np.ndarray) -> float:
    """The least value of one trigonometric polynomial."""
    return float(least(p[:, None])[1][0])


class _Cells:
    """Ends that lie k to k + 1 turns from the start, and which of them can hold the least work.

    Z u^2 + U >= 2 sqrt(Z (U + h)) |u| - h for every h >= -min U, so that n full turns cost at least n times the
    integral of the root, less h T: a table in h gives each cell a floor.  Ways that may be taken give a ceiling.
    """

    def __init__(self, well: Well, energy: CircleEnergy, duration: float) -> None:
        self.well, self.energy, self.duration = well, energy, duration
        reach = abs(float(energy.rate)) * duration
        swing = float(np.ptp(value(energy.power, np.linspace(0, TURN, 64)))) + 1e-12
        furthest = (reach + math.sqrt(reach**2 + swing * duration**2 / well.friction)) / TURN + 3
        if furthest > MOST_TURNS:
            raise InputError(
                f"duration: least work is searched for up to {MOST_TURNS} turns; {duration:g} s allow {furthest:.3g}, "
                "so the duration should be shorter (occ.theory.long_run answers for the long run)"
            )
        self.cells = np.arange(-int(furthest), int(furthest))
        scale = max(np.abs(energy.power).sum(), well.friction * energy.rate**2)
        self.above = np.concatenate([[0.0], np.logspace(-8, 3, 40) * scale])
        self.h = self.above - well.bottom

    def worth_searching(self, start: float, rest: np.ndarray) -> np.ndarray:
        """The cells whose floor is not above the ceiling.

        Args:
            start: [rad] psi~(0).
            rest: (5,) [J] T_min.

        Returns:
            (K,) whole turns.
        """
        of_end = rest + np.array([0, -2 * self.energy.drag[2], 2 * self.energy.drag[1], 0, 0])
        time, length = self._around()
        turns = np.where(self.cells >= 0, self.cells, -self.cells - 1)
        floors = np.max(length[:, None] * turns - (self.h * self.duration)[:, None], axis=0)
        force = 2 * float(self.energy.friction * self.energy.rate) * TURN
        floors += np.minimum(force * self.cells, force * (self.cells + 1)) + _least(of_end)
        turned = self._rotating(time, length, force) + float(value(of_end, start))
        ceiling = min(self._waiting(start, of_end), turned)
        return self.cells[floors <= ceiling + 1e-9 * abs(ceiling)]

    def of_turns(self, turns: np.ndarray) -> np.ndarray:
        """[J] Floors of the work of cycles in which psi~ makes so many full turns; kinetic energy cancels."""
        _, length = self._around()
        floors = np.max(length[:, None] * np.abs(turns) - (self.h * self.duration)[:, None], axis=0)
        return np.asarray(floors + 2 * float(self.energy.friction * self.energy.rate) * TURN * turns)

    def _around(self) -> tuple[np.ndarray, np.ndarray]:
        """Time and length of one turn at each level above the bottom of U."""
        bottom = self.well.minima[np.argmin(self.well.bottoms)]
        ends = np.full_like(self.h, bottom), np.full_like(self.h, bottom + TURN)
        return self.well.integrals(ends, self.h, (self.above, self.above), COARSE)

    def _waiting(self, start: float, of_end: np.ndarray) -> float:
        """[J] Going to the bottom of U, on either side, and waiting there."""
        bottom = self.well.minima[np.argmin(self.well.bottoms)]
        after = start + np.mod(bottom - start, TURN)
        ends = np.repeat([after, after - TURN], len(self.h))
        h, above = np.tile(self.h, 2), np.tile(self.above, 2)
        levels = value(self.well.power, start) + h, above
        time, length = self.well.integrals((np.full_like(ends, start), ends), h, levels, COARSE)
        work = length - h * time + (self.duration - time) * self.well.bottom
        work += 2 * self.energy.friction * self.energy.rate * (ends - start) + value(of_end, ends)
        return float(work[time <= self.duration].min(initial=np.inf))

    def _rotating(self, time: np.ndarray, length: np.ndarray, force: float) -> float:
        """[J] Whole turns at the same level, and waiting at the bottom of U; none costs what U does at the worst."""
        turns = np.abs(self.cells)
        left = self.duration - time[:, None] * turns
        with np.errstate(invalid="ignore"):
            work = (length - self.h * time)[:, None] * turns + left * self.well.bottom + force * self.cells
        work[:, turns == 0] = self.duration * np.abs(self.energy.power).sum()
        return float(work[left >= 0].min(initial=np.inf))


def minimum_work(
    task: Task,
    end: EndClass = "free",
    end_state: np.ndarray | None = None,
    winding: int | None = None,
    free_start: bool = False,
) -> LeastWork:
    """The least work on a circle for a class of starts and ends of section 4.3.

    Args:
        task: whose program motion is a circle.
        end: ``free``; ``law`` with the law's `end_state`; ``periodic``; ``rest`` is impossible on a circle.
        end_state: (6,) at the end, where it is given.
        winding: net full turns of the heading, where the end is ``periodic``; None for the best.
        free_start: whether the start is chosen, too (``periodic`` only).

    Returns:
        The infimum without torque limits; limits can only raise it.

    Raises:
        InputError: a motion that is not a circle, or an end that is not defined there.
        NoExtremal: the search found none.
    """
    circle = circle_of(task)
    energy = energy_of(task.platform, task.point, circle)
    start = task.start.heading - circle.phase
    first = float(energy.kinetic_energy(start, task.start.heading_rate))
    program = circle.rate * task.duration
    if end == "free":
        return least_work_free_end(energy, start, first, task.duration)
    if end == "law" and end_state is not None:
        place = float(end_state[2]) - circle.phase - program
        last = float(energy.kinetic_energy(place, float(end_state[5])))
        return least_work_fixed_end(energy, start, place, (first, last), task.duration)
    if end == "periodic":
        turns = round(program / TURN)
        if abs(program - TURN * turns) > 1e-9 * max(1.0, abs(program)):
            raise InputError("duration: a periodic end needs a whole number of laps")
        choices = np.arange(min(0, turns) - 2, max(0, turns) + 3) if winding is None else np.array([winding])
        return _best_winding(energy, choices - turns, start, None if free_start else first, task.duration)
    raise InputError(
        f"end: least work on a circle is known for 'free', 'law' (with its state) and 'periodic', not {end!r}"
    )


def _best_winding(
    energy: CircleEnergy, turns: np.ndarray, start: float, kinetic_energy: float | None, duration: float
) -> LeastWork:
    """The least work over so many full turns of psi~; the start is chosen where it has no kinetic energy."""
    if len(turns) > 1 and _resists(energy):
        floors = _Cells(Well(float(energy.friction), energy.power), energy, duration).of_turns(turns)
        order = np.argsort(floors)
        turns, floors = turns[order], floors[order]
    else:
        floors = np.full(len(turns), -np.inf)
    best: LeastWork | None = None
    for turn, floor in zip(TURN * turns, floors, strict=True):
        if best is not None and floor > best.work + 1e-9 * best.scale:
            break
        if kinetic_energy is None:
            found = least_work_of_a_cycle(energy, float(turn), duration)
        else:
            ends = (kinetic_energy, kinetic_energy)
            found = least_work_fixed_end(energy, start, start + float(turn), ends, duration)
        if best is None or found.work < best.work:
            best = found
    assert best is not None
    return best
