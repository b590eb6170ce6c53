"""A task (platform, point B, program motion, start, horizon, limits), and what a player makes of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np

from occ.checks import Angle, Positive, Vector2, check_fields
from occ.control import Control
from occ.errors import InputError, Status
from occ.model.coefficients import coefficients
from occ.model.constraint import path_functions
from occ.model.dynamics import Dynamics, dynamics
from occ.model.platform import Platform
from occ.motion import ProgramMotion
from occ.numeric import evaluate_many
from occ.plant import Plant
from occ.trajectory import Trajectory

LONGEST_HORIZON = 1e6
"""[s] Durations beyond this are taken for a mistake."""
MOST_SAMPLES = 100_000
"""More samples of a sampled controller than this are taken for a mistake."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """psi(0) and Omega(0); B starts on its program in position and velocity.

    Args:
        heading: [rad] psi(0).
        heading_rate: [rad/s] Omega(0).
    """

    heading: Angle = 0.0
    heading_rate: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """|M_i| <= torque, |phi_i'| <= wheel_speed, |M_i phi_i'| <= wheel_power on each wheel, and so on; None is no limit.

    Args:
        torque: [N m].
        wheel_speed: [rad/s].
        wheel_power: [W].
        torque_rate: [N m/s] |dM_i/dt| at most; torques do not jump then.
        platform_speed: [m/s] of O.
        stall_torque: [N m] with no_load_speed the torque-speed line |M_i / stall_torque + phi_i' / no_load_speed| <= 1.
        no_load_speed: [rad/s] of a wheel at full voltage without torque.

    Raises:
        InputError: only one of stall_torque and no_load_speed.

    Source: the torque-speed line is the motor's voltage equation, R_a i + k_t n phi' = U with |U| limited.
    """

    torque: Positive | None = None
    wheel_speed: Positive | None = None
    wheel_power: Positive | None = None
    torque_rate: Positive | None = None
    platform_speed: Positive | None = None
    stall_torque: Positive | None = None
    no_load_speed: Positive | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if (self.stall_torque is None) != (self.no_load_speed is None):
            missing = "stall_torque" if self.stall_torque is None else "no_load_speed"
            raise InputError(
                f"Limits: {missing} should be given, too; the torque-speed line needs stall_torque and no_load_speed"
            )

    @property
    def torque_speed_line(self) -> tuple[float, float] | None:
        """Stall torque [N m] and no-load speed [rad/s]; None where there is no such limit."""
        if self.stall_torque is None or self.no_load_speed is None:
            return None
        return self.stall_torque, self.no_load_speed


@dataclass(frozen=True, kw_only=True)
class Task:
    """Keep point B of a platform on its program motion over 0 <= t <= T.

    Args:
        platform: what the controllers know of the platform.
        point: (2,) [m] B = (b_X, b_Y) in the body frame.
        motion: r_B*(t).
        duration: [s] T.
        start: heading and yaw rate at t = 0.
        limits: of the wheels.
        plant: how the real platform differs from that; only the referee looks at it.

    Raises:
        InputError: a point that is not finite, a horizon that is not in (0, 1e6] s, or a plant that does not fit.
    """

    platform: Platform
    point: Vector2
    motion: ProgramMotion
    duration: Positive
    start: Start = Start()
    limits: Limits = Limits()
    plant: Plant | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.duration > LONGEST_HORIZON:
            raise InputError(f"Task: duration should be at most {LONGEST_HORIZON:g} s, not {self.duration!r}")
        if self.plant is not None:
            wheels = self.true_platform.wheel_count
            if wheels != self.platform.wheel_count:
                raise InputError(
                    f"Task: the plant has {wheels} wheels; should have the {self.platform.wheel_count} of the model"
                )
            rate = self.plant.sample_rate
            if rate is not None and rate * self.duration > MOST_SAMPLES:
                raise InputError(
                    f"Task: a sample_rate of {rate:g} Hz makes {rate * self.duration:.4g} samples in "
                    f"{self.duration:.4g} s; should be at most {MOST_SAMPLES}"
                )

    @property
    def true_platform(self) -> Platform:
        """The plant's platform, which is the model's unless the plant has its own."""
        return self.plant.platform if self.plant is not None and self.plant.platform is not None else self.platform

    @property
    def off_model(self) -> bool:
        """Whether the plant differs from what the controllers know, so that errors are measures and no verdicts."""
        return self.plant is not None and self.plant.differs_from(self.platform)

    @property
    def dynamics(self) -> Dynamics:
        """The platform's dynamics."""
        return dynamics(self.platform)

    @cached_property
    def path_data(self) -> np.ndarray:
        """(d,) Packed platform matrices, point and motion numbers: the data of every path-keeping function."""
        return np.concatenate([coefficients(self.platform), self.point, self.motion.values()])

    @property
    def motion_structure(self) -> tuple[type[ProgramMotion], tuple[int, ...], int]:
        """What of the motion shapes a CasADi function, as opposed to its numbers."""
        return type(self.motion), self.motion.structure(), len(self.motion.values())

    def state_on_program(self, t: float, heading: float, yaw_rate: float) -> np.ndarray:
        """x_O = r_B* - R(psi) b with V_X, V_Y by eq. (3.6).

        Args:
            t: [s].
            heading: [rad].
            yaw_rate: [rad/s].

        Returns:
            (6,) state with B on its program in position and velocity.
        """
        return self.states_on_program(np.array([t]), np.array([heading]), np.array([yaw_rate]))[:, 0]

    def states_on_program(self, t: np.ndarray, heading: np.ndarray, yaw_rate: np.ndarray) -> np.ndarray:
        """The same for many times at once: t, heading, yaw_rate (N,); result (6, N)."""
        position, velocity, acceleration = self.motion.at(t)
        b_x, b_y = self.point
        c, s = np.cos(heading), np.sin(heading)
        center = position - np.array([c * b_x - s * b_y, s * b_x + c * b_y])
        (pseudo,) = evaluate_many(
            path_functions(self.platform.wheel_count)["velocity"],
            coefficients(self.platform),
            np.array(self.point),
            heading[None, :],
            yaw_rate[None, :],
            velocity,
            acceleration,
            shared=(0, 1),
        )
        return np.vstack([center, heading[None, :], pseudo])

    def point_motion(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r_B = r_O + R(psi) b and its velocity on the floor.

        Args:
            state: (6, N).

        Returns:
            Position [m] and velocity [m/s] of B, each (2, N).
        """
        x, y, heading, v_x, v_y, omega = state
        b_x, b_y = self.point
        c, s = np.cos(heading), np.sin(heading)
        position = np.array([x + c * b_x - s * b_y, y + s * b_x + c * b_y])
        body_x, body_y = v_x - omega * b_y, v_y + omega * b_x
        return position, np.array([c * body_x - s * body_y, s * body_x + c * body_y])


Keep = Literal["path", "tube", "ends"]
ClaimedKeep = Literal["path", "tube", "ends", "none"]
StartClass = Literal["given", "own", "free"]
EndClass = Literal["free", "law", "periodic", "rest"]


@dataclass(frozen=True, kw_only=True)
class Claim:
    """What a solution says of itself, which the referee checks.

    Args:
        keep: ``path``: B stays on its program in position and velocity; ``tube``: within ``radius`` of its program
            position; ``ends``: B ends on its program in position, and in velocity unless the end is ``rest``;
            ``none``: B leaves its program, and its errors are measures.  All start with B on its program in position
            and velocity.
        start: ``given``: the task's start; ``own``: another heading or yaw rate, not charged for getting there;
            ``free``: chosen, and equal to the end state (end ``periodic`` only), so that no kinetic energy is gained.
        end: ``free``; ``law``: the end state of the servo law from the same start; ``periodic``: the start's heading
            plus ``winding`` full turns and its yaw rate, B on its program; ``rest``: no velocity.
        radius: [m] of the tube.
        winding: net full turns of the heading, where the end is ``periodic``.
    """

    keep: ClaimedKeep = "path"
    start: StartClass = "given"
    end: EndClass = "free"
    radius: float | None = None
    winding: int | None = None


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A player's answer to a task.

    Args:
        control: the wheel torques; None where the player found none.
        start_state: (6,) where the motion starts; None where the player found no solution.
        claim: what the player says of it.
        claimed: the motion that the player expects; None where it expects nothing.
        status: ``OK`` unless the player itself gave up.
        message: why, in words with numbers and units.
        statistics: of the solver, for the record of the run.
        local_objective: name of the objective of which the player says that this is a local optimum.
    """

    control: Control | None
    start_state: np.ndarray | None
    claim: Claim = Claim()
    claimed: Trajectory | None = None
    status: Status = Status.OK
    message: str = ""
    statistics: dict[str, Any] = field(default_factory=dict)
    local_objective: str | None = None


class Player(Protocol):
    """Anything that maps a task to a solution: a law, an optimal controller, an allocation."""

    def check(self, task: Task) -> None:
        """Refuse, with an `InputError`, a task that this player cannot be meant for; called before anything runs."""
        ...

    def solve(self, task: Task) -> Solution:
        """Find wheel torques for the task; numerical failure is a solution with a status, not an exception."""
        ...
