"""What a motion on a circle costs per second, in balls, as a polynomial of angle, yaw rate and yaw acceleration.

While B keeps its program, pi' = C Omega + V*(psi~), eq. (3.7), and pi'' = C Omega' + V*'(psi~) (Omega - omega_B), so
that the wrench Pi = A pi'' + f + Z pi' of eq. (2.16) is linear in Omega' and quadratic in Omega.  The torques of least
norm with that wrench have sum M_i^2 = Pi^T (C_phi^T C_phi)^-1 Pi; whatever null torque is added, the sum is no smaller,
and the power of the torques is Pi^T pi' with every one of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

from flint import arb, arb_mat

from occ.certify.balls import Ball, Matrix, enclose, matrices
from occ.certify.bellman import CONSTANT, Inequality, Scales, State, value_at
from occ.certify.ends import FREE, Ends
from occ.certify.series import Series
from occ.errors import InputError
from occ.objectives import COPPER_LOSS
from occ.task import Task
from occ.theory.dissipation import circle_of

Cost = Literal["work", "torque_squared", "electric"]


class Running(NamedTuple):
    """Polynomials of x = psi~, w = (Omega - omega_B) / s, a = Omega' / p."""

    torque_squared: Series  # [N^2 m^2] sum M_i^2
    power: Series  # [W] sum M_i phi_i'
    dissipation: Series  # [W] pi'^T Z pi', the power but for the rate of the kinetic energy
    kinetic_energy: Series  # [J] pi'^T A pi' / 2


def scales_of(task: Task) -> Scales:
    """Powers of two of the size of the yaw rates and accelerations that the task needs."""
    rate = circle_of(task).rate
    largest = max(abs(rate), abs(task.start.heading_rate - rate))
    size = 2.0 ** round(math.log2(largest))
    return Scales(size, size * size)


def running_costs(task: Task) -> Running:
    """Squares of the torques, their power, and what becomes of it.

    Args:
        task: on a circle.

    Returns:
        Series whose balls hold the true values.

    Raises:
        InputError: the motion is not a circle.
    """
    circle, scales, m = circle_of(task), scales_of(task), matrices(task)
    speed = arb(circle.radius) * arb(circle.rate)
    direction = [arb(task.point[1]), -arb(task.point[0]), arb(1)]
    difference = Series({(1, 0, 0, 0): arb(scales.rate)})
    yaw_rate = difference + Series({CONSTANT: arb(circle.rate)})
    acceleration = Series({(0, 1, 0, 0): arb(scales.acceleration)})
    program = [Series({(0, 0, 0, -1): speed}), Series({(0, 0, 0, 1): speed}), Series({})]
    velocity = [yaw_rate * c + part for c, part in zip(direction, program, strict=True)]
    change = [acceleration * c + part.by_angle() * difference for c, part in zip(direction, program, strict=True)]
    (s_x, s_y), square = m.moment, yaw_rate * yaw_rate
    gyroscopic = [
        yaw_rate * velocity[1] * -m.mass - square * s_x,
        yaw_rate * velocity[0] * m.mass - square * s_y,
        yaw_rate * (velocity[0] * s_x + velocity[1] * s_y),
    ]
    drag = _times(m.friction, velocity)
    wrench = [Series.sum(parts) for parts in zip(gyroscopic, _times(m.inertia, change), drag, strict=True)]
    weight = arb_mat(m.wheels).inv().tolist()
    return Running(
        torque_squared=_product(wrench, _times(weight, wrench)),
        power=_product(wrench, velocity),
        dissipation=_product(velocity, drag),
        kinetic_energy=_product(velocity, _times(m.inertia, velocity)) * 0.5,
    )


def _times(matrix: Matrix, vector: Sequence[Series]) -> list[Series]:
    return [Series.sum(part * c for part, c in zip(vector, row, strict=True)) for row in matrix]


def _product(a: Sequence[Series], b: Sequence[Series]) -> Series:
    return Series.sum(p * q for p, q in zip(a, b, strict=True)).cleared()


def state_of(task: Task, heading: Ball, yaw_rate: Ball, time: Ball = 0) -> State:
    """psi~ and w of a heading [rad] and a yaw rate [rad/s] at a time [s]."""
    circle = circle_of(task)
    angle = arb(heading) - arb(circle.phase) - arb(circle.rate) * arb(time)
    return State(angle, (arb(yaw_rate) - arb(circle.rate)) / scales_of(task).rate)


def inequality(task: Task, cost: Cost, ends: Ends = FREE, *, for_ever: bool = False) -> Inequality:
    """Bellman's inequality of a task, in balls.

    Args:
        task: on a circle.
        cost: what is bounded.
        ends: class of starts and ends.
        for_ever: whether the mean over an endless motion is bounded instead.

    Returns:
        To be proven by `occ.certify.checker.examine`.

    Raises:
        InputError: the motion is not a circle, or ends without a bound.
    """
    running = running_costs(task)
    scales, regular = scales_of(task), cost != "work"
    costs = {
        "work": running.dissipation,
        "torque_squared": running.torque_squared,
        "electric": running.power + running.torque_squared * arb(COPPER_LOSS),
    }
    if for_ever:
        return Inequality(costs[cost], scales, regular)
    duration = arb(task.duration)
    start = state_of(task, task.start.heading, task.start.heading_rate)
    if ends.end == "periodic" and ends.free_start:
        return Inequality(costs[cost], scales, regular, duration, turn=arb(circle_of(task).rate) * duration)
    if ends.free_start or ends.end == "rest":
        raise InputError(
            f"end: {ends.end!r} with{' a free' if ends.free_start else ' the given'} start has no bound here"
        )
    end = None
    if ends.end == "periodic":
        end = state_of(task, task.start.heading, task.start.heading_rate, duration)
    elif ends.end == "law":
        assert ends.state is not None
        end = state_of(task, ends.state[2], ends.state[5], duration)
    end_cost, paid = Series({}), arb(0)
    if not regular:
        paid = -value_at(running.kinetic_energy, start)
        end_cost = Series.of(enclose(task).rest)
        if end:
            paid += value_at(running.kinetic_energy, end)
    return Inequality(costs[cost], scales, regular, duration, start, end, end_cost, paid)
