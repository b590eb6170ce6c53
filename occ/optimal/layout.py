"""Where each unknown and each condition of a collocation program stands: in blocks, or stage by stage.

IPOPT takes any order.  FATROP factorises stage by stage and wants the unknowns as x_0, u_0, x_1, u_1, .. x_N and the
conditions as the step to the next stage followed by the stage's own.  The collocation points of an interval are part of
its u, so that the stages stay as small as the states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.optimal.mesh import Scheme
from occ.optimal.problem import Problem


@dataclass(frozen=True)
class Stages:
    """Sizes of FATROP's stages, each (N + 1,): states, controls, conditions beside the step to the next stage."""

    states: np.ndarray
    controls: np.ndarray
    conditions: np.ndarray


@dataclass(frozen=True)
class Layout:
    """Numbers of unknowns and of conditions.

    Args:
        edges: (nx, N + 1) unknowns: states at the edges.
        points: (nx, N, d) unknowns: states at the collocation points; None where they are integrals of the controls.
        control: (nu, N, d) unknowns.
        start: (nx,) unknowns that stand for x(0) in terminal cost and boundary conditions.
        memory: (nm, N + 1) unknowns: x(0) carried from stage to stage; nm is 0 or nx.
        defects: (nx, N, d) conditions.
        ends: (nx, N) conditions: edge k + 1 is the end of polynomial k; None where they are the same unknown.
        steps: (nm, N) conditions: memory k + 1 is memory k.
        first: (nm,) conditions: memory 0 is x(0).
        holds: (held, N, d - 1) conditions: held controls are the same at all points of an interval.
        path: (nh, N, d) conditions.
        boundary: (nb,) conditions; None where they are left out.
        stages: their sizes; None for blocks.
    """

    edges: np.ndarray
    points: np.ndarray | None
    control: np.ndarray
    start: np.ndarray
    memory: np.ndarray
    defects: np.ndarray
    ends: np.ndarray | None
    steps: np.ndarray
    first: np.ndarray
    holds: np.ndarray
    path: np.ndarray
    boundary: np.ndarray | None
    stages: Stages | None = None

    @property
    def unknowns(self) -> int:
        """How many there are."""
        blocks = (self.edges, self.points, self.control, self.memory)
        return 1 + max(int(block.max()) for block in blocks if block is not None and block.size)

    @property
    def only_steps(self) -> bool:
        """There are no conditions but the steps from edge to edge and those of the path."""
        none = (self.defects, self.steps, self.first, self.holds, *(() if self.boundary is None else (self.boundary,)))
        return self.points is None and not any(block.size for block in none)

    @property
    def of_intervals(self) -> np.ndarray:
        """(nx + d nu, N) Unknowns x_k, u_1 .. u_d of each interval."""
        controls, count, degree = self.control.shape
        return np.concatenate([self.edges[:, :-1], self.control.transpose(2, 0, 1).reshape(degree * controls, count)])

    @property
    def conditions(self) -> int:
        """How many there are."""
        blocks = [self.defects, self.ends, self.steps, self.first, self.holds, self.path, self.boundary]
        return sum(block.size for block in blocks if block is not None)


class _Counter:
    """Hands out consecutive numbers, in Fortran order of the shape."""

    def __init__(self) -> None:
        self.count = 0

    def take(self, *shape: int) -> np.ndarray:
        size = int(np.prod(shape))
        numbers = np.arange(self.count, self.count + size).reshape(shape, order="F")
        self.count += size
        return numbers


