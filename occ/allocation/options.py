"""How a law's wrench is shared among the wheels: an option of the law.

To add one: a class here, and its name in `AllocationOption`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from occ.allocation.input_map import platform_input_map
from occ.allocation.realised import Realised, States, realise
from occ.control import Control
from occ.task import Task


@dataclass(frozen=True, kw_only=True)
class MinNorm:
    """min |M|^2, C_phi^T M = Pi: the paper's torques, whatever the limits; eq. (3.13)."""

    kind: ClassVar[str] = "min_norm"

    def realise(self, task: Task, control: Control, states: States, t: np.ndarray) -> Realised:
        """The law's own control."""
        return Realised(control)


@dataclass(frozen=True, kw_only=True)
class BoxQp:
    """min |M|^2, C_phi^T M = Pi, |M_i| <= the task's torque limit; the minimum norm where there is no limit."""

    kind: ClassVar[str] = "box_qp"

    def realise(self, task: Task, control: Control, states: States, t: np.ndarray) -> Realised:
        """Allocate the wrenches of a law along its own motion.

        Args:
            task: platform and limits.
            control: of the law, with minimum-norm torques.
            states: the law's motion.
            t: (N,) [s] samples, the ends of the horizon among them.

        Returns:
            The control with allocated torques, or why there is none.
        """
        if task.limits.torque is None:
            return Realised(control)
        return realise(platform_input_map(task.platform), task.limits.torque, control, states, t)


AllocationOption = MinNorm | BoxQp
"""Any of them; its members are the kinds that experiment files know."""
