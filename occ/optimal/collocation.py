"""The optimal controllers: direct collocation on a mesh that is refined to a tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le

from occ.checks import Positive, check_fields
from occ.errors import InputError, Status
from occ.laws.base import law_motion
from occ.laws.servo import ServoLaw
from occ.model.dynamics import friction_time
from occ.objectives import objective
from occ.optimal import homotopy
from occ.optimal.attempt import Attempt, Method
from occ.optimal.cost import Aim, Weights, is_non_smooth, is_regular
from occ.optimal.formulation import Formulation
from occ.optimal.full import Full
from occ.optimal.infeasible import passed_at_ends
from occ.optimal.limits import with_knots
from occ.optimal.mesh import SchemeName, graded_mesh
from occ.optimal.nearby import Nearby
from occ.optimal.reduced import Reduced
from occ.optimal.refinement import MOST_INTERVALS
from occ.optimal.scouts import scouted
from occ.optimal.search import Search
from occ.optimal.shape import EndConditions, Settings
from occ.optimal.singular import note
from occ.optimal.smoothing import Settled, settled
from occ.optimal.solvers import SolverName, SolverOptions
from occ.optimal.starts import distinct, found_in_words, starts_of
from occ.task import Claim, EndClass, Keep, Solution, Task

LAYER = 3.0
"""Width of the first and last interval in units of the platform's shortest time constant of friction."""
SINGULAR_LAYER = 0.03
"""The same where the cost has no curvature in the torque: its layers are jumps of the yaw rate."""
NON_SMOOTH_LAYER = 0.3
"""The same where a small copper loss is all the curvature there is."""
NON_SMOOTH_TOLERANCE = 1e-8, 1e-2
"""Of the optimality conditions, where the cost has slacks: at most, and in units of the tolerance between nodes.

An interior point method leaves its last barrier parameter, a tenth of this, to each pair p, p - P: the slacks overpay
by as much in every one of them, and a finer mesh has more of them."""
LEAST_NON_SMOOTH = 1e-11
"""Below this the solver's linear equations lose the digits of the pairs."""
LEAST_TOLERANCE = 1e-12
"""Below this the error between nodes is rounding, and no mesh would do."""
STARTS = 6
"""Where nothing is said: the law's may end in a minimum that is a quarter dearer."""
EXTRA_TURNS = 1
"""Windings that ``any`` tries beyond those between no turn and the turns of the program."""