def blocks(problem: Problem, scheme: Scheme, intervals: int) -> Layout:
    """All edges, then the points between them, then the controls; all defects, then the other conditions.

    Args:
        problem: for its sizes.
        scheme: of collocation.
        intervals: N.

    Returns:
        A layout without repeated unknowns.
    """
    nx, nu, _, _, nh, nb = problem.sizes
    degree = len(scheme.points)
    unknown, condition = _Counter(), _Counter()
    edges = unknown.take(nx, intervals + 1)
    inner = unknown.take(nx, degree - scheme.ends_on_point, intervals).transpose(0, 2, 1)
    points = np.concatenate([inner, edges[:, 1:, None]], axis=2) if scheme.ends_on_point else inner
    control = unknown.take(nu, degree, intervals).transpose(0, 2, 1)
    defects = condition.take(nx, degree, intervals).transpose(0, 2, 1)
    ends = None if scheme.ends_on_point else condition.take(nx, intervals)
    holds = condition.take(problem.held, degree - 1, intervals).transpose(0, 2, 1)
    path = condition.take(nh, degree, intervals).transpose(0, 2, 1)
    return Layout(
        edges=edges,
        points=points,
        control=control,
        start=edges[:, 0],
        memory=np.zeros((0, intervals + 1), dtype=int),
        defects=defects,
        ends=ends,
        steps=np.zeros((0, intervals), dtype=int),
        first=np.zeros(0, dtype=int),
        holds=holds,
        path=path,
        boundary=condition.take(nb),
    )


def stages(problem: Problem, scheme: Scheme, intervals: int, boundary: bool, integrated: bool = False) -> Layout:
    """Stage k: x_k, then the interval's points and controls; its step, its defects, its path conditions.

    A boundary condition or terminal cost that couples x(0) and x(T) reaches over all stages; x(0) is then carried along
    as a constant state.

    Args:
        problem: for its sizes and couplings.
        scheme: of collocation.
        intervals: N.
        boundary: keep the boundary conditions.
        integrated: states at the points are integrals of the controls, neither unknowns nor conditions.

    Returns:
        A layout with the sizes of its stages.
    """
    nx, nu, _, _, nh, nb = problem.sizes
    degree, count = len(scheme.points), intervals
    inner = 0 if integrated else degree * nx
    carried = nx if (boundary and nb) or problem.couples_ends_in_cost else 0
    each_unknown = (nx + carried) + inner + degree * nu
    held = problem.held * (degree - 1)
    each_condition = (nx + carried) + inner + degree * nh + held
    unknown = np.arange(count) * each_unknown
    condition = np.arange(count) * each_condition + np.where(np.arange(count) > 0, carried, 0)

    def within(begin: np.ndarray, offset: int, size: int, points: int = degree) -> np.ndarray:
        """(size, N, points) Numbers of a block of every interval, point by point."""
        local = offset + np.arange(size * points).reshape(size, points, order="F")
        return begin[None, :, None] + local[:, None, :]

    def at_edges(begin: np.ndarray, offset: int, size: int) -> np.ndarray:
        return begin[None, :] + offset + np.arange(size)[:, None]

    last = count * each_unknown
    states = at_edges(np.append(unknown, last), 0, nx)
    memory = at_edges(np.append(unknown, last), nx, carried)
    final = count * each_condition + carried
    own = inner + degree * nh + held
    empty = np.zeros((0, count, degree), dtype=int)
    return Layout(
        edges=states,
        points=None if integrated else within(unknown, nx + carried, nx),
        control=within(unknown, nx + carried + inner, nu),
        start=memory[:, -1] if carried else states[:, 0],
        memory=memory,
        defects=empty if integrated else within(condition, nx + carried, nx),
        ends=at_edges(condition, 0, nx),
        steps=at_edges(condition, nx, carried),
        first=np.arange(carried) + each_condition,
        holds=within(condition, nx + carried + inner + degree * nh, problem.held, degree - 1),
        path=within(condition, nx + carried + inner, nh),
        boundary=final + np.arange(nb) if boundary else None,
        stages=Stages(
            states=np.full(count + 1, nx + carried),
            controls=np.append(np.full(count, inner + degree * nu), 0),
            conditions=np.concatenate([[own + carried], np.full(count - 1, own), [nb if boundary else 0]]),
        ),
    )
