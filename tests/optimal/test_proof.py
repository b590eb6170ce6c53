"""Limits proven between the nodes: bounds of analytic functions, remainders and rounding included."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest

from occ.control import SymbolicControl
from occ.errors import Status
from occ.model.presets import omni3, youbot
from occ.motion import Circle, Ellipse, FigureEight, RestToRestLine, SplineMotion
from occ.motion.base import ProgramMotion
from occ.optimal import limit_proof
from occ.optimal.attempt import Attempt, Grid
from occ.optimal.between import DEGREE, chebyshev_places, largest_of_polynomial
from occ.optimal.collocation import Collocation
from occ.optimal.driven import DrivenMotion
from occ.optimal.full import Full
from occ.optimal.limit_proof import AFFORDABLE, SHARP, on_path, with_proof
from occ.optimal.proof import Proven, Quantities, proven
from occ.optimal.reduced import path_control
from occ.optimal.search import HELD, Search
from occ.optimal.starts import starts_of
from occ.referee import examine
from occ.task import Claim, Limits, Solution, Task
from occ.trajectory import PiecewisePolynomial
from tests.tasks import LAP, paper_task


def of_time(expression: ca.SX, t: ca.SX, edges: np.ndarray) -> Quantities:
    count = len(edges) - 1
    function = ca.Function("of_time", [t, ca.SX(0, 1), ca.SX(0, 1)], [expression])
    empty = np.zeros((0, count, 1)), np.zeros((0, count)), np.zeros(0)
    return Quantities(function, edges, *empty, np.ones(expression.numel()), np.ones(count, dtype=bool))


def interpolation_error(pole: float) -> float:
    """Largest |q - p| of q = 1 / (pole - x) on [-1, 1], from samples."""
    x = 2 * chebyshev_places() - 1
    fine = np.cos(np.linspace(0.0, np.pi, 4001))
    p = np.polynomial.chebyshev.Chebyshev.fit(x, 1 / (pole - x), DEGREE, domain=[-1, 1])
    return float(np.abs(1 / (pole - fine) - p(fine)).max())


class TestRemainder:
    """Of functions whose distance from their polynomials is known."""

    @pytest.mark.parametrize("pole", [1.8, 2.0, 3.0, 4.0])
    def test_holds_the_distance_and_is_not_much_larger(self, pole: float) -> None:
        t = ca.SX.sym("t")
        found = proven(of_time(0.1 / (pole - t), t, np.array([-1.0, 1.0])))
        true = 0.1 * interpolation_error(pole)
        assert found.largest[0, 0] >= 0.1 / (pole - 1)
        assert true <= found.remainder <= 1e4 * true + 1e-13

    def test_of_a_function_that_no_sample_shows(self) -> None:
        # q vanishes at all Chebyshev points and is 1 between them: only the remainder sees it.
        t = ca.SX.sym("t")
        wave = ca.cos(DEGREE * 2.5 * t + 1.0)
        found = proven(of_time(wave, t, np.array([-1.0, 1.0])))
        assert 1.0 <= found.largest[0, 0] <= 1.0 + 5e-6
        x = 2 * chebyshev_places() - 1
        q = 1.1 * np.prod([t - place for place in x]) * 2.0 ** (DEGREE - 2)
        (bound,) = proven(of_time(ca.vertcat(q), t, np.array([-1.0, 1.0]))).largest[0]
        fine = np.linspace(-1.0, 1.0, 20_001)
        true = np.abs(1.1 * 2.0 ** (DEGREE - 2) * np.prod(fine[:, None] - x, axis=1)).max()
        assert true > 0.5
        assert largest_of_polynomial(np.zeros(DEGREE + 1))[0] == 0.0
        assert bound >= true

    @pytest.mark.parametrize("segment", range(6))
    def test_every_segment_is_looked_at(self, segment: int) -> None:
        # A bump that is above 1 in one segment only.
        t, middle = ca.SX.sym("t"), segment + 0.4
        bump = 1.2 / (1.0 + 9.0 * (t - middle) ** 2)
        found = proven(of_time(bump, t, np.arange(7.0)))
        assert 1.2 <= found.largest[0, segment] <= 1.2 + 1e-8
        other = np.delete(found.largest[0], segment)
        assert np.all(other < 1.0)
        # What stays below is bounded, too.
        ends = 1.2 / (1.0 + 9.0 * np.minimum(np.abs(np.arange(6) - middle), np.abs(np.arange(1, 7) - middle)) ** 2)
        assert np.all(other >= np.delete(ends, segment))

    def test_where_a_knot_is_inside_a_segment_nothing_is_proven(self) -> None:
        t = ca.SX.sym("t")
        quantities = of_time(0.1 * t, t, np.arange(4.0))
        found = proven(dataclasses.replace(quantities, smooth=np.array([True, False, True])))
        np.testing.assert_array_equal(np.isinf(found.largest[0]), [False, True, False])

    def test_rounding_is_part_of_it(self) -> None:
        # 1e6 (1 + t) - 1e6 - 1e6 t is zero, and its values are not.
        t = ca.SX.sym("t")
        q = (1e6 / 3.0 + 1e6 * t) - 1e6 * (t + 1.0 / 3.0)
        found = proven(of_time(q, t, np.array([0.0, 1.0])))
        assert 1e-11 < found.remainder < 1e-7
        assert found.largest[0, 0] >= 0.0


POINTS = ((0.0, 0.0), (0.5, 0.2), (0.8, -0.1), (1.2, 0.3))
MOTIONS: dict[str, ProgramMotion] = {
    "ellipse": Ellipse(semi_axes=(0.8, 0.4), rate=0.5),
    "figure_eight": FigureEight(semi_axes=(0.8, 0.4), rate=0.4),
    "rest_to_rest": RestToRestLine(start=(0.0, 0.0), end=(1.5, 0.3), duration=5.0),
    "spline": SplineMotion(points=POINTS, times=(0.0, 1.5, 3.1, 5.0)),
}
EVERYTHING = Limits(
    torque=5.0, wheel_speed=40.0, wheel_power=60.0, stall_torque=9.0, no_load_speed=60.0, platform_speed=2.0
)


def proof_of(task: Task, player: Collocation) -> tuple[Quantities, Task, np.ndarray]:
    """The quantities of a solution, and their values along the referee's replay at many times in each interval."""
    solution = player.solve(task)
    assert solution.status is Status.OK, solution.message
    formulation = player.posed(task)
    assert formulation is not None
    assert isinstance(solution.control, SymbolicControl)
    assert solution.start_state is not None
    quantities = on_path(formulation, solution.control, solution.start_state[[2, 5]])
    verdict = examine(task, solution)
    assert verdict.replay is not None
    s = np.linspace(1e-9, 1.0 - 1e-9, 61)
    times = (quantities.edges[:-1, None] + np.diff(quantities.edges)[:, None] * s).ravel()
    seen = verdict.replay.sample(times)
    speed = np.sum(seen.state[3:5] ** 2, axis=0)[None]
    limits = task.limits
    assert limits.torque_speed_line is not None
    stall, no_load = limits.torque_speed_line
    line = seen.torque / stall + seen.wheel_rates / no_load
    values = np.concatenate([seen.torque, seen.wheel_rates, seen.torque * seen.wheel_rates, line, speed])
    return quantities, task, np.abs(values / quantities.scales[:, None]).reshape(len(values), -1, len(s)).max(axis=2)


