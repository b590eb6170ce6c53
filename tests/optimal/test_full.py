"""The full formulation: it agrees with the reduced one, and holds tubes and ends."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np
import pytest

from occ.errors import InputError, Status
from occ.model.presets import omni3, youbot
from occ.motion import RestToRestLine, SplineMotion
from occ.optimal.attempt import Attempt, Grid
from occ.optimal.collocation import Collocation
from occ.optimal.problem import Bounds, Nodes, Numbers, Problem
from occ.optimal.search import Method, Search
from occ.optimal.starts import starts_of
from occ.optimal.transcription import Transcription
from occ.referee import examine, judge
from occ.task import Limits, Solution, Start, Task
from tests.tasks import POINT, paper_task

REST = Task(
    platform=youbot(), point=POINT, motion=RestToRestLine(start=(0.0, 0.0), end=(0.6, 0.8), duration=4.0), duration=4.0
)
WAY = ((0.0, 0.0), (0.13, -0.37), (-0.16, -2.07), (1.1, -1.27))
ASIDE = Start(heading=-1.87, heading_rate=0.23)
COLUMN = {"work": "work_J", "torque_squared": "torque_squared_N2m2s", "electric": "electric_J"}


def heading(task: Task, solution: Solution, t: np.ndarray) -> np.ndarray:
    replay = examine(task, solution).replay
    assert replay is not None
    return np.asarray(replay.at(t)[2])


def searched(task: Task, player: Collocation) -> tuple[Search, Attempt]:
    """The first solve from the law's rotation, on the first mesh."""
    formulation = player.posed(task)
    assert formulation is not None
    search = Search(formulation, player.method)
    guess = partial(formulation.guess, rotation=starts_of(task, 1, None)[0].rotation)
    return search, search.attempt(Grid(edges=player.first_mesh(task), degree=player.degree), guess)


def attempted(task: Task, player: Collocation) -> Attempt:
    return searched(task, player)[1]


