"""How a law's wrench is shared among the wheels: an option of the law.

To add one: a class here, and its name in `AllocationOption`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import MinLen

from occ.allocation.allocator import Allocator
from occ.allocation.criteria import LEAST_NORM, Criterion, ElectricPower, LargestTorque, WeightedNorm
from occ.allocation.input_map import platform_input_map
from occ.allocation.out_of_reach import Rule
from occ.allocation.realised import Realised, States, realise
from occ.checks import Positive, check_fields
from occ.control import Control
from occ.errors import InputError
from occ.model.dynamics import dynamics
from occ.objectives import COPPER_LOSS
from occ.task import Limits, Task


@dataclass(frozen=True, kw_only=True)
class WithinLimits(ABC):
    """An allocation that holds the torque range of the task's limits: torque, power and the torque-speed line.

    Args:
        out_of_reach: what becomes of a wrench that no torque within the limits makes; without it the row is infeasible.
    """

    kind: ClassVar[str]
    out_of_reach: Rule | None = None

    def __post_init__(self) -> None:
        check_fields(self)

    @abstractmethod
    def criterion(self) -> Criterion:
        """What is least."""

    def check(self, task: Task) -> None:
        """Refuse a task that this cannot be meant for.

        Raises:
            InputError: what is wrong and what would be right.
        """
        try:
            self.criterion().check(task.platform.wheel_count)
        except InputError as error:
            raise InputError(f"allocation.{error}") from error

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
        criterion = self.criterion()
        if criterion is LEAST_NORM and not limits_torque(task.limits):
            return Realised(control)
        platform = task.platform
        inertia = np.array(dynamics(platform).coefficients.inertia)
        wheels = platform_input_map(platform)
        return realise(Allocator(wheels, task.limits, criterion, self.out_of_reach, inertia), control, states, t)


def limits_torque(limits: Limits) -> bool:
    """Whether some limit of the task bounds the torques at given wheel rates."""
    return not (limits.torque is None and limits.wheel_power is None and limits.torque_speed_line is None)


@dataclass(frozen=True, kw_only=True)
class MinNorm(WithinLimits):
    """min |M|^2, C_phi^T M = Pi: the paper's torques, whatever the limits; eq. (3.13).

    Args:
        out_of_reach: none, as nothing is out of reach without limits.
    """

    kind: ClassVar[str] = "min_norm"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.out_of_reach is not None:
            raise InputError(
                f'MinNorm: out_of_reach ("{self.out_of_reach}") has no meaning for min_norm, which ignores all limits; '
                "should be with another kind such as box_qp"
            )

    def criterion(self) -> Criterion:
        return LEAST_NORM

    def realise(self, task: Task, control: Control, states: States, t: np.ndarray) -> Realised:
        """The law's own control."""
        return Realised(control)


@dataclass(frozen=True, kw_only=True)
class BoxQp(WithinLimits):
    """min |M|^2, C_phi^T M = Pi, within the torque range of the limits; the minimum norm where there is no limit.

    Args:
        out_of_reach: what becomes of a wrench that no torque within the limits makes; without it the row is infeasible.
    """

    kind: ClassVar[str] = "box_qp"

    def criterion(self) -> Criterion:
        return LEAST_NORM


@dataclass(frozen=True, kw_only=True)
class Weighted(WithinLimits):
    """min sum w_i M_i^2 within the torque range of the limits.

    Args:
        weights: w_i, one for each wheel; a wheel with a large one is spared.
        out_of_reach: what becomes of a wrench that no torque within the limits makes; without it the row is infeasible.
    """

    kind: ClassVar[str] = "weighted"
    weights: Annotated[tuple[Positive, ...], MinLen(3)]

    def criterion(self) -> Criterion:
        return WeightedNorm(self.weights)


@dataclass(frozen=True, kw_only=True)
class MinMax(WithinLimits):
    """min max |M_i| within the torque range of the limits; of several such torques the one of least norm.

    Args:
        out_of_reach: what becomes of a wrench that no torque within the limits makes; without it the row is infeasible.
    """

    kind: ClassVar[str] = "min_max"

    def criterion(self) -> Criterion:
        return LargestTorque()


@dataclass(frozen=True, kw_only=True)
class Copper(WithinLimits):
    """min sum k_i M_i^2 within the torque range of the limits: copper loss, the least norm where all motors are alike.

    Args:
        losses: [W/(N m)^2] k_i of each wheel's motor; all alike where they are not given.
        out_of_reach: what becomes of a wrench that no torque within the limits makes; without it the row is infeasible.
    """

    kind: ClassVar[str] = "copper"
    losses: Annotated[tuple[Positive, ...], MinLen(3)] | None = None

    def criterion(self) -> Criterion:
        return LEAST_NORM if self.losses is None else WeightedNorm(self.losses)

    def check(self, task: Task) -> None:
        try:
            super().check(task)
        except InputError as error:
            raise InputError(str(error).replace("weights", "losses", 1)) from error


@dataclass(frozen=True, kw_only=True)
class Electric(WithinLimits):
    """min sum max(M_i phi_i' + k M_i^2, 0) within the torque range of the limits: no power flows back from a wheel.

    Args:
        loss: [W/(N m)^2] k, copper loss of every motor.
        out_of_reach: what becomes of a wrench that no torque within the limits makes; without it the row is infeasible.
    """

    kind: ClassVar[str] = "electric"
    loss: Positive = COPPER_LOSS

    def criterion(self) -> Criterion:
        return ElectricPower(self.loss)


AllocationOption = MinNorm | BoxQp | Weighted | MinMax | Copper | Electric
"""Any of them; its members are the kinds that experiment files know."""
