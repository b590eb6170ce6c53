"""Limits held between the nodes: what is passed there is taken off the limit of that interval, or the control is held.

Where the optimal control jumps inside an interval, its polynomial overshoots, and no tightening cures that: the solver
answers with another overshoot.  Such an interval is short by then; its control is held at its mean, which leaves the
velocity at the end of the interval as it is and, the limited quantities being affine in the control, within the limits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occ.optimal.attempt import Attempt
from occ.optimal.between import loads
from occ.optimal.cost import is_regular
from occ.optimal.formulation import Formulation
from occ.optimal.problem import Bounds, Nodes, Numbers

JUMP = 1e-4
"""An excess beyond this part of the limit is that of a jump inside the interval."""
MORE = 1.1
"""Part of an excess that is taken off the limit."""
MARGIN = 1e-5
"""Part of the limits that a held control leaves to the motion inside its interval."""
LOOSE = -1.0
"""Taken off the limits where the control is held: they are of no use there."""


@dataclass(frozen=True)
class Tightening:
    """What is changed in a problem so that its solution holds the limits between the nodes, too.

    Args:
        taken: (k, N) part that is taken off each limit in each interval; behind them, where the largest torque is the
            cost, part of it by which each torque is kept below it.
        held: (nu, N) controls that are held, NaN where they are free.
        largest: [N m] torque of which these parts are taken.
    """

    taken: np.ndarray
    held: np.ndarray
    largest: float = 0.0

    @property
    def doubled(self) -> Tightening:
        """The same with every interval cut in two."""
        return replace(self, taken=np.repeat(self.taken, 2, axis=1), held=np.repeat(self.held, 2, axis=1))

    @property
    def is_possible(self) -> bool:
        """Something is left of every limit, wherever the control is free."""
        free = ~np.isfinite(self.held).any(axis=0)
        return bool((self.taken[:, free] < 1.0).all())

    def applied(self, formulation: Formulation, numbers: Numbers, degree: int) -> Numbers:
        """The numbers of a problem with tighter limits and held controls.

        Args:
            formulation: for its limits.
            numbers: as they are without.
            degree: of the transcription.

        Returns:
            Numbers with bounds node by node.
        """
        holds = np.isfinite(self.held).any(axis=0)
        loose = holds & _controlled(formulation)[:, None]
        path = formulation.path_bounds(np.where(loose, LOOSE, self.taken), degree, self.largest)
        if not holds.any():
            return replace(numbers, path=path)
        free = numbers.control or Bounds.free(len(self.held))
        sides = [np.where(np.isfinite(self.held), self.held, side[:, None]) for side in (free.lower, free.upper)]
        lower, upper = (np.repeat(side[:, :, None], degree, axis=2) for side in sides)
        return replace(numbers, path=path, control=Bounds(lower=lower, upper=upper))

    def guess(self, nodes: Nodes) -> Nodes:
        """The nodes with the held controls in their places."""
        held = self.held[:, :, None]
        return Nodes(nodes.edges, nodes.points, np.where(np.isfinite(held), held, nodes.control))


def tightened(
    formulation: Formulation, attempt: Attempt, before: Tightening | None, allowed: float = 0.0
) -> Tightening:
    """The next tightening: more off the limits that are passed, and controls held where they jump.

    Args:
        formulation: of the task.
        attempt: that passes limits between its nodes.
        before: with which it was solved; None where it was solved as it is.
        allowed: part by which the largest torque, where that is the cost, may be passed.

    Returns:
        A tightening that is stronger.
    """
    assert attempt.arcs is not None
    excess = attempt.arcs.excess.copy()
    soft = excess[attempt.arcs.hard :]
    soft[soft <= allowed] = 0.0
    nu = attempt.transcription.sizes[1]
    if before is None:
        before = Tightening(np.zeros_like(excess), np.full((nu, excess.shape[1]), np.nan))
    # Where no node is on its limit a tightening begins to be felt at the value of the largest.
    slack = 1.0 - attempt.arcs.node_load[: len(excess)].reshape(*excess.shape, -1).max(axis=2)
    taken = np.where(excess > 0.0, np.maximum(before.taken, slack) + MORE * excess, before.taken)
    holds = np.isfinite(before.held).any(axis=0)
    controlled = _controlled(formulation)[:, None]
    passed = np.where(controlled, excess, 0.0).max(axis=0)
    new = np.flatnonzero((passed > np.where(holds, 0.0, JUMP)) & can_hold(formulation))
    held = before.held.copy()
    # A control that is held from now on does not overshoot as its polynomial did.
    least = np.where(holds | ~controlled, taken, before.taken)
    for interval, values in zip(new, held_controls(formulation, attempt, new, least), strict=True):
        if values is not None:
            held[: len(values), interval], taken[:, interval] = values, least[:, interval]
    largest = float(attempt.outcome.nodes.edges[-1, -1]) if len(soft) else 0.0
    return Tightening(_spread(taken, np.isfinite(held).any(axis=0)), held, largest)


def _controlled(formulation: Formulation) -> np.ndarray:
    """(k,) of booleans: the control itself is in the limited quantity, or in the torque that the largest bounds."""
    controlled, hard = formulation.problem().controlled, len(formulation.hard_limits)
    peaks = formulation.shape.following()[3]
    return np.concatenate([controlled[:hard], controlled[len(controlled) - peaks :][: peaks // 2]])


def _spread(taken: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """Half of what is taken off in an interval is taken off in its neighbours, too, a quarter in theirs, and so on.

    A step of a limit makes the quantity ripple in the next interval; a smaller step than what is taken off there makes
    a ripple that is smaller than that.
    """
    spread = np.where(holds, 0.0, np.minimum(taken, JUMP))
    for k in range(1, taken.shape[1]):
        spread[:, k] = np.maximum(spread[:, k], spread[:, k - 1] / 2)
    for k in range(taken.shape[1] - 2, -1, -1):
        spread[:, k] = np.maximum(spread[:, k], spread[:, k + 1] / 2)
    return np.where(holds, taken, np.maximum(taken, spread))


def can_hold(formulation: Formulation) -> bool:
    """Whether controls jump, and constant ones are a solution.

    A cost with curvature in the torques has continuous ones, and their rates jump; constant torques cannot hold B on
    its path.
    """
    shape = formulation.shape
    jumps = shape.has_torque_states or not is_regular(formulation.settings.aim.terms)
    return jumps and not (shape.full and shape.keep == "path")


def held_controls(
    formulation: Formulation, attempt: Attempt, intervals: np.ndarray, taken: np.ndarray
) -> list[np.ndarray | None]:
    """The constant controls nearest to the mean ones that hold the limits that they are in, on the motion as it is.

    Args:
        formulation: of the task.
        attempt: with the motion.
        intervals: (m,) their numbers.
        taken: (hard, N) part that is taken off each limit, beside a margin.

    Returns:
        (nu - slacks,) for each of the intervals; None where there is none.
    """
    if not len(intervals):
        return []
    transcription, nodes, numbers = attempt.transcription, attempt.outcome.nodes, attempt.numbers
    count = len(nodes.control) - formulation.shape.slacks
    mean = nodes.control @ transcription.scheme.weights
    size = np.maximum(np.abs(nodes.control).max(axis=(1, 2)), 1e-6)

    def at(change: np.ndarray) -> np.ndarray:
        """(hard, N, d) Limited quantities with the control held at its mean and a change."""
        control = np.broadcast_to((mean + change[:, None])[:, :, None], nodes.control.shape)
        found, _ = loads(formulation, transcription, (nodes.points, control, numbers.data))
        return found[: len(taken)].reshape(len(taken), *nodes.points.shape[1:])

    at_mean = at(np.zeros(len(mean)))
    steps = np.eye(len(mean))[:count] * size
    slopes = np.stack([at(step) - at_mean for step in steps])
    most, rows = 1.0 - MARGIN - taken, _controlled(formulation)
    found = []
    for k in intervals:
        room = np.repeat(most[rows, k], at_mean.shape[2])
        change = _smallest_change(at_mean[rows, k].ravel(), slopes[:, rows, k].reshape(count, -1), room)
        found.append(None if change is None else mean[:count, k] + change * size[:count])
    return found


def _smallest_change(value: np.ndarray, slope: np.ndarray, room: np.ndarray) -> np.ndarray | None:
    """The smallest z, by its largest entry, with |value + z slope| <= room: a linear program."""
    from scipy.optimize import linprog

    count = len(slope)
    if np.all(np.abs(value) <= room):
        return np.zeros(count)
    rows = [np.column_stack([sign * slope.T, np.zeros(len(value))]) for sign in (1.0, -1.0)]
    sizes = [np.column_stack([sign * np.eye(count), np.full(count, -1.0)]) for sign in (1.0, -1.0)]
    result = linprog(
        np.append(np.zeros(count), 1.0),
        A_ub=np.concatenate([*rows, *sizes]),
        b_ub=np.concatenate([room - value, room + value, np.zeros(2 * count)]),
        bounds=(None, None),
    )
    return np.asarray(result.x[:count]) if result.success else None