class TestAgreement:
    """B on its path in both formulations: to 1e-7 in objective and heading."""

    @pytest.mark.parametrize(
        ("task", "keys"),
        [
            (paper_task(), {}),
            (paper_task(), {"objective": "electric", "end": "law"}),
            (paper_task(), {"end": "periodic", "winding": -1}),
            (paper_task(), {"end": "periodic", "winding": -1, "start": "free"}),
            (REST, {"end": "rest"}),
            # No null torques, and a limit that is looked at between the nodes.
            (replace(paper_task(4.0, limits=Limits(torque=2.0)), platform=omni3()), {}),
        ],
        ids=["free", "law", "periodic", "free start", "rest", "three wheels"],
    )
    def test_of_regular_problems(self, task: Task, keys: dict[str, object]) -> None:
        objective = str(keys.get("objective", "torque_squared"))
        keys = {"objective": objective, "tolerance": 1e-8} | keys
        both = [Collocation(formulation=name, **keys).solve(task) for name in ("reduced", "full")]
        records = [judge(task, solution) for solution in both]
        assert [record.status for record in records] == [Status.OK] * 2, records[1].message
        assert records[0].end == records[1].end == keys.get("end", "free")
        one, other = (record.measures[COLUMN[objective]] for record in records)
        assert other == pytest.approx(one, rel=1e-7)
        t = np.linspace(0.0, task.duration, 500)
        np.testing.assert_allclose(heading(task, both[1], t), heading(task, both[0], t), atol=1e-7 * 2 * np.pi)

    def test_of_min_work_on_one_mesh(self) -> None:
        # The infimum is not attained: what a mesh makes of it depends on its first and last interval.
        task = paper_task()
        keys = {"objective": "work", "intervals": 32, "tolerance": 1e-4, "starts": 1}
        both = [Collocation(formulation=name, **keys).solve(task) for name in ("reduced", "full")]
        assert [len(solution.statistics["rounds"]) for solution in both] == [2, 2]  # the mesh and its double
        one, other = (solution.statistics["claimed_cost"] for solution in both)
        assert other == pytest.approx(one, rel=1e-7)
        t = np.linspace(0.0, task.duration, 500)
        np.testing.assert_allclose(heading(task, both[1], t), heading(task, both[0], t), atol=1e-7 * 2 * np.pi)

    @pytest.mark.slow
    def test_under_limits(self) -> None:
        task = paper_task(limits=Limits(torque=1.0))
        records = [
            judge(task, Collocation(objective="torque_squared", formulation=name, tolerance=1e-7).solve(task))
            for name in ("reduced", "full")
        ]
        assert [record.status for record in records] == [Status.OK] * 2
        one, other = (record.measures["torque_squared_N2m2s"] for record in records)
        assert other == pytest.approx(one, rel=1e-7)

    @pytest.mark.slow
    def test_in_the_same_minimum_where_limits_bind(self) -> None:
        motion = SplineMotion(points=WAY, times=(0.0, 2.0, 4.0, 6.0))
        task = replace(paper_task(6.0, limits=Limits(torque=4.245)), motion=motion, point=(0.3, 0.05), start=ASIDE)
        found = {}
        for name, starts in (("reduced", None), ("full", None), ("reduced", 1)):
            player = Collocation(objective="electric", formulation=name, starts=starts, tolerance=1e-6)
            record = judge(task, player.solve(task))
            assert record.status is Status.OK, record.message
            found[name, starts] = record.measures["electric_J"]
        assert found["full", None] == pytest.approx(found["reduced", None], rel=1e-7)
        # The law, which knows no limits, leads to a worse one.
        assert found["reduced", None] < 0.96 * found["reduced", 1]

    def test_of_torque_rates_on_one_mesh(self) -> None:
        # To the solver's own tolerance, and not to the looser one at which it may stop where its linear solver is lost.
        task = paper_task(3.0, limits=Limits(torque=1.1, torque_rate=20.0))
        found = []
        for name in ("reduced", "full"):
            attempt = attempted(task, Collocation(objective="work", formulation=name))
            assert attempt.outcome.statistics["return_status"] == "Solve_Succeeded"
            assert "optimality conditions" not in attempt.words
            found.append(attempt.outcome.cost)
        # The rates of the torques are those of other polynomials: a little between the nodes.
        assert found[1] == pytest.approx(found[0], rel=1e-8)

    def test_a_solver_that_stops_short_is_in_the_row(self, monkeypatch: pytest.MonkeyPatch) -> None:
        # IPOPT's own threshold for pivots, on a mesh that no other test uses.
        monkeypatch.setattr("occ.optimal.solvers.PIVOTS", 1e-6)
        task = paper_task(3.0, limits=Limits(torque=1.1, torque_rate=20.0))
        attempt = attempted(task, Collocation(objective="work", formulation="full", intervals=14))
        assert attempt.outcome.status is Status.OK
        assert "its optimality conditions hold to 1e-06 only" in attempt.words

    @pytest.mark.slow
    def test_under_limits_of_torques_and_their_rates(self) -> None:
        task = paper_task(3.0, limits=Limits(torque=1.1, torque_rate=20.0))
        both = [Collocation(objective="work", formulation=name, tolerance=1e-4) for name in ("reduced", "full")]
        solutions = [player.solve(task) for player in both]
        records = [judge(task, solution) for solution in solutions]
        assert [record.status for record in records] == [Status.OK] * 2, records[1].message
        # No program without a solution was handed to the solver.
        assert {each["return_status"] for each in solutions[1].statistics["rounds"]} == {"Solve_Succeeded"}
        one, other = (record.measures["work_J"] for record in records)
        assert other == pytest.approx(one, rel=1e-7)

    def test_b_is_on_its_velocity_at_every_collocation_point_and_at_the_end(self) -> None:
        task, player = paper_task(), Collocation(objective="torque_squared", formulation="full")
        formulation = player.posed(task)
        assert formulation is not None
        search = Search(formulation, Method(degree=5, tolerance=1e-4, options=player.options))
        (attempt,) = search.starts(player.first_mesh(task), starts_of(task, 1, None)).values()
        nodes = attempt.outcome.nodes
        t = attempt.transcription.node_times(attempt.edges)
        assert t[-1, -1] == task.duration
        _, velocity = task.point_motion(nodes.points.reshape(6, -1))
        np.testing.assert_allclose(velocity, task.motion.at(t.ravel())[1], atol=1e-9)


def least_in_tube(radius: float) -> float:
    task = paper_task(4.0)
    verdict = examine(task, Collocation(objective="torque_squared", keep="tube", radius=radius).solve(task))
    assert verdict.record.status is Status.OK, verdict.record.message
    assert verdict.record.keep == "tube"
    assert verdict.record.measures["tube_radius_m"] == radius
    # Between nodes, too: looked at twenty thousand times.
    assert verdict.replay is not None
    t = np.linspace(0.0, task.duration, 20_001)
    position, _ = task.point_motion(verdict.replay.at(t))
    distance = np.hypot(*(position - task.motion.at(t)[0]))
    assert distance.max() == pytest.approx(radius, abs=1e-7)
    return verdict.record.measures["torque_squared_N2m2s"]


