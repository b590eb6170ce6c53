"""What can be said of the platform on a circle without simulating it: section 4 of the paper, and beyond it."""

from occ.theory.circle import CircleQuantities, circle_function, circle_quantities
from occ.theory.coefficients import YawCoefficients, yaw_coefficients, yaw_coefficients_many, yaw_function

__all__ = [
    "CircleQuantities",
    "YawCoefficients",
    "circle_function",
    "circle_quantities",
    "yaw_coefficients",
    "yaw_coefficients_many",
    "yaw_function",
]
