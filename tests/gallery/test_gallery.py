"""Published and closed-form answers, by the transcription that solves the platform's problems."""

from __future__ import annotations

import numpy as np
import pytest

from occ.errors import Status
from occ.optimal.attempt import Attempt, Grid, Method
from occ.optimal.elastic import smallest_relaxation
from occ.optimal.mesh import graded_mesh
from occ.optimal.refinement import Refinement
from occ.optimal.solvers import SolverOptions
from tests.gallery import problems as gallery
from tests.gallery.problems import Posed, at

SOLVERS = [SolverOptions(solver="ipopt"), SolverOptions(solver="fatrop")]
by_both_solvers = pytest.mark.parametrize("options", SOLVERS, ids=lambda options: options.solver)


def cost(posed: Posed, edges: np.ndarray, degree: int, scheme: str = "radau", **kwargs: SolverOptions) -> float:
    outcome = posed.solve(edges, degree, scheme, **kwargs)[2]
    assert outcome.status is Status.OK, outcome.message
    return outcome.cost


def refined(posed: Posed, grid: Grid, tolerance: float) -> tuple[Attempt, Refinement]:
    method = Method(degree=grid.degree, tolerance=tolerance, options=SolverOptions(), doubled=True)
    refinement = Refinement(posed.problem, posed, method)
    attempt, reason = refinement.solve(grid, posed.guess)
    assert not reason
    assert attempt.error is not None
    assert attempt.error.total <= tolerance
    assert attempt.doubled <= tolerance
    return attempt, refinement


@by_both_solvers
@pytest.mark.parametrize("scheme", ["radau", "legendre"])
class TestClosedForms:
    """Both solvers, both schemes."""

    def test_least_effort_of_a_double_integrator(self, scheme: str, options: SolverOptions) -> None:
        transcription, _, outcome = gallery.double_integrator().solve(np.linspace(0, 1, 4), 3, scheme, options)
        assert outcome.cost == pytest.approx(12.0, rel=1e-10)
        s = np.linspace(0, 1, 9)
        t = (np.arange(3)[:, None] + s) / 3
        state, _, _ = transcription.interpolate(outcome.nodes, s)
        np.testing.assert_allclose(state[0], 3 * t**2 - 2 * t**3, atol=1e-9)

    def test_brachistochrone(self, scheme: str, options: SolverOptions) -> None:
        posed = gallery.brachistochrone()
        exact = gallery.brachistochrone_time()
        assert exact == pytest.approx(0.8243386694, abs=1e-10)
        assert cost(posed, posed.mesh(8), 5, scheme, options=options) == pytest.approx(exact, rel=1e-10)

    def test_hypersensitive(self, scheme: str, options: SolverOptions) -> None:
        posed = gallery.hypersensitive()
        found = cost(posed, 40 * graded_mesh(24, 0.004), 6, scheme, options=options)
        assert found == pytest.approx(gallery.hypersensitive_cost(), rel=1e-9)


class TestBounds:
    """Constraints of states and controls."""

    @pytest.mark.parametrize("limit", [1 / 9, 1 / 7])
    def test_bryson_denham(self, limit: float) -> None:
        posed = gallery.bryson_denham(limit)
        transcription, _, outcome = posed.solve(posed.mesh(6), 3)
        assert outcome.cost == pytest.approx(4 / (9 * limit), rel=1e-8)
        # Between the nodes, too: the touching arcs are cubics.
        state, _, control = transcription.interpolate(outcome.nodes, np.linspace(0, 1, 50))
        assert state[0].max() <= limit * (1 + 1e-6)
        t = posed.mesh(6)[:-1, None] + np.diff(posed.mesh(6))[:, None] * np.linspace(0, 1, 50)
        expected = -2 / (3 * limit) * np.maximum(np.maximum(1 - t / (3 * limit), 1 - (1 - t) / (3 * limit)), 0)
        np.testing.assert_allclose(control[0], expected, atol=1e-4)

    @by_both_solvers
    def test_least_time_of_a_double_integrator(self, options: SolverOptions) -> None:
        posed = gallery.bang_bang(distance=2.0, limit=0.5)
        transcription, _, outcome = posed.solve(posed.mesh(4), 3, options=options)
        assert outcome.cost == pytest.approx(2 * np.sqrt(2.0 / 0.5), rel=1e-6)
        control = outcome.nodes.control[0]
        np.testing.assert_allclose(control, np.repeat([[0.5], [0.5], [-0.5], [-0.5]], 3, axis=1), atol=1e-4)
        assert transcription.options.solver == options.solver

    def test_van_der_pol(self) -> None:
        attempt, _ = refined(gallery.van_der_pol(), Grid(edges=np.linspace(0, 5, 7), degree=4), 1e-7)
        # The PROPT manual's value comes from one polynomial of degree 60 over both corners of the control.
        assert attempt.outcome.cost == pytest.approx(2.86725953808, rel=1e-6)
        assert attempt.outcome.cost == pytest.approx(van_der_pol_by_the_maximum_principle(), rel=1e-7)


