"""What the optimum of a cost without curvature in the torques looks like: jumps of the velocity and singular arcs.

Signed work sees the torques through the kinetic energy only.  Its optimum jumps on to an arc on which the switching
function vanishes identically and jumps off it at the end; a mesh turns each jump into a layer as wide as its interval,
so that the largest torque grows with the mesh while the cost converges.  Under limits the jumps become bang arcs, on
which the switching function tells which way the control would go.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from occ.errors import Status
from occ.optimal.attempt import Attempt, transcription_of
from occ.optimal.formulation import Formulation
from occ.optimal.limits import NEEDS_NULL_TORQUE, rows_of
from occ.optimal.solvers import SolverOptions
from occ.optimal.switching import Switching, switching

STEEP = 20.0
"""Yaw accelerations this many times the typical one belong to a layer."""
SMALLEST = 1e-3
"""Jumps below this part of the largest yaw rate are not worth a word."""

GROWS = 1.2
"""Growth of the control on a doubled mesh from which on it is not bounded."""
VANISHES = 1e-3, 1e-8
"""The switching function counts as zero below this part of its largest value, and of max(1, |J|)."""
ON_LIMIT = 1e-2
"""A quantity this near to its limit, relative to it, is on it: back-offs take off less."""
HELD = "a held control"
"""What stands for a limit where a back-off holds the control of an interval in which it jumps."""
UNSEEN = "no limit that is seen"
"""Stands for a limit where the switching function does not vanish and nothing is found that holds the control."""


@dataclass(frozen=True)
class Arc:
    """A run of intervals on which the switching function vanishes, or does not.

    Args:
        start: [s].
        end: [s].
        limits: names of the quantities that reach their limits on it; empty on a singular arc.
    """

    start: float
    end: float
    limits: tuple[str, ...]


@dataclass(frozen=True)
class Layer:
    """A jump of the yaw rate.

    Args:
        t: [s] where it begins.
        width: [s] over which the mesh spreads it.
        jump: [rad/s] change of the yaw rate.
        torque: [N m] largest wheel torque inside it.
    """

    t: float
    width: float
    jump: float


def layers(edges: np.ndarray, yaw_rates: np.ndarray) -> list[Layer]:
    """Runs of intervals in which the yaw rate changes much faster than elsewhere.

    Args:
        edges: (N + 1,) [s].
        yaw_rates: (N + 1,) [rad/s].

    Returns:
        In the order of time.
    """
    widths, changes = np.diff(edges), np.diff(yaw_rates)
    slopes = np.abs(changes) / widths
    # The typical slope over time, not over intervals: a graded mesh has most of its intervals in the layers.
    order = np.argsort(slopes)
    half = int(np.searchsorted(np.cumsum(widths[order]), (edges[-1] - edges[0]) / 2))
    scale = np.abs(yaw_rates).max(initial=1e-12)
    typical = max(slopes[order[half]], scale / (edges[-1] - edges[0]))
    steep = np.concatenate([[False], slopes > STEEP * typical, [False]])
    begins, ends = np.flatnonzero(~steep[:-1] & steep[1:]), np.flatnonzero(steep[:-1] & ~steep[1:])
    found = [
        Layer(float(edges[a]), float(edges[b] - edges[a]), float(yaw_rates[b] - yaw_rates[a]))
        for a, b in zip(begins, ends, strict=True)
    ]
    return [layer for layer in found if abs(layer.jump) > SMALLEST * scale]


def arcs_of(formulation: Formulation, attempt: Attempt, found: Switching) -> list[Arc]:
    """Bang arcs, on which phi is not zero and the control is on a limit, and singular arcs between them.

    Args:
        formulation: for the names of its limits.
        attempt: the solution.
        found: its switching function.

    Returns:
        In the order of time.
    """
    size, edges = found.size.max(axis=1), attempt.edges
    least = max(VANISHES[0] * size.max(), VANISHES[1] * max(1.0, abs(attempt.outcome.cost)))
    names, on_limit = _on_limits(formulation, attempt)
    marked = size > least
    found_arcs: list[Arc] = []
    for a, b in pairwise([0, *(1 + np.flatnonzero(marked[1:] != marked[:-1])), len(marked)]):
        there = on_limit[:, a:b].any(axis=1) & marked[a]
        limits = [name for name, touched in zip(names, there, strict=True) if touched]
        found_arcs.append(Arc(float(edges[a]), float(edges[b]), tuple(limits) or (UNSEEN,) * int(marked[a])))
    return _joined(found_arcs)


def _joined(arcs: list[Arc]) -> list[Arc]:
    """Arcs without two singular ones in a row."""
    joined = arcs[:1]
    for arc in arcs[1:]:
        if joined[-1].limits or arc.limits:
            joined.append(arc)
        else:
            joined[-1] = Arc(joined[-1].start, arc.end, ())
    return joined


def _on_limits(formulation: Formulation, attempt: Attempt) -> tuple[list[str], np.ndarray]:
    """Names of what can hold the control, and (k, N) of booleans: at some node of the interval it does."""
    shape, count = formulation.shape, len(attempt.edges) - 1
    # Others are limits of the state: the control is free to follow them, and phi vanishes there, too.
    holding = ("torque_rate",) if shape.has_torque_states else NEEDS_NULL_TORQUE
    places = rows_of(formulation.limited, shape.wheel_count)
    rows = [int(row) for name in formulation.limited if name in holding for row in places[name]]
    listed = shape.path_names()
    on_limit = np.zeros((len(rows) + 1, count), dtype=bool)
    if attempt.arcs is not None:
        loads = attempt.arcs.node_load.reshape(len(attempt.arcs.node_load), count, -1)
        on_limit[:-1] = (loads[rows] > 1.0 - ON_LIMIT).any(axis=2)
    bounds = attempt.numbers.control
    if bounds is not None and bounds.lower.ndim > 1:
        on_limit[-1] = (bounds.lower == bounds.upper).any(axis=(0, 2))
    return [*(listed[row].name for row in rows), HELD], on_limit


def switching_of(formulation: Formulation, attempt: Attempt) -> Switching | None:
    """The switching function of a solution.

    Args:
        formulation: of the task.
        attempt: the solution.

    Returns:
        None where no costates are found.
    """
    outcome = attempt.outcome
    if outcome.costates is None:
        # Where states are integrals of the controls there are no defects: another solver has them.
        grid = attempt.grid
        other = transcription_of(formulation.problem(), grid.intervals, grid.degree, grid.scheme, SolverOptions())
        outcome = other.solve(attempt.numbers, outcome.nodes, restart=True)
    if outcome.costates is None or outcome.status is not Status.OK:
        return None
    return switching(formulation.problem(), outcome.nodes, attempt.numbers, outcome.costates)


def _switching_words(formulation: Formulation, attempt: Attempt) -> str:
    if formulation.shape.constant:
        return "its controls are constant in each interval, where the switching function vanishes in the mean only"
    found = switching_of(formulation, attempt)
    if found is None:
        return "its switching function is not known"
    arcs = arcs_of(formulation, attempt, found)
    singular = [arc for arc in arcs if not arc.limits]
    if len(singular) == len(arcs):
        text = "no limit holds the control, and its switching function vanishes throughout"
    else:
        bang = [f"{_span(arc)} ({', '.join(arc.limits)})" for arc in arcs if arc.limits]
        text = f"by its switching function bang on {', '.join(bang)}"
        if singular:
            text += f" and singular on {', '.join(map(_span, singular))}"
    convex = found.kelley_holds(np.array([not arc.limits for arc in arcs])[_arc_of(arcs, attempt.edges)])
    return text if convex is None else f"{text}, where Kelley's condition {'holds' if convex else 'does not hold'}"


def _span(arc: Arc) -> str:
    return f"{arc.start:.6g} .. {arc.end:.6g} s"


def _arc_of(arcs: list[Arc], edges: np.ndarray) -> np.ndarray:
    """(N,) Number of the arc of each interval."""
    return np.searchsorted([arc.end for arc in arcs], (edges[:-1] + edges[1:]) / 2)


def note(formulation: Formulation, attempt: Attempt, *, by_switching: bool = True) -> str:
    """A sentence on the singular arcs and layers of a solution.

    Args:
        formulation: for the yaw rate.
        attempt: the solution.
        by_switching: with the arcs that the switching function tells.

    Returns:
        Text with numbers and units.
    """
    found = layers(attempt.edges, formulation.yaw_rates(attempt.outcome.nodes))
    arcs = f"; {_switching_words(formulation, attempt)}" if by_switching else ""
    if not found:
        return f"singular arc (the cost has no curvature in the torques), without jumps of the yaw rate{arcs}"
    words = [
        f"at t = {layer.t:.4g} s the yaw rate jumps by {layer.jump:.3g} rad/s (layer of {layer.width:.2g} s)"
        for layer in found
    ]
    text = "singular arc (the cost has no curvature in the torques) between boundary layers: " + ", ".join(words)
    if attempt.growth > GROWS:
        text += f"; the control in them grows with the mesh, {attempt.growth:.2g} times on one with twice the intervals"
    return f"{text}{arcs}"
