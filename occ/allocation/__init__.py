"""Wrench to wheel torques: the best torques within the limits, and what becomes of a wrench out of reach."""

from occ.allocation.allocator import Allocator, allocate
from occ.allocation.criteria import LEAST_NORM, Criterion, ElectricPower, LargestTorque, WeightedNorm
from occ.allocation.input_map import InputMap, input_map, platform_input_map
from occ.allocation.options import AllocationOption, BoxQp, Copper, Electric, MinMax, MinNorm, Weighted
from occ.allocation.ranges import TorqueRange, torque_range
from occ.allocation.realised import Realised
from occ.allocation.result import Allocation

__all__ = [
    "LEAST_NORM",
    "Allocation",
    "AllocationOption",
    "Allocator",
    "BoxQp",
    "Copper",
    "Criterion",
    "Electric",
    "ElectricPower",
    "InputMap",
    "LargestTorque",
    "MinMax",
    "MinNorm",
    "Realised",
    "TorqueRange",
    "Weighted",
    "WeightedNorm",
    "allocate",
    "input_map",
    "platform_input_map",
    "torque_range",
]
