from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from occ.errors import InputError
from occ.figures.comparison import drawn
from occ.referee import LABELS, MEASURES
from occ.report.report import write_report
from occ.report.stored import load
from tests.report.synthetic import motion, row, store

ROWS = [
    row("law", 100.0),
    row("least_work", 90.0, peak_torque_Nm=300.0),
    row("own better", 95.0, start="own"),
    row("own worse", 150.0, start="own"),
    row("other", 120.0, peak_torque_Nm=1.5),
    row("bound | too tight", 85.0, status="infeasible", message="wheel 2 torque needs 3.1 N m; limit 2.1 N m"),
    row("lost", None, status="crashed", message="ValueError: <no>", torque_squared_N2m2s=None),
]


def report(folder: Path) -> str:
    write_report(folder)
    return (folder / "report.md").read_text(encoding="utf-8")


def section(text: str, heading: str) -> str:
    """What stands between a heading and the next one of its level."""
    return text.split(f"\n{heading}\n")[1].split("\n## ")[0]


def test_question_comes_first_and_then_the_answer(tmp_path: Path) -> None:
    lines = [line for line in report(store(tmp_path, ROWS)).splitlines() if line]
    assert lines[:3] == ["# A made-up comparison", r"**Question.** How close is the first \| law?", "## Answer"]
    assert lines[3].startswith("| controller | status | start | end | work")


def test_rows_that_are_not_ok_come_with_reason_and_advice(tmp_path: Path) -> None:
    text = section(report(store(tmp_path, ROWS)), "## Answer").split("### Rows that are not ok\n")[1]
    assert "| infeasible | wheel 2 torque needs 3.1 N m; limit 2.1 N m |" in text
    assert "\n- Infeasible: raise the limit that the message names, or" in text
    assert "\n- Crashed: the message says why: what ran out of time wants more --time-limit or --patience" in text
    assert "Failed" not in text
    assert "Infeasible" not in report(store(tmp_path, ROWS[:2]))


def test_classes_are_explained_where_they_appear(tmp_path: Path) -> None:
    plain = section(report(store(tmp_path, ROWS)), "## How to read this table")
    rows = [row("law", 100.0), row("a", 90.0, keep="tube", start="free", end="periodic"), row("b", 90.0, end="rest")]
    text = section(report(store(tmp_path, [*rows, row("c", 80.0, keep="ends")])), "## How to read this table")
    for words in ("Keep `tube`", "Keep `ends`", "Start `free`", "End `periodic`", "End `rest`"):
        assert text.count(words) == 1
        assert words not in plain
    assert re.findall(r"^(\d+)\. ", text, re.MULTILINE) == [str(i + 1) for i in range(10)]


def test_each_row_has_its_numbers(tmp_path: Path) -> None:
    text = section(report(store(tmp_path, ROWS)), "## Answer")
    assert "| law | ok | given | free | 100.000 | 25.00 (local) | 2.00000 | 100.0 (local) | 1.250 |" in text
    assert "| own better | ok | own | free | 95.0000 | – (none) | 2.00000 | – (none) | 1.250 |" in text
    assert "| lost | crashed | given | free | – | – (none) | – | – (none) | 1.250 |" in text


def test_the_answer_in_words_follows_from_the_numbers(tmp_path: Path) -> None:
    text = section(report(store(tmp_path, ROWS)), "## Answer")
    work = next(line for line in text.splitlines() if line.startswith("- Work:"))
    assert r"**least\_work** needs least, 90.0000 J (end class free); **law** needs 100.000 J, 11.11 % more." in work
    assert "**law** is 25.00 % above the best known value of its class, 80.0000 J; this bound is *local*" in work
    assert "**own better** (95.0000 J, 5.000 % less)" in work
    assert "own worse" not in work
    # Neither a row that is not ok nor one with another start is what the law is compared with.
    assert "85.0000" not in work


def test_the_law_is_compared_with_its_own_class_only(tmp_path: Path) -> None:
    rows = [row("law", 90.0), row("own", 60.0, start="own"), row("tube", 50.0, keep="tube"), row("peer", 95.0)]
    text = section(report(store(tmp_path, rows)), "## Answer")
    work = next(line for line in text.splitlines() if line.startswith("- Work:"))
    assert "**law** itself needs least, 90.0000 J" in work
    assert "**own** (60.0000 J, 33.33 % less)" in work
    assert "tube" not in work


def test_the_law_can_be_the_best(tmp_path: Path) -> None:
    rows = [row("law", 81.0), row("other", 90.0), row("own", 95.0, start="own")]
    text = section(report(store(tmp_path, rows)), "## Answer")
    assert "of the controllers with its start, **law** itself needs least, 81.0000 J." in text
    assert "No controller with a start of its own needs less than the law." in text


def test_a_law_below_a_local_bound_is_said_to_be_below(tmp_path: Path) -> None:
    assert "**law** is 1.250 % below the best known" in report(store(tmp_path, [row("law", 79.0), row("other", 90.0)]))