def van_der_pol_by_the_maximum_principle() -> float:
    """u = clip(-p_1 / 2, -0.3, 1), p' = -dH/dx, p(5) = 0: shooting with SciPy's integrator."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import root

    def rate(t: float, y: np.ndarray) -> list[float]:
        x, z, p, q, _ = y
        u = min(max(-p / 2, -0.3), 1.0)
        return [
            (1 - z**2) * x - z + u,
            x,
            -(2 * x + p * (1 - z**2) + q),
            -(2 * z - p * (2 * z * x + 1)),
            x**2 + z**2 + u**2,
        ]

    def end(costate: np.ndarray) -> np.ndarray:
        found = solve_ivp(rate, (0, 5), [0, 1, *costate, 0], method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.05)
        return np.asarray(found.y[:, -1])

    found = root(lambda costate: end(costate)[2:4], [0.5, 4.0], tol=1e-10)
    assert found.success, found.message
    return float(end(found.x)[4])


class TestSingularArc:
    """Catalyst mixing: bang, singular, bang."""

    def test_cost_and_singular_control(self) -> None:
        exact, (first, second, level) = gallery.catalyst_arcs()
        assert exact == pytest.approx(-0.048055, abs=1e-6)
        posed = gallery.catalyst_mixing([first, second])
        transcription, _, outcome = posed.solve(posed.mesh(12), 4)
        assert outcome.cost == pytest.approx(exact, rel=1e-6)
        _, _, control = transcription.interpolate(outcome.nodes, np.linspace(0.1, 0.9, 9))
        np.testing.assert_allclose(control[0, 4:8], level, atol=2e-3)
        np.testing.assert_allclose(control[0, :4], 1.0, atol=1e-3)
        np.testing.assert_allclose(control[0, 8:], 0.0, atol=1e-3)


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize(("scheme", "shift"), [("radau", -1), ("legendre", 0)])
class TestOrders:
    """Order 2 d - 1 (Radau IIA) and 2 d (Gauss) of the cost on smooth problems, down to the rounding floor."""

    def test_brachistochrone(self, scheme: str, shift: int, degree: int) -> None:
        posed, exact = gallery.brachistochrone(), gallery.brachistochrone_time()
        assert order(posed, exact, [4, 8, 16, 32], degree, scheme) == pytest.approx(2 * degree + shift, abs=0.45)

    def test_hypersensitive_over_a_short_horizon(self, scheme: str, shift: int, degree: int) -> None:
        posed = gallery.hypersensitive(horizon=4.0)
        reference = cost(posed, posed.mesh(32), 8, scheme)
        found = order(posed, reference, [12, 24, 48, 96] if degree == 2 else [8, 16, 32, 64], degree, scheme)
        assert found == pytest.approx(2 * degree + shift, abs=0.45)


def order(posed: Posed, exact: float, counts: list[int], degree: int, scheme: str) -> float:
    errors = np.array([abs(cost(posed, posed.mesh(n), degree, scheme) - exact) for n in counts])
    above = errors > 3e-12 * abs(exact)
    assert above.sum() >= 2, errors
    # The finest meshes above the floor: where the order shows.
    kept = np.flatnonzero(above)[-2:]
    return float(-np.diff(np.log(errors[kept]))[0] / np.diff(np.log(np.array(counts)[kept]))[0])


class TestRefinement:
    """From six intervals to the tolerance that was asked for."""

    @pytest.mark.parametrize("tolerance", [1e-5, 1e-8])
    def test_a_smooth_problem_is_given_a_higher_degree(self, tolerance: float) -> None:
        posed, exact = gallery.brachistochrone(), gallery.brachistochrone_time()
        attempt, refinement = refined(posed, Grid(edges=posed.mesh(6), degree=3), tolerance)
        assert abs(attempt.outcome.cost - exact) <= tolerance
        assert refinement.rounds[-1]["degree"] > 3

    def test_boundary_layers_are_given_intervals(self) -> None:
        posed = gallery.hypersensitive(horizon=1e4)
        attempt, _ = refined(posed, Grid(edges=posed.mesh(6), degree=4), 1e-6)
        assert attempt.outcome.cost == pytest.approx(gallery.hypersensitive_cost(), rel=1e-6)
        widths = np.diff(attempt.edges)
        assert widths[[0, -1]].max() < 1e-3 * widths.max()
        # No degree makes up for intervals that are too long for a layer.
        assert attempt.grid.degree <= 6

    def test_a_tolerance_that_is_not_reached_is_said(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("occ.optimal.refinement.MOST_INTERVALS", 100)
        posed = gallery.catalyst_mixing()
        grid = Grid(edges=posed.mesh(4), degree=6)
        method = Method(degree=6, tolerance=1e-13, options=SolverOptions())
        _, reason = Refinement(posed.problem, posed, method).solve(grid, posed.guess)
        assert "error between nodes is still" in reason

    def test_all_solves_together_have_a_time(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("occ.optimal.refinement.TOGETHER", 0.0)
        posed = gallery.catalyst_mixing()
        method = Method(degree=6, tolerance=1e-13, options=SolverOptions())
        refinement = Refinement(posed.problem, posed, method)
        _, reason = refinement.solve(Grid(edges=posed.mesh(4), degree=6), posed.guess)
        assert len(refinement.rounds) == 1
        assert "the error between nodes is still" in reason
        assert "all solves together used their time, 0 s" in reason


class TestInfeasible:
    """The smallest relaxation, against its closed form."""

    def test_bryson_denham_below_what_its_start_can_turn_around_in(self) -> None:
        # |u| <= a from (0, 1): the least height is 1 / (2 a), here 1/8 at t = 1/4; the limit 1/10 has to give way by
        # e = 1/4 if only it may.
        posed = gallery.bryson_denham(0.1)
        bounded = Posed(
            posed.problem, 1.0, posed.start, posed.end, posed.first, posed.last, posed.held,
            control=gallery.between([-4.0], [4.0]), path=posed.path,
        )  # fmt: skip
        edges = np.linspace(0, 1, 17)
        transcription, numbers, outcome = bounded.solve(edges, 3)
        assert outcome.status is Status.INFEASIBLE
        relaxation = smallest_relaxation(
            transcription, numbers, bounded.guess(transcription, edges), rows=np.array([0])
        )
        assert relaxation is not None
        assert relaxation.part == pytest.approx(0.25, rel=1e-5)
        worst = relaxation.violations[0]
        assert (worst.row.name, worst.row.unit) == ("position", "m")
        assert worst.value == pytest.approx(0.125, rel=1e-5)
        assert worst.time == pytest.approx(0.25, abs=0.02)
        assert "position needs 0.125 m at t = 0.25 s; limit 0.1" in relaxation.words()

    def test_an_end_out_of_reach(self) -> None:
        # x' = u over unit time: from 0 to 2 with u as it is, when |x| <= 1 everywhere: no bound but the end's.
        posed = gallery.double_integrator()
        impossible = Posed(
            posed.problem, 1.0, posed.start, at(1, 0), posed.first, posed.last, posed.held,
            control=gallery.between([-3.0], [3.0]),
        )  # fmt: skip
        transcription, numbers, outcome = impossible.solve(np.linspace(0, 1, 9), 3)
        assert outcome.status is Status.INFEASIBLE
        relaxation = smallest_relaxation(transcription, numbers, impossible.guess(transcription, numbers.edges))
        assert relaxation is not None
        # |u| = 4 is what rest to rest over unit distance in unit time takes: bang-bang.
        assert relaxation.part == pytest.approx(1 / 3, rel=1e-5)
