"""Classes of starts and ends of section 4.3."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occ.task import EndClass, Task
from occ.theory.minimum_work import LeastWork, minimum_work


@dataclass(frozen=True)
class Ends:
    """A class of starts and ends.

    Args:
        end: ``free``; ``law`` with its state; ``periodic``, with any winding.
        state: (6,) at the end, where it is given; its numbers are exact.
        free_start: whether the start is chosen, too (``periodic`` only).
    """

    end: EndClass = "free"
    state: tuple[float, ...] | None = None
    free_start: bool = False

    def least(self, task: Task) -> LeastWork:
        """The infimum of the work by theory."""
        state = None if self.state is None else np.array(self.state)
        return minimum_work(task, self.end, state, free_start=self.free_start)


FREE = Ends()
