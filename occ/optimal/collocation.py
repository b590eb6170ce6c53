"""The optimal controllers: direct collocation with B on its program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le

from occ.checks import Positive, check_fields
from occ.task import Solution, Task


@dataclass(frozen=True, kw_only=True)
class Collocation:
    """min J over the yaw acceleration, with V_X and V_Y eliminated by eq. (3.6).

    Args:
        objective: what to minimise.
        keep: ``path``: B exactly on its program.
        end: ``free``, or ``law`` for the end state of the servo law from the same start.
        scheme: collocation points, Radau IIA or Gauss-Legendre.
        intervals: of the first mesh; the mesh is refined until the tolerance holds.
        degree: of the state's polynomials in each interval.
        tolerance: largest error between nodes, relative to max(1, size) of each state and of the cost.
    """

    kind: ClassVar[str] = "collocation"
    objective: Literal["work", "torque_squared"]
    keep: Literal["path"] = "path"
    end: Literal["free", "law"] = "free"
    scheme: Literal["radau", "legendre"] = "radau"
    intervals: Annotated[int, Ge(2), Le(2000)] = 16
    degree: Annotated[int, Ge(2), Le(12)] = 5
    tolerance: Positive = 1e-7

    def __post_init__(self) -> None:
        check_fields(self)

    def solve(self, task: Task) -> Solution:
        """Solve the task."""
        raise NotImplementedError
