"""The wrenches that the wheels can reach within their limits: a zonotope, or less where the allocation is fixed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from occ.allocation.input_map import PARALLEL, InputMap
from occ.allocation.ranges import TorqueRange

REACH = 1e-9
"""A wrench counts as reachable if the limits lack less than this part of its largest minimum-norm torque."""
MOST_CORNERS = 12
"""Wheels of which all combinations of limits are tried for a drawing; of more there are too many."""


@dataclass(frozen=True, eq=False)
class Reach:
    """{Pi: -against_k <= y_k M <= along_k for every k}, M any torques of Pi.

    Args:
        rows: (F, n) y with sum |y_i| = 1.
        normals: (F, 3) w with w Pi = y M for every M of Pi.
    """

    rows: np.ndarray
    normals: np.ndarray

    def bounds(self, ranges: TorqueRange) -> tuple[np.ndarray, np.ndarray]:
        """max of y M and max of -y M within the ranges, both (F, N) or (F, 1) [N m]."""
        up, down = self.rows.clip(0.0), (-self.rows).clip(0.0)
        return up @ ranges.upper - down @ ranges.lower, down @ ranges.upper - up @ ranges.lower

    def excess(self, torque: np.ndarray, ranges: TorqueRange) -> tuple[np.ndarray, np.ndarray]:
        """By how much every limit would have to be wider for a wrench, and in which row that is seen.

        Args:
            torque: (n, N) [N m] any torques of the wrenches.
            ranges: of the wheels.

        Returns:
            (N,) [N m], negative where there is room, and (N,) the row.
        """
        values = self.rows @ torque
        along, against = self.bounds(ranges)
        over = np.maximum(values - along, -values - against)
        row = over.argmax(axis=0)
        return over[row, np.arange(over.shape[1])], row

    def binding(self, row: np.ndarray, torque: np.ndarray, ranges: TorqueRange) -> np.ndarray:
        """Of the wheels that a row finds at their limits, the one whose minimum-norm torque leaves its range most.

        Args:
            row: (N,) as `excess` returns it.
            torque: (n, N) [N m] minimum-norm torques.
            ranges: of the wheels.

        Returns:
            (N,) wheel, counted from 0.
        """
        loaded = np.abs(self.rows[row].T) > PARALLEL
        over = np.maximum(torque - ranges.upper, ranges.lower - torque)
        return np.asarray(np.where(loaded, over, -np.inf).argmax(axis=0))

    def halfspaces(self, ranges: TorqueRange) -> tuple[np.ndarray, np.ndarray]:
        """Normals (2 F, 3) and offsets (2 F, N): normals Pi <= offsets."""
        along, against = self.bounds(ranges)
        return np.vstack([self.normals, -self.normals]), np.vstack([along, against])


def zonotope(wheels: InputMap) -> Reach:
    """All wrenches of all torques within the ranges; each facet is normal to the wrenches of two wheels.

    Source: Ziegler, Lectures on Polytopes, chapter 7.
    """
    return Reach(wheels.facets, wheels.facets @ wheels.min_norm)


def shadow(wheels: InputMap) -> Reach:
    """All forces (F_X, F_Y) of all torques within the ranges, whatever the moment; normals (F, 2).

    Each edge of this zonogon is along the force of one wheel.
    """
    normals = np.column_stack([-wheels.wheel_rates[:, 1], wheels.wheel_rates[:, 0]])
    rows = wheels.wheel_rates[:, :2] @ normals.T
    np.fill_diagonal(rows, 0.0)
    size = np.abs(rows).sum(axis=0)
    good = size > PARALLEL * np.abs(wheels.wheel_rates).max() ** 2
    return Reach((rows[:, good] / size[good]).T, normals[good] / size[good, None])


def tolerance(torque: np.ndarray) -> np.ndarray:
    """(N,) [N m] what the limits may lack for wrenches that count as reachable; torque (n, N) is any of theirs."""
    return np.asarray(REACH * np.abs(torque).max(axis=0, initial=0.0) + 1e-15)


def corners(wheels: InputMap, ranges: TorqueRange, sample: int = 0) -> np.ndarray:
    """The corners of the zonotope at one sample, for a drawing.

    Args:
        wheels: at most `MOST_CORNERS` of them.
        ranges: of the wheels.
        sample: which one.

    Returns:
        (3, K) [N, N, N m], in no order.

    Raises:
        ValueError: more wheels.
    """
    from scipy.spatial import ConvexHull

    if wheels.wheel_count > MOST_CORNERS:
        raise ValueError(f"a drawing is for at most {MOST_CORNERS} wheels")
    column = sample if ranges.lower.shape[1] > 1 else 0
    ends = np.column_stack([ranges.lower[:, column], ranges.upper[:, column]])
    points = wheels.wrench(np.array(list(product(*ends))).T)
    return points[:, ConvexHull((points / np.abs(points).max(axis=1, keepdims=True)).T).vertices]
