"""Which mesh comes next: layers are cut again and again in one go, and cases of a sweep share their programs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.errors import Status
from occ.optimal.attempt import Attempt
from occ.optimal.collocation import Collocation
from occ.optimal.error import ErrorEstimate
from occ.optimal.refinement import GAIN, Refinement, refine
from occ.optimal.search import quartered
from occ.task import Limits
from tests.tasks import paper_task


def estimate(each: np.ndarray) -> ErrorEstimate:
    return ErrorEstimate(state=each, cost=np.zeros_like(each))


@given(st.lists(st.floats(1e-12, 1.0), min_size=2, max_size=40), st.integers(0, 2**32 - 1))
def test_a_finer_mesh_keeps_all_edges_and_grows_by_eights_up_to_twice(each: list[float], seed: int) -> None:
    edges = np.cumsum(np.random.default_rng(seed).uniform(0.1, 1.0, len(each) + 1))
    finer = refine(edges, estimate(np.array(each)), 1e-3 * sum(each))
    count = len(finer) - 1
    assert np.isin(edges, finer).all()
    assert (np.diff(finer) > 0).all()
    assert len(each) < count <= 2 * len(each)
    assert count % 8 == 0 or count == 2 * len(each)


def test_a_layer_is_cut_until_what_is_left_meets_the_tolerance() -> None:
    edges, each = np.linspace(0.0, 1.0, 17), np.full(16, 1e-8)
    each[-1] = 1e-2
    finer = refine(edges, estimate(each), 1e-4)
    # Half the tolerance is between 1e-2 times GAIN and 1e-2 times GAIN^2: two generations, no thinner layer, and the
    # rest of the eight among the whole ones.
    assert 1e-2 * GAIN > 5e-5 > 1e-2 * GAIN**2
    assert len(finer) - 1 == 24
    assert np.diff(finer).min() == np.diff(finer)[-1] == 1 / 64
    assert np.isin(edges, finer).all()


def test_an_error_that_is_everywhere_is_met_by_halves() -> None:
    edges = np.linspace(0.0, 1.0, 17)
    np.testing.assert_allclose(refine(edges, estimate(np.full(16, 1.0)), 1e-6), np.linspace(0.0, 1.0, 33), atol=1e-15)


@pytest.mark.parametrize("marked", [[0], [3, 9], list(range(16))])
def test_intervals_cut_in_four_are_filled_up_to_eights(marked: list[int]) -> None:
    edges = np.linspace(0.0, 1.0, 17) ** 2
    finer = quartered(edges, np.isin(np.arange(16), marked))
    assert np.isin(edges, finer).all()
    assert (len(finer) - 1) % 8 == 0
    for k in marked:
        assert ((finer > edges[k]) & (finer < edges[k + 1])).sum() >= 3
    # The widest of the others are halved.
    whole = [k for k in range(16) if not ((finer > edges[k]) & (finer < edges[k + 1])).any()]
    cut = [k for k in range(16) if k not in whole and k not in marked]
    assert max(np.diff(edges)[whole], default=0.0) <= min(np.diff(edges)[cut], default=np.inf)


def test_the_doubled_mesh_is_looked_at_only_where_it_changes_the_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[int] = []
    look = Refinement.looked_at
    monkeypatch.setattr(
        Refinement, "looked_at", lambda self, attempt: looked.append(attempt.grid.intervals) or look(self, attempt)
    )
    player = Collocation(objective="torque_squared", intervals=8, tolerance=1e-4, starts=1)
    solution = player.solve(paper_task())
    assert solution.status is Status.OK
    assert [entry["intervals"] for entry in solution.statistics["rounds"]] == [8, 16]
    assert looked == [8]


def test_a_doubled_mesh_without_a_solution_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    twice = Refinement.on_doubled_mesh

    def lost(self: Refinement, attempt: Attempt) -> Attempt:
        found = twice(self, attempt)
        return replace(found, outcome=replace(found.outcome, status=Status.FAILED))

    monkeypatch.setattr(Refinement, "on_doubled_mesh", lost)
    solution = Collocation(objective="torque_squared", tolerance=1e-4, starts=1).solve(paper_task(2.0))
    assert solution.status is Status.OK
    assert "not confirmed by twice as many" in solution.message
    assert solution.statistics["doubled_mesh"] is None


def test_short_excesses_over_limits_cost_no_mesh_where_the_cost_has_no_curvature() -> None:
    task = paper_task(limits=Limits(torque=6.9))
    solution = Collocation(objective="work", tolerance=1e-5, solver="fatrop", starts=1).solve(task)
    assert solution.status is Status.OK
    rounds = solution.statistics["rounds"]
    assert rounds[0]["excess"] > 1e-2
    assert solution.statistics["limits_cost"] < 1e-6
    # The first mesh, the same with tighter limits, and twice as many intervals; none with knots where the jumps end.
    assert [entry["intervals"] for entry in rounds] == [16, 16, 32]
