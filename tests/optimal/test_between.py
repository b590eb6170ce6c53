"""Largest values between the nodes: proven for polynomials, estimated for what is near one, and held by the optimum."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.errors import Status
from occ.optimal import search
from occ.optimal.between import DEGREE, GRID, chebyshev_places, largest_of_polynomial, largest_values
from occ.optimal.collocation import Collocation
from occ.referee import examine, judge
from occ.referee.judge import Tolerances
from occ.task import Limits, Task
from tests.tasks import paper_task


def polynomial(coefficients: list[float]) -> np.polynomial.Chebyshev:
    return np.polynomial.Chebyshev(coefficients, domain=[0, 1])


def exact_largest(p: np.polynomial.Chebyshev) -> float:
    """From the roots of the derivative."""
    roots = p.deriv().roots()
    inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > 0) & (roots.real < 1)]
    return float(p(np.concatenate([[0.0, 1.0], inside])).max())


class TestPolynomials:
    """The bound is one, and tight."""

    @given(st.lists(st.integers(-1000, 1000), min_size=1, max_size=DEGREE - 3))
    def test_the_bound_is_proven_and_as_tight_as_it_says(self, thousandths: list[int]) -> None:
        coefficients = [k / 1000 for k in thousandths]
        p = polynomial(coefficients).trim()
        bound, rest = largest_of_polynomial(p(chebyshev_places()))
        gap = np.arange(len(coefficients)) ** 3 @ np.abs(coefficients) * (np.pi / GRID) ** 3 / 48
        assert exact_largest(p) - 1e-12 <= bound <= exact_largest(p) + 2 * gap + 1e-12
        # The last coefficients are zero: the polynomial is the quantity.
        assert rest < 1e-12 * (1 + np.abs(coefficients).sum())

    def test_a_peak_between_samples_is_seen(self) -> None:
        # 1.0025 at s = 0.083, half way between two of 25 Chebyshev samples, which all stay below 1.
        at = (chebyshev_places(24)[4] + chebyshev_places(24)[5]) / 2
        p = np.polynomial.Polynomial([1.0025 - 8.0 * at**2, 16.0 * at, -8.0])
        assert p(chebyshev_places(24)).max() < 1.0
        bound, _ = largest_of_polynomial(p(chebyshev_places()))
        assert 1.0025 - 1e-12 <= bound <= 1.0025 + 1e-6


class TestQuantities:
    """What is no polynomial is looked at in shorter and shorter panels."""

    @pytest.mark.parametrize("waves", [0.3, 3.0, 20.0, 60.0])
    def test_of_a_wave(self, waves: float) -> None:
        def sample(s: np.ndarray) -> np.ndarray:
            return 1.02 * np.cos(waves * (s - 0.123))[None, None]

        found = largest_values(sample, sample(chebyshev_places()))
        assert 1.02 - 1e-12 <= found[0, 0] <= 1.02 + 5e-6

    def test_of_both_signs(self) -> None:
        values = np.stack([sign * (1.1 - (chebyshev_places() - 0.37) ** 2) for sign in (1.0, -1.0)])[:, None]
        found = largest_values(lambda s: np.zeros((2, 1, len(s))), values)
        assert found[0, 0] == found[1, 0] == pytest.approx(1.1, abs=1e-7)

    def test_what_cannot_be_resolved_is_bounded_from_above(self) -> None:
        # A kink: the distance from every polynomial is part of the bound.
        def sample(s: np.ndarray) -> np.ndarray:
            return 1.0 + 1e-3 - np.abs(s - 1 / np.pi)[None, None]

        found = largest_values(sample, sample(chebyshev_places()))
        assert 1.0 + 1e-3 <= found[0, 0] <= 1.0 + 5e-3


def lap(rate: float, radius: float, limit: float) -> Task:
    return paper_task(2 * np.pi / abs(rate), rate=rate, radius=radius, limits=Limits(torque=limit))


class TestOptimum:
    """Limits are held between the nodes of any mesh."""

    @pytest.mark.parametrize("intervals", [4, 6])
    @pytest.mark.parametrize("limits", [Limits(torque=1.1), Limits(wheel_speed=7.75)])
    def test_on_coarse_meshes_with_a_coarse_tolerance(self, intervals: int, limits: Limits) -> None:
        task = paper_task(limits=limits)
        player = Collocation(objective="torque_squared", intervals=intervals, degree=4, tolerance=3e-3, starts=1)
        solution = player.solve(task)
        assert solution.status is Status.OK, solution.message
        # The polynomials are millimetres away from the motion of their control, which holds the limits all the same.
        verdict = examine(task, solution, Tolerances(replay=0.01))
        assert verdict.record.status is Status.OK, verdict.record.message
        assert verdict.record.measures["replay_error_m"] > 1e-5
        assert verdict.record.measures["limit_excess"] <= 1e-6
        assert verdict.replay is not None
        fine = verdict.replay.sample(np.linspace(0.0, task.duration, 50_001))
        for values, limit in ((fine.torque, limits.torque), (fine.wheel_rates, limits.wheel_speed)):
            assert limit is None or np.abs(values).max() <= limit * (1 + 1e-6)

    # Circles of the comparison atlas on which the control jumps inside of an interval, wherever an edge is put.
    @pytest.mark.parametrize(("rate", "radius"), [(-0.7, 0.45), (0.2, 0.4), (0.8, 0.1)])
    def test_min_work_with_the_motors_torque(self, rate: float, radius: float) -> None:
        limited, free = lap(rate, radius, 6.9), lap(rate, radius, 1e3)
        # From the law alone: its minimum has small jumps on all of these circles; those of others may last for 40 ms.
        player = Collocation(objective="work", starts=1)
        record, other = (judge(task, player.solve(task)) for task in (limited, free))
        assert record.status is Status.OK, record.message
        assert record.measures["limit_excess"] <= 1e-6
        # The limit makes the jumps take some milliseconds, which costs little.
        work = record.measures["work_J"]
        assert other.measures["work_J"] * (1 - 1e-6) < work < other.measures["work_J"] * (1 + 1e-4)
        assert 0.5 * 6.9 < record.measures["peak_torque_Nm"] < other.measures["peak_torque_Nm"]

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("rate", "radius"), [(-1, 1.05), (-0.8, 0.55), (-0.4, 0.35), (-0.1, 0.7), (0.1, 1.05), (0.3, 1.05), (0.7, 0.85)]
    )
    def test_min_work_with_the_motors_torque_on_more_circles(self, rate: float, radius: float) -> None:
        self.test_min_work_with_the_motors_torque(rate, radius)

    def test_what_it_costs_is_in_the_row(self) -> None:
        solution = Collocation(objective="work").solve(lap(0.2, 0.4, 6.9))
        cost = solution.statistics["limits_cost"]
        assert 0.0 < cost <= 1e-7
        assert f"holding the limits between nodes costs {cost:.1g} of it" in solution.message

    def test_where_it_would_cost_too_much_the_mesh_is_refined(self) -> None:
        # On the first mesh with a small enough error it would cost 2e-7 here.
        solution = Collocation(objective="work").solve(lap(0.8, 0.1, 6.9))
        assert abs(solution.statistics["limits_cost"]) <= 1e-7

    def test_a_limit_that_is_not_held_is_said_with_a_number(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(search, "BACKOFFS", 0)
        monkeypatch.setattr("occ.optimal.refinement.MOST_INTERVALS", 40)
        solution = Collocation(objective="work").solve(lap(-0.7, 0.45, 6.9))
        assert solution.status is Status.FAILED
        assert "a limit is still passed by" in solution.message
        assert "passed by 0 " not in solution.message
