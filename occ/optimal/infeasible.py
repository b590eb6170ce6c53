"""Which limits contradict each other: seen at ends that are given, or by the least relaxation from several starts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import numpy as np

from occ.optimal.attempt import Attempt, transcription_of
from occ.optimal.elastic import Relaxation, Violation, smallest_relaxation
from occ.optimal.formulation import Formulation
from occ.optimal.limits import LimitedMoment, limit_expressions, limit_names, limit_values, limited_quantities
from occ.optimal.problem import Nodes
from occ.optimal.refinement import resample
from occ.optimal.shape import EndConditions
from occ.optimal.starts import starts_of
from occ.task import Limits, Task

STARTS = 7
"""From which a motion within the limits is looked for: the relaxation has local minima, too."""
FEW = 64
"""Intervals up to which it is looked for from all of them."""
DOUBLINGS = 4
"""Of the mesh at most: conditions at more nodes need more relaxation."""
SETTLED = 2e-4
"""Change of the relaxation with the mesh below which it is finest."""
ROUNDING = 1e-9
"""Part of a limit by which a given state may pass it."""


def passed_at_ends(task: Task, ends: EndConditions) -> str:
    """The limits that a start or an end passes that nothing can change.

    Args:
        task: with its limits.
        ends: what holds at both ends.

    Returns:
        In words; empty where there are none.
    """
    given = []
    if ends.start == "given":
        start = task.state_on_program(0.0, task.start.heading, task.start.heading_rate)
        given.append((0.0, start, "where the start is given"))
    if ends.end == "law" and ends.law_end is not None:
        given.append((task.duration, ends.law_end, "where the law's end is asked for"))
    for time, state, where in given:
        violations = _violations(task, time, state[3:])
        if violations:
            return f"the limits contradict each other: {'; '.join(map(str, violations))}, {where}"
    return ""


def _violations(task: Task, time: float, velocity: np.ndarray) -> list[Violation]:
    """Limits of speeds that a state passes, the worst first."""
    # Whatever the torques do; and there is nothing else that a state alone could pass.
    limits = Limits(wheel_speed=task.limits.wheel_speed, platform_speed=task.limits.platform_speed)
    names, wheels = limited_quantities(limits), task.platform.wheel_count
    rates = np.array(task.dynamics.coefficients.wheel_rates) @ velocity
    nothing = ca.DM.zeros(wheels)
    moment = LimitedMoment(nothing, ca.DM(rates), ca.DM(velocity), nothing, ca.DM.zeros(2))
    values = np.array(ca.DM(limit_expressions(names, moment))).ravel()
    found = []
    for row, value, bound in zip(limit_names(names, wheels), values, limit_values(limits, wheels), strict=True):
        part = abs(value) / bound - 1.0
        if part > ROUNDING:
            found.append(Violation(row, float(value), float(np.copysign(bound, value)), time, part))
    return sorted(found, key=lambda violation: -violation.part)


def least_relaxation(formulation: Formulation, attempt: Attempt) -> Relaxation | None:
    """The least relaxation that is found from several starts, on meshes that are doubled until it settles.

    Args:
        formulation: of the task.
        attempt: without a solution.

    Returns:
        One that contradicts nothing where a start leads to a motion within the limits, on the mesh of the attempt; None
        where nothing may give way, or no relaxed problem could be solved.
    """
    rows, best, tried = np.arange(len(formulation.hard_limits)), None, 0
    for guess in _guesses(formulation, attempt):
        found = smallest_relaxation(attempt.transcription, attempt.numbers, guess, rows)
        tried += 1
        if found is not None and (best is None or found.part < best.part):
            best = found
        if best is not None and not best.contradicts:
            return best
    if best is None:
        return None
    transcription, edges, change = attempt.transcription, attempt.edges, 0.0
    for _ in range(DOUBLINGS):
        grid = replace(attempt.grid, edges=edges).doubled
        finer = transcription_of(transcription.problem, grid.intervals, grid.degree, grid.scheme, transcription.options)
        nodes = resample(transcription, edges, best.nodes, finer, grid.edges)
        found = smallest_relaxation(finer, formulation.numbers(finer, grid.edges), nodes, rows)
        if found is None:
            break
        change, best, transcription, edges = abs(found.part - best.part), found, finer, grid.edges
        if change <= SETTLED:
            break
    # As much again as the last doubling of the mesh has added.
    note = f" (the least found from {tried} starts, on {len(edges) - 1} intervals)"
    return replace(best, part=best.part + change, note=note)


def _guesses(formulation: Formulation, attempt: Attempt) -> Iterator[Nodes]:
    """Where the attempt began, and the starts of a search."""
    yield attempt.guess
    if attempt.grid.intervals <= FEW:
        ends = formulation.settings.ends
        for start in starts_of(formulation.task, STARTS, ends.turn, free=ends.start == "free"):
            yield formulation.guess(attempt.transcription, attempt.edges, start.rotation)