BOTH = [
    pytest.param(
        name, kind, marks=() if (name, kind) in (("ellipse", "full"), ("spline", "reduced")) else pytest.mark.slow
    )
    for name in MOTIONS
    for kind in ("reduced", "full")
]


@pytest.mark.parametrize(("name", "formulation"), BOTH)
def test_bounds_are_those_of_the_replayed_motion(name: str, formulation: str) -> None:
    task = dataclasses.replace(paper_task(5.0, limits=EVERYTHING), motion=MOTIONS[name])
    player = Collocation(objective="torque_squared", tolerance=1e-5, formulation=formulation)
    quantities, _, seen = proof_of(task, player)
    found = proven(quantities)
    # Independent of the proof: the referee's integrator, at sixty times in each interval.
    assert np.all(found.largest >= seen - 1e-9)
    assert np.all(found.largest <= seen + 1e-3 * np.abs(seen).max(axis=1, keepdims=True) + 1e-8)
    assert found.remainder < 1e-8


def test_a_knot_of_the_program_belongs_on_an_edge() -> None:
    task = dataclasses.replace(paper_task(5.0, limits=EVERYTHING), motion=MOTIONS["spline"])
    formulation = Collocation(objective="torque_squared").posed(task)
    assert formulation is not None
    for edges, smooth in (([0.0, 1.5, 3.1, 5.0], [True] * 3), ([0.0, 1.5, 3.0, 5.0], [True, True, False])):
        signal = PiecewisePolynomial(np.array(edges), np.array([0.2, 0.8]), np.zeros((2, 3, 2)))
        found = proven(on_path(formulation, path_control(task, signal), np.zeros(2)))
        np.testing.assert_array_equal(np.isfinite(found.largest).all(axis=0), smooth)


