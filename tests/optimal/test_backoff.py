"""What is taken off limits and which controls are held, so that limits hold between the nodes."""

from __future__ import annotations

import numpy as np
import pytest

from occ.optimal.attempt import Attempt, Method
from occ.optimal.backoff import JUMP, LOOSE, MARGIN, Tightening, can_hold, held_controls, tightened
from occ.optimal.between import loads
from occ.optimal.collocation import Collocation
from occ.optimal.formulation import Formulation
from occ.optimal.search import Search
from occ.optimal.starts import starts_of
from occ.task import Limits
from tests.tasks import paper_task


@pytest.fixture(scope="module")
def jumping() -> tuple[Formulation, Attempt]:
    """Least work on the first mesh, where the wheel torques jump off their limits inside two of the intervals."""
    task = paper_task(2 * np.pi / 0.7, rate=-0.7, radius=0.45, limits=Limits(torque=6.9))
    player = Collocation(objective="work")
    formulation = player.posed(task)
    assert formulation is not None
    search = Search(formulation, Method(degree=5, tolerance=1e-6, options=player.options))
    (attempt,) = search.starts(player.first_mesh(task), starts_of(task, 1, None)).values()
    return formulation, attempt


def loads_with(formulation: Formulation, attempt: Attempt, interval: int, values: np.ndarray) -> np.ndarray:
    """(4, d) M / limit in one interval with its controls held."""
    nodes, numbers = attempt.outcome.nodes, attempt.numbers
    control = np.broadcast_to(values[:, None, None], nodes.control.shape)
    found, _ = loads(formulation, attempt.transcription, (nodes.points, control, numbers.data))
    return found.reshape(4, *nodes.points.shape[1:])[:, interval]


class TestHeldControls:
    """Constant, within the limits, and as near as can be to the mean."""

    def test_are_within_the_limits(self, jumping: tuple[Formulation, Attempt]) -> None:
        formulation, attempt = jumping
        intervals = np.flatnonzero(attempt.passes(JUMP))
        assert len(intervals) == 2
        taken = np.full((4, len(attempt.edges) - 1), 0.25)
        for part in (0.0, 0.25):
            for k, values in zip(
                intervals, held_controls(formulation, attempt, intervals, part / 0.25 * taken), strict=True
            ):
                assert values is not None
                assert np.abs(loads_with(formulation, attempt, k, values)).max() <= 1 - part - MARGIN + 1e-9

    def test_are_the_mean_where_that_is_within_the_limits(self, jumping: tuple[Formulation, Attempt]) -> None:
        formulation, attempt = jumping
        mean = attempt.outcome.nodes.control @ attempt.transcription.scheme.weights
        free = np.flatnonzero(attempt.arcs.largest[:4].max(axis=0) < 0.9) if attempt.arcs else np.zeros(0, dtype=int)
        found = held_controls(formulation, attempt, free[:3], np.zeros((4, len(attempt.edges) - 1)))
        np.testing.assert_allclose(np.array(found).T, mean[:, free[:3]], rtol=1e-12)

    def test_do_not_exist_where_the_limit_is_too_low(self, jumping: tuple[Formulation, Attempt]) -> None:
        formulation, attempt = jumping
        nearly_all = np.full((4, len(attempt.edges) - 1), 0.999)
        assert held_controls(formulation, attempt, np.array([8]), nearly_all) == [None]

    def test_leave_the_yaw_rate_behind_the_interval_as_it_is(self, jumping: tuple[Formulation, Attempt]) -> None:
        formulation, attempt = jumping
        k = int(np.flatnonzero(attempt.passes(JUMP))[0])
        (values,) = held_controls(formulation, attempt, np.array([k]), np.zeros((4, len(attempt.edges) - 1)))
        assert values is not None
        rates, width = attempt.outcome.nodes.edges[1], np.diff(attempt.edges)[k]
        # The mean within the limits; off by the margin at most.
        assert values[0] * width == pytest.approx(rates[k + 1] - rates[k], rel=1e-3)

    @pytest.mark.parametrize(
        ("keys", "limits", "expected"),
        [
            ({"objective": "work"}, Limits(torque=6.9), True),
            ({"objective": "work", "formulation": "full"}, Limits(torque=6.9), False),
            ({"objective": "work", "keep": "ends"}, Limits(torque=6.9), True),
            ({"objective": "torque_squared"}, Limits(torque=6.9), False),
            ({"objective": "torque_squared"}, Limits(torque_rate=1.0), True),
        ],
    )
    def test_are_for_jumps_off_the_path(self, keys: dict[str, str], limits: Limits, expected: bool) -> None:
        formulation = Collocation(**keys).posed(paper_task(limits=limits))
        assert formulation is not None
        assert can_hold(formulation) is expected