class TestTube:
    """|r_B - r_B*| <= radius."""

    def test_a_wider_tube_needs_less_and_a_narrow_one_nearly_as_much_as_the_path(self) -> None:
        task = paper_task(4.0)
        path = judge(task, Collocation(objective="torque_squared").solve(task)).measures["torque_squared_N2m2s"]
        narrow, wide = (least_in_tube(radius) for radius in (0.001, 0.05))
        assert path > narrow > wide
        assert path - narrow < 0.1 * (path - wide)

    @pytest.mark.parametrize(
        ("end", "keys"),
        [("law", {}), ("rest", {}), ("periodic", {"winding": -1}), ("periodic", {"start": "free", "winding": -1})],
    )
    def test_ends(self, end: str, keys: dict[str, object]) -> None:
        task = paper_task()
        player = Collocation(objective="torque_squared", keep="tube", radius=0.05, end=end, tolerance=1e-5, **keys)
        record = judge(task, player.solve(task))
        assert record.status is Status.OK, record.message
        assert (record.keep, record.end) == ("tube", end)

    def test_a_claim_of_a_narrower_tube_is_found_false(self) -> None:
        task = paper_task(4.0)
        solution = Collocation(objective="torque_squared", keep="tube", radius=0.05, tolerance=1e-5).solve(task)
        record = judge(task, replace(solution, claim=replace(solution.claim, radius=0.04)))
        assert record.status is Status.FAILED
        assert "radius of the tube 0.04 m" in record.message
        record = judge(task, replace(solution, claim=replace(solution.claim, keep="path", radius=None)))
        assert record.status is Status.FAILED
        assert judge(task, replace(solution, claim=replace(solution.claim, radius=None))).status is Status.CRASHED


class TestConstantTorques:
    """Torques that are constant in each interval."""

    @pytest.mark.parametrize("intervals", [4, 8, 16])
    def test_on_the_double_integrator_have_their_closed_form(self, intervals: int) -> None:
        # x'' = u, rest to rest over unit time and distance, least integral of u^2: 12 N^2 / (N^2 - 1).
        state, control = ca.SX.sym("x", 2), ca.SX.sym("u")
        problem = Problem(
            state=state,
            control=control,
            data=ca.SX(0, 1),
            parameters=ca.SX(0, 1),
            start=ca.SX.sym("start", 2),
            end=ca.SX.sym("end", 2),
            rate=ca.vertcat(state[1], control),
            integrand=control**2,
            held=1,
        )
        transcription = Transcription(problem, intervals, 3)
        numbers = Numbers(
            edges=np.linspace(0, 1, intervals + 1),
            data=np.zeros((0, intervals, 3)),
            parameters=np.zeros(0),
            start=Bounds.fixed(np.zeros(2)),
            end=Bounds.fixed(np.array([1.0, 0.0])),
        )
        guess = Nodes(np.zeros((2, intervals + 1)), np.zeros((2, intervals, 3)), np.zeros((1, intervals, 3)))
        outcome = transcription.solve(numbers, guess)
        assert outcome.cost == pytest.approx(12 * intervals**2 / (intervals**2 - 1), rel=1e-9)

    @pytest.mark.slow
    def test_hold_a_torque_limit_exactly(self) -> None:
        task = paper_task(4.0, limits=Limits(torque=0.8))
        keys = {"objective": "torque_squared", "keep": "tube", "radius": 0.05}
        record = judge(task, Collocation(control="constant", intervals=40, **keys).solve(task))
        assert record.status is Status.OK, record.message
        assert record.measures["peak_torque_Nm"] <= 0.8 * (1 + 1e-9)
        assert record.measures["peak_torque_Nm"] == pytest.approx(0.8, rel=1e-6)
        smooth = judge(task, Collocation(**keys).solve(task))
        ratio = record.measures["torque_squared_N2m2s"] / smooth.measures["torque_squared_N2m2s"]
        assert 1.0 < ratio < 1.01