PEAK = {"objective": "peak_torque", "tolerance": 1e-4, "intervals": 8}


def first_attempt(task: Task, keys: dict[str, Any]) -> tuple[Search, Attempt]:
    player = Collocation(**(PEAK | keys))
    formulation = player.posed(task)
    assert formulation is not None
    search = Search(formulation, player.method)
    guess = partial(formulation.guess, rotation=starts_of(task, 1, None)[0].rotation)
    attempt = search.attempt(Grid(edges=player.first_mesh(task), degree=player.degree), guess)
    assert attempt.outcome.status is Status.OK, attempt.outcome.message
    return search, attempt


def torques_of(search: Search, attempt: Attempt) -> np.ndarray:
    """(n, N) [N m] Largest torques of the referee's replay, at sixty times in each interval."""
    formulation, task = search.formulation, search.formulation.task
    control = formulation.control(attempt.transcription, attempt.edges, attempt.outcome.nodes)
    claim = Claim(keep=formulation.settings.keep, radius=formulation.settings.radius)
    start = formulation.start_state(attempt.outcome.nodes)
    replay = examine(task, Solution(control=control, start_state=start, claim=claim)).replay
    assert replay is not None
    s = np.linspace(1e-9, 1.0 - 1e-9, 61)
    times = attempt.edges[:-1, None] + np.diff(attempt.edges)[:, None] * s
    return np.abs(replay.sample(times.ravel()).torque.reshape(-1, *times.shape)).max(axis=2)


