"""What becomes of a wrench that no torque within the limits makes: first the wrench, then the least torque for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from occ.allocation.input_map import PARALLEL, InputMap
from occ.allocation.least_distance import least_distance
from occ.allocation.ranges import TorqueRange
from occ.allocation.reach import shadow, zonotope

Rule = Literal["closest", "translation_first", "rotation_first", "scale"]
"""``closest``: least (Pi' - Pi)^T A^-1 (Pi' - Pi), the metric in which the acceleration is off least (Gauss);
``translation_first``: closest force (F_X, F_Y), then the closest moment; ``rotation_first``: the reverse;
``scale``: the largest part of the wrench in its own direction."""

ROUNDING = 1e-13
"""Offsets are widened by this part of their size where the set of what is left is a point."""


def nearest_wrench(
    wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, rule: Rule, inertia: np.ndarray
) -> np.ndarray:
    """The first stage of an allocation of wrenches out of reach.

    Args:
        wheels: the input map.
        wrench: (3, N) [N, N, N m].
        ranges: of the wheels.
        rule: what is kept first.
        inertia: (3, 3) A, the metric of ``closest``.

    Returns:
        (3, N) reachable wrenches; NaN where not even a part of a wrench can be kept (``scale`` only).

    Source: Johansen and Fossen, Control allocation - a survey, Automatica 49 (2013), sections 2.2 and 3; Durham,
    Constrained control allocation, J. Guidance 16 (1993) (scaling).
    """
    return _RULES[rule](wheels, wrench, ranges, inertia)


def _closest(wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, inertia: np.ndarray) -> np.ndarray:
    normals, offsets = zonotope(wheels).halfspaces(ranges)
    root = np.linalg.cholesky(inertia)
    return wrench + root @ _nearest(normals @ root, offsets - normals @ wrench)


def _translation_first(wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, inertia: np.ndarray) -> np.ndarray:
    normals, offsets = shadow(wheels).halfspaces(ranges)
    force = wrench[:2] + _nearest(normals, offsets - normals @ wrench[:2])
    normals, offsets = zonotope(wheels).halfspaces(ranges)
    # What a facet that hardly sees the moment leaves of it would be rounding, divided by next to nothing.
    used = normals[:, :2] @ force
    left = offsets - used + 1e2 * ROUNDING * (np.abs(offsets) + np.abs(used))
    slope = normals[:, 2:]
    # A facet along the moment says nothing of it.
    slope = np.where(np.abs(slope) > PARALLEL * np.abs(slope).max(), slope, 0.0)
    ends = np.divide(left, slope, out=np.full(left.shape, np.inf), where=slope != 0)
    low, high = np.where(slope < 0, ends, -np.inf).max(axis=0), np.where(slope > 0, ends, np.inf).min(axis=0)
    moment = np.where(low > high, (low + high) / 2, np.clip(wrench[2], low, np.maximum(low, high)))
    return np.vstack([force, moment])


def _rotation_first(wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, inertia: np.ndarray) -> np.ndarray:
    arm = wheels.wheel_rates[:, 2:]
    one, two = arm * ranges.lower, arm * ranges.upper
    moment = np.clip(wrench[2], np.minimum(one, two).sum(axis=0), np.maximum(one, two).sum(axis=0))
    normals, offsets = zonotope(wheels).halfspaces(ranges)
    right = offsets - normals[:, 2:] * moment - normals[:, :2] @ wrench[:2]
    return np.vstack([wrench[:2] + _nearest(normals[:, :2], right), moment])


def _scale(wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, inertia: np.ndarray) -> np.ndarray:
    normals, offsets = zonotope(wheels).halfspaces(ranges)
    offsets, along = np.broadcast_arrays(offsets, normals @ wrench)
    # A wrench without effect on a facet, or one that the facet allows, is not bound by it.
    bound = along > np.maximum(offsets, 0.0)
    share = np.divide(offsets, along, out=np.ones(along.shape), where=bound).min(axis=0)
    possible = (share[None] * along <= offsets + 1e-9 * np.abs(offsets).max(axis=0)).all(axis=0)
    return np.where(possible & (share >= 0), share, np.nan) * wrench


_RULES: dict[str, Callable[[InputMap, np.ndarray, TorqueRange, np.ndarray], np.ndarray]] = {
    "closest": _closest,
    "translation_first": _translation_first,
    "rotation_first": _rotation_first,
    "scale": _scale,
}


def _nearest(normals: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """(d, N) The shortest x with normals x <= offsets (h, N), of each sample."""
    points = np.empty((normals.shape[1], offsets.shape[1]))
    for k, right in enumerate(offsets.T):
        size = float(np.abs(right).max())
        for wider in (0.0, ROUNDING, 1e2 * ROUNDING, 1e4 * ROUNDING):
            x = least_distance(normals, right + wider * size).x
            if x is not None:
                points[:, k] = x
                break
        else:
            points[:, k] = np.nan
    return points
