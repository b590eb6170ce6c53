"""How far a run has come: counts, failures, rate and time left; lines now and then where nobody watches."""

from __future__ import annotations

import io

import pytest

from occ import progress as module
from occ.progress import Progress, progress_of


def test_rate_and_time_left_do_not_count_what_was_stored() -> None:
    clock = iter([0.0, *[10.0] * 20])
    told: list[str] = []
    state = Progress(400, lambda state, what: told.append(what), now=lambda: next(clock))
    state("a", 200, stored=True)
    state("b", 20, failed=3)
    assert (state.done, state.failed, state.rate) == (220, 3, 2.0)
    assert state.remaining == 90.0
    assert state.text() == "220 of 400 rows, 3 not ok, 2 a second, 90 s left"
    assert told == ["a", "b"]


def test_nothing_is_known_before_the_first_row() -> None:
    state = Progress(10, lambda *_: None, now=lambda: 0.0)
    assert state.remaining is None
    assert state.text() == "0 of 10 rows, 0 not ok, 0 a second"


@pytest.mark.parametrize(("left", "text"), [(99, "99 s"), (600, "10 min"), (36000, "10.0 h")])
def test_long_times_are_told_in_minutes_and_hours(left: int, text: str) -> None:
    clock = iter([0.0, *[1.0] * 20])
    state = Progress(left + 1, lambda *_: None, now=lambda: next(clock))
    state("a", 1)
    assert state.text().endswith(f", {text} left")


def test_what_is_quick_is_quiet_and_what_is_slow_has_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    with progress_of(3, out) as progress:
        progress("a", 1)
    assert out.getvalue() == ""
    monkeypatch.setattr(module, "EVERY", 0.0)
    with progress_of(3, out) as progress:
        progress("a", 1)
        progress("b", 1, 1)
    first, second = out.getvalue().splitlines()
    assert first.startswith("1 of 3 rows, 0 not ok")
    assert second.startswith("2 of 3 rows, 1 not ok")
    assert "\x1b" not in out.getvalue()


def test_a_terminal_has_a_bar() -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    out = Terminal()
    with progress_of(3, out) as progress:
        progress("a case", 1)
    assert "1 of 3 rows" in out.getvalue()
