"""What the two formulations share: conditions in a fixed order, ends, and the way from a task to numbers and back.

Path conditions stand in this order: limits of the task; the tube; B's velocity on its program; slacks of the positive
parts; the largest torque.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from occ.control import Control
from occ.model.coefficients import coefficients
from occ.model.dynamics import friction_time
from occ.optimal.cost import has_largest, is_regular, slack_shares
from occ.optimal.error import fine_points
from occ.optimal.limits import limit_values, limited_quantities, line_numbers
from occ.optimal.problem import Bounds, Nodes, Numbers, Problem, flat
from occ.optimal.shape import Settings, Shape
from occ.optimal.transcription import Outcome, Transcription
from occ.task import Task
from occ.trajectory import Trajectory

DAMPING = 1e-6
"""Size of the smallest cost that settles what nothing else determines, in units of the natural one."""
SETTLING = 0.02
"""Cost of torque rates on their limit where nothing else settles them, in units of the tolerance and of the power that
friction takes from the program."""
MOMENTS = 400
"""Times at which the program's speed is looked at for its mean power."""

Rotation = Callable[[np.ndarray], np.ndarray]
"""t (N,) [s] -> (3, N) heading, yaw rate, yaw acceleration: a guess of the motion with B on its program."""


@dataclass(frozen=True, eq=False)
class Formulation(ABC):
    """One task in one formulation: the program's numbers, a first guess, and a solution as a control.

    Args:
        task: what to do.
        settings: how the problem is put.
    """

    task: Task
    settings: Settings

    @property
    @abstractmethod
    def shape(self) -> Shape:
        """What the problem is built for."""

    @abstractmethod
    def problem(self) -> Problem:
        """The problem of that shape, built once in a process."""

    @abstractmethod
    def data(self, edges: np.ndarray, s: np.ndarray) -> np.ndarray:
        """(nd, N, m) Node data at the places s (m,) or (N, m) of each interval of a mesh (N + 1,) [s]."""

    @abstractmethod
    def parameters(self) -> np.ndarray:
        """(np,) of the problem."""

    @abstractmethod
    def end_bounds(self) -> tuple[Bounds, Bounds, Bounds]:
        """Bounds of the mechanical states at start and end, and of the boundary conditions."""

    @abstractmethod
    def motion_guess(self, transcription: Transcription, edges: np.ndarray, rotation: Rotation) -> Nodes:
        """Mechanical states and controls of a rotation on a mesh, with zeros for slacks and the largest torque."""

    @abstractmethod
    def control(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> Control:
        """The wheel torques of a solution."""

    @abstractmethod
    def claimed(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> Trajectory:
        """The motion that a solution describes."""

    @abstractmethod
    def start_state(self, nodes: Nodes) -> np.ndarray:
        """(6,) Where a solution starts."""

    @abstractmethod
    def yaw_rates(self, nodes: Nodes) -> np.ndarray:
        """(N + 1,) [rad/s] Yaw rates at the edges of a solution."""

    @abstractmethod
    def headings(self, nodes: Nodes) -> np.ndarray:
        """(N + 1,) [rad] Headings at the edges of a solution."""

    @property
    def phase_is_open(self) -> bool:
        """A motion that begins at a later time costs the same, and all headings relative to the program are passed.

        So it is where the program turns at a constant rate, start and end are free up to full turns, and the heading
        makes another number of turns than the program.  Which heading is the first may then be chosen: left open, the
        phase drifts from mesh to mesh to where the errors flatter the cost, and no edge stays at its switching time.
        """
        ends, rate = self.settings.ends, self.task.motion.turning_rate
        if self.settings.keep != "path" or ends.start != "free" or ends.turn is None or rate is None:
            return False
        return abs(ends.turn - rate * self.task.duration) > np.pi

    @cached_property
    def hard_limits(self) -> np.ndarray:
        """Largest absolute values of the first path conditions, the tube's included."""
        values = limit_values(self.task.limits, self.task.platform.wheel_count)
        return np.append(values, 1.0) if self.settings.keep == "tube" else values

    def path_bounds(self, taken: np.ndarray | None = None, degree: int = 1, largest: float = 0.0) -> Bounds:
        """Bounds of the path conditions.

        Args:
            taken: (hard, N) part that is taken off each limit in each interval; None takes nothing off.  Behind them,
                where the largest torque is the cost, (n, N) parts of it by which each torque is kept below it.
            degree: of the transcription, with ``taken``.
            largest: [N m] torque of which these parts are taken.

        Returns:
            (nh,) bounds, or (nh, N, d) ones with ``taken``.
        """
        values = self.hard_limits
        _, velocity, slacks, peaks = self.shape.following()
        positive = np.full(slacks + peaks, np.inf)
        lower = np.concatenate([-values, np.zeros(velocity + slacks + peaks)])
        upper = np.concatenate([values, np.zeros(velocity), positive])
        if taken is None:
            return Bounds(lower=lower, upper=upper)
        factor = np.ones((len(upper), taken.shape[1]))
        factor[: len(values)] -= taken[: len(values)]
        both = [np.where(np.isfinite(side)[:, None], side[:, None] * factor, side[:, None]) for side in (lower, upper)]
        if len(taken) > len(values):
            both[0][-peaks:] = largest * np.tile(taken[len(values) :], (2, 1))
        both = [np.repeat(side[:, :, None], degree, axis=2) for side in both]
        return Bounds(lower=both[0], upper=both[1])

    def numbers(self, transcription: Transcription, edges: np.ndarray) -> Numbers:
        """The numbers of the task for a transcription.

        Args:
            transcription: of this formulation's problem.
            edges: (N + 1,) [s].

        Returns:
            Numbers, with the task's limits at the nodes.
        """
        start, end, boundary = self.end_bounds()
        nx, nu, *_ = transcription.sizes
        more = Bounds.free(nx - len(start.lower))
        lower = np.full(nu, -np.inf)
        if self.shape.slacks:
            lower[-self.shape.slacks :] = 0.0
        return Numbers(
            edges=edges,
            data=self.data(edges, transcription.scheme.points),
            parameters=self.parameters(),
            start=_joined(start, more),
            end=_joined(end, more),
            control=Bounds(lower=lower, upper=np.full(nu, np.inf)) if self.shape.slacks else None,
            path=self.path_bounds(),
            boundary=boundary,
        )

    def guess(self, transcription: Transcription, edges: np.ndarray, rotation: Rotation) -> Nodes:
        """A rotation with B on its program, and the slacks and the largest torque that belong to it.

        Args:
            transcription: of this formulation's problem.
            edges: (N + 1,) [s].
            rotation: with B on its program.

        Returns:
            States and controls to start from.
        """
        return self.with_slacks(transcription, edges, self.motion_guess(transcription, edges, rotation))

    def with_slacks(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> Nodes:
        """The same motion with the least slacks and the least largest torque that it allows.

        Args:
            transcription: of this formulation's problem.
            edges: (N + 1,) [s].
            nodes: a motion; its slacks and largest torque are overlooked.

        Returns:
            Other nodes where there are slacks or a largest torque.
        """
        shape = self.shape
        if not (shape.slacks or shape.peaks):
            return nodes
        nodes = Nodes(nodes.edges.copy(), nodes.points.copy(), nodes.control.copy())
        *_, slacks, peaks = shape.following()
        if slacks:
            nodes.control[-slacks:] = 0.0
        if peaks:
            nodes.edges[-1], nodes.points[-1] = 0.0, 0.0
        data = flat(self.data(edges, transcription.scheme.points))
        path = transcription.evaluate(flat(nodes.points), flat(nodes.control), data, self.parameters())[2]
        rows = len(path) - slacks - peaks
        if slacks:
            # With slack zero the row is the negative of the power.
            powers = -path[rows : rows + slacks].reshape(nodes.control[-slacks:].shape)
            nodes.control[-slacks:] = np.maximum(powers, 0.0)
        if peaks:
            largest = float(path[rows + slacks :].max())
            nodes.edges[-1], nodes.points[-1] = largest, largest
        return nodes

    def easier(self) -> list[Formulation]:
        """The same task with easier aims whose solutions are guesses of one another's, the easiest first."""
        aims = self.settings.aim.easier()
        return [replace(self, settings=replace(self.settings, aim=aim)) for aim in aims]

    def aimed(self, transcription: Transcription, edges: np.ndarray, nodes: Nodes) -> Formulation | None:
        """The same task, aimed beside its end by as much as the torques of a solution miss what its polynomials hit.

        Args:
            transcription: of this formulation's problem.
            edges: (N + 1,) [s].
            nodes: the solution.

        Returns:
            None where the torques hit the end.
        """
        return None

    def between(
        self, transcription: Transcription, edges: np.ndarray, nodes: Nodes, s: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """States (nx, N, m) and controls (nu, N, m) at the places s (m,) in every interval, as `control` makes them."""
        state, _, control = transcription.interpolate(nodes, s)
        return state, control

    def overpaid(self, transcription: Transcription, nodes: Nodes, numbers: Numbers) -> np.ndarray:
        """(N,) Integral of sum share * min(p, p - P) in each interval: what the slacks cost beyond what they stand for.

        It vanishes at the nodes, and between them where the powers keep their sign.

        Args:
            transcription: of this formulation's problem.
            nodes: the solution.
            numbers: with which it was found.

        Returns:
            In the cost's unit.
        """
        widths = np.diff(numbers.edges)
        if not self.shape.slacks:
            return np.zeros(len(widths))
        s, weights = fine_points(transcription.degree)
        state, _, control = transcription.interpolate(nodes, s)
        flats = flat(state), flat(control), flat(self.data(numbers.edges, s))
        path = transcription.evaluate(*flats, self.parameters())[2]
        unpaired = self._slack_shares @ self.unpaired(flats[1], path)
        return np.asarray(widths * (unpaired.reshape(len(widths), -1) @ weights))

    def unpaired(self, control: np.ndarray, path: np.ndarray) -> np.ndarray:
        """(j, M) [W] min(p, p - P) of each slack: zero where one of the pair is zero, as it should be."""
        *_, slacks, peaks = self.shape.following()
        rows = len(path) - slacks - peaks
        return np.minimum(control[len(control) - slacks :], path[rows : rows + slacks])

    def complementarity(self, transcription: Transcription, nodes: Nodes, numbers: Numbers) -> float | None:
        """[W] Largest min(p, p - P) at the nodes: how well the slacks are what they stand for; None without slacks."""
        if not self.shape.slacks:
            return None
        control = flat(nodes.control)
        path = transcription.evaluate(flat(nodes.points), control, flat(numbers.data), self.parameters())[2]
        return float(np.abs(self.unpaired(control, path)).max())

    @cached_property
    def _slack_shares(self) -> np.ndarray:
        aim = self.settings.aim
        return slack_shares(aim.terms, aim.weights, self.task.platform.wheel_count)

    @property
    def limited(self) -> tuple[str, ...]:
        """Names of the limited quantities."""
        return limited_quantities(self.task.limits)

    def damping(self) -> tuple[float, float]:
        """[1/W, s] Factors of the smallest costs that settle what nothing else determines; zeros elsewhere.

        A cost without curvature in the torque sees the velocities at the collocation points only.  With Radau points
        they are all there are; with Legendre points those at the edges are not, and the smallest cost of the squared
        accelerating control settles them.  Null torques that no limit and no cost sees are settled in the same way.

        Returns:
            c J_a tau [J s^3] for the squared yaw acceleration, and c W / M^2 [W/(N m)^2] for squared torques; c is so
            small that the cost changes by less than 1e-7 of its value.
        """
        if is_regular(self.settings.aim.terms):
            return 0.0, 0.0
        k = self.task.dynamics.coefficients
        direction = np.array([self.task.point[1], -self.task.point[0], 1.0])
        inertia = float(direction @ np.array(k.inertia) @ direction)
        rates, friction = np.array(k.wheel_rates), np.array(k.friction)
        # Power over squared torque of a motion against friction alone, in the stiffest direction.
        loss = float(np.trace(friction) / max(np.trace(friction @ np.linalg.pinv(rates.T @ rates) @ friction), 1e-12))
        time = min(friction_time(self.task.platform), self.task.duration)
        return DAMPING * inertia * time, DAMPING * loss

    @cached_property
    def rate_damping(self) -> float:
        """[W s^2/(N m)^2] Factor of the squared torque rates in the integrand.

        A cost without curvature in the torques does not see how fast they change: under a limit of the torque rate, and
        with B off its path, rates chatter between their limits on singular arcs, and meshes grow after them.  So a
        rate costs something, at its limit ``SETTLING`` times the tolerance and the power of the program's friction.
        """
        limit, aim = self.task.limits.torque_rate, self.settings.aim
        settled = is_regular(aim.terms) and not aim.is_regularised
        if limit is None or self.settings.keep == "path" or has_largest(aim.terms) or settled:
            return 0.0
        _, velocity, _ = self.task.motion.at(np.linspace(0.0, self.task.duration, MOMENTS))
        friction = np.trace(np.array(self.task.dynamics.coefficients.friction)[:2, :2]) / 2
        power = friction * float(np.mean(np.sum(velocity**2, axis=0)))
        return SETTLING * self.settings.tolerance * sum(aim.weights) * power / limit**2

    def words_of_rates(self, transcription: Transcription, edges: np.ndarray, outcome: Outcome) -> list[str]:
        """What the squared torque rates of a solution add to its cost, in words.

        Args:
            transcription: of this formulation's problem.
            edges: (N + 1,) [s].
            outcome: the solution.

        Returns:
            A sentence; none where they cost nothing.
        """
        if not self.rate_damping:
            return []
        squares = np.sum(outcome.nodes.control[: self.task.platform.wheel_count] ** 2, axis=0)
        added = self.rate_damping * float(np.diff(edges) @ (squares @ transcription.scheme.weights))
        share = added / max(1.0, abs(outcome.cost))
        return [f"with a cost of squared torque rates, {share:.1g} of it, that settles what the objective leaves open"]

    def common_parameters(self) -> np.ndarray:
        """(p,) Matrices of the platform, point B, weights of the cost, torque-speed line."""
        weights, line = self.settings.aim.weights, line_numbers(self.task.limits)
        return np.concatenate([coefficients(self.task.platform), self.task.point, weights, line])


def _joined(first: Bounds, second: Bounds) -> Bounds:
    return Bounds(lower=np.concatenate([first.lower, second.lower]), upper=np.concatenate([first.upper, second.upper]))
