"""Starts for problems that take long: the minima of the smooth problem with B on its path, found in milliseconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from occ.optimal.attempt import Attempt, Method
from occ.optimal.formulation import Formulation, Rotation
from occ.optimal.reduced import Reduced
from occ.optimal.search import Search
from occ.optimal.starts import NamedStart, distinct
from occ.task import Limits

CLOSE = 0.05
"""Minima of the smooth problem that are dearer than its least one by more than this part are hardly the least here."""
MOST = 2
"""Scouts that are followed at most."""


def scouted(
    formulation: Formulation, method: Method, edges: np.ndarray, starts: Sequence[NamedStart]
) -> list[NamedStart]:
    """Rotations of the least minima of a simpler problem, where the first start does not lead to them there.

    In it B keeps its path, nothing is limited, powers count with their signs, and the copper loss stands for the
    largest torque.

    Args:
        formulation: of the problem.
        method: how to solve.
        edges: (N + 1,) [s] first mesh.
        starts: of the simpler problem; the first one is the problem's own.

    Returns:
        At most `MOST`, the best first.
    """
    settings, task = formulation.settings, formulation.task
    # A program need not be at rest where a platform is asked to be.
    ends = replace(settings.ends, end="free") if settings.ends.end == "rest" else settings.ends
    simple = replace(settings, aim=settings.aim.signed, ends=ends, keep="path", radius=None, constant=False, aside=None)
    easy = Reduced(replace(task, limits=Limits()), simple)
    minima = distinct(easy, Search(easy, method).starts(edges, starts))
    return [
        NamedStart(f"least smooth cost on the path, {minimum.names[0]}", rotation_of(minimum.attempt))
        for minimum in minima
        if starts[0].name not in minimum.names and minimum.cost <= minima[0].cost + CLOSE * abs(minima[0].cost)
    ][:MOST]


def rotation_of(attempt: Attempt) -> Rotation:
    """Heading, yaw rate and yaw acceleration of a solution with B on its path, as a guess.

    Args:
        attempt: of the reduced formulation without a limit of torque rates.

    Returns:
        t (N,) [s] -> (3, N).
    """
    edges, nodes = attempt.edges, attempt.outcome.nodes

    def rotation(t: np.ndarray) -> np.ndarray:
        interval = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(edges) - 2)
        s = (t - edges[interval]) / np.diff(edges)[interval]
        state, control = attempt.transcription.at_places(nodes, interval, s)
        return np.vstack([state[:2], control[:1]])

    return rotation
