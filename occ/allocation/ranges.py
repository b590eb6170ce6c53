"""Which torques the limits of the wheels leave at a given wheel rate: an interval for each wheel and sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.errors import InputError
from occ.task import Limits

NO_LIMIT = 1e30
"""[N m] A bound that no wrench meets stands for none, so that no infinity is multiplied by zero."""
AT_LIMIT = 1e-9
"""A torque this near to its limit, relative to the width of the range, is on it."""


@dataclass(frozen=True, eq=False)
class TorqueRange:
    """lower_i <= M_i <= upper_i.

    Args:
        lower: (n, N) or (n, 1) [N m].
        upper: of the same shape [N m].
    """

    lower: np.ndarray
    upper: np.ndarray

    def of(self, which: np.ndarray | slice) -> TorqueRange:
        """The ranges of some samples."""
        if self.lower.shape[1] == 1:
            return self
        return TorqueRange(self.lower[:, which], self.upper[:, which])

    def side(self, torque: np.ndarray, near: float = AT_LIMIT) -> np.ndarray:
        """(n, N) 1 where a torque (n, N) is at its upper limit, -1 at its lower one, 0 between them."""
        near = near * np.minimum(
            self.upper - self.lower, np.abs(torque) + self.upper.clip(0) - self.lower.clip(None, 0)
        )
        return (torque >= self.upper - near).astype(int) - (torque <= self.lower + near).astype(int)

    def excess(self, torque: np.ndarray) -> np.ndarray:
        """(N,) [N m] by how much the worst wheel's torque (n, N) leaves its range; 0 where none does."""
        return np.asarray(np.maximum(torque - self.upper, self.lower - torque).max(axis=0).clip(0.0))

    def holding(self, torque: np.ndarray) -> TorqueRange:
        """The ranges widened by what torques (n, N) exceed them.

        Where limits nearly contradict each other the best value depends on them far more than in proportion, and what
        rounding moves a limit by would be taken for a better or a worse torque.
        """
        return TorqueRange(np.minimum(self.lower, torque), np.maximum(self.upper, torque))


def box(limit: float, wheel_count: int) -> TorqueRange:
    """|M_i| <= limit [N m] on every wheel."""
    upper = np.full((wheel_count, 1), float(limit))
    return TorqueRange(-upper, upper)


def torque_range(limits: Limits, rates: np.ndarray) -> TorqueRange:
    """|M_i| <= torque, |M_i phi_i'| <= wheel_power, |M_i / stall_torque + phi_i' / no_load_speed| <= 1.

    Where a wheel is so fast that its torque limit cannot brake it as the torque-speed line demands, the range is the
    one torque that brakes it most.

    Args:
        limits: of the task; limits on speeds and on rates of change are none of the torque's range.
        rates: (n, N) [rad/s] phi'.

    Returns:
        The range at each sample.
    """
    parts = limit_parts(limits, rates)
    if len(parts) < 2:
        return next(iter(parts.values()), box(NO_LIMIT, len(rates)))
    lower = np.max([part.lower for part in parts.values()], axis=0)
    upper = np.min([part.upper for part in parts.values()], axis=0)
    crossed = lower > upper
    if crossed.any():
        own = parts["torque"].upper if "torque" in parts else np.zeros_like(lower)
        meet = np.clip(np.where(rates > 0, upper, lower), -own, own)
        lower, upper = np.where(crossed, meet, lower), np.where(crossed, meet, upper)
    return TorqueRange(lower, upper)


def limit_parts(limits: Limits, rates: np.ndarray) -> dict[str, TorqueRange]:
    """The range that each single limit leaves, by the limit's name.

    Args:
        limits: of the task.
        rates: (n, N) [rad/s] phi'.

    Returns:
        ``torque``, ``power`` and ``voltage`` (the torque-speed line), those of them that there are; each (n, N).
    """
    parts = {}
    if limits.torque is not None:
        parts["torque"] = _symmetric(np.full(rates.shape, limits.torque))
    if limits.wheel_power is not None:
        # A wheel that stands needs no power, whatever its torque.
        parts["power"] = _symmetric(limits.wheel_power / np.maximum(np.abs(rates), limits.wheel_power / NO_LIMIT))
    line = limits.torque_speed_line
    if line is not None:
        stall, speed = line
        parts["voltage"] = TorqueRange(-stall * (1 + rates / speed), stall * (1 - rates / speed))
    return parts


def _symmetric(upper: np.ndarray) -> TorqueRange:
    return TorqueRange(-upper, upper)


def checked_range(limits: float | TorqueRange, wheel_count: int, samples: int) -> TorqueRange:
    """The limits of an allocation as a range that can be meant.

    Args:
        limits: one limit [N m] of every wheel in both directions, or a range of each.
        wheel_count: n.
        samples: N.

    Returns:
        The range.

    Raises:
        InputError: names what is wrong and what would be right.
    """
    if not isinstance(limits, TorqueRange):
        if isinstance(limits, bool) or not isinstance(limits, int | float | np.number) or not 0 < limits < np.inf:
            raise InputError(f"limit should be a positive finite number of N m, not {limits!r}")
        return box(float(limits), wheel_count)
    for name in ("lower", "upper"):
        bound = getattr(limits, name)
        if not isinstance(bound, np.ndarray) or bound.shape not in ((wheel_count, 1), (wheel_count, samples)):
            raise InputError(
                f"limits.{name} should have the shape ({wheel_count}, 1) or ({wheel_count}, {samples}), "
                f"not {np.shape(bound)}"
            )
    if limits.lower.shape != limits.upper.shape:
        raise InputError(
            f"limits.lower and limits.upper should have one shape, not {limits.lower.shape} and {limits.upper.shape}"
        )
    wrong = ~(limits.lower <= limits.upper)
    if wrong.any():
        wheel, sample = (int(i) for i in np.argwhere(wrong)[0])
        raise InputError(
            f"limits of wheel {wheel + 1} at sample {sample} should be a lower and an upper one in this order, "
            f"not {limits.lower[wheel, sample]:g} and {limits.upper[wheel, sample]:g} N m"
        )
    return TorqueRange(limits.lower.clip(-NO_LIMIT, NO_LIMIT), limits.upper.clip(-NO_LIMIT, NO_LIMIT))