class TestEnds:
    """B only starts and ends on its program."""

    def test_a_free_platform_has_its_closed_form(self) -> None:
        # Massless wheels, no friction, mass centre at O: m r_O'' = F and I psi'' = M_Omega, and the torques of least
        # norm are sum M_i^2 = R^2 / 4 (|F|^2 + M_Omega^2 / (l + h)^2), whatever the heading.  From rest to rest over T
        # the least integral of a squared second derivative is 12 distance^2 / T^3, so that
        #   J = 3 R^2 / T^3 (m^2 d^2 + I^2 turn^2 / (l + h)^2).
        # With B off O and whole turns O moves as far as B does.
        distance, duration, turns = np.hypot(0.6, 0.8), 2.0, 1
        platform = youbot(
            mass_center=(0.0, 0.0), wheel_mass=0.0, wheel_spin_inertia=0.0, wheel_friction=0.0, roller_friction=0.0
        )
        motion = RestToRestLine(start=(0.0, 0.0), end=(0.6, 0.8), duration=duration)
        task = Task(platform=platform, point=POINT, motion=motion, duration=duration)
        player = Collocation(
            objective="torque_squared", keep="ends", end="periodic", winding=turns, degree=7, tolerance=1e-9
        )
        record = judge(task, player.solve(task))
        assert record.status is Status.OK, record.message
        mass, inertia, arm, radius = 29.94, 4.42, 0.150 + 0.235, 0.0475
        turned = inertia * 2 * np.pi * turns / arm
        least = 3 * radius**2 / duration**3 * (mass**2 * distance**2 + turned**2)
        assert record.measures["torque_squared_N2m2s"] == pytest.approx(least, rel=1e-8)

    def test_cost_less_than_the_path_between_them(self) -> None:
        task = REST
        keys = {"objective": "torque_squared", "end": "rest"}
        path, ends = (judge(task, Collocation(**keys, **more).solve(task)) for more in ({}, {"keep": "ends"}))
        for record in (path, ends):
            assert record.status is Status.OK, record.message
        assert path.measures["torque_squared_N2m2s"] > ends.measures["torque_squared_N2m2s"]
        assert ends.measures["position_error_end_m"] < 1e-6

    def test_a_solver_that_loses_its_way_starts_again_from_a_motion_that_holds_the_limits(self) -> None:
        task = paper_task(3.0, limits=Limits(wheel_speed=7.2))
        search, first = searched(task, Collocation(objective="electric", keep="ends"))
        # So it does here, at least with some versions of its libraries.
        lost = replace(first, outcome=replace(first.outcome, status=Status.INFEASIBLE, message="lost", statistics={}))
        again = search.explained(lost)
        assert again.outcome.status is Status.OK, again.outcome.message
        rates = np.array(task.dynamics.coefficients.wheel_rates)
        speeds = np.tensordot(rates, again.outcome.nodes.points[3:6], 1)
        assert np.abs(speeds).max() <= 7.2 * (1 + 1e-6)

    def test_an_end_off_the_program_is_found_by_the_referee(self) -> None:
        task = paper_task(4.0)
        solution = Collocation(objective="torque_squared", keep="tube", radius=0.05).solve(task)
        record = judge(task, replace(solution, claim=replace(solution.claim, keep="ends", radius=None)))
        assert record.status is Status.FAILED
        assert "away from B's program" in record.message

    def test_an_unpaid_start_cannot_be_asked_for(self) -> None:
        for keep in ({}, {"keep": "tube", "radius": 0.1}, {"keep": "ends"}):
            for end in ("free", "law", "rest"):
                with pytest.raises(InputError, match="nobody pays"):
                    Collocation(objective="work", start="free", end=end, **keep)
        # Even without a path the given start pays for its kinetic energy, and no motion returns more than it had.
        task = paper_task(4.0)
        record = judge(task, Collocation(objective="work", keep="tube", radius=0.5, end="rest").solve(task))
        assert record.status is Status.OK, record.message
        k = np.array(task.dynamics.coefficients.inertia)
        velocity = task.state_on_program(0.0, 0.0, 0.0)[3:]
        assert record.measures["work_J"] > -velocity @ k @ velocity / 2


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"keep": "tube"}, "radius"),
        ({"radius": 0.1}, "radius"),
        ({"keep": "tube", "radius": -0.1}, "radius"),
        ({"keep": "ends", "formulation": "reduced"}, "formulation"),
        ({"control": "constant"}, "control"),
        ({"control": "constant", "formulation": "full"}, "control"),
        ({"formulation": "full", "scheme": "legendre"}, "scheme"),
        ({"keep": "tunnel"}, "keep"),
    ],
)
def test_keys_that_contradict_each_other_are_refused(keys: dict[str, object], word: str) -> None:
    with pytest.raises(InputError, match=word):
        Collocation(objective="work", **keys)
