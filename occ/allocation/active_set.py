"""min sum max(M_i phi_i' + k M_i^2, 0) of any number of wheels at one sample: an active set of wheels at corners."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from occ.allocation.input_map import PARALLEL
from occ.allocation.least_norm import least_norm

STATIONARY = 1e-13
"""A slope below this, relative to the largest one, is zero."""
PROOF = 1e-9
"""Slopes and torques at the end may be wrong by this, relative to the largest one."""
FLAT = 1e-10
"""A direction of the unit null torques with less curvature than this has none."""
WIDER = (1e-7, 1e-9, 1e-11, 1e-5, 1e-8, 1e-10, 1e-12, 1e-13, 0.0)
"""Corners move apart by this part of the torques, so that no two wheels meet theirs at once; tried in this order."""
MOST_STEPS = 300


@dataclass(frozen=True, eq=False)
class Powers:
    """f = sum max(M_i phi_i' + k M_i^2, 0) within limits, at one sample.

    Each f_i is zero between two torques, and a parabola with the vertex in the middle of these outside of them.

    Args:
        rates: (n,) [rad/s] phi'.
        loss: [W/(N m)^2] k.
        corners: (n, 4) [N m] lower limit, the two ends of the idle interval, upper limit.
    """

    rates: np.ndarray
    loss: float
    corners: np.ndarray

    def take(self, torque: np.ndarray, up: np.ndarray | bool = True) -> np.ndarray:
        """(n, K) Whether a wheel takes power just above (or below) its torque (n, K)."""
        low, high = self.corners[:, 1:2], self.corners[:, 2:3]
        return np.where(up, (torque < low) | (torque >= high), (torque <= low) | (torque > high))

    def slopes(self, torque: np.ndarray, up: np.ndarray | bool = True) -> np.ndarray:
        """(n, K) Slope of f_i just above (or below) the torque (n, K); infinite where a limit ends it."""
        slope = np.where(self.take(torque, up), 2 * self.loss * torque + self.rates[:, None], 0.0)
        ends = np.where(up, torque >= self.corners[:, 3:], torque <= self.corners[:, :1])
        return np.where(ends, np.where(up, np.inf, -np.inf), slope)


class _Place(NamedTuple):
    """Torques (n,), the corner (0 to 3) of each held wheel, and which wheels (n,) take power."""

    torque: np.ndarray
    held: dict[int, int]
    takes: np.ndarray


def least_powers(powers: Powers, null: np.ndarray, start: np.ndarray, slack: float) -> Iterator[np.ndarray]:
    """min f(M), M = start + null nu; of several best torques the one of least norm.

    Args:
        powers: f.
        null: (n, n - 3) orthonormal null torques.
        start: (n,) [N m] torques within the limits, up to rounding.
        slack: [N m] twice this is rounding.

    Yields:
        (n,) [N m] torques that should be the best ones, by other corners each time; for the caller to prove.  The last
        is the start, which is next to the only torque where limits leave hardly any other.

    Source: Fletcher, Practical Methods of Optimization, 10.3 (active sets), 14 (corners of composite functions).
    """
    # What rounding leaves of the share of a wheel that no null torque moves would push and never move anything.
    null = np.where(np.abs(null).max(axis=1, keepdims=True) > PARALLEL, null, 0.0)
    size = float(np.abs(start).max()) + 1e-6
    rng = np.random.default_rng(0)
    for near, part in product((1e-3 * slack, slack), WIDER):
        wider = powers.corners + part * size * (1 + rng.uniform(size=powers.corners.shape)) * [-1, -1, 1, 1]
        wider[:, 0], wider[:, 3] = np.minimum(wider[:, 0], start), np.maximum(wider[:, 3], start)
        place = _descend(Powers(powers.rates, powers.loss, wider), null, start)
        if place is not None:
            place = _settle(powers, null, place)
            if _leaving(powers, null, place, PROOF) is None:
                torque = _least_norm(powers, null, place, near)
                if np.isfinite(torque).all():
                    yield torque
    yield start


def _descend(powers: Powers, null: np.ndarray, start: np.ndarray) -> _Place | None:
    """Steps to the lowest point along a direction in which all held wheels rest; where there is none, one lets go."""
    torque, held = start.copy(), dict[int, int]()
    for _ in range(MOST_STEPS):
        place = _Place(torque, held, _takes(powers, torque, held))
        way = _direction(powers, null, place)
        if way is None:
            leaving = _leaving(powers, null, place)
            if leaving is None:
                return place
            del held[leaving]
            continue
        torque, hit = _lowest(powers, torque, way)
        held |= hit
        # Rounding of the steps does not add up.
        torque[list(held)] = [powers.corners[wheel, corner] for wheel, corner in held.items()]
    return None


def _takes(powers: Powers, torque: np.ndarray, held: dict[int, int]) -> np.ndarray:
    """(n,) Whether a wheel takes power; of one that has let go downwards the step along the direction finds it out."""
    takes = powers.take(torque[:, None])[:, 0]
    takes[list(held)] = False
    return takes


def _still(null: np.ndarray, held: dict[int, int]) -> np.ndarray:
    """(n, d) Orthonormal null torques that do not move the held wheels."""
    if not held:
        return null
    rows = list(held)
    basis = null @ np.linalg.svd(null[rows])[2][len(rows) :].T
    basis[rows] = 0.0
    return basis


def _gradient(powers: Powers, place: _Place) -> tuple[np.ndarray, float]:
    """(n,) Slopes of the wheels that are not held, and the size of slopes that decides what is zero."""
    steep = 2 * powers.loss * place.torque + powers.rates
    size = float(np.abs(powers.rates).max() + 2 * powers.loss * np.abs(place.torque).max())
    return np.where(place.takes, steep, 0.0), size


def _direction(powers: Powers, null: np.ndarray, place: _Place) -> np.ndarray | None:
    """(n,) Newton's step, or straight down where f has no curvature; None where f is stationary."""
    basis = _still(null, place.held)
    slope, size = _gradient(powers, place)
    gradient = basis.T @ slope
    if np.abs(gradient).max(initial=0.0) <= STATIONARY * size:
        return None
    bend, turn = np.linalg.eigh(basis[place.takes].T @ basis[place.takes])
    along, flat = turn.T @ gradient, bend < FLAT
    if np.abs(along[flat]).max(initial=0.0) > STATIONARY * size:
        along = np.where(flat, along, 0.0)
    else:
        along = np.where(flat, 0.0, along / np.where(flat, 1.0, 2 * powers.loss * bend))
    return -basis @ (turn @ along)


def _leaving(powers: Powers, null: np.ndarray, place: _Place, small: float = 1e3 * STATIONARY) -> int | None:
    """The held wheel whose corner is least able to hold it; None where every corner is."""
    rows = list(place.held)
    if not rows:
        return None
    slope, size = _gradient(powers, place)
    needed = np.linalg.lstsq(null[rows].T, -null.T @ slope, rcond=None)[0]
    column = place.torque[:, None]
    above, below = powers.slopes(column)[rows, 0], powers.slopes(column, False)[rows, 0]
    over = np.maximum(needed - above, below - needed)
    return rows[int(over.argmax())] if over.max() > small * size else None


def _lowest(powers: Powers, torque: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, dict[int, int]]:
    """The lowest point of f along torque + t way, t > 0, and the corner at which it lies, if it lies at one."""
    moves = np.abs(way) > 1e-12 * np.abs(way).max()
    way = np.where(moves, way, 0.0)
    distance = powers.corners - torque[:, None]
    t = np.divide(distance, way[:, None], out=np.zeros_like(distance), where=moves[:, None])
    wheel, corner = np.nonzero(t > 0)
    order = t[wheel, corner].argsort()
    wheel, corner = wheel[order], corner[order]
    times = t[wheel, corner]
    at = torque[:, None] + way[:, None] * times
    at[wheel, np.arange(len(times))] = powers.corners[wheel, corner]
    after = (way[moves, None] * powers.slopes(at, (way > 0)[:, None])[moves]).sum(axis=0)
    j = int((after >= 0).argmax())
    begin = times[j - 1] if j else 0.0
    takes = moves & powers.take((torque + way * (begin + times[j]) / 2)[:, None])[:, 0]
    fall = -way[takes] @ (2 * powers.loss * torque + powers.rates)[takes]
    bend = 2 * powers.loss * way[takes] @ way[takes]
    if fall < bend * times[j]:
        return torque + way * max(fall / bend, begin), {}
    return at[:, j].copy(), {int(wheel[j]): int(corner[j])}


def _settle(powers: Powers, null: np.ndarray, place: _Place) -> _Place:
    """The same wheels held at the corners proper, and the others where they are stationary."""
    rows, torque = list(place.held), place.torque
    if rows:
        corners = powers.corners[rows, list(place.held.values())]
        torque = torque + null @ np.linalg.lstsq(null[rows], corners - torque[rows], rcond=None)[0]
        torque[rows] = corners
    place = place._replace(torque=torque)
    way = _direction(powers, null, place)
    return place if way is None else place._replace(torque=torque + way)


def _least_norm(powers: Powers, null: np.ndarray, place: _Place, slack: float) -> np.ndarray:
    """(n,) The torque of a wheel that takes power is unique; the others may be idle together in many ways.

    NaN where they cannot be, or where a wheel does not take the power that it is said to take.
    """
    lower, low, high, upper = powers.corners.T
    at_limit = np.zeros(len(lower), dtype=bool)
    at_limit[[wheel for wheel, corner in place.held.items() if corner in (0, 3)]] = True
    away = np.maximum(place.torque - high, low - place.torque)
    fixed = place.takes | (at_limit & (away > 0))
    _, size, rows = np.linalg.svd(null[fixed])
    still = null @ rows[int((size > FLAT).sum()) :].T
    still[fixed] = 0.0
    bottom = np.where(fixed, place.torque, np.maximum(lower, low))
    top = np.where(fixed, place.torque, np.minimum(upper, high))
    wrong = np.maximum.reduce([-away, place.torque - upper, lower - place.torque])[fixed]
    if wrong.max(initial=0.0) > 2 * slack:
        return np.full(len(lower), np.nan)
    return least_norm(still, place.torque, bottom, top, np.ones(len(lower)), slack)
