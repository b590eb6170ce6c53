"""What an allocation makes least, one file for each; to add one: a class with the methods of `Criterion`.

Of a sum over the wheels `Separable` derives value, bound and multipliers from the terms of one wheel.
"""

from occ.allocation.criteria.base import Criterion
from occ.allocation.criteria.electric_power import ElectricPower
from occ.allocation.criteria.largest_torque import LargestTorque
from occ.allocation.criteria.weighted_norm import LEAST_NORM, WeightedNorm

__all__ = ["LEAST_NORM", "Criterion", "ElectricPower", "LargestTorque", "WeightedNorm"]
