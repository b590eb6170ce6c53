"""What the limits of a task see along the true motion: largest values, between the nodes too, and where they occur."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from occ.referee.replay import Replay, Samples, gauss_lobatto
from occ.task import Limits, Task
from occ.trajectory import lagrange_basis

JUMP = 1e-3
"""[s] A jump of a torque counts as a change within this time."""
ROUNDING = 1e-9
"""Wheels whose peaks are this near to each other, relative to them, need the same."""
TORQUE_ROUNDING = 1e-14
"""Part of the largest torque by which rounding may move one: a sign that changes next to an edge makes a panel so short
that nothing else is seen of its rates."""
BETWEEN_NODES = 17
"""Places between two nodes at which a peak is looked for."""
BETWEEN = 33
"""Places in each panel at which its polynomials are looked at."""

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


def peaks(replay: Replay, samples: Samples, quantities: Sequence[Quantity]) -> list[Peak]:
    """Largest absolute values between nodes too: the best panels are sampled again, three times finer and finer.

    Args:
        replay: the true motion.
        samples: the same on quadrature nodes.
        quantities: samples -> (k, N), one row a wheel.

    Returns:
        Value, wheel and time of each.
    """
    count = samples.nodes
    places = np.linspace(0.0, 1.0, BETWEEN)
    between = lagrange_basis(gauss_lobatto(count)[0], places)
    begins, widths = samples.t[::count], samples.t[count - 1 :: count] - samples.t[::count]
    found, ends = [], []
    for quantity in quantities:
        values = quantity(samples)
        # Between the nodes by the polynomial on each panel: there another wheel may need more.
        fine = (values.reshape(len(values), -1, count) @ between).reshape(len(values), -1)
        wheel, column = _largest(values)
        other, _ = _largest(fine)
        if np.abs(fine[other]).max() > (1 + ROUNDING) * abs(values[wheel, column]):
            wheel, column = other, _largest(values[[other]])[1]
        found.append(Peak(float(abs(values[wheel, column])), wheel, float(samples.t[column])))
        _, column = _largest(fine[[wheel]])
        panel, place = divmod(column, BETWEEN)
        near = places[[max(place - 1, 0), min(place + 1, BETWEEN - 1)]]
        ends.append(begins[panel] + widths[panel] * near)
    low, high = np.array(ends).reshape(-1, 2).T
    for _ in range(3 if quantities else 0):
        t = np.linspace(low, high, BETWEEN_NODES)
        there = replay.sample(t.ravel())
        for i, quantity in enumerate(quantities):
            values = np.abs(quantity(there)[found[i].wheel]).reshape(t.shape)[:, i]
            k = int(np.argmax(values))
            low[i], high[i] = t[max(k - 1, 0), i], t[min(k + 1, len(t) - 1), i]
            if values[k] > found[i].value:
                found[i] = Peak(float(values[k]), found[i].wheel, float(t[k, i]))
    return found


def _largest(values: np.ndarray) -> tuple[int, int]:
    row, column = np.unravel_index(np.argmax(np.abs(values)), values.shape)
    return int(row), int(column)


def torque_rate_peak(samples: Samples) -> Peak:
    """Largest |dM_i/dt| [N m/s]: of the torques' polynomials in each panel, and of their jumps between panels.

    Args:
        samples: of the true motion.

    Returns:
        Value, wheel and time; a jump counts as a change within a millisecond, and what rounding may add does not count.
    """
    count = samples.nodes
    wheels = len(samples.torque)
    t = samples.t.reshape(-1, count)
    torque = samples.torque.reshape(wheels, -1, count)
    nodes, _ = gauss_lobatto(count)
    places = np.linspace(0.0, 1.0, BETWEEN)
    slopes, widths = differentiation(nodes) @ lagrange_basis(nodes, places), (t[:, -1] - t[:, 0])[:, None]
    rounding = TORQUE_ROUNDING * np.abs(torque).max(initial=0.0) * np.abs(slopes).sum(axis=0) / widths
    rates = np.maximum(np.abs(torque @ slopes) / widths - rounding, 0.0)
    times = t[:, :1] + (t[:, -1:] - t[:, :1]) * places
    jumps = (torque[:, 1:, 0] - torque[:, :-1, -1]) / JUMP
    values = np.concatenate([rates.reshape(wheels, -1), np.abs(jumps)], axis=1)
    moments = np.concatenate([times.ravel(), t[1:, 0]])
    wheel, column = _largest(values)
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


@dataclass(frozen=True)
class Loads:
    """What the wheels bear along the true motion.

    Args:
        torque: [N m] largest.
        wheel_speed: [rad/s] largest.
        power: [W] largest.
        excesses: of each limit, relative to it and 0 where it is held, with the sentence that names wheel, time, value
            and limit.
    """

    torque: float
    wheel_speed: float
    power: float
    excesses: tuple[tuple[float, str], ...]

    @property
    def largest_excess(self) -> tuple[float, str]:
        """Of all limits."""
        return max(self.excesses, default=(0.0, ""))


def loads(task: Task, replay: Replay, samples: Samples) -> Loads:
    """Largest loads and the excess over each limit of the task.

    Args:
        task: with its limits.
        replay: the true motion.
        samples: the same on quadrature nodes.

    Returns:
        All of them, between the nodes too.
    """
    rules = _rules(task.limits)
    quantities = [*_MEASURED, *(rule.quantity for rule in rules if rule.quantity not in _MEASURED)]
    found = dict(zip(quantities, peaks(replay, samples, quantities), strict=True))
    excesses = [_excess(samples, found[rule.quantity], rule) for rule in rules]
    if task.limits.torque_rate is not None:
        excesses.append(_torque_rate_excess(task.limits.torque_rate, samples))
    return Loads(found[_torque].value, found[_wheel_speed].value, found[_power].value, tuple(excesses))


class _Rule(NamedTuple):
    """A limit on a value at one time."""

    quantity: Quantity
    limit: float
    word: str
    unit: str


def _excess(samples: Samples, most: Peak, rule: _Rule) -> tuple[float, str]:
    quantity, limit, word, unit = rule
    values = np.abs(quantity(samples))
    share = float(samples.weight[np.any(values > limit, axis=0)].sum())
    who = "platform" if len(values) == 1 else f"wheel {most.wheel + 1}"
    some = "it" if who == "platform" else "some wheel"
    sentence = (
        f"{who} {word} needs {most.value:.4f}{unit} at t = {most.t:.3f} s; limit {limit:g}{unit} "
        f"(exceeded by {most.value - limit:.4f}{unit}; {some} is over it for {share:.3g} s)"
    )
    return max(most.value / limit - 1.0, 0.0), sentence


def _torque(samples: Samples) -> np.ndarray:
    return samples.torque


def _wheel_speed(samples: Samples) -> np.ndarray:
    return samples.wheel_rates


def _power(samples: Samples) -> np.ndarray:
    return samples.power


_MEASURED = (_torque, _wheel_speed, _power)


def _rules(limits: Limits) -> list[_Rule]:
    line = limits.torque_speed_line
    rules: list[tuple[Quantity, float | None, str, str]] = [
        (_torque, limits.torque, "torque", " N m"),
        (_wheel_speed, limits.wheel_speed, "speed", " rad/s"),
        (_power, limits.wheel_power, "power", " W"),
        (lambda s: np.hypot(s.state[3], s.state[4])[None], limits.platform_speed, "speed", " m/s"),
    ]
    if line is not None:
        stall, speed = line
        rules.append((lambda s: s.torque / stall + s.wheel_rates / speed, 1.0, "voltage", " of the full voltage"))
    return [_Rule(quantity, limit, word, unit) for quantity, limit, word, unit in rules if limit is not None]


def _torque_rate_excess(limit: float, samples: Samples) -> tuple[float, str]:
    most = torque_rate_peak(samples)
    sentence = (
        f"wheel {most.wheel + 1} torque changes at {most.value:.4g} N m/s at t = {most.t:.3f} s; limit {limit:g} N m/s "
        "(a jump counts as a change within 1 ms)"
    )
    return max(most.value / limit - 1.0, 0.0), sentence
