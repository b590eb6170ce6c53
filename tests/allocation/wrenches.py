"""Wheel sets, wrenches and ranges that the allocation tests share, and allocations by brute force."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest

from occ.allocation import (
    LEAST_NORM,
    Criterion,
    ElectricPower,
    InputMap,
    LargestTorque,
    TorqueRange,
    WeightedNorm,
    input_map,
    platform_input_map,
)
from occ.allocation.ranges import NO_LIMIT
from occ.laws import ServoLaw
from occ.model.presets import youbot
from tests.tasks import paper_task

CRITERIA = [
    pytest.param(LEAST_NORM, id="norm"),
    pytest.param(WeightedNorm((1.0, 4.0, 0.3, 2.0)), id="weighted"),
    pytest.param(LargestTorque(), id="largest"),
    pytest.param(ElectricPower(), id="electric"),
]


def youbot_map() -> InputMap:
    """The paper's four wheels."""
    return platform_input_map(youbot())


def skewed_map() -> InputMap:
    """Four wheels whose null torque moves them by different amounts."""
    return input_map(np.random.default_rng(3).normal(size=(4, 3)) * [20.0, 20.0, 6.0])


def law_samples(count: int) -> tuple[np.ndarray, np.ndarray]:
    """(3, count) Wrenches and (4, count) wheel rates of the servo law over one lap of the paper's circle, both ends."""
    solution = ServoLaw().solve(paper_task())
    assert solution.claimed is not None
    assert solution.control is not None
    t = np.linspace(0.0, solution.claimed.t[-1], count)
    state = np.array([np.interp(t, solution.claimed.t, row) for row in solution.claimed.state])
    wheels = youbot_map()
    return wheels.wrench(solution.control.torque(t, state)), wheels.wheel_rates @ state[3:]


def law_wrenches(count: int) -> np.ndarray:
    """The wrenches alone."""
    return law_samples(count)[0]


def random_wrenches(wheels: InputMap, limit: float, count: int, seed: int) -> np.ndarray:
    """(3, count) Wrenches of random torques, from well inside to well outside of what the limit lets the wheels do."""
    rng = np.random.default_rng(seed)
    torque = rng.uniform(-1, 1, (wheels.wheel_count, count))
    return wheels.wrench(torque) * limit * rng.uniform(0.2, 3.0, count)


def random_ranges(wheels: InputMap, count: int, seed: int) -> TorqueRange:
    """Lower and upper limits that differ; some wheels have none, some a range that is a point, some cannot rest."""
    rng = np.random.default_rng(seed)
    shape = wheels.wheel_count, count
    lower, upper = -rng.uniform(0.1, 2.0, shape), rng.uniform(0.1, 2.0, shape)
    kind = rng.uniform(size=shape)
    lower, upper = np.where(kind < 0.05, -NO_LIMIT, lower), np.where(kind < 0.05, NO_LIMIT, upper)
    point = rng.uniform(-1.0, 1.0, shape)
    lower, upper = np.where(kind > 0.97, point, lower), np.where(kind > 0.97, point, upper)
    return TorqueRange(np.where((kind > 0.9) & (kind < 0.95), 0.4 * upper, lower), upper)


def random_rates(count: int, seed: int) -> np.ndarray:
    """(4, count) [rad/s] Wheel rates; a tenth of them are zero."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(4, count)) * 6.0 * (rng.uniform(size=(4, count)) > 0.1)


def by_vertices(
    wheels: InputMap, wrench: np.ndarray, ranges: TorqueRange, rates: np.ndarray, criterion: Criterion
) -> np.ndarray:
    """Four wheels: the best of all nu at which something changes, and of the lowest points of parabolas in between.

    The torques are M + nu n.  A wheel on a limit, two torques of the same size, a torque where a wheel begins to take
    power: these are the ends of the pieces on which the criterion is a polynomial of degree two at most.

    Args:
        wheels: four of them.
        wrench: (3, N).
        ranges: of each wheel and sample.
        rates: (4, N).
        criterion: what is least.

    Returns:
        (4, N) torques; NaN where there are none.
    """
    null = wheels.null_torque[:, 0]
    # The same factor as in C_phi^T M = Pi; lstsq of a wide system is its minimum norm.
    torque = np.linalg.lstsq(wheels.wheel_rates.T, wrench, rcond=None)[0]
    lower, upper = (np.broadcast_to(end, torque.shape) for end in (ranges.lower, ranges.upper))
    count = torque.shape[1]

    def value(nu: np.ndarray) -> np.ndarray:
        shifted = torque[:, None] + null[:, None, None] * nu
        spread = np.broadcast_to(rates[:, None], shifted.shape)
        return criterion.value(shifted.reshape(4, -1), spread.reshape(4, -1)).reshape(nu.shape)

    places = [np.zeros(count)]
    for i in np.flatnonzero(np.abs(null) > 1e-9):
        ends = [np.where(np.abs(end) < NO_LIMIT, end, 0.0) for end in (lower[i], upper[i])]
        if isinstance(criterion, ElectricPower):
            ends.append(-rates[i] / criterion.loss)
        places += [(end - torque[i]) / null[i] for end in (*ends, 0.0)]
    for (i, j), sign in product(combinations(range(4), 2), (-1, 1)):
        if abs(null[i] - sign * null[j]) > 1e-9:
            places.append(-(torque[i] - sign * torque[j]) / (null[i] - sign * null[j]))
    weight = criterion.of(4)[:, 0] if isinstance(criterion, WeightedNorm) else np.ones(4)
    places.append(-((weight * null) @ torque) / (weight @ null**2))
    corners = np.sort(places, axis=0)
    low, high = corners[:-1], corners[1:]
    half = (high - low) / 2
    # The lowest point of the parabola through three points of each piece.
    one, two, three = value(low), value(low + half), value(high)
    bend = one - 2 * two + three
    curved = (bend > 1e-12 * np.abs(two)) & (half > 1e-12)
    share = np.divide(one - three, 2 * bend, out=np.zeros_like(bend), where=curved)
    nu = np.concatenate([corners, np.where(curved, low + half * np.clip(1 + share, 0, 2), low)])
    slack = 1e-9 * np.maximum(1.0, np.abs(torque).max(axis=0))
    shifted = torque[:, None] + null[:, None, None] * nu
    admissible = ((shifted <= (upper + slack)[:, None]) & (shifted >= (lower - slack)[:, None])).all(axis=0)
    values = np.where(admissible, value(nu), np.inf)
    least = values.min(axis=0)
    # Of several best ones the least norm is meant; a weighted norm has one only.
    same = least if isinstance(criterion, WeightedNorm) else least + 1e-11 * np.maximum(least, 1.0)
    best = np.where(values <= same, np.abs(nu), np.inf).argmin(axis=0)
    return np.where(np.isfinite(least), torque + null[:, None] * nu[best, np.arange(count)], np.nan)
