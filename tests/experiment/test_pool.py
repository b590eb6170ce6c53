"""Items in worker processes, which import this module: so it loads nothing else."""

from __future__ import annotations

import os

import pytest

from occ.experiment.pool import THREADS, Died, in_processes


def _work(item: int) -> tuple[int, str]:
    if item == 2:
        os._exit(3)
    if item == 4:
        raise ArithmeticError("four")
    return 2 * item, os.environ["OMP_NUM_THREADS"]


def test_worker_that_dies_costs_its_own_item_only() -> None:
    before = {name: os.environ.get(name) for name in THREADS}
    outcomes = dict(in_processes(_work, [0, 1, 2, 3], 2))
    assert outcomes == {0: (0, "1"), 1: (2, "1"), 2: Died(), 3: (6, "1")}
    assert {name: os.environ.get(name) for name in THREADS} == before


def test_error_of_a_worker_is_raised_here() -> None:
    with pytest.raises(ArithmeticError, match="four"):
        list(in_processes(_work, [4, 1], 2))
