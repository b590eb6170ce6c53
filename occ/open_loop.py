"""The torques of another controller as a function of time alone, replayed without feedback."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from occ.checks import check_fields
from occ.control import Control
from occ.errors import Status
from occ.integration import IntegrationError
from occ.laws import MeasuredServoLaw, PrescribedRotation, ServoLaw
from occ.optimal.collocation import Collocation
from occ.referee.replay import Replay
from occ.task import Solution, Task


@dataclass(frozen=True, kw_only=True)
class OpenLoop:
    """M(t) = M(t, x(t)) along the motion that a controller makes of the model, whatever the real platform does.

    Args:
        of: the controller, as a table with its kind and its keys.
    """

    kind: ClassVar[str] = "open_loop"
    of: ServoLaw | MeasuredServoLaw | PrescribedRotation | Collocation

    def __post_init__(self) -> None:
        check_fields(self)

    def check(self, task: Task) -> None:
        """Refuse what the controller refuses.

        Raises:
            InputError: what is wrong and what would be right.
        """
        self.of.check(task)

    def solve(self, task: Task) -> Solution:
        """The controller's solution with its torques frozen along the model's motion.

        Args:
            task: what to do; its plant is not looked at.

        Returns:
            The solution; ``UNSTABLE`` where the model's own motion cannot be followed.
        """
        solution = self.of.solve(task)
        if solution.status is not Status.OK or solution.control is None or solution.start_state is None:
            return solution
        try:
            motion = Replay(task.platform, solution.control, solution.start_state, task.duration)
        except IntegrationError as error:
            return replace(solution, control=None, status=Status.UNSTABLE, message=str(error))
        return replace(solution, control=_Frozen(solution.control, motion))


class _Frozen:
    """M(t) of a control along a motion.

    Args:
        control: M(t, x).
        motion: x(t).
    """

    def __init__(self, control: Control, motion: Replay) -> None:
        self._control, self._motion = control, motion

    @property
    def knots(self) -> np.ndarray:
        return self._control.knots

    def torque(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        return self._control.torque(t, self._motion.at(t))

    def segment(self, start: float, end: float) -> Callable[[float, np.ndarray], np.ndarray]:
        inner, motion = self._control.segment(start, end), self._motion
        return lambda t, state: inner(t, motion.at(np.array([t]))[:, 0])
