"""Wheel sets and wrenches that the allocation tests share."""

from __future__ import annotations

import numpy as np

from occ.allocation import InputMap, platform_input_map
from occ.laws import ServoLaw
from occ.model.presets import youbot
from tests.tasks import paper_task


def youbot_map() -> InputMap:
    """The paper's four wheels."""
    return platform_input_map(youbot())


def law_wrenches(count: int) -> np.ndarray:
    """(3, count) Wrenches of the servo law over one lap of the paper's circle, both ends included."""
    solution = ServoLaw().solve(paper_task())
    assert solution.claimed is not None
    assert solution.control is not None
    chosen = np.linspace(0, len(solution.claimed.t) - 1, count).astype(int)
    torque = solution.control.torque(solution.claimed.t[chosen], solution.claimed.state[:, chosen])
    return youbot_map().wrench(torque)


def random_wrenches(wheels: InputMap, limit: float, count: int, seed: int) -> np.ndarray:
    """(3, count) Wrenches of random torques, from well inside to well outside of what the limit lets the wheels do."""
    rng = np.random.default_rng(seed)
    torque = rng.uniform(-1, 1, (wheels.wheel_count, count))
    return wheels.wrench(torque) * limit * rng.uniform(0.2, 3.0, count)


def by_enumeration(wheels: InputMap, wrench: np.ndarray, limit: float) -> np.ndarray | None:
    """Four wheels: of nu = 0 and every nu that puts a wheel on its limit, the admissible one nearest to 0."""
    (null,) = wheels.null_torque.T
    torque = np.linalg.lstsq(wheels.wheel_rates.T, wrench, rcond=None)[0]
    places = [0.0, *((side * limit - m) / n for side in (-1, 1) for m, n in zip(torque, null, strict=True))]
    admissible = [nu for nu in places if np.abs(torque + nu * null).max() <= limit * (1 + 1e-12)]
    return torque + min(admissible, key=abs) * null if admissible else None
