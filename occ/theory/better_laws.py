"""Laws that the theory of the circle suggests where the servo law is far from optimal; both keep B on its program.

They are players like any other law and are judged like any other; the theory only chooses their numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from occ.checks import Positive
from occ.errors import InputError
from occ.laws.base import Moment, PathKeepingLaw
from occ.task import Solution, Start, StartClass, Task
from occ.theory.dissipation import CircleEnergy, circle_of, energy_of
from occ.theory.extremals import Extremal, NoExtremal
from occ.theory.long_run import long_run
from occ.theory.minimum_work import minimum_work
from occ.theory.quadrature import FINE, Well
from occ.theory.trigonometric import TURN, recentred, value

SOFT = 0.01
"""Share of the level by which the end of a manifold is rounded off."""


@dataclass(frozen=True, kw_only=True)
class BestOffset(PathKeepingLaw):
    """psi = omega_B t + phi_B + argmin U: the steady rotation that needs the least power of all.

    It starts on its own heading and yaw rate without a charge for getting there: start class ``own``.

    Args:
        allocation: of the wrench to the wheels: { kind = "min_norm" }, or another kind that holds the limits.
        stabilisation: { position = .., velocity = .. } of B's error; the rotation itself is not stabilised.
    """

    kind: ClassVar[str] = "best_offset"
    start_class: ClassVar[StartClass] = "own"

    def yaw_acceleration(self, moment: Moment) -> ca.SX:
        return ca.SX(0)

    def start(self, task: Task) -> Start:
        circle = circle_of(task)
        angle = float(long_run(energy_of(task.platform, task.point, circle)).angle)
        return Start(heading=math.remainder(circle.phase + angle, TURN), heading_rate=circle.rate)


@dataclass(frozen=True, kw_only=True)
class SlowManifold(PathKeepingLaw):
    """Omega' = d/dt Omega* + (Omega* - Omega) / settling with Omega*(psi~) on the long-run optimum's first integral.

    Z u^2 = U - min U leads to the best steady rotation, Z u^2 = U + h round and round on circles below the switch
    radius (`occ.theory.long_run`).  Where the horizon is too short to get to the steady rotation, h is that of the
    optimum of this horizon, which is slower and turns before it (`occ.theory.minimum_work`): the law comes to rest
    there.  Heading and yaw rate are fed back, so that the law holds from any start and under disturbance; the
    optimum's last move at the end of a horizon is left out.

    Args:
        settling: [s] time constant of the approach to the manifold.
        allocation: of the wrench to the wheels: { kind = "min_norm" }, or another kind that holds the limits.
        stabilisation: { position = .., velocity = .. } of B's error.
    """

    kind: ClassVar[str] = "slow_manifold"
    settling: Positive = 0.05

    def check(self, task: Task) -> None:
        """Refuse a task without a circle, or one that the allocation refuses.

        Raises:
            InputError: what is wrong and what would be right.
        """
        circle_of(task)
        super().check(task)

    def yaw_acceleration(self, moment: Moment) -> ca.SX:
        raise NotImplementedError("the manifold belongs to a task: solve makes it")

    def solve(self, task: Task) -> Solution:
        circle = circle_of(task)
        energy = energy_of(task.platform, task.point, circle)
        best = long_run(energy)
        lowest = float(best.angle)
        _, c_1, _, c_2, s_2 = (float(c) for c in recentred(energy.power, best.angle))
        start = task.start.heading - circle.phase
        level, side = 0.0, -math.copysign(1.0, circle.rate)
        if not best.steady:
            level = float(best.steady_power - best.mean_power)
        elif (way := _turning_way(task)) is not None and way.energy + best.steady_power < 0:
            level, side = float(way.energy + best.steady_power), math.copysign(1.0, way.places[1] - way.places[0])
        return OnManifold(
            rate=circle.rate,
            offset=circle.phase + _cheapest_bottom(energy, start, lowest),
            friction=float(energy.friction),
            valley=(-(c_1 + 2 * c_2), -2 * c_2, -2 * s_2),
            level=level,
            side=side,
            settling=self.settling,
            allocation=self.allocation,
            stabilisation=self.stabilisation,
        ).solve(task)


def _turning_way(task: Task) -> Extremal | None:
    """The optimum of the task's horizon, if it is known and turns."""
    try:
        way = minimum_work(task).extremal
    except (InputError, NoExtremal):
        # More turns than are searched for: the horizon is long.  Where none was found the long run's manifold will do.
        return None
    return way if way is not None and len(way.places) == 3 else None


def _cheapest_bottom(energy: CircleEnergy, start: float, lowest: float) -> float:
    """The lowest U on the right or on the left of the start, whichever costs less to reach when time does not count."""
    well = Well(float(energy.friction), energy.power)
    after = start + np.mod(lowest - start, TURN)
    ends = np.array([after, after - TURN])
    h = np.full(2, -float(value(energy.power, lowest)))
    starts = np.full(2, start)
    levels = np.maximum(value(energy.power, starts) + h, 0.0), np.zeros(2)
    length = well.integrals((starts, ends), h, levels, FINE)[1]
    return float(ends[np.argmin(length + energy.of_end_points(ends))])


@dataclass(frozen=True, kw_only=True)
class OnManifold(PathKeepingLaw):
    """`SlowManifold` with the numbers of one task.

    Args:
        rate: [rad/s] omega_B.
        offset: [rad] heading at t = 0 of the best steady rotation.
        friction: [N m s] Z.
        valley: (3,) [W] q of U - min U = 2 sin^2(s/2) (q_0 + q_1 cos s + q_2 sin s).
        level: [W] h + min U; zero where steady rotation is optimal, negative where the horizon is too short for it.
        side: direction in which psi~ goes, where the level is not zero.
        settling: [s].
        allocation: of the wrench to the wheels: { kind = "min_norm" }, or another kind that holds the limits.
        stabilisation: { position = .., velocity = .. } of B's error.
    """

    kind: ClassVar[str] = "on_manifold"
    rate: float
    offset: float
    friction: Positive
    valley: tuple[float, float, float]
    level: float
    side: float
    settling: Positive

    def yaw_acceleration(self, moment: Moment) -> ca.SX:
        angle = ca.SX.sym("angle")
        q = self.valley[0] + self.valley[1] * ca.cos(angle) + self.valley[2] * ca.sin(angle)
        if self.level == 0.0:
            speed = -ca.sin(angle / 2) * ca.sqrt(2 * q / self.friction)
        else:
            above = 2 * ca.sin(angle / 2) ** 2 * q + self.level
            # Where U + h < 0 the manifold has ended, and psi~ rests; rounded off, for its slope enters the law.
            round_off = SOFT * abs(self.level) if self.level < 0 else 0.0
            speed = self.side * ca.sqrt((above + ca.sqrt(above**2 + round_off**2)) / (2 * self.friction))
        here = moment.heading - self.rate * moment.t - self.offset
        both = ca.Function("manifold", [angle], [speed, ca.jacobian(speed, angle)])
        wanted, slope = both(here)
        u = moment.yaw_rate - self.rate
        return slope * u + (wanted - u) / self.settling