@dataclass(frozen=True, kw_only=True)
class Collocation:
    """min J over the wheel torques, or over what determines them with B on its program.

    Args:
        objective: what to minimise; ``weighted`` takes the sum of objectives that ``weights`` gives.
        weights: factors of the objectives, where the objective is ``weighted``.
        homotopy: of ``work`` only: several solves with less and less copper loss, and the limit to which their costs
            tend, which no bounded torque attains; the row is the solve with the least copper loss.
        keep: ``path``: B exactly on its program; ``tube``: within ``radius`` of it; ``ends``: on it at the end only.
        radius: [m] of the tube.
        end: ``free``; ``law`` for the end state of the servo law from the same start; ``periodic`` for the start's
            heading, up to full turns, and yaw rate; ``rest`` for no velocity.
        start: ``given``; ``free`` (only with end ``periodic``) chooses heading and yaw rate, too.
        winding: net full turns of the heading where the end is ``periodic``; ``any`` tries several and keeps the best.
        formulation: ``reduced``: heading and yaw rate, V_X and V_Y eliminated by eq. (3.6), only with keep ``path``;
            ``full``: six states and all wheel torques; left out: ``reduced`` where that is possible.
        control: ``polynomial``, or ``constant`` for torques that are constant in each interval (full formulation with
            keep ``tube`` or ``ends``): they hold a torque limit exactly; under a limit of torque rates these are.
        scheme: collocation points, Radau IIA or Gauss-Legendre.
        intervals: of the first mesh; the mesh is refined until the tolerance holds.
        degree: of the state's polynomials in each interval.
        tolerance: largest error between nodes, relative to max(1, size) of each state and of the cost.
        starts: guesses from which the first mesh is solved; the best minimum is kept.  Left out: 6 with B on its
            path and a cost without kinks, where a start takes milliseconds; elsewhere 1, and the minima to which the
            others lead there and this one does not.
        solver: of the nonlinear program: ``ipopt``, or ``fatrop``, which goes through the horizon stage by stage, and
            which ipopt takes over from where it gives up.
        compiled: the program's functions in machine code where there is a C compiler (solver fatrop): the same numbers
            to the last bit, sooner where one program is solved many times.
        arcs: bang and singular arcs of an objective without curvature in the torques by the switching function, in the
            row's message; its costates take one more solve where the solver is fatrop.
        iterations: of the solver in each solve, at most.
        seconds: [s] of the solver in each solve, at most; fatrop gets the iterations that fit into them.

    Raises:
        InputError: keys that contradict each other.

    Source: Betts, Practical Methods for Optimal Control and Estimation, chapter 4.
    """

    kind: ClassVar[str] = "collocation"
    objective: Literal[
        "work",
        "positive_work",
        "absolute_work",
        "bus_work",
        "torque_squared",
        "copper_loss",
        "electric",
        "electric_drawn",
        "peak_torque",
        "weighted",
    ]
    weights: Weights | None = None
    homotopy: bool = False
    keep: Keep = "path"
    radius: Positive | None = None
    end: EndClass = "free"
    start: Literal["given", "free"] = "given"
    winding: int | Literal["any"] | None = None
    formulation: Literal["reduced", "full"] | None = None
    control: Literal["polynomial", "constant"] = "polynomial"
    scheme: SchemeName = "radau"
    intervals: Annotated[int, Ge(2), Le(MOST_INTERVALS)] = 16
    degree: Annotated[int, Ge(2), Le(12)] = 5
    tolerance: Annotated[float, Ge(LEAST_TOLERANCE), Le(1.0)] = 1e-6
    starts: Annotated[int, Ge(1), Le(200)] | None = None
    solver: SolverName = "ipopt"
    compiled: bool = False
    arcs: bool = True
    iterations: Annotated[int, Ge(1), Le(100_000)] = 500
    seconds: Positive = 60.0

    def __post_init__(self) -> None:
        check_fields(self)
        for wrong in (self._wrong_ends(), self._wrong_keep(), self._wrong_cost()):
            if wrong:
                raise InputError(f"Collocation: {wrong}")

    def _wrong_ends(self) -> str:
        if self.start == "free" and self.end != "periodic":
            return "start should be 'given' unless end is 'periodic'; a free start that nobody pays for is no optimum"
        if self.winding is not None and self.end != "periodic":
            return f"winding should be left out where end is {self.end!r}, not 'periodic'"
        return ""

    def _wrong_keep(self) -> str:
        if (self.radius is None) == (self.keep == "tube"):
            return f"radius should be given [m] where keep is 'tube' and left out elsewhere; keep is {self.keep!r}"
        if self.formulation == "reduced" and self.keep != "path":
            return f"formulation should be 'full' where keep is {self.keep!r}: the reduced one has B on its path"
        if self.control == "constant" and not (self.is_full and self.keep != "path"):
            return (
                "control = 'constant' should go with formulation = 'full' and keep = 'tube' or 'ends': piecewise "
                "constant torques cannot hold B on its path"
            )
        if self.is_full and self.keep == "path" and self.scheme != "radau":
            return (
                "scheme should be 'radau' where formulation is 'full' and keep is 'path': its points hold B's velocity "
                "at the final time, too"
            )
        return ""

    def _wrong_cost(self) -> str:
        if (self.objective == "weighted") != (self.weights is not None):
            return "weights should be given where objective is 'weighted', and left out elsewhere"
        if self.homotopy and self.objective != "work":
            return f"homotopy should be left out where objective is {self.objective!r}: only 'work' tends to a limit"
        if self.compiled and self.solver != "fatrop":
            return f"compiled should be left out where solver is {self.solver!r}: it is for 'fatrop'"
        return ""

    @property
    def is_full(self) -> bool:
        """Whether the full formulation is used."""
        return self.formulation == "full" or self.keep != "path"

    @property
    def asked(self) -> Aim:
        """The weighted sum of objectives that is asked for."""
        return Aim.single(self.objective) if self.weights is None else Aim.weighted(self.weights)

    def aim(self, task: Task) -> Aim:
        """The weighted sum of objectives that is minimised, with what settles it."""
        return self.asked.regularised(self.keep, task.limits)

    @property
    def options(self) -> SolverOptions:
        """Of the solver of the nonlinear programs."""
        tolerance = SolverOptions().tolerance
        if is_non_smooth(self.asked.terms):
            # Slacks that are zero over whole arcs converge slowly: no more than what the error between nodes asks for.
            most, part = NON_SMOOTH_TOLERANCE
            tolerance = max(min(most, part * self.tolerance), LEAST_NON_SMOOTH)
        return SolverOptions(
            solver=self.solver,
            compiled=self.compiled,
            iterations=self.iterations,
            seconds=self.seconds,
            tolerance=tolerance,
        )

    @property
    def method(self) -> Method:
        """How the mesh is refined."""
        # Torques that are constant in each interval belong to their mesh: on a finer one the problem is another.
        doubled = self.control != "constant"
        return Method(degree=self.degree, tolerance=self.tolerance, options=self.options, doubled=doubled)

    def check(self, task: Task) -> None:
        """Refuse a task whose program cannot end as asked.

        Raises:
            InputError: end ``rest`` on a program that moves at the end, ``periodic`` on one whose velocity differs.
        """
        _, velocity, _ = task.motion.at(np.array([0.0, task.duration]))
        speed = float(np.hypot(*velocity).max())
        if self.end == "rest" and self.keep == "path" and np.hypot(*velocity[:, 1]) > 1e-9 * max(1.0, speed):
            raise InputError(
                f"collocation: end = 'rest' needs a motion that is at rest at t = {task.duration:g} s; there B should "
                f"move at {np.hypot(*velocity[:, 1]):.4g} m/s"
            )
        if self.end == "periodic" and np.abs(velocity[:, 1] - velocity[:, 0]).max() > 1e-9 * max(1.0, speed):
            raise InputError(
                "collocation: end = 'periodic' needs a motion with the same velocity at start and end; the horizon "
                "should be a whole number of laps"
            )

    def solve(self, task: Task, near: Solution | None = None) -> Solution:
        """Solve on a graded mesh, look between the nodes, refine, and solve again until tolerance and limits hold.

        Args:
            task: what to do.
            near: solution of a task with other numbers: the search begins with its mesh, motion and winding, and with
                nothing else.  Its programs are there, so that nothing is built where its mesh is fine enough.

        Returns:
            Solution whose control is the yaw acceleration in time (its torques follow from heading and yaw rate) where
            B is on its path, and the wheel torques in time elsewhere.

        Raises:
            InputError: a task whose program cannot end as asked, or ``near`` without a solution.
        """
        self.check(task)
        return self._limit(task, near) if self.homotopy else self._best(task, near)

    def _limit(self, task: Task, near: Solution | None) -> Solution:
        """Least work as the limit of a vanishing copper loss."""
        tolerance = min(self.tolerance, homotopy.TOLERANCE)
        regular = replace(self, objective="weighted", weights=Weights(work=1.0), homotopy=False, tolerance=tolerance)
        found = homotopy.copper_loss_limit(lambda weights: replace(regular, weights=weights).solve(task, near))
        if isinstance(found, Solution):
            return found
        last = found.solution
        return replace(
            last,
            message=f"{found.words}: {last.message}",
            statistics=last.statistics | {"copper_loss_limit": found.statistics},
        )

    def _best(self, task: Task, near: Solution | None) -> Solution:
        """The best of all windings that the end leaves open."""
        best, tried = None, {}
        for winding in self._windings(task, near):
            solution = self._solve(task, winding, None if near is None else Nearby.of(near, task))
            tried[winding] = solution.statistics.get("claimed_cost")
            better = best is None or (best.status is not Status.OK and solution.status is Status.OK)
            if best is not None and best.status is solution.status is Status.OK:
                better = solution.statistics["claimed_cost"] < best.statistics["claimed_cost"]
            if better:
                best = solution
        assert best is not None
        if len(tried) == 1:
            return best
        note = f"best of the windings {', '.join(f'{winding:+d}' for winding in tried if winding is not None)}"
        message = f"{best.message}; {note}: {best.claim.winding:+d}" if best.status is Status.OK else best.message
        return replace(best, message=message, statistics=best.statistics | {"windings": tried})

    def first_mesh(self, task: Task) -> np.ndarray:
        """(N + 1,) [s] Edges whose widths grow from the boundary layers at both ends, and the program's knots."""
        if self.control == "constant":
            # Equal steps: the error of constant torques is everywhere, not in the layers.
            mesh = np.linspace(0.0, task.duration, self.intervals + 1)
        else:
            aim = self.aim(task)
            small = aim.is_regularised or is_non_smooth(aim.terms)
            layer = SINGULAR_LAYER if not is_regular(aim.terms) else NON_SMOOTH_LAYER if small else LAYER
            width = layer * friction_time(task.platform) / task.duration
            mesh = graded_mesh(self.intervals, width) * task.duration
        knots = task.motion.knots(task.duration)
        return with_knots(mesh, knots) if knots.size else mesh

    def posed(self, task: Task, winding: int | None = None) -> Formulation | None:
        """The problem of a task, with its numbers.

        Args:
            task: what to do.
            winding: net full turns of the heading where the end is periodic.

        Returns:
            Full or reduced; None where the end is the servo law's and the law has none.
        """
        law_end = None
        if self.end == "law":
            motion, _ = law_motion(ServoLaw(), task, np.array([0.0, task.duration]), tolerance=1e-12)
            if motion is None:
                return None
            law_end = task.state_on_program(task.duration, *motion[:2, -1])
        settings = Settings(
            aim=self.aim(task),
            ends=EndConditions(start=self.start, end=self.end, winding=winding, law_end=law_end),
            keep=self.keep,
            radius=self.radius,
            scheme=self.scheme,
            constant=self.control == "constant",
            tolerance=self.tolerance,
        )
        return Full(task, settings) if self.is_full else Reduced(task, settings)

    def _windings(self, task: Task, near: Solution | None) -> list[int | None]:
        if self.end != "periodic":
            return [None]
        winding = near.claim.winding if near is not None and self.winding == "any" else self.winding
        if isinstance(winding, int):
            return [winding]
        turns = round((task.motion.turning_rate or 0.0) * task.duration / (2 * math.pi))
        return list(range(min(0, turns) - EXTRA_TURNS, max(0, turns) + EXTRA_TURNS + 1))

    def _solve(self, task: Task, winding: int | None, nearby: Nearby | None) -> Solution:
        claim = Claim(keep=self.keep, radius=self.radius, start=self.start, end=self.end, winding=winding)
        failed = Solution(control=None, start_state=None, claim=claim, status=Status.FAILED)
        formulation = self.posed(task, winding)
        if formulation is None:
            return replace(failed, message="the servo law is unstable on this horizon, so that it has no end state")
        passed = passed_at_ends(task, formulation.settings.ends)
        if passed:
            return replace(failed, status=Status.INFEASIBLE, message=passed)
        search = Search(formulation, self.method)
        attempts, starts = self._from_starts(search) if nearby is None else (search.near(nearby), 0)
        minima = distinct(formulation, attempts)
        attempt, reason = search.run(minima[0].attempt if minima else next(iter(attempts.values())))
        statistics: dict[str, Any] = {
            "rounds": search.rounds,
            "minima": [{"cost": m.cost, "starts": m.names} for m in minima],
        }
        if attempt.outcome.status is not Status.OK or reason:
            status = attempt.outcome.status if attempt.outcome.status is not Status.OK else Status.FAILED
            return replace(failed, status=status, message=reason, statistics=statistics)
        smoothed = settled(search, attempt) if formulation.settings.aim.is_regularised else None
        if smoothed is not None:
            formulation, attempt = smoothed.search.formulation, smoothed.attempt
            statistics |= smoothed.statistics
        notes = self._notes(formulation, attempt, smoothed)
        notes.append(found_in_words(minima, starts) if starts else "searched from a solution nearby only")
        given_up = [r["instead"] for r in search.rounds if "instead" in r]
        if given_up:
            notes.append(f"{len(given_up)} of {len(search.rounds)} solves by ipopt: {given_up[0]}")
        solution = self._solution(formulation, attempt, notes)
        complementarity = formulation.complementarity(attempt.transcription, attempt.outcome.nodes, attempt.numbers)
        statistics |= attempt.quality | {"complementarity_W": complementarity}
        return replace(solution, claim=claim, statistics=statistics)

    def _from_starts(self, search: Search) -> tuple[dict[str, Attempt], int]:
        """First solves by the names of their ways, and how many starts there were."""
        task, ends, mesh = (
            search.formulation.task,
            search.formulation.settings.ends,
            self.first_mesh(search.formulation.task),
        )
        starts = starts_of(task, self.starts or STARTS, ends.turn, free=self.start == "free")
        if self.starts is not None:
            return search.starts(mesh, starts), len(starts)
        # The others are for better minima; limits that the first cannot hold, they hardly can.
        attempts = search.starts(mesh, starts[:1])
        if not any(attempt.outcome.status is Status.OK for attempt in attempts.values()):
            return attempts, 1
        quick = self.keep == "path" and not is_non_smooth(self.asked.terms)
        others = starts[1:] if quick else scouted(search.formulation, self.method, mesh, starts)
        return attempts | search.starts(mesh, others), 1 + len(others)

    def _solution(self, formulation: Formulation, attempt: Attempt, notes: list[str]) -> Solution:
        transcription, nodes, edges = attempt.transcription, attempt.outcome.nodes, attempt.edges
        return Solution(
            control=formulation.control(transcription, edges, nodes),
            start_state=formulation.start_state(nodes),
            claimed=formulation.claimed(transcription, edges, nodes),
            local_objective=None if self.objective == "weighted" or self.control == "constant" else self.objective,
            message="; ".join(notes),
        )

    def _notes(self, formulation: Formulation, attempt: Attempt, smoothed: Settled | None) -> list[str]:
        """What there is to say of a solution that is fine."""
        notes = [f"local optimum, {attempt.words}"]
        if not is_regular(formulation.settings.aim.terms):
            notes.append(note(formulation, attempt, by_switching=self.arcs))
        if smoothed is not None:
            notes.append(smoothed.words("units" if self.objective == "weighted" else objective(self.objective).unit))
        return notes + formulation.words_of_rates(attempt.transcription, attempt.edges, attempt.outcome)
