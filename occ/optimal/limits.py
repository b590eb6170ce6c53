"""Limits of the wheels inside the optimum, and between the nodes: knots at the switching times, then a back-off.

A limit that is imposed at the nodes only is passed between them.  Where the optimum moves on to a limit or leaves it,
its control has a kink: an edge of the mesh is put there, so that each polynomial represents a smooth arc.  What is
still passed after that is taken off the limit of that interval, until nothing is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.optimal.transcription import Nodes, Numbers, Transcription, flat
from occ.task import Limits

QUANTITIES = ("torque", "wheel_speed", "wheel_power")
"""What can be limited, in the order of the path conditions; the names are those of `occ.task.Limits`."""
NEEDS_NULL_TORQUE = ("torque", "wheel_power")
"""Limits that see how a wrench is shared among the wheels."""
SAMPLES = 24
"""Places in each interval at which limits are looked at."""
ACTIVE = 1e-5
"""A quantity this close to its limit, relative to it, counts as on it."""
MOST_MOVED = 0.2
"""An edge nearer to a switching time than this part of its smaller interval is moved there."""


def limited_quantities(limits: Limits) -> tuple[str, ...]:
    """Names of the quantities for which a limit is set."""
    return tuple(name for name in QUANTITIES if getattr(limits, name) is not None)


def limit_values(limits: Limits, wheel_count: int) -> np.ndarray:
    """(k n,) The limits in the order of the path conditions: n wheels for each limited quantity."""
    return np.repeat([getattr(limits, name) for name in limited_quantities(limits)], wheel_count).astype(float)


@dataclass(frozen=True)
class LimitedArcs:
    """The limited quantities along a solution, between the nodes too.

    Args:
        t: (N, m) [s] sample times in each interval, its ends included.
        load: (k n, N, m) |quantity| / limit.
        node_times: (N d,) [s].
        node_load: (k n, N d) the same at the collocation points.
    """

    t: np.ndarray
    load: np.ndarray
    node_times: np.ndarray
    node_load: np.ndarray

    @property
    def excess(self) -> np.ndarray:
        """(k n, N) Largest excess in each interval, relative to the limit; 0 where there is none."""
        return np.maximum(self.load.max(axis=2) - 1.0, 0.0)

    def switching_times(self) -> np.ndarray:
        """[s] Times at which a quantity moves on to its limit or leaves it, from its values on the free side."""
        times = []
        t, load = self.t.ravel(), self.load.reshape(len(self.load), -1)
        for row, nodes in zip(load, self.node_load, strict=True):
            active = nodes > 1.0 - ACTIVE
            for k in np.flatnonzero(active[1:] != active[:-1]):
                low, high = self.node_times[k], self.node_times[k + 1]
                inside = np.flatnonzero((t >= low) & (t <= high) & (row >= 1.0))
                if not inside.size:
                    times.append((low + high) / 2)
                else:
                    times.append(t[inside[0]] if active[k + 1] else t[inside[-1]])
        return np.array(sorted(times))


def limited_arcs(
    transcription: Transcription, nodes: Nodes, numbers: Numbers, sample_data: np.ndarray, limits: np.ndarray
) -> LimitedArcs:
    """The path conditions along the polynomials, relative to their limits.

    Args:
        transcription: whose path conditions are the limited quantities.
        nodes: the solution.
        numbers: with which it was found.
        sample_data: (nd, N, m) node data at `sample_places`.
        limits: (k n,) untightened.

    Returns:
        Loads at samples and nodes.
    """
    s = sample_places()
    state, _, control = transcription.interpolate(nodes, s)
    path = transcription.evaluate(flat(state), flat(control), flat(sample_data), numbers.parameters)[2]
    at_nodes = transcription.evaluate(flat(nodes.points), flat(nodes.control), flat(numbers.data), numbers.parameters)[
        2
    ]
    t = numbers.edges[:-1, None] + np.diff(numbers.edges)[:, None] * s
    load = np.abs(path) / limits[:, None]
    node_load = np.abs(at_nodes) / limits[:, None]
    return LimitedArcs(
        t, load.reshape(len(limits), *t.shape), transcription.node_times(numbers.edges).ravel(), node_load
    )


def sample_places() -> np.ndarray:
    """(m,) Places in [0, 1] at which limits are looked at, crowded towards the ends like Chebyshev's points."""
    return (1 - np.cos(np.pi * np.arange(SAMPLES + 1) / SAMPLES)) / 2


def with_knots(edges: np.ndarray, times: np.ndarray) -> np.ndarray:
    """A mesh with an edge at every switching time: a near edge is moved there, otherwise a new one is put in.

    Args:
        edges: (N + 1,) [s] without knots.
        times: [s] switching times.

    Returns:
        (M + 1,) edges; M is rounded up to a multiple of four by bisecting the widest intervals.
    """
    result = list(edges)
    fixed = {edges[0], edges[-1]}
    span = edges[-1] - edges[0]
    for time in times:
        if min(abs(time - f) for f in fixed) < 1e-7 * span:
            continue
        k = int(np.argmin(np.abs(np.array(result) - time)))
        widths = [abs(result[j] - result[k]) for j in (k - 1, k + 1) if 0 <= j < len(result)]
        if result[k] not in fixed and abs(result[k] - time) < MOST_MOVED * min(widths):
            result[k] = float(time)
        else:
            result.append(float(time))
        fixed.add(float(time))
        result.sort()
    while (len(result) - 1) % 4:
        k = int(np.argmax(np.diff(result)))
        result.insert(k + 1, (result[k] + result[k + 1]) / 2)
    return np.array(result)
