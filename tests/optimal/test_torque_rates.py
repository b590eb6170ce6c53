"""The small cost of torque rates that settles what a cost without curvature leaves open."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from occ.errors import Status
from occ.optimal.collocation import Collocation
from occ.optimal.formulation import SETTLING, Formulation
from occ.optimal.search import Search
from occ.optimal.starts import law_rotation
from occ.optimal.transcription import Outcome, Transcription
from occ.referee import examine, judge
from occ.task import Limits
from tests.tasks import paper_task

RATE = 20.0
LIMITS = Limits(torque=1.1, torque_rate=RATE)
TUBE: dict[str, Any] = {"keep": "tube", "radius": 0.02, "tolerance": 1e-3}


def posed(limits: Limits = LIMITS, **keys: Any) -> Formulation:
    formulation = Collocation(**(TUBE | keys)).posed(paper_task(3.0, limits=limits))
    assert formulation is not None
    return formulation


@pytest.mark.parametrize("objective", ["work", "positive_work", "bus_work"])
def test_a_rate_on_its_limit_costs_a_part_of_the_tolerance_and_of_the_power_of_friction(objective: str) -> None:
    formulation = posed(objective=objective)
    # B's speed is 0.4 rad/s * 0.7 m; the mean over all headings of a translation, the copper loss's weight beside it.
    angle = np.linspace(0.0, 2 * np.pi, 360, endpoint=False)
    velocity = 0.28 * np.stack([np.cos(angle), np.sin(angle), np.zeros(360)])
    friction = np.array(formulation.task.dynamics.coefficients.friction)
    power = np.einsum("it,ij,jt->t", velocity, friction, velocity).mean()
    assert formulation.rate_damping * RATE**2 == pytest.approx(SETTLING * 1e-3 * power, rel=2e-2)
    # Half the tolerance: half the cost; and none of it where nobody says how exact the cost has to be.
    assert posed(objective=objective, tolerance=5e-4).rate_damping == pytest.approx(formulation.rate_damping / 2)
    assert replace(formulation, settings=replace(formulation.settings, tolerance=0.0)).rate_damping == 0.0


@pytest.mark.parametrize(
    ("keys", "limits"),
    [
        ({"objective": "work"}, Limits(torque=1.1)),
        ({"objective": "torque_squared"}, LIMITS),
        ({"objective": "electric"}, LIMITS),
        ({"objective": "peak_torque"}, LIMITS),
        ({"objective": "work", "keep": "path", "radius": None}, LIMITS),
        ({"objective": "work", "keep": "path", "radius": None, "formulation": "full"}, LIMITS),
    ],
)
def test_where_rates_are_settled_there_is_none(keys: dict[str, Any], limits: Limits) -> None:
    formulation = posed(limits, **keys)
    assert formulation.rate_damping == 0.0
    assert formulation.words_of_rates(None, np.zeros(1), None) == []  # type: ignore[arg-type]  # not looked at


def test_what_it_adds_is_in_the_integrand_and_in_words() -> None:
    # Rates of one on all wheels: the factor is what each costs per second.
    formulation = posed(objective="work")
    transcription = Transcription(formulation.problem(), 4, 3)
    edges = np.linspace(0.0, 3.0, 5)
    nodes = formulation.guess(transcription, edges, law_rotation(formulation.task))
    nodes.control[:] = 1.0
    data = formulation.data(edges, transcription.scheme.points)
    moments = (nodes.points, nodes.control, data)
    integrands = [
        transcription.evaluate(*(part.reshape(len(part), -1) for part in moments), each.parameters())[1]
        for each in (formulation, replace(formulation, settings=replace(formulation.settings, tolerance=0.0)))
    ]
    np.testing.assert_allclose(integrands[0] - integrands[1], 4 * formulation.rate_damping, rtol=1e-6)
    # Four wheels for three seconds, relative to max(1, |J|).
    for cost, unit in ((0.01, 1.0), (-500.0, 500.0)):
        outcome = Outcome(status=Status.OK, message="", cost=cost, nodes=nodes, statistics={})
        (words,) = formulation.words_of_rates(transcription, edges, outcome)
        share = 12 * formulation.rate_damping / unit
        assert (
            words
            == f"with a cost of squared torque rates, {share:.1g} of it, that settles what the objective leaves open"
        )


@pytest.mark.slow
def test_least_work_in_a_tube_under_limits_of_torques_and_their_rates() -> None:
    task = paper_task(3.0, limits=LIMITS)
    solution = Collocation(objective="work", **TUBE).solve(task)
    record = examine(task, solution).record
    assert record.status is Status.OK, record.message
    assert record.measures["limit_excess"] <= 1e-6
    assert "with a cost of squared torque rates" in solution.message
    # No less than without limits, to the tolerance of both.
    free = judge(paper_task(3.0), Collocation(objective="work", **TUBE).solve(paper_task(3.0)))
    work = record.measures["work_J"]
    assert free.measures["work_J"] * (1 - 2e-3) < work < free.measures["work_J"] * (1 + 2e-2)
    assert sum(each["iterations"] for each in solution.statistics["rounds"]) < 1500


def test_slacks_and_torque_rates_are_ordered_so_that_matrices_stay_sparse() -> None:
    """MUMPS' own ordering delays pivots there, until 512 intervals take 40 times as long."""
    for limits, objective, ordering in (
        (Limits(torque_rate=1.0), "bus_work", "minimum_degree"),
        (Limits(torque_rate=1.0), "torque_squared", "own"),
        (Limits(torque=1.0), "bus_work", "own"),
    ):
        player = Collocation(objective=objective)
        formulation = player.posed(paper_task(4.0, limits=limits))
        assert formulation is not None
        assert Search(formulation, player.method).method.options.ordering == ordering
