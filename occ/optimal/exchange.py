"""A nonlinear solver with its memory: numbers go in and an answer comes out without a CasADi matrix in between."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from occ.optimal.chains import Integrated
from occ.optimal.layout import Layout
from occ.optimal.problem import Nodes, Numbers, flat

BUFFER = 1
"""CasADi counts a function's memories: the first is that of plain calls, the second that of its first buffer."""


class Exchange:
    """Arrays that a solver reads and writes in place.

    Args:
        solver: of `casadi.nlpsol`; multipliers are neither handed in nor asked for.
        layout: of its unknowns and conditions.
    """

    def __init__(self, solver: ca.Function, layout: Layout) -> None:
        self._solver, self._layout, self._of_intervals = solver, layout, layout.of_intervals
        self._buffer, self._trigger = solver.buffer()
        unknowns, conditions = solver.numel_out("x"), solver.numel_out("g")
        # Unknowns and conditions stand one after the other, so that their bounds are looked at together.
        self._values, self._lower, self._upper = (np.zeros(unknowns + conditions) for _ in range(3))
        self.inputs = {
            "x0": np.zeros(unknowns),
            "p": np.zeros(solver.numel_in("p")),
            "lbx": self._lower[:unknowns],
            "ubx": self._upper[:unknowns],
            "lbg": self._lower[unknowns:],
            "ubg": self._upper[unknowns:],
        }
        self.outputs = {"x": self._values[:unknowns], "g": self._values[unknowns:], "f": np.zeros(1)}
        for name, array in self.inputs.items():
            self._buffer.set_arg(solver.index_in(name), array.data)
        for name, array in self.outputs.items():
            self._buffer.set_res(solver.index_out(name), array.data)

    def solve(self) -> dict[str, Any]:
        """Solve with what `inputs` hold; the answer is in `outputs`.

        Returns:
            The solver's statistics.

        Raises:
            RuntimeError: the solver stopped with an error.
            KeyboardInterrupt: somebody wants it to stop.
        """
        try:
            self._trigger()
        except SystemError as error:
            # What a signal's handler raises in the middle of compiled code arrives as the cause of this.
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise KeyboardInterrupt from error
            raise RuntimeError(str(error)) from error
        statistics: dict[str, Any] = self._solver.stats(BUFFER)
        return statistics

    def write(self, numbers: Numbers, guess: Nodes) -> None:
        """Mesh, data, parameters, bounds and guess into the solver's memory."""
        layout, inputs = self._layout, self.inputs
        x0 = inputs["x0"]
        if layout.points is not None:
            x0[layout.points] = guess.points
        x0[layout.edges], x0[layout.control] = guess.edges, guess.control
        if layout.memory.size:
            x0[layout.memory] = guess.edges[:, :1]
        count, data = len(numbers.edges) - 1, flat(numbers.data)
        inputs["p"][:count] = np.diff(numbers.edges)
        inputs["p"][count : count + data.size] = data.ravel(order="F")
        inputs["p"][count + data.size :] = numbers.parameters
        for side, extreme, none in (("lower", np.maximum, -np.inf), ("upper", np.minimum, np.inf)):
            self._write_side(numbers, side, extreme, none)

    def _write_side(self, numbers: Numbers, side: str, extreme: np.ufunc, none: float) -> None:
        layout, letter = self._layout, side[0]
        unknowns, conditions = self.inputs[f"{letter}bx"], self.inputs[f"{letter}bg"]
        unknowns[:] = none
        if numbers.state is not None:
            bound = getattr(numbers.state, side)
            if layout.points is not None:
                unknowns[layout.points] = bound[:, None, None]
            unknowns[layout.edges] = bound[:, None]
        for edge, bounds in ((0, numbers.start), (-1, numbers.end)):
            places = layout.edges[:, edge]
            unknowns[places] = extreme(unknowns[places], getattr(bounds, side))
        if numbers.control is not None:
            unknowns[layout.control] = _by_node(getattr(numbers.control, side))
        # All other conditions are equations with zero on the right.
        if layout.path.size:
            conditions[layout.path] = none if numbers.path is None else _by_node(getattr(numbers.path, side))
        if layout.boundary is not None and layout.boundary.size:
            conditions[layout.boundary] = none if numbers.boundary is None else getattr(numbers.boundary, side)

    def read(self, maps: Integrated | None, edges: np.ndarray) -> Nodes:
        """The solution at edges and nodes.

        Args:
            maps: from the controls to the states at the points, where these are not unknowns.
            edges: (N + 1,) of the mesh.
        """
        layout, x = self._layout, self.outputs["x"]
        if layout.points is not None:
            points = x[layout.points]
        else:
            assert maps is not None
            points = maps.states(x[self._of_intervals], np.diff(edges))
        return Nodes(x[layout.edges], points, x[layout.control])

    def violation(self, least: float) -> float:
        """Largest amount by which bounds and conditions are passed, relative to max(1, their size).

        Args:
            least: up to which the absolute amount, which is never smaller, does as well.
        """
        under, over = self._lower - self._values, self._values - self._upper
        worst = float(np.maximum(under, over).max(initial=0.0))
        if worst <= least:
            return worst
        for excess, bound in ((under, self._lower), (over, self._upper)):
            excess /= np.maximum(1.0, np.where(np.isfinite(bound), np.abs(bound), 1.0))
        return float(np.maximum(under, over).max(initial=0.0))


def _by_node(bound: np.ndarray) -> np.ndarray:
    return bound[:, None, None] if bound.ndim == 1 else bound