class TestTightening:
    """Bounds node by node."""

    def test_holds_jumps_and_takes_off_elsewhere(self, jumping: tuple[Formulation, Attempt]) -> None:
        formulation, attempt = jumping
        tightening = tightened(formulation, attempt, None)
        held = np.isfinite(tightening.held).any(axis=0)
        np.testing.assert_array_equal(held, attempt.passes(JUMP))
        numbers = tightening.applied(formulation, attempt.numbers, 5)
        assert numbers.control is not None
        assert numbers.path is not None
        np.testing.assert_array_equal(numbers.control.lower[:, held], numbers.control.upper[:, held])
        assert np.isinf(numbers.control.lower[:, ~held]).all()
        np.testing.assert_allclose(numbers.path.upper[:4, held], 6.9 * (1 - LOOSE))
        assert (numbers.path.upper[:4, ~held] <= 6.9).all()

    def test_spreads_to_the_neighbours(self, jumping: tuple[Formulation, Attempt]) -> None:
        formulation, attempt = jumping
        before = np.zeros((4, len(attempt.edges) - 1))
        before[1, 8] = 8e-5
        free = Tightening(before, np.full((2, before.shape[1]), np.nan))
        taken = tightened(formulation, attempt, free).taken
        np.testing.assert_allclose(taken[1, 6:11], [2e-5, 4e-5, 8e-5, 4e-5, 2e-5])

    def test_is_the_same_on_a_doubled_mesh(self) -> None:
        taken, held = np.array([[0.0, 0.1]]), np.array([[np.nan, 3.0], [np.nan, np.nan]])
        doubled = Tightening(taken, held).doubled
        assert doubled.taken.tolist() == [[0.0, 0.0, 0.1, 0.1]]
        np.testing.assert_array_equal(doubled.held[0], [np.nan, np.nan, 3.0, 3.0])

    def test_leaves_something_of_every_limit_where_the_control_is_free(self) -> None:
        taken, held = np.array([[0.2, 1.3, 0.0]]), np.full((1, 3), np.nan)
        assert Tightening(np.minimum(taken, 0.99), held).is_possible
        assert not Tightening(taken, held).is_possible
        held[0, 1] = 0.5
        assert Tightening(taken, held).is_possible


@pytest.fixture(scope="module")
def chattering() -> tuple[Formulation, Attempt]:
    """Torque rates that jump off their limits in intervals in which torques are on theirs."""
    task = paper_task(3.0, limits=Limits(torque=1.1, torque_rate=20.0))
    player = Collocation(objective="work", keep="tube", radius=0.02, tolerance=1e-3)
    formulation = player.posed(task)
    assert formulation is not None
    search = Search(formulation, player.method)
    (attempt,) = search.starts(player.first_mesh(task), starts_of(task, 1, None)).values()
    return formulation, attempt


class TestStatesInLimits:
    """A control that is held is in some of the limits only: the torque is a state where its rate is the control."""

    def test_are_none_of_what_a_held_control_has_to_hold(self, chattering: tuple[Formulation, Attempt]) -> None:
        formulation, attempt = chattering
        assert attempt.arcs is not None
        on_limit = attempt.arcs.node_load[:4].reshape(4, len(attempt.edges) - 1, -1).max(axis=(0, 2)) > 1 - 1e-4
        jumps = attempt.arcs.hard_excess[4:8].max(axis=0) > JUMP
        assert (jumps & on_limit).sum() >= 4
        held = np.isfinite(tightened(formulation, attempt, None).held).any(axis=0)
        np.testing.assert_array_equal(held, jumps)

    def test_keep_their_bounds_where_the_control_is_held(self, chattering: tuple[Formulation, Attempt]) -> None:
        formulation, attempt = chattering
        tightening = tightened(formulation, attempt, None)
        held = np.isfinite(tightening.held).any(axis=0)
        path = tightening.applied(formulation, attempt.numbers, attempt.transcription.degree).path
        assert path is not None
        # Torques, torque rates, the tube.
        assert np.all(path.upper[:4] <= 1.1)
        np.testing.assert_allclose(path.upper[4:8][:, held], 20.0 * (1 - LOOSE))
        assert np.all(path.upper[8] <= 1.0)

    def test_of_a_first_hold_have_no_overshoot_to_take_off(self, chattering: tuple[Formulation, Attempt]) -> None:
        # The polynomial's overshoot is up to twice the limit; a constant control has none.
        formulation, attempt = chattering
        assert attempt.hard_excess > 1.0
        tightening = tightened(formulation, attempt, None)
        held = np.isfinite(tightening.held).any(axis=0)
        assert np.abs(tightening.held[:, held]).max() <= 20.0
        np.testing.assert_array_equal(tightening.taken[4:8][:, held], 0.0)