def test_a_certified_bound_is_called_so(tmp_path: Path) -> None:
    rows = [row("law", 81.0, work_bound_kind="certified"), row("other", 90.0, work_bound_kind="certified")]
    text = report(store(tmp_path, rows))
    assert "this bound is *certified*: a proof, independent of every controller" in text


def test_a_bound_set_by_a_row_of_the_table_is_not_told_twice(tmp_path: Path) -> None:
    rows = [row("law", 100.0), row("least", 80.0)]
    text = section(report(store(tmp_path, rows)), "## Answer")
    work = next(line for line in text.splitlines() if line.startswith("- Work:"))
    assert work.count("25.00 %") == 1
    assert "That least value is the bound of the law's class, too, and it is *local*: it is the value of a KKT" in work


def test_without_a_bound_nothing_is_claimed(tmp_path: Path) -> None:
    rows = [row("law", 81.0, work_bound=None, work_bound_kind="none", work_gap_percent=None)]
    text = section(report(store(tmp_path, rows)), "## Answer")
    work = next(line for line in text.splitlines() if line.startswith("- Work:"))
    assert "there is no bound" in work
    assert "above" not in work


def test_a_law_without_result_is_said_to_have_none(tmp_path: Path) -> None:
    rows = [row("law", 81.0, status="infeasible", message="too much"), row("other", 90.0)]
    assert "- Work: **law** has no result here (status infeasible)." in report(store(tmp_path, rows))


def test_rows_that_are_not_ok_stand_with_their_messages(tmp_path: Path) -> None:
    text = report(store(tmp_path, ROWS)).split("### Rows that are not ok")[1].split("\n## ")[0]
    assert r"| bound \| too tight | infeasible | wheel 2 torque needs 3.1 N m; limit 2.1 N m |" in text
    assert r"| lost | crashed | ValueError: \<no\> |" in text
    assert "| law |" not in text


def test_no_such_section_where_all_rows_are_ok(tmp_path: Path) -> None:
    assert "not ok\n" not in report(store(tmp_path, [row("law"), row("other")]))


def test_a_note_of_an_ok_row_is_shown(tmp_path: Path) -> None:
    assert "| other | stopped early |" in report(store(tmp_path, [row("law"), row("other", message="stopped early")]))


def test_only_a_peak_far_above_the_others_is_explained(tmp_path: Path) -> None:
    text = report(store(tmp_path / "a", ROWS))
    assert r"The peak torque of **least\_work** (300.0 N m in base) is not meaningful" in text
    assert text.count("is not meaningful") == 1
    assert "not meaningful" not in report(store(tmp_path / "b", [row("law"), row("other", peak_torque_Nm=12.0)]))


@pytest.mark.parametrize("kind", ["local", "certified", "exact"])
def test_no_sentence_says_optimal_without_its_kind_of_truth(tmp_path: Path, kind: str) -> None:
    rows = [entry | {"work_bound_kind": kind if entry["work_bound"] else "none"} for entry in ROWS]
    for sentence in re.split(r"(?<=[.:;|])\s", report(store(tmp_path, rows)).lower()):
        if "optim" in sentence:
            assert re.search("certified|local|measured", sentence), sentence


def test_ten_lines_tell_how_to_read_the_table(tmp_path: Path) -> None:
    text = section(report(store(tmp_path, ROWS)), "## How to read this table")
    assert re.findall(r"^(\d+)\. ", text, flags=re.MULTILINE) == [str(i) for i in range(1, 11)]
    for word in ("referee", "path", "given", "own", "free", "law", "certified", "exact", "local", "none", "ledger"):
        assert word in text


def test_no_date_and_the_same_bytes_again(tmp_path: Path) -> None:
    folder = store(tmp_path, ROWS)
    names = ("report.md", "table.md", "table.tex")
    write_report(folder)
    first = [(folder / name).read_bytes() for name in names]
    write_report(folder)
    assert [(folder / name).read_bytes() for name in names] == first
    assert not re.search(rb"20\d\d-\d\d|\d\d:\d\d|seconds", b"".join(first))
    assert str(tmp_path).encode() not in b"".join(first)
    assert sorted(path.name for path in folder.iterdir()) == sorted([*names, "results.csv", "run.json"])


def test_few_cases_have_a_table_each_and_many_share_one(tmp_path: Path) -> None:
    def swept(count: int) -> list[dict[str, object]]:
        return [
            row(name, 81.0 + i, case=f"motion.radius={i}", **{"motion.radius": i})
            for i in range(count)
            for name in ("law", "other")
        ]

    few, many = report(store(tmp_path / "few", swept(2))), report(store(tmp_path / "many", swept(7)))
    assert "### motion.radius=1\n" in few
    assert "- motion.radius=1, work: " in few
    assert "###" not in many
    assert "| motion.radius=6 | other | ok |" in section(many, "## Answer")
    assert (
        "- Work: **law** is ok in 7 of 7 cases. Its gap to the best known value of its class runs from 1.250 % "
        "(motion.radius=0) to 8.750 % (motion.radius=6); kinds of bounds: *local*."
    ) in many