class TestLargestTorque:
    """That no torque passes the claimed m between the nodes, where m is the cost."""

    @pytest.mark.parametrize(
        "keys", [{}, {"formulation": "full"}, {"keep": "tube", "radius": 0.02}], ids=["reduced", "full", "tube"]
    )
    def test_bounds_are_those_of_the_replayed_motion(self, keys: dict[str, Any]) -> None:
        search, attempt = first_attempt(paper_task(3.0), keys)
        claimed = attempt.outcome.nodes.edges[-1, -1]
        found = with_proof(search.formulation, attempt).arcs
        assert found is not None
        assert found.claimed == claimed
        seen = torques_of(search, attempt)
        # Independent of the proof: the referee's integrator.
        bounds = found.largest[found.hard :] * claimed
        assert np.all(bounds >= seen - 1e-9)
        assert np.all(bounds <= seen + 1e-3)
        assert bounds.max() > claimed * (1 + 1e-4)
        assert f"to pass the claimed {claimed:.6g} N m by at most" in found.words

    def test_beside_a_limit_of_the_torque_each_has_its_own_unit(self) -> None:
        # One limit that is slack, and one that is what the wheels would need anyway.
        for limit in (1.5, 0.9):
            search, attempt = first_attempt(paper_task(3.0, limits=Limits(torque=limit, wheel_speed=9.0)), {})
            found = with_proof(search.formulation, attempt).arcs
            assert found is not None
            assert found.proven == ("torque", "wheel_speed")
            soft = found.largest[found.hard :] * found.claimed
            np.testing.assert_allclose(found.largest[:4] * limit, soft, rtol=1e-9)
            assert np.all(soft >= torques_of(search, attempt) - 1e-9)

    def test_a_torque_that_only_the_proof_sees_is_not_accepted(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("occ.optimal.between.largest_values", lambda sample, first: 0.5 * np.abs(first).max(axis=2))
        search, attempt = first_attempt(paper_task(3.0), {})
        claimed = attempt.outcome.nodes.edges[-1, -1]
        assert torques_of(search, attempt).max() > claimed * (1 + 5e-4)
        found, reason = search.run(attempt)
        assert not reason
        claimed = found.outcome.nodes.edges[-1, -1]
        assert torques_of(search, found).max() <= claimed * (1 + 1e-4)
        assert found.largest_excess <= 1e-4


FREE = youbot(wheel_friction=0.0, roller_friction=0.0)
TUBES = {
    "thin": (paper_task(4.0), 1e-4),
    "four laps": (paper_task(4 * LAP), 0.01),
    "no friction": (paper_task(15.0, platform=FREE), 0.01),
    "three wheels": (
        dataclasses.replace(paper_task(15.7, platform=omni3()), motion=Circle(radius=0.7, rate=0.4, phase=0.0)),
        1e-3,
    ),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name == "three wheels" else ()) for name in TUBES]
)
def test_tubes_that_are_thin_or_long(name: str) -> None:
    task, radius = TUBES[name]
    keys = {"objective": "torque_squared", "keep": "tube", "radius": radius, "tolerance": 1e-6, "intervals": 24}
    search, attempt = first_attempt(task, keys)
    found = with_proof(search.formulation, attempt).arcs
    assert found is not None
    assert found.proven == ("tube",)
    assert found.remainder <= SHARP
    # Independent of the proof: the distances in the referee's replay.
    formulation = search.formulation
    control = formulation.control(attempt.transcription, attempt.edges, attempt.outcome.nodes)
    start = formulation.start_state(attempt.outcome.nodes)
    replay = examine(task, Solution(control=control, start_state=start, claim=Claim(keep="tube", radius=radius))).replay
    assert replay is not None
    times = attempt.edges[:-1, None] + np.diff(attempt.edges)[:, None] * np.linspace(1e-9, 1.0 - 1e-9, 61)
    away = task.point_motion(replay.sample(times.ravel()).state)[0] - task.motion.at(times.ravel())[0]
    seen = (np.sum(away**2, axis=0) / radius**2).reshape(times.shape).max(axis=1)
    # The referee's own errors are larger than those of the proof.
    rough = 2e-9 / radius
    assert np.all(found.largest[0] >= seen - rough)
    assert np.all(found.largest[0] <= seen + rough + 1e-2 * seen.max())


def with_remainder(monkeypatch: pytest.MonkeyPatch, remainder: float) -> None:
    """Proofs that know the motion less well than they do."""
    exact = limit_proof.beside_path

    def rough(*arguments: Any) -> tuple[Proven, np.ndarray]:
        found, added = exact(*arguments)
        return found, added + remainder

    monkeypatch.setattr(limit_proof, "beside_path", rough)


