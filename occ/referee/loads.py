"""What the limits of a task see along the true motion: largest values, between the nodes too, and where they occur."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occ.referee.replay import Replay, Samples, gauss_lobatto
from occ.task import Limits, Task
from occ.trajectory import lagrange_basis

JUMP = 1e-3
"""[s] A jump of a torque counts as a change within this time."""
BETWEEN = 33
"""Places in each step at which torque rates are looked at."""

Quantity = Callable[[Samples], np.ndarray]


@dataclass(frozen=True)
class Peak:
    """The largest value of a quantity.

    Args:
        value: in the quantity's unit.
        wheel: from 0.
        t: [s].
    """

    value: float
    wheel: int
    t: float


def peak(replay: Replay, samples: Samples, quantity: Quantity) -> Peak:
    """Largest absolute value between nodes too: the best panel is sampled again, three times finer and finer.

    Args:
        replay: the true motion.
        samples: the same on quadrature nodes.
        quantity: samples -> (k, N), one row a wheel.

    Returns:
        Value, wheel and time.
    """
    values = np.abs(quantity(samples))
    wheel, column = (int(i) for i in np.unravel_index(np.argmax(values), values.shape))
    best, when = float(values[wheel, column]), float(samples.t[column])
    low, high = samples.t[max(column - 1, 0)], samples.t[min(column + 1, len(samples.t) - 1)]
    for _ in range(3):
        if not high > low:
            break
        t = np.linspace(low, high, 17)
        fine = np.abs(quantity(replay.sample(t))[wheel])
        k = int(np.argmax(fine))
        low, high = t[max(k - 1, 0)], t[min(k + 1, len(t) - 1)]
        if fine[k] > best:
            best, when = float(fine[k]), float(t[k])
    return Peak(best, wheel, when)


def torque_rate_peak(samples: Samples) -> Peak:
    """Largest |dM_i/dt| [N m/s]: of the torques' polynomials in each step, and of their jumps between steps.

    Args:
        samples: of the true motion.

    Returns:
        Value, wheel and time; a jump counts as a change within a millisecond.
    """
    count = samples.nodes
    wheels = len(samples.torque)
    t = samples.t.reshape(-1, count)
    torque = samples.torque.reshape(wheels, -1, count)
    nodes, _ = gauss_lobatto(count)
    places = np.linspace(0.0, 1.0, BETWEEN)
    rates = torque @ (differentiation(nodes) @ lagrange_basis(nodes, places)) / (t[:, -1] - t[:, 0])[:, None]
    times = t[:, :1] + (t[:, -1:] - t[:, :1]) * places
    jumps = (torque[:, 1:, 0] - torque[:, :-1, -1]) / JUMP
    values = np.abs(np.concatenate([rates.reshape(wheels, -1), jumps], axis=1))
    moments = np.concatenate([times.ravel(), t[1:, 0]])
    wheel, column = (int(i) for i in np.unravel_index(np.argmax(values), values.shape))
    return Peak(float(values[wheel, column]), wheel, float(moments[column]))


def differentiation(nodes: np.ndarray) -> np.ndarray:
    """(d, d) D with p'(s_j) = sum_i p(s_i) D_ij for every polynomial of degree d - 1.

    Args:
        nodes: (d,) the s_i.

    Returns:
        The transposed differentiation matrix of the nodes.

    Source: Berrut and Trefethen, Barycentric Lagrange interpolation, SIAM Review 46 (2004), section 9.3.
    """
    distance = nodes[:, None] - nodes[None, :] + np.eye(len(nodes))
    weights = 1.0 / distance.prod(axis=1)
    matrix = weights[:, None] / weights[None, :] / -distance
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=0))
    return np.asarray(matrix)


def excesses(task: Task, replay: Replay, samples: Samples) -> list[tuple[float, str]]:
    """Relative excess over each limit of the task, with the sentence that names wheel, time, value and limit.

    Args:
        task: with its limits.
        replay: the true motion.
        samples: the same on quadrature nodes.

    Returns:
        One pair for each limit; the excess is 0 where the limit is held.
    """
    found = []
    for quantity, limit, word, unit in _rules(task.limits):
        most = peak(replay, samples, quantity)
        over = np.any(np.abs(quantity(samples)) > limit, axis=0)
        share = float(samples.weight[over].sum())
        who = "platform" if len(quantity(samples)) == 1 else f"wheel {most.wheel + 1}"
        some = "it" if who == "platform" else "some wheel"
        sentence = (
            f"{who} {word} needs {most.value:.4f}{unit} at t = {most.t:.3f} s; limit {limit:g}{unit} "
            f"(exceeded by {most.value - limit:.4f}{unit}; {some} is over it for {share:.3g} s)"
        )
        found.append((max(most.value / limit - 1.0, 0.0), sentence))
    if task.limits.torque_rate is not None:
        found.append(_torque_rate_excess(task.limits.torque_rate, samples))
    return found


def _rules(limits: Limits) -> list[tuple[Quantity, float, str, str]]:
    """Quantity, limit, word and unit of each limit on a value at one time."""
    line = limits.torque_speed_line
    rules: list[tuple[Quantity, float | None, str, str]] = [
        (lambda s: s.torque, limits.torque, "torque", " N m"),
        (lambda s: s.wheel_rates, limits.wheel_speed, "speed", " rad/s"),
        (lambda s: s.power, limits.wheel_power, "power", " W"),
        (lambda s: np.hypot(s.state[3], s.state[4])[None], limits.platform_speed, "speed", " m/s"),
    ]
    if line is not None:
        stall, speed = line
        rules.append((lambda s: s.torque / stall + s.wheel_rates / speed, 1.0, "voltage", " of the full voltage"))
    return [(quantity, limit, word, unit) for quantity, limit, word, unit in rules if limit is not None]


def _torque_rate_excess(limit: float, samples: Samples) -> tuple[float, str]:
    most = torque_rate_peak(samples)
    sentence = (
        f"wheel {most.wheel + 1} torque changes at {most.value:.4g} N m/s at t = {most.t:.3f} s; limit {limit:g} N m/s "
        "(a jump counts as a change within 1 ms)"
    )
    return max(most.value / limit - 1.0, 0.0), sentence