def test_figures_are_embedded_where_they_are(tmp_path: Path) -> None:
    folder = store(tmp_path, ROWS)
    assert "## Figures" not in report(folder)
    (folder / "figures").mkdir()
    (folder / "figures" / "heading.svg").write_text("<svg/>")
    (folder / "figures" / "of-an-older-run.svg").write_text("<svg/>")
    write_report(folder, drawn(folder))
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert re.findall(r"!\[.+\]\((.+)\)", text) == ["figures/heading.svg"]


def test_the_csv_alone_is_enough(tmp_path: Path) -> None:
    folder = store(tmp_path / "fresh-clone", ROWS)
    (folder / "run.json").unlink()
    text = report(folder)
    assert text.startswith("# fresh-clone\n\n## Answer\n")
    assert "| law | ok | given | free | 100.000 | 25.00 (local) |" in text


def test_a_rounding_error_has_no_six_digits(tmp_path: Path) -> None:
    text = section(report(store(tmp_path, [row("law", kinetic_change_J=1.23456e-13)])), "## Energy")
    assert "| law | 100.000 | 1.2e-13 | 101.000 |" in text


def test_latex_table_holds_all_rows(tmp_path: Path) -> None:
    write_report(store(tmp_path, ROWS))
    text = (tmp_path / "table.tex").read_text(encoding="utf-8")
    assert r"least\_work & ok & given & free & 90.0000 & 12.50 (local)" in text
    assert text.count(r"\\") == len(ROWS) + 1


def test_names_that_look_like_numbers_or_blanks_stay_names(tmp_path: Path) -> None:
    stored = load(store(tmp_path, [row("NA", case="007"), row("nan", case="007"), row("1e3", None, case="007")]))
    assert stored.cases == ["007"]
    assert stored.controllers == ["NA", "nan", "1e3"]
    assert stored.rows["work_J"].isna().tolist() == [False, False, True]


@pytest.mark.parametrize("content", [None, "", "case,controller\na,b\n", ",".join((*LABELS, *MEASURES)) + "\n"])
def test_a_folder_without_results_is_refused(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "results.csv").write_text(content)
    with pytest.raises(InputError, match="results"):
        write_report(tmp_path)
    assert not (tmp_path / "report.md").exists()


@pytest.mark.parametrize("content", ["{", "[]", json.dumps({"cases": {}}), '{"experiment": {}, "cases": null}'])
def test_a_broken_record_of_the_run_is_refused(tmp_path: Path, content: str) -> None:
    folder = store(tmp_path, ROWS)
    (folder / "run.json").write_text(content)
    with pytest.raises(InputError, match="run"):
        load(folder)


def test_a_table_that_was_cut_or_changed_is_refused(tmp_path: Path) -> None:
    table = store(tmp_path, ROWS) / "results.csv"
    whole = table.read_text()
    table.write_text(whole[: whole.rindex(",lost,") + 20])
    with pytest.raises(InputError, match=rf"row {len(ROWS)} is not as long"):
        load(tmp_path)
    table.write_text(whole.replace(",crashed,", ",craashed,"))
    with pytest.raises(InputError, match='status "craashed" is none; should be one of ok'):
        load(tmp_path)


def test_a_broken_trajectory_is_named(tmp_path: Path) -> None:
    folder = store(tmp_path, ROWS, {("base", "law"): motion()})
    assert load(folder).motion("base", "law") is not None
    (folder / "trajectories" / "base@law.nc").write_bytes(b"half a file")
    with pytest.raises(InputError, match=r"base@law\.nc: not a stored trajectory"):
        load(folder).motion("base", "law")


def test_the_long_run_is_told_once_for_each_circle(tmp_path: Path) -> None:
    cases = {"one": (12.5, 12.0), "two": (12.5, 12.0), "three": (14.0, 12.0)}
    store(tmp_path, [row("law", case=case) for case in cases])
    record = json.loads((tmp_path / "run.json").read_text())
    for case, (law, least) in cases.items():
        record["cases"][case]["for_ever"] = {
            "law_mean_power_W": law,
            "least_mean_power_W": least,
            "least_mean_power_kind": "certified",
            "long_run_gap_percent": 100 * (law - least) / least,
        }
    (tmp_path / "run.json").write_text(json.dumps(record))
    told = [line for line in report(tmp_path).splitlines() if line.startswith("- For ever")]
    assert len(told) == 2
    for words, line in (("one; two", told[0]), ("*certified*", told[0]), ("4.167 % above", told[0])):
        assert words in line
    for words in ("in three:", "16.67 % above"):
        assert words in told[1]
