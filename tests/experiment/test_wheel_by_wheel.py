"""A platform given wheel by wheel: its preset has the name of one of its keys, which no message may confuse."""

from __future__ import annotations

import pytest

from tests.experiment import tiny
from tests.experiment.conftest import Occ, Write

WHEEL = """[[platform.wheels]]
position = [{x}, {y}]
mounting_angle = {angle}
roller_angle = 0.0
radius = 0.05
roller_radius = 0.008
"""
BODY = 'preset = "wheels"\nplatform_mass = 8.5\nmass_center = [0.0, 0.0]\nyaw_inertia = 0.3\n'
WHEELS = "".join(WHEEL.format(x=x, y=y, angle=a) for x, y, a in ((0.1, 0.17, 2.6), (-0.2, 0.0, 4.7), (0.1, -0.17, 0.5)))
FILE = tiny(('preset = "youbot"', BODY + WHEELS))


def test_a_file_that_is_right(write: Write, occ: Occ) -> None:
    assert occ("check", write(FILE)).exit_code == 0


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("platform.platform_mass=-1", "platform.platform_mass: out of range (-1)"),
        ("platform.tyres=4", "platform.tyres: unknown key"),
        ("platform.wheels=3", "platform.wheels: wrong type (3)"),
        ("platform.wheels=[]", "at least 3 needed"),
        ("platform.wheels=[3]", "platform.wheels #1: wrong type (3)"),
    ],
)
def test_mistakes_are_where_they_are(write: Write, occ: Occ, setting: str, words: str) -> None:
    result = occ("check", write(FILE), "--set", setting)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert words in line


def test_a_mistake_in_one_wheel_names_it(write: Write, occ: Occ) -> None:
    result = occ("check", write(FILE.replace("radius = 0.05", "radius = -0.05", 1)))
    assert "platform.wheels #1.radius: out of range (-0.05)" in result.stderr


def test_it_is_listed(occ: Occ) -> None:
    assert "  wheels: " in occ("list", "platforms").stdout
