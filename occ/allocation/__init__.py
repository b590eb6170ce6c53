"""Wrench to wheel torques: minimum norm, and least norm within a torque limit."""

from occ.allocation.input_map import InputMap, input_map, platform_input_map
from occ.allocation.options import AllocationOption, BoxQp, MinNorm
from occ.allocation.realised import Realised
from occ.allocation.result import Allocation

__all__ = [
    "Allocation",
    "AllocationOption",
    "BoxQp",
    "InputMap",
    "MinNorm",
    "Realised",
    "input_map",
    "platform_input_map",
]
