"""x' = f(t, x) by the explicit Runge-Kutta method of order 8 of Dormand and Prince, with its polynomial on every step.

The method and its numbers are those of SciPy's DOP853.  Here all stages of a step are one call of a CasADi function, so
that a step takes some ten microseconds and not a millisecond, and where that is used often all steps of a piece are one
call of machine code; where f is a Python function it is called stage by stage.
Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.4 to II.6.
"""

from occ.integration.methods import CompiledStep, PythonStep
from occ.integration.steps import OUT_OF_RANGE, IntegrationError, Settings, Step, Steps, integrate

__all__ = [
    "OUT_OF_RANGE",
    "CompiledStep",
    "IntegrationError",
    "PythonStep",
    "Settings",
    "Step",
    "Steps",
    "integrate",
]
