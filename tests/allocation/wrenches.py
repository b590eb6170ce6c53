"""Wheel sets, wrenches and ranges that the allocation tests share, and allocations by brute force."""

from __future__ import annotations

from itertools import combinations, pairwise, product

import numpy as np

from occ.allocation import Criterion, ElectricPower, InputMap, TorqueRange, WeightedNorm, platform_input_map
from occ.allocation.ranges import NO_LIMIT
from occ.laws import ServoLaw
from occ.model.presets import youbot
from tests.tasks import paper_task


def youbot_map() -> InputMap:
    """The paper's four wheels."""
    return platform_input_map(youbot())


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
    wheels: InputMap, wrench: np.ndarray, lower: np.ndarray, upper: np.ndarray, rates: np.ndarray, criterion: Criterion
) -> np.ndarray | None:
    """Four wheels: the best of all nu at which something changes, and of the lowest points of parabolas in between.

    The torques are M + nu n.  A wheel on a limit, two torques of the same size, a torque where a wheel begins to take
    power: these are the ends of the pieces on which the criterion is a polynomial of degree two at most.
    """
    null = wheels.null_torque[:, 0]
    torque = np.linalg.lstsq(wheels.wheel_rates.T, wrench, rcond=None)[0]
    # The same factor as in C_phi^T M = Pi; lstsq of a wide system is its minimum norm.
    places = [0.0]
    for m, n, low, high, rate in zip(torque, null, lower, upper, rates, strict=True):
        if abs(n) > 1e-9:
            places += [(end - m) / n for end in (low, high, 0.0) if abs(end) < NO_LIMIT]
            if isinstance(criterion, ElectricPower):
                places.append((-rate / criterion.loss - m) / n)
    for (i, j), sign in product(combinations(range(4), 2), (-1, 1)):
        if abs(null[i] - sign * null[j]) > 1e-9:
            places.append(-(torque[i] - sign * torque[j]) / (null[i] - sign * null[j]))

    def value(nu: float) -> float:
        m = (torque + nu * null)[:, None]
        return float(criterion.value(m, rates[:, None])[0])

    weight = criterion.of(4)[:, 0] if isinstance(criterion, WeightedNorm) else np.ones(4)
    places.append(-float((weight * null * torque).sum() / (weight * null**2).sum()))
    places = sorted(places)
    for low, high in pairwise(places):
        # The lowest point of the parabola through three points of the piece.
        half = (high - low) / 2
        one, two, three = value(low), value(low + half), value(high)
        bend = one - 2 * two + three
        if bend > 1e-12 * abs(two) and half > 1e-12:
            places.append(low + half * float(np.clip(1 + (one - three) / (2 * bend), 0, 2)))
    slack = 1e-9 * max(1.0, float(np.abs(torque).max()))
    admissible = [
        nu
        for nu in places
        if np.all(torque + nu * null <= upper + slack) and np.all(torque + nu * null >= lower - slack)
    ]
    if not admissible:
        return None
    least = min(value(nu) for nu in admissible)
    # Of several best ones the least norm is meant.
    best = min((nu for nu in admissible if value(nu) <= least + 1e-11 * max(least, 1.0)), key=abs)
    return torque + best * null
