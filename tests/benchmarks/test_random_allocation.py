"""The comparison of four ways of allocation on random wrenches: few samples, and what it says of wrong answers."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from occ.allocation.allocator import solve
from occ.allocation.result import Question, question
from tests.allocation.wrenches import youbot_map
from tests.benchmarks.random_allocation import (
    CLASSES,
    CRITERIA,
    KINDS,
    WAYS,
    compared,
    page,
    proven_answers,
    rows_of,
    vertices,
    write,
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_discrepancy_is_explained(kind: str) -> None:
    for part, name in enumerate(CRITERIA):
        for row in rows_of(name, kind, part, 120):
            assert row["closed_form_unproven"] == 0
            assert row["unexplained"] == row["outside"] == row["border"] == 0, row
            assert row["agree"] + sum(row[column] for column in CLASSES) == 120
            assert row["agree"] >= (120 if row["way"] == "vertices" else 80), row


def sampled(kind: str) -> Question:
    wrench, ranges, rates = KINDS[kind](youbot_map(), 60, 0)
    return question(youbot_map(), wrench, ranges, CRITERIA["least norm"], rates)


class TestKinds:
    """Samples are what their kind says."""

    def test_reach(self) -> None:
        assert solve(sampled("in reach")).reachable.all()
        out = solve(sampled("out of reach"))
        assert not out.reachable.any()
        assert 0 < out.excess.min() < 1e-4 < 1.0 < out.excess.max()

    def test_rates(self) -> None:
        standing = (sampled("zero rates").rates == 0).sum(axis=0)
        assert set(standing.tolist()) >= {1, 2, 3, 4}

    def test_grid(self) -> None:
        asked = sampled("grid")
        assert solve(asked).reachable.all()
        border = youbot_map().least_peak(asked.min_norm)
        assert (np.abs(border - 1) < 1e-12).mean() > 0.2


class TestWrongAnswers:
    """Each is counted as what it is."""

    @staticmethod
    def counted(kind: str, proven: bool = True, **wrong: np.ndarray) -> dict[str, int]:
        """The discrepancies of answers that are right but for what is given."""
        asked = sampled(kind)
        found = solve(asked)
        answer = vertices(asked)._replace(**wrong)
        counts = compared(asked, found, proven_answers(asked, found) & proven, answer)
        return {name: count for name, count in counts.items() if count and name in CLASSES}

    @pytest.mark.parametrize("kind", KINDS)
    def test_right_ones(self, kind: str) -> None:
        assert self.counted(kind) == {}

    def test_torques_of_another_criterion(self) -> None:
        asked = sampled("in reach")
        other = solve(dataclasses.replace(asked, criterion=CRITERIA["largest torque"])).torque
        assert self.counted("in reach", torque=other)["worse"] > 30

    def test_limits_that_are_passed(self) -> None:
        asked = sampled("in reach")
        beyond = int((asked.ranges.excess(asked.min_norm) > 1e-3).sum())
        assert beyond > 10
        assert self.counted("in reach", torque=asked.min_norm)["outside"] >= beyond

    def test_undecided(self) -> None:
        assert self.counted("in reach", unknown=np.ones(60, dtype=bool)) == {"undecided": 60}

    def test_what_has_no_explanation(self) -> None:
        all_of_them = {"unexplained": 60}
        assert self.counted("in reach", torque=np.zeros((4, 60))) == all_of_them
        assert self.counted("in reach", torque=np.full((4, 60), np.nan)) == all_of_them
        assert self.counted("out of reach", torque=np.zeros((4, 60))) == all_of_them
        assert self.counted("out of reach", excess=np.full(60, 1e3)) == all_of_them
        assert self.counted("in reach", proven=False) == all_of_them


def test_page_adds_up_the_rows(tmp_path: Path) -> None:
    head = {"criterion": "least norm", "kind": "grid", "samples": "10", "reachable": "10", "closed_form_unproven": "0"}
    rows = [
        head | {"part": str(part), "way": way, "agree": "9", "greatest_difference": f"{part + 1}e-9"} | none
        for none in [dict.fromkeys(CLASSES, "0") | {"undecided": "1"}]
        for part in range(3)
        for way in WAYS
    ]
    text = page(rows)
    assert "| least norm | grid | OSQP | 30 | 30 | 27 | 3.0e-09 | 3 | 0 | 0 | 0 | 0 |" in text
    assert text.startswith("# Random wrenches")
    assert "30 samples for the youBot" in text
    write(tmp_path / "a.csv", rows)
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]
    assert page(list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))) == text
