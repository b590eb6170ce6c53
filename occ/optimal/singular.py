"""What the optimum of a cost without curvature in the torques looks like: jumps of the velocity and singular arcs.

Signed work sees the torques through the kinetic energy only.  Its optimum jumps on to an arc on which the switching
function vanishes identically and jumps off it at the end; a mesh turns each jump into a layer as wide as its interval,
so that the largest torque grows with the mesh while the cost converges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.optimal.attempt import Attempt
from occ.optimal.formulation import Formulation

STEEP = 20.0
"""Yaw accelerations this many times the typical one belong to a layer."""
SMALLEST = 1e-3
"""Jumps below this part of the largest yaw rate are not worth a word."""

GROWS = 1.2
"""Growth of the control on a doubled mesh from which on it is not bounded."""


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


def note(formulation: Formulation, attempt: Attempt) -> str:
    """A sentence on the singular arcs and layers of a solution.

    Args:
        formulation: for the yaw rate.
        attempt: the solution.

    Returns:
        Text with numbers and units.
    """
    found = layers(attempt.edges, formulation.yaw_rates(attempt.outcome.nodes))
    if not found:
        return "singular arc (the cost has no curvature in the torques), without jumps of the yaw rate"
    words = [
        f"at t = {layer.t:.4g} s the yaw rate jumps by {layer.jump:.3g} rad/s (layer of {layer.width:.2g} s)"
        for layer in found
    ]
    text = "singular arc (the cost has no curvature in the torques) between boundary layers: " + ", ".join(words)
    if attempt.growth > GROWS:
        text += f"; the control in them grows with the mesh, {attempt.growth:.2g} times on one with twice the intervals"
    return text
