"""Units of swept keys, as the tables' documentation states them."""

from __future__ import annotations

from typing import Any

import pytest

from occ.errors import InputError
from occ.experiment.units import unit_of

TABLES: dict[str, Any] = {
    "controller": [
        {"name": "servo", "kind": "servo"},
        {"name": "turn 1.5", "kind": "prescribed_rotation"},
        {"name": "optimum", "kind": "collocation"},
        {"name": "own", "kind": "law.py:Law"},
    ]
}


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("motion.radius", "m"),
        ("motion.rate", "rad/s"),
        ("motion.velocity", "m/s"),
        ("point.x", "m"),
        ("platform.wheel_friction", "N m s"),
        ("platform.friction_scale", "1"),
        ("plant.platform.wheel_friction", "N m s"),
        ("plant.sample_rate", "Hz"),
        ("limits.torque", "N m"),
        ("horizon", "1"),
        ("horizon.laps", "1"),
        ("horizon.duration", "s"),
        ("controller.turn 1.5.rate", "rad/s"),
        ("controller.servo.stabilisation.position", "1/s^2"),
        ("controller.optimum.radius", "m"),
        ("controller.optimum.weights.torque_squared", "J/(N^2 m^2 s)"),
        ("controller.optimum.weights.work", "1"),
        ("controller.own.gain", "1"),
    ],
)
def test_units_of_swept_keys(key: str, unit: str) -> None:
    assert unit_of(key, TABLES) == unit


def test_tables_are_needed_for_controllers_only() -> None:
    assert unit_of("motion.radius", {}) == "m"
    assert unit_of("controller.servo.stabilisation.position", {}) == "1"
    with pytest.raises(InputError, match="unknown controller"):
        unit_of("controller.law.rate", TABLES)
