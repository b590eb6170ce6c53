"""A certified least mean power of any rotation strategy, while B goes round its circle for ever.

For every h with U + h >= 0 everywhere, Z u^2 + U >= 2 sqrt(Z (U + h)) |u| - h.  A full turn of psi~ gains at most
4 pi Z |omega_B| by the ends and pays at least the integral of the root, so that

    mean sqrt(U + h) >= |omega_B| sqrt(Z)    proves    mean power >= -h

for every strategy whatever; kinetic energy is bounded and does not count in the long run.  The smallest h is tight.
"""

from __future__ import annotations

import flint

from occ.certify.angle import one_angle
from occ.certify.balls import Refused
from occ.certify.checker import examine
from occ.certify.proofs import Level
from occ.certify.work import BITS
from occ.task import Task
from occ.theory.dissipation import circle_of, energy_of
from occ.theory.long_run import long_run

STEPS = (0.0, *(10.0**k for k in range(-14, -5)))
"""Relative rises of the level that are tried above the value of the theory."""
ROUNDED = 1e-13
"""A claim that is above min U by less than this (relative) is above it by rounding."""
GRAIN = 1e-13
"""Lengths that need not be found, relative to the largest."""


def least_mean_power(task: Task) -> float:
    """A float that is certainly not above the least mean power of any rotation strategy.

    Args:
        task: on a circle; only platform, point and circle count.

    Returns:
        [W]

    Raises:
        InputError: not a circle.
        Refused: no level near the value of the theory proves a bound.
    """
    value = float(long_run(energy_of(task.platform, task.point, circle_of(task))).mean_power)
    for step in STEPS:
        try:
            return check_mean_power(task, value - step * max(abs(value), 1e-9))
        except Refused:
            continue
    raise Refused(f"no level close to {-value:.12g} W proves a bound")


def check_mean_power(task: Task, claim: float) -> float:
    """Whether a mean power is a lower bound, in ball arithmetic.

    Args:
        task: on a circle.
        claim: [W]

    Returns:
        The claim, or the least steady power from below where that is less by its rounding only.

    Raises:
        Refused: nothing is proven.
    """
    with flint.ctx.workprec(BITS):
        problem = one_angle(task, for_ever=True)
        if not problem.task.friction > 0:
            raise Refused("without friction nothing is paid for a way")
        turn = float(problem.lengths.sums(1.0 - claim)[-1])
        problem = one_angle(task, grain=GRAIN * turn, for_ever=True)
        lower = examine(problem, Level(-claim))
    if lower < claim - ROUNDED * abs(claim):
        raise Refused(f"{claim!r} W: standing where U is least needs {lower!r} W")
    return lower
