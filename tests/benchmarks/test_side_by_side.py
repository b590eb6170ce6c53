"""What the comparison rests on: the same equations for everybody, and a page that says what the run says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.benchmarks import side_by_side
from tests.benchmarks.peers.model import evaluate
from tests.benchmarks.printed import report


@pytest.mark.parametrize("case", side_by_side.CASES, ids=lambda case: case.name[:2])
def test_other_packages_get_the_same_equations(case: side_by_side.Case) -> None:
    formulation = side_by_side.posed(case.task)
    problem, model = formulation.problem(), side_by_side.exported(case.task)
    rng = np.random.default_rng(0)
    for t in rng.uniform(0, case.task.duration, 3):
        x, u = rng.normal(size=2), rng.normal(size=problem.control.numel())
        data = formulation.data(np.array([t, t + 1.0]), np.zeros(1))[:, 0, 0]
        expected = problem.node_function(x, u, data, formulation.parameters())
        for found, truth in zip(evaluate(model, math, [t], x, u), expected, strict=True):
            np.testing.assert_allclose(found, np.array(truth)[:, 0], rtol=1e-12, atol=1e-12)


def row(package: str, milliseconds: float, error: float, excess: float = 0.0) -> dict[str, object]:
    setting = {"intervals": 8, "degree": 5, "solver": "fatrop", "solves": 1}
    seconds = [milliseconds / 1e3] * 3
    keys = ("seconds", "call_seconds", "whole_seconds", "resolve_seconds")
    times = {key: [(2 if key == "call_seconds" else 1) * s for s in seconds] for key in keys}
    return {"package": package, "version": "1", "setting": setting, "error": error, "excess": excess} | times


def page(rows: list[dict[str, object]]) -> str:
    case = {"name": "P0", "optimum": 1.0, "accuracy": 1e-6, "peers_accuracy": 1e-5, "target": 0.05, "rows": rows}
    growth = {"ipopt": [{"intervals": n, "build_s": n, "solve_s": n, "memory_MB": 1, "status": "ok"} for n in (1, 4)]}
    about = {"machine": {"processor": "x", "python": "3"}, "versions": {"casadi": "3"}, "repeats": 3, "finalists": 3}
    return report(about | {"cases": [case], "growth": growth})


def test_the_fastest_that_is_good_enough_is_compared() -> None:
    # Faster rows do not count where the error is too large or the limit is passed.
    rows = [row("occ", 2.0, 1e-7), row("occ", 1.0, 1e-3), row("a", 50.0, 1e-6), row("a", 5.0, 1e-6, excess=1e-3)]
    text = page([*rows, row("b", 30.0, 1e-4)])
    assert "one 25.0th of the time of the best of the others (a), its call one 25.0th of the other's" in text
    assert "one 12.5th of the other's solver alone" in text
    assert "target of one 20th is met" in text
    assert "b does not reach it; its least error is 1.0e-04" in text
    assert "target of one 20th is missed" in page([row("occ", 2.0, 1e-7), row("a", 39.0, 1e-6)])
    assert "4 times the intervals the build takes 4 times" in text


def test_a_package_that_fails_is_a_row() -> None:
    failed = {"package": "a", "version": "1", "setting": {"intervals": 8}, "failure": "no way"}
    assert "| a | 8 intervals | failed: no way |" in page([row("occ", 1.0, 0.0), failed])


def test_the_fastest_of_each_way_is_compiled() -> None:
    ways = (("collocation", "ipopt", 6.0), ("shooting", "fatrop", 9.0), ("collocation", "ipopt", 5.0))
    rows = [
        row("a", ms, 1e-6) | {"setting": {"method": method, "solver": solver, "intervals": round(ms)}}
        for method, solver, ms in ways
    ]
    free, limited = (side_by_side.compiled_settings(case, rows, ("-O1", "-O2")) for case in side_by_side.CASES)
    assert [(setting["intervals"], setting["flags"]) for setting in free] == [
        *((5, "-O1"), (5, "-O2"), (9, "-O1"), (9, "-O2"))
    ]
    # The code of shooting with a limit takes too long.
    assert [(setting["intervals"], setting["flags"]) for setting in limited] == [(5, "-O1"), (5, "-O2")]
    # Not every package has ways, or can compile.
    unnamed = [row("b", 1.0, 1e-6) | {"setting": {"intervals": 8}}]
    assert all(side_by_side.compiled_settings(case, unnamed, ()) == [] for case in side_by_side.CASES)
    assert "compiled -O2" in page([row("occ", 1.0, 0.0), rows[2] | {"setting": limited[1]}])
