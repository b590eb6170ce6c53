"""One motion of the paper, made twice: the full platform model under the law's torques, and the yaw equation (4.3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from occ.errors import OccError, Status
from occ.laws import PathKeepingLaw, ServoLaw
from occ.model.presets import youbot
from occ.motion import Circle
from occ.paper.numbers import PHASE, POINT, RATE
from occ.referee.replay import Replay, Samples
from occ.task import Start, Task
from occ.theory import YawCoefficients, yaw_coefficients
from occ.theory.equation import reduced_motion

AGREEMENT_COLUMNS = (
    "figure",
    "curve",
    "duration_s",
    "heading_difference_rad",
    "yaw_rate_difference_rad_s",
    "centre_difference_m",
    "velocity_difference_m_s",
    "point_off_program_m",
)


def platform_coefficients(point: tuple[float, float] = POINT) -> YawCoefficients:
    """Eq. (3.10) for the platform (2.17).

    Args:
        point: (2,) [m] B.

    Returns:
        Numbers, each of shape ().
    """
    return yaw_coefficients(youbot(), point)


@dataclass(frozen=True, kw_only=True)
class Run:
    """What to simulate: B of the platform (2.17) on a circle with omega_B = -0.4 1/s.

    Args:
        radius: [m] R_B.
        duration: [s].
        psi_tilde: [rad] psi~(0) = psi(0) - phi_B.
        yaw_rate: [rad/s] Omega(0).
        phase: [rad] phi_B.
        point: (2,) [m] B.
    """

    radius: float
    duration: float
    psi_tilde: float = -PHASE
    yaw_rate: float = 0.0
    phase: float = PHASE
    point: tuple[float, float] = POINT

    @property
    def task(self) -> Task:
        """The same as a task."""
        return Task(
            platform=youbot(),
            point=self.point,
            motion=Circle(radius=self.radius, rate=RATE, phase=self.phase),
            duration=self.duration,
            start=Start(heading=self.psi_tilde + self.phase, heading_rate=self.yaw_rate),
        )


@dataclass(frozen=True)
class Simulated:
    """The motion of the full model at some times, and how far the yaw equation (4.3) is from it.

    Args:
        run: what was simulated.
        samples: states, torques and objectives of the full model.
        wrench: (3, N) F_X [N], F_Y [N], M_Omega [N m].
        differences: by the columns of the agreement table.
    """

    run: Run
    samples: Samples
    wrench: np.ndarray
    differences: Mapping[str, float]

    @property
    def psi_tilde(self) -> np.ndarray:
        """(N,) [rad] psi - omega_B t - phi_B, not wrapped."""
        return self.samples.state[2] - RATE * self.samples.t - self.run.phase

    def agreement(self, figure: int, curve: str) -> dict[str, float | str]:
        """A row of the agreement table.

        Args:
            figure: its number.
            curve: its name.

        Returns:
            By the names in `AGREEMENT_COLUMNS`.
        """
        return {"figure": figure, "curve": curve, "duration_s": self.run.duration, **self.differences}


def replay_of(task: Task, law: PathKeepingLaw) -> Replay:
    """The full model under a law's torques.

    Args:
        task: platform, motion and start.
        law: whose torques.

    Returns:
        The true motion.

    Raises:
        OccError: the law gives up.
    """
    solution = law.solve(task)
    if solution.status is not Status.OK or solution.control is None or solution.start_state is None:
        raise OccError(f"{law.kind}: {solution.message}")
    return Replay(task.platform, solution.control, solution.start_state, task.duration)


def simulate(run: Run, t: np.ndarray) -> Simulated:
    """Integrate the six states of the platform under the law, and eq. (4.3) beside them.

    Args:
        run: what to simulate.
        t: (N,) [s] inside the horizon, increasing.

    Returns:
        The motion of the full model and its distances from the reduced one, over these times.
    """
    task = run.task
    samples = replay_of(task, ServoLaw()).sample(t)
    psi, omega = reduced_motion(platform_coefficients(run.point), run.radius, RATE, (run.psi_tilde, run.yaw_rate), t)
    reduced = task.states_on_program(t, psi + RATE * t + run.phase, omega)
    apart = np.abs(samples.state - reduced).max(axis=1)
    off = np.hypot(*(task.point_motion(samples.state)[0] - task.motion.at(t)[0])).max()
    differences = {
        "heading_difference_rad": float(apart[2]),
        "yaw_rate_difference_rad_s": float(apart[5]),
        "centre_difference_m": float(apart[:2].max()),
        "velocity_difference_m_s": float(apart[3:5].max()),
        "point_off_program_m": float(off),
    }
    wrench = np.array(task.dynamics.input_map(np.zeros(6))) @ samples.torque
    return Simulated(run, samples, wrench, differences)
