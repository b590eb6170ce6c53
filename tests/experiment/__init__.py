"""A small experiment that the tests of this folder change in one place each."""

from occ.experiment.pool import Engine

HERE = Engine(in_process=True)
"""Where patches hold and nothing has to be started; what users get is another process."""

TINY = """\
title = "Tiny"
question = "Does it run?"

[platform]
preset = "youbot"

[point]
x = 0.40
y = 0.05

[motion]
kind = "circle"
radius = 0.70
rate = -0.4
phase = 1.5707963267948966

[horizon]
duration = 0.5

[[controller]]
name = "servo law"
kind = "servo"

[[controller]]
name = "translation"
kind = "prescribed_rotation"
rate = 0.0
"""


def tiny(*changes: tuple[str, str], more: str = "") -> str:
    """The experiment with texts replaced, each of which must be there, and with more at its end."""
    text = TINY
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text + more
