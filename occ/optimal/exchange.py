"""A nonlinear solver with its memory: numbers go in and an answer comes out without a CasADi matrix in between."""

from __future__ import annotations

from typing import Any

import numpy as np

from occ.optimal.chains import Integrated
from occ.optimal.engines import Engine
from occ.optimal.layout import Layout
from occ.optimal.problem import Nodes, Numbers, flat


class Exchange:
    """Arrays that a solver reads and writes in place.

    Args:
        engine: the solver.
        layout: of its unknowns and conditions.
        parameters: how many it has.
    """

    def __init__(self, engine: Engine, layout: Layout, parameters: int) -> None:
        self._engine, self._layout, self._of_intervals = engine, layout, layout.of_intervals
        self._ends = layout.edges[:, 0], layout.edges[:, -1]
        unknowns, conditions = layout.unknowns, layout.conditions
        # Unknowns and conditions stand one after the other, so that their bounds are looked at together.
        self._values, self._lower, self._upper = (np.zeros(unknowns + conditions) for _ in range(3))
        self.inputs = {
            "x0": np.zeros(unknowns),
            "p": np.zeros(parameters),
            "lbx": self._lower[:unknowns],
            "ubx": self._upper[:unknowns],
            "lbg": self._lower[unknowns:],
            "ubg": self._upper[unknowns:],
        }
        self.outputs = {"x": self._values[:unknowns], "g": self._values[unknowns:], "f": np.zeros(1)}
        if layout.defects.size:
            self.outputs["lam_g"] = np.zeros(conditions)
        engine.bind(self.inputs, self.outputs)

    def solve(self) -> dict[str, Any]:
        """Solve with what `inputs` hold; the answer is in `outputs`.

        Returns:
            The solver's statistics.

        Raises:
            RuntimeError: the solver stopped with an error.
            KeyboardInterrupt: somebody wants it to stop.
        """
        return self._engine.run()

    def pace(self) -> float:
        """[s] What an iteration takes, about, with what `inputs` hold."""
        return self._engine.pace()

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
        inputs["p"][:count] = _widths(numbers.edges)
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
        for places, bounds in zip(self._ends, (numbers.start, numbers.end), strict=True):
            bound = getattr(bounds, side)
            unknowns[places] = bound if numbers.state is None else extreme(unknowns[places], bound)
        if numbers.control is not None:
            unknowns[layout.control] = _by_node(getattr(numbers.control, side))
        # All other conditions are equations with zero on the right.
        if layout.path.size:
            conditions[layout.path] = none if numbers.path is None else _by_node(getattr(numbers.path, side))
        if layout.boundary is not None and layout.boundary.size:
            conditions[layout.boundary] = none if numbers.boundary is None else getattr(numbers.boundary, side)

    def read(self, maps: Integrated | None, edges: np.ndarray) -> Nodes:
        """What the solver has left in the outputs.

        Args:
            maps: from the controls to the states at the points, where these are not unknowns.
            edges: (N + 1,) of the mesh.

        Returns:
            The solution at edges and nodes.
        """
        layout, x = self._layout, self.outputs["x"]
        if layout.points is not None:
            points = x[layout.points]
        else:
            assert maps is not None
            points = maps.states(x[self._of_intervals], _widths(edges))
        return Nodes(x[layout.edges], points, x[layout.control])

    def costates(self, weights: np.ndarray) -> np.ndarray | None:
        """p = -lambda / w from the multipliers lambda of the defects.

        Args:
            weights: (d,) w of the quadrature on the collocation points.

        Returns:
            (nx, N, d); None where there are no defects.

        Source: Betts, Practical Methods for Optimal Control and Estimation, section 4.10 (discrete adjoints); Garg et
            al., A unified framework for the numerical solution of optimal control problems, Automatica 46 (2010).
        """
        if "lam_g" not in self.outputs:
            return None
        return np.asarray(-self.outputs["lam_g"][self._layout.defects] / weights)

    def violation(self, least: float) -> float:
        """Largest amount by which bounds and conditions are passed, relative to max(1, their size).

        Args:
            least: up to which the absolute amount, which is never smaller, does as well.

        Returns:
            0 where all hold.
        """
        under, over = self._lower - self._values, self._values - self._upper
        worst = float(np.maximum(under, over).max(initial=0.0))
        if worst <= least:
            return worst
        for excess, bound in ((under, self._lower), (over, self._upper)):
            excess /= np.maximum(1.0, np.where(np.isfinite(bound), np.abs(bound), 1.0))
        return float(np.maximum(under, over).max(initial=0.0))


def _widths(edges: np.ndarray) -> np.ndarray:
    return edges[1:] - edges[:-1]


def _by_node(bound: np.ndarray) -> np.ndarray:
    return bound[:, None, None] if bound.ndim == 1 else bound
