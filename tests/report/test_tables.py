from __future__ import annotations

import io
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from occ.report.tables import (
    MISSING,
    Column,
    Table,
    amount,
    gap,
    latex,
    latex_text,
    markdown,
    markdown_text,
    parts,
    peak,
    plain_lines,
    residual,
    terminal,
)

finite = st.floats(allow_nan=False, allow_infinity=False)
text = st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=40)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (201.3897730545, "201.390"),
        (29.17156773, "29.1716"),
        (-0.8671832981775, "-0.867183"),
        (123456.0, "123456"),
        (1234567.0, "1.23457e+06"),
        (0.0, "0"),
        (None, MISSING),
        (math.nan, MISSING),
        (math.inf, "∞"),
    ],
)
def test_an_objective_has_six_significant_digits(value: float | None, shown: str) -> None:
    assert amount(value) == shown


def test_a_peak_has_four_digits_and_a_residual_two() -> None:
    assert (peak(1.22969), peak(127.93), peak(None)) == ("1.230", "127.9", MISSING)
    assert (residual(4.94e-12), residual(0.0), residual(math.nan)) == ("4.9e-12", "0", MISSING)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.530494, "0.5305"),
        (12.3456, "12.35"),
        (142.48, "142.5"),
        (98765.4, "98765"),
        (-0.01234, "-0.0123"),
        (3e-9, "< 0.0001"),
        (-3e-9, "< 0.0001"),
        (0.0, "0"),
        (-0.0, "0"),
        (None, MISSING),
        (math.nan, MISSING),
    ],
)
def test_gap(value: float | None, shown: str) -> None:
    assert gap(value) == shown


@given(finite)
def test_a_gap_never_shows_a_zero_that_is_not_one(value: float) -> None:
    shown = gap(value)
    if shown.startswith("<"):
        assert 0 < abs(value) < 1e-4
    else:
        assert float(shown) == pytest.approx(value, rel=1e-3, abs=5.1e-5)
        assert not re.fullmatch(r"-0(\.0*)?", shown)
        assert (float(shown) == 0) == (value == 0)


@given(finite)
def test_an_amount_reads_back(value: float) -> None:
    assert float(amount(value)) == pytest.approx(value, rel=5.1e-6)


TABLE = Table(
    "Work & torque",
    (Column("controller"), Column("status"), Column("torque squared", "N² m² s", numeric=True)),
    (("a_b | c", "ok", "31.2480"), ("[x] 50 %", "failed", "-1.5")),
)


def test_markdown_has_one_line_per_row_and_escaped_cells() -> None:
    lines = markdown(TABLE).splitlines()
    assert lines == [
        r"| controller | status | torque squared \[N² m² s\] |",
        "| :--- | :--- | ---: |",
        r"| a\_b \| c | ok | 31.2480 |",
        r"| \[x\] 50 % | failed | -1.5 |",
    ]


def test_latex_uses_booktabs_and_escapes_text_and_units() -> None:
    lines = latex(TABLE).splitlines()
    assert r"\begin{tabular}{llr}" in lines
    assert r"\caption{Work \& torque}" in lines
    assert [line for line in lines if "rule" in line] == [r"\toprule", r"\midrule", r"\bottomrule"]
    assert r"controller & status & torque squared [N\textsuperscript{2} m\textsuperscript{2} s] \\" in lines
    assert r"a\_b \textbar{} c & ok & 31.2480 \\" in lines
    # A bracket after a line break would be an argument of the break.
    assert r"{[x] 50 \%} & failed & $-$1.5 \\" in lines


@pytest.mark.parametrize("character", list("&%$#_{}~^\\<>"))
def test_latex_leaves_no_character_of_its_own_alone(character: str) -> None:
    assert latex_text(f"a{character}b") != f"a{character}b"


@given(text)
def test_latex_text_has_balanced_braces_and_no_bare_special_character(content: str) -> None:
    escaped = latex_text(content)
    bare = re.sub(r"\\[{}$&#%_]", "", escaped)
    assert bare.count("{") == bare.count("}")
    assert not re.search(r"[&#%_~^<>]", bare)
    assert "\n" not in escaped


@given(st.lists(st.tuples(text, text, text), min_size=1, max_size=4))
def test_a_markdown_row_keeps_its_number_of_cells(rows: list[tuple[str, str, str]]) -> None:
    table = Table("x", (Column("a"), Column("b"), Column("c")), tuple(rows))
    lines = markdown(table).split("\n")
    assert len(lines) == len(rows) + 3
    for line in lines[:-1]:
        assert len(re.findall(r"(?<!\\)(?:\\\\)*\|", line)) == 4


def test_markdown_text_is_one_line() -> None:
    assert markdown_text("F_X\n <b>") == r"F\_X \<b\>"


def test_terminal_shows_every_cell_as_it_is() -> None:
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(terminal(TABLE))
    shown = console.export_text()
    for cell in (
        "Work & torque",
        "controller",
        " torque ",
        " squared ",
        "[N² m² s]",
        "a_b | c",
        "[x] 50 %",
        "failed",
        "-1.5",
    ):
        assert cell in shown


def lines(table: Table) -> list[str]:
    """As a terminal without an end on the right shows it."""
    console = Console(file=io.StringIO(), width=1000)
    console.print(terminal(table))
    assert isinstance(console.file, io.StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


ANSWER = Table(
    "base",
    (
        Column("case"),
        Column("controller"),
        Column("status"),
        *(Column(f"{name} squared above bound", "N² m² s", numeric=True) for name in ("torque", "work", "speed")),
    ),
    (("one lap", "servo law", "ok", "31.2480", "– (none)", "1.230"), ("one lap", "min work", "ok", "9.5", "–", "90")),
)


@pytest.mark.parametrize("room", [45, 60, 200])
def test_a_narrow_terminal_gets_the_table_in_pieces(room: int) -> None:
    pieces = parts(ANSWER, room)
    assert len(pieces) > 1 or room == 200
    assert max(len(line) for piece in pieces for line in lines(piece)) <= room
    # Every piece names its rows, and together they have every column once.
    assert all([column.heading for column in piece.columns[:2]] == ["case", "controller"] for piece in pieces)
    assert [column for piece in pieces for column in piece.columns[2:]] == list(ANSWER.columns[2:])
    assert [cell for piece in pieces for cell in piece.rows[1][2:]] == list(ANSWER.rows[1][2:])


def test_a_column_that_is_too_wide_alone_has_a_piece_of_its_own() -> None:
    assert [len(piece.columns) for piece in parts(ANSWER, 10)] == [3] * 4


def test_a_heading_is_broken_and_its_unit_is_not() -> None:
    shown = lines(ANSWER)
    assert any("[N² m² s]" in line for line in shown)
    assert max(map(len, shown)) < 100


def test_plain_columns_are_as_wide_as_their_widest_cell() -> None:
    columns = (Column("who"), Column("work", "J", numeric=True), Column("status"))
    table = Table("All", columns, (("the servo law", "1.25", "ok"), ("b", "201.390", "infeasible")))
    assert plain_lines(table) == [
        "All",
        "who            work [J]  status",
        "the servo law      1.25  ok",
        "b               201.390  infeasible",
    ]
    assert plain_lines(Table("None", columns, ())) == ["None", "who  work [J]  status"]


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="2 cells in a table of 1"):
        Table("x", (Column("a"),), (("1", "2"),))
