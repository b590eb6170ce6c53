"""Dynamic programming: order of convergence, and motions on which the answer is known otherwise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from occ.errors import InputError
from occ.model.presets import YouBot
from occ.motion import Ellipse, Line
from occ.theory.coefficients import yaw_coefficients
from occ.theory.dynamic_programming import DynamicProgram, least_work
from tests.tasks import LAP, paper_task

EXACT = 200.327119033710


def test_fourth_order_after_one_extrapolation() -> None:
    result = least_work(paper_task(), DynamicProgram(steps=16, levels=3, points=480))
    once = [b + (b - a) / 3 for a, b in zip(result.levels[:-1], result.levels[1:], strict=True)]
    errors = np.abs(np.array(once) - EXACT)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4)
    plain = np.abs(np.array(result.levels) - EXACT)
    assert math.log2(plain[1] / plain[2]) == pytest.approx(2.0, abs=0.05)


def test_published_infimum_to_nine_digits() -> None:
    result = least_work(paper_task(), DynamicProgram())
    assert result.work == pytest.approx(EXACT, rel=1e-9)
    assert abs(result.work - EXACT) <= result.error


def test_straight_line_without_moving_the_heading() -> None:
    # B at the centre of a youBot on a straight line: by symmetry the best heading on a long way is the cheap direction
    # of translation, zeta_X < zeta_Y, and a start in it never leaves it.
    platform = YouBot(mass_center=(0.0, 0.0)).platform()
    task = paper_task(platform=platform, point=(0.0, 0.0), motion=Line(velocity=(0.3, 0.0), start=(0.0, 0.0)))
    c = yaw_coefficients(platform, (0.0, 0.0))
    result = least_work(task, DynamicProgram(steps=10, levels=2, points=240))
    assert result.work == pytest.approx(float(c.friction_xx) * 0.09 * LAP, rel=1e-9)


def test_ellipse_of_equal_axes_is_a_circle() -> None:
    method = DynamicProgram(steps=12, levels=2, points=240)
    ellipse = Ellipse(semi_axes=(0.7, 0.7), rate=-0.4, phase=math.pi / 2)
    assert least_work(paper_task(motion=ellipse), method).work == pytest.approx(
        least_work(paper_task(), method).work, rel=1e-12
    )


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="steps"):
        DynamicProgram(steps=2)
    platform = YouBot(wheel_friction=0.0, roller_friction=0.0).platform()
    with pytest.raises(InputError, match="friction"):
        least_work(paper_task(platform=platform))
