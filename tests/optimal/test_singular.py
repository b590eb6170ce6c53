"""Bang and singular arcs of least work by the switching function, and the words for them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import nnls

from occ.errors import Status
from occ.optimal.attempt import Attempt
from occ.optimal.collocation import Collocation
from occ.optimal.formulation import Formulation
from occ.optimal.problem import flat
from occ.optimal.search import Search
from occ.optimal.singular import HELD, ON_LIMIT, arcs_of, note, switching_of
from occ.optimal.starts import starts_of
from occ.task import Limits, Task
from tests.tasks import LAP, paper_task


def solved(task: Task, player: Collocation) -> tuple[Formulation, Attempt]:
    formulation = player.posed(task)
    assert formulation is not None
    search = Search(formulation, player.method)
    (start,) = starts_of(task, 1, None, free=False)
    attempt, reason = search.run(search.starts(player.first_mesh(task), [start])[start.name])
    assert attempt.outcome.status is Status.OK, reason
    return formulation, attempt


@pytest.fixture(scope="module", params=["ipopt", pytest.param("fatrop", marks=pytest.mark.slow)])
def limited(request: pytest.FixtureRequest) -> tuple[Formulation, Attempt]:
    return solved(paper_task(limits=Limits(torque=2.1)), Collocation(objective="work", solver=request.param))


def test_least_work_is_bang_singular_bang(limited: tuple[Formulation, Attempt]) -> None:
    formulation, attempt = limited
    found = switching_of(formulation, attempt)
    assert found is not None
    first, middle, last = arcs_of(formulation, attempt, found)
    assert first.limits
    assert not middle.limits
    assert last.limits
    assert (first.start, first.end, last.start, last.end) == (0.0, middle.start, middle.end, pytest.approx(LAP))
    # The jumps of the unlimited problem, in milliseconds; over the rest phi is zero to the solver's tolerance.
    assert first.end < 0.02
    assert last.start > LAP - 0.02
    size = found.size.max(axis=1)
    inside = (attempt.edges[:-1] >= middle.start) & (attempt.edges[1:] <= middle.end)
    assert size[inside].max() < 1e-4 * size.max()
    assert found.kelley_holds(inside) is True
    words = note(formulation, attempt)
    assert f"bang on 0 .. {first.end:.6g} s" in words
    assert f"singular on {middle.start:.6g} .. {middle.end:.6g} s, where Kelley's condition holds" in words
    assert "wheel 3 torque, wheel 4 torque" in words
    # The rest of the sentence is the same where the arcs are not asked for.
    assert words.startswith(f"{note(formulation, attempt, by_switching=False)}; by its switching function")


def test_kelleys_expression_is_the_curvature_of_the_dissipation(limited: tuple[Formulation, Attempt]) -> None:
    # phi = p_Omega, phi'' = .. - 2 D_2 u with D = D_0 + D_1 Omega + D_2 Omega^2 (mathematics, section 4).
    formulation, attempt = limited
    found = switching_of(formulation, attempt)
    assert found is not None
    b_x, b_y = formulation.task.point
    friction = np.array(formulation.task.dynamics.coefficients.friction)
    direction = np.array([b_y, -b_x, 1.0])
    np.testing.assert_allclose(found.kelley[0], 2 * direction @ friction @ direction, rtol=1e-9)


def test_the_sign_agrees_with_the_active_limits(limited: tuple[Formulation, Attempt]) -> None:
    formulation, attempt = limited
    found = switching_of(formulation, attempt)
    assert found is not None
    assert attempt.arcs is not None
    arcs = arcs_of(formulation, attempt, found)
    problem, nodes = formulation.problem(), attempt.outcome.nodes
    arguments = [problem.state, problem.control, problem.data, problem.parameters]
    slopes = ca.Function("slopes", arguments, [problem.path, ca.jacobian(problem.path, problem.control)])
    state, control, data = flat(nodes.points), flat(nodes.control), flat(attempt.numbers.data)
    phi = found.values.reshape(len(control), -1)
    seen, bounds = 0, attempt.numbers.control
    held = np.zeros(phi.shape[1], dtype=bool)
    if bounds is not None and bounds.lower.ndim > 1:
        held = (bounds.lower == bounds.upper).any(axis=0).ravel()
    for k in np.flatnonzero(found.size.ravel() > 1e-2 * found.size.max()):
        interval = k // attempt.transcription.degree
        arc = next(arc for arc in arcs if arc.start <= attempt.edges[interval] < arc.end)
        assert arc.limits
        path, slope = map(np.array, slopes(state[:, k], control[:, k], data[:, k], formulation.parameters()))
        active = np.abs(path[:, 0]) > 2.1 * (1 - ON_LIMIT)
        if held[k]:
            # There the multiplier belongs to the control itself.
            assert HELD in arc.limits
            continue
        assert active.any()
        # phi = -sum of nu_i dh_i/du with multipliers nu_i >= 0 of h_i <= limit and -h_i <= limit.
        outward = (np.sign(path) * slope)[active]
        _, residual = nnls(-outward.T, phi[:, k])
        assert residual < 1e-4 * np.abs(phi[:, k]).max()
        seen += 1
    assert seen >= 3


@pytest.mark.parametrize(
    ("limits", "formulation"),
    [
        (Limits(), "reduced"),
        pytest.param(Limits(), "full", marks=pytest.mark.slow),
        pytest.param(Limits(wheel_speed=7.9), "reduced", marks=pytest.mark.slow),
    ],
)
def test_without_a_limit_that_holds_the_control_all_is_singular(limits: Limits, formulation: str) -> None:
    # A limit of the state bends the singular arc, and phi vanishes on it all the same.
    player = Collocation(objective="work", formulation=formulation)  # type: ignore[arg-type]  # by parameter
    words = player.solve(paper_task(limits=limits)).message
    assert "no limit holds the control, and its switching function vanishes throughout" in words
    assert "the control in them grows with the mesh" in words
