"""Limits of the wheels inside the optimum, and between the nodes: knots at the switching times, then a back-off.

A limit that is imposed at the nodes only is passed between them.  Where the optimum moves on to a limit or leaves it,
its control has a kink: an edge of the mesh is put there, so that each polynomial represents a smooth arc.  What is
still passed after that is taken off the limit of that interval, until nothing is.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from occ.optimal.problem import Row
from occ.task import Limits

QUANTITIES = ("torque", "wheel_speed", "wheel_power", "torque_speed_line", "platform_speed", "torque_rate")
"""What can be limited, in the order of the path conditions; the names are those of `occ.task.Limits`."""
NEEDS_NULL_TORQUE = ("torque", "wheel_power", "torque_speed_line", "torque_rate")
"""Limits that see how a wrench is shared among the wheels."""
ACTIVE = 1e-5
"""A quantity this close to its limit, relative to it, counts as on it."""
RIPPLE = 0.05
"""A power that stays below this part of the largest one between two changes of its sign is held at zero there: its
polynomials ripple, and an edge at each of these times would only make intervals of microseconds."""
MOST_MOVED = 0.2
"""An edge nearer to a switching time than this part of its smaller interval is moved there."""


def limited_quantities(limits: Limits) -> tuple[str, ...]:
    """Names of the quantities for which a limit is set."""
    return tuple(name for name in QUANTITIES if getattr(limits, name) is not None)


def limit_values(limits: Limits, wheel_count: int) -> np.ndarray:
    """(k,) Largest absolute values in the order of the path conditions; the platform's speed appears squared.

    Args:
        limits: of the task.
        wheel_count: n.

    Returns:
        One entry a wheel, or one for the platform, for each limited quantity.
    """
    values: list[float] = []
    for name in limited_quantities(limits):
        if limits.platform_speed is not None and name == "platform_speed":
            values.append(limits.platform_speed**2)
        else:
            values += [1.0 if name == "torque_speed_line" else getattr(limits, name)] * wheel_count
    return np.array(values)


def rows_of(names: tuple[str, ...], wheel_count: int) -> dict[str, np.ndarray]:
    """Which of the `limit_values` belong to which limited quantity.

    Args:
        names: of the limited quantities.
        wheel_count: n.

    Returns:
        Numbers of the rows of each.
    """
    sizes = [1 if name == "platform_speed" else wheel_count for name in names]
    ends = np.cumsum(sizes)
    return {name: np.arange(end - size, end) for name, size, end in zip(names, sizes, ends, strict=True)}


_WORDS = {
    "torque": ("torque", "N m"),
    "wheel_speed": ("speed", "rad/s"),
    "wheel_power": ("power", "W"),
    "torque_speed_line": ("voltage", "of the full voltage"),
    "torque_rate": ("torque rate", "N m/s"),
}


def limit_names(names: tuple[str, ...], wheel_count: int) -> tuple[Row, ...]:
    """What each of the `limit_values` is.

    Args:
        names: of the limited quantities.
        wheel_count: n.

    Returns:
        In the same order.
    """
    rows: list[Row] = []
    for name in names:
        if name == "platform_speed":
            rows.append(Row("platform speed", "m/s", squared=True))
        else:
            rows += [Row(*_WORDS[name], wheel) for wheel in range(1, wheel_count + 1)]
    return tuple(rows)


def limit_expressions(names: tuple[str, ...], moment: LimitedMoment) -> ca.SX:
    """(k,) The limited quantities, CasADi.

    Args:
        names: of the limited quantities.
        moment: what they depend on.

    Returns:
        In the order of `limit_rows`.
    """
    m, w = moment.torque, moment.rates
    stall, no_load = ca.vertsplit(moment.line)
    table = {
        "torque": m,
        "wheel_speed": w,
        "wheel_power": m * w,
        "torque_speed_line": m * stall + w * no_load,
        "platform_speed": ca.sumsqr(moment.velocity[:2]),
        "torque_rate": moment.torque_rate,
    }
    return ca.vertcat(*(table[name] for name in names)) if names else ca.SX(0, 1)


@dataclass(frozen=True, eq=False)
class LimitedMoment:
    """What the limited quantities depend on at one time, CasADi.

    Args:
        torque: (n,) M.
        rates: (n,) phi'.
        velocity: (3,) pi'.
        torque_rate: (n,) dM/dt.
        line: (2,) 1 / stall torque, 1 / no-load speed; zeros where there is no such limit.
    """

    torque: ca.SX
    rates: ca.SX
    velocity: ca.SX
    torque_rate: ca.SX
    line: ca.SX


def line_numbers(limits: Limits) -> tuple[float, float]:
    """1 / stall torque [1/(N m)] and 1 / no-load speed [s/rad]; zeros where there is no torque-speed line."""
    line = limits.torque_speed_line
    return (0.0, 0.0) if line is None else (1.0 / line[0], 1.0 / line[1])


@dataclass(frozen=True)
class LimitedArcs:
    """The limited quantities along a solution, between the nodes too.

    Args:
        t: (N, m) [s] sample times in each interval, its ends included.
        load: (k, N, m) |quantity| / limit.
        largest: (k, N) upper bounds of it in each interval, between the samples too.
        node_times: (N d,) [s].
        node_load: (k, N d) the same at the collocation points.
        hard: so many of the rows are limits of the task; the others follow the solution (the largest torque).
        clipped: (j, N, m) powers whose positive parts are counted.
        proven: names of the limited quantities whose bounds are proven for the motion that is handed over; those of the
            others are proven for polynomials only, and their distance from the motion is estimated.
        estimated: names of those others.
        remainder: largest distance from a polynomial that the proven bounds contain, relative to the limit.
        claimed: [N m] the largest torque where it is the cost and the rows that follow it are proven; NaN elsewhere.
    """

    t: np.ndarray
    load: np.ndarray
    largest: np.ndarray
    node_times: np.ndarray
    node_load: np.ndarray
    hard: int
    clipped: np.ndarray
    proven: tuple[str, ...] = ()
    estimated: tuple[str, ...] = ()
    remainder: float = np.nan
    claimed: float = np.nan

    @property
    def words(self) -> str:
        """What is proven of limits and the largest torque between the nodes; empty before anything is looked at."""
        parts = [self._words_of_limits]
        if np.isfinite(self.claimed):
            passed = float(self.soft_excess.max())
            parts.append(
                f"torques proven between nodes to pass the claimed {self.claimed:.6g} N m by at most {passed:.1g} of it"
            )
        return "; ".join(part for part in parts if part)

    @property
    def _words_of_limits(self) -> str:
        listed, others = (" and ".join(names).replace("_", " ") for names in (self.proven, self.estimated))
        if not self.proven:
            return f"limits of {others} estimated between nodes" if others else ""
        rest = f", of {others} estimated" if others else ""
        return (
            f"limits of {listed} proven between nodes on its motion, remainders of {self.remainder:.0e} included{rest}"
        )

    @property
    def excess(self) -> np.ndarray:
        """(k, N) Largest excess in each interval, relative to the limit; 0 where there is none."""
        return np.maximum(self.largest - 1.0, 0.0)

    @property
    def hard_excess(self) -> np.ndarray:
        """(hard, N) The same over the limits of the task only."""
        return self.excess[: self.hard]

    @property
    def soft_excess(self) -> np.ndarray:
        """(k - hard, N) The same over the largest torque, which is the cost."""
        return self.excess[self.hard :]

    def switching_times(self) -> np.ndarray:
        """[s] Times at which a quantity moves on to its limit or leaves it, or a clipped power changes its sign."""
        times = list(self.sign_changes())
        t, load = self.t.ravel(), self.load.reshape(len(self.load), self.t.size)
        for row, nodes in zip(load, self.node_load, strict=True):
            active = nodes > 1.0 - ACTIVE
            for k in np.flatnonzero(active[1:] != active[:-1]):
                low, high = self.node_times[k], self.node_times[k + 1]
                inside = np.flatnonzero((t >= low) & (t <= high) & (row >= 1.0))
                if not inside.size:
                    times.append((low + high) / 2)
                else:
                    times.append(t[inside[0]] if active[k + 1] else t[inside[-1]])
        return np.array(sorted(times))

    def sign_changes(self) -> np.ndarray:
        """[s] Times at which a clipped power changes its sign."""
        t, powers = self.t.ravel(), self.clipped.reshape(len(self.clipped), self.t.size)
        least, times = RIPPLE * np.abs(powers).max(initial=0.0), [np.zeros(0)]
        for power in powers:
            changes = np.flatnonzero(power[:-1] * power[1:] < 0.0)
            large = np.maximum.reduceat(np.abs(power), np.append(0, changes + 1)) > least
            k = changes[large[:-1] | large[1:]]
            times.append(t[k] + (t[k + 1] - t[k]) * power[k] / (power[k] - power[k + 1]))
        return np.sort(np.concatenate(times))


def with_knots(edges: np.ndarray, times: np.ndarray, kept: np.ndarray | None = None) -> np.ndarray:
    """A mesh with an edge at every switching time: a near edge is moved there, otherwise a new one is put in.

    Args:
        edges: (N + 1,) [s] without knots.
        times: [s] switching times.
        kept: [s] edges that stay where they are, beside the first and the last: knots of the program.

    Returns:
        (M + 1,) edges; M is rounded up to a multiple of four by bisecting the widest intervals.
    """
    result = list(edges)
    fixed = {edges[0], edges[-1], *([] if kept is None else kept)}
    span = edges[-1] - edges[0]
    for time in times:
        if min(abs(time - f) for f in fixed) < 1e-7 * span:
            continue
        k = int(np.argmin(np.abs(np.array(result) - time)))
        widths = [abs(result[j] - result[k]) for j in (k - 1, k + 1) if 0 <= j < len(result)]
        if result[k] not in fixed and abs(result[k] - time) < MOST_MOVED * min(widths):
            result[k] = float(time)
        else:
            result.append(float(time))
        fixed.add(float(time))
        result.sort()
    while (len(result) - 1) % 4:
        k = int(np.argmax(np.diff(result)))
        result.insert(k + 1, (result[k] + result[k + 1]) / 2)
    return np.array(result)