class TestRemainderInUnitsOfTheTolerance:
    """How much of a bound may be that of not knowing the motion any better."""

    keys: ClassVar = {"objective": "torque_squared", "keep": "tube", "radius": 0.02}

    @pytest.mark.parametrize(("remainder", "proven"), [(0.9e-6, True), (1.1e-6, False)])
    def test_where_the_proof_ends(self, remainder: float, proven: bool, monkeypatch: pytest.MonkeyPatch) -> None:
        search, attempt = first_attempt(paper_task(3.0), self.keys)
        exact = with_proof(search.formulation, attempt).arcs
        with_remainder(monkeypatch, remainder)
        found = with_proof(search.formulation, attempt).arcs
        assert found is not None
        assert exact is not None
        assert search.formulation.settings.tolerance * AFFORDABLE == pytest.approx(1e-6)
        assert (found.proven, found.estimated) == ((("tube",), ()) if proven else ((), ("tube",)))
        if proven:
            np.testing.assert_allclose(found.largest - exact.largest, remainder, rtol=1e-6)

    @pytest.mark.parametrize("growth", [1e2, 1e3, 1e5])
    def test_distances_beyond_all_numbers_are_no_proof(self, growth: float, monkeypatch: pytest.MonkeyPatch) -> None:
        limits = Limits(wheel_speed=9.0, wheel_power=30.0, platform_speed=0.5)
        search, attempt = first_attempt(paper_task(3.0, limits=limits), self.keys)
        monkeypatch.setattr("occ.optimal.enclosed_motion.EIGENVALUES", growth)
        found = with_proof(search.formulation, attempt).arcs
        assert found is not None
        assert found.estimated == ("wheel_speed", "wheel_power", "platform_speed", "tube")

    def test_it_is_taken_off_the_limit(self, monkeypatch: pytest.MonkeyPatch) -> None:
        # The bound with the remainder in it has to be held, so that the motion itself stays that far inside.
        with_remainder(monkeypatch, 0.9e-6)
        player = Collocation(**self.keys, tolerance=1e-4)
        solution = player.solve(paper_task(3.0))
        assert solution.status is Status.OK, solution.message
        assert "limits of tube proven between nodes on its motion, remainders of 9e-07 included" in solution.message
        monkeypatch.undo()
        formulation = player.posed(paper_task(3.0))
        assert isinstance(formulation, Full)
        assert isinstance(solution.control, SymbolicControl)
        assert solution.start_state is not None
        motion = DrivenMotion(formulation.task, solution.control, solution.start_state)
        found, added = limit_proof.beside_path(formulation, solution.control, motion)
        assert (found.largest + added).max() <= 1.0 + HELD - 0.8e-6


class TestRows:
    """What a row says."""

    @pytest.mark.slow
    def test_of_all_limits_in_the_reduced_formulation(self) -> None:
        limits = Limits(torque=1.1, wheel_speed=9.0, torque_rate=8.0)
        player = Collocation(objective="torque_squared", tolerance=1e-4)
        solution = player.solve(paper_task(3.0, limits=limits))
        assert solution.status is Status.OK, solution.message
        assert "limits of torque and wheel speed and torque rate proven between nodes on its motion" in solution.message
        assert "estimated" not in solution.message

    def test_of_torques_where_b_may_leave_its_path(self) -> None:
        task = paper_task(3.0, limits=Limits(torque=1.1, wheel_speed=9.0))
        player = Collocation(objective="torque_squared", keep="tube", radius=0.02, tolerance=1e-4)
        solution = player.solve(task)
        assert solution.status is Status.OK, solution.message
        assert "limits of torque and wheel speed and tube proven between nodes on its motion" in solution.message
        assert "estimated" not in solution.message

    def test_a_limit_that_only_the_proof_sees_passed_is_not_held(self, monkeypatch: pytest.MonkeyPatch) -> None:
        # An estimate that sees nothing: the proof alone makes the search tighten its limits.
        monkeypatch.setattr("occ.optimal.between.largest_values", lambda sample, first: 0.5 * np.abs(first).max(axis=2))
        task = paper_task(limits=Limits(torque=1.1))
        player = Collocation(objective="torque_squared", intervals=6, degree=4, tolerance=3e-3)
        solution = player.solve(task)
        assert solution.status is Status.OK, solution.message
        quantities = on_path(player.posed(task), solution.control, solution.start_state[[2, 5]])
        assert proven(quantities).largest.max() <= 1 + 3e-7
