"""`reports/benchmarks.md` from `reports/benchmarks.json`: every number of the text comes from the run."""

from __future__ import annotations

import json
import statistics
import sys
from pathlib import Path
from typing import Any

HELD = 1e-6
"""A limit may be passed by this part of it between the nodes."""
Row = dict[str, Any]


INTRODUCTION = """# Speed beside other packages

One run on one core ({processor}, Python {python}, CasADi {casadi} for occ); medians of {repeats} solves for occ and
for the {finalists} fastest good settings of each other package, of two for the rest. Every answer is a control in
time that occ's referee replays: *error* is that of the replayed cost against the known optimum, and *excess* the
largest part by which a torque limit is passed, between nodes too. All start from the same guess on the same graded
meshes (*first*: width of the first interval, of the horizon), the others with the numbers of the problem folded into
their equations, and for all the solver of the nonlinear program is set carefully, or to stop at a larger tolerance
(*tol*) and to start with a smaller barrier (*mu*). The time is that of the processor, in one thread: other work on the
machine does not count. *ms* is for the solver of the nonlinear program alone, *call* for the package's own call around
it, with the writing of numbers and the reading of the answer (and in yapss the derivation of the program). A package
that passes the limit between its nodes is timed in its last solve, with the limit drawn in by as much as was passed.
The fastest good setting of each of rockit's ways to solve (method and solver) is timed again with its functions in
machine code (*compiled*: CasADi's `jit` with gcc; the steps of shooting stay calls there), but not shooting with a
limit at every step, whose code takes minutes to compile; compiling is no part of the time. yapss has no such option.
occ's functions are compiled and handed to FATROP without CasADi in between (`compiled` of its solver's options: a few
seconds once for a problem, kept for all later processes, the same numbers to the last bit).
"""
BLOCKS = (
    "What grows with the square in FATROP's build through CasADi is the interface's own table of blocks (a sparse "
    "matrix filled block by block, also with a structure given by hand). Compiled, the functions are handed to FATROP "
    "without CasADi in between, and nothing is built for an interval but its memory. States that are integrals of the "
    "controls are no unknowns for FATROP, which keeps its blocks small."
)


def report(results: dict[str, Any]) -> str:
    """The whole page."""
    lines = [
        INTRODUCTION.format(
            **results["machine"], **results["versions"], **{k: results[k] for k in ("repeats", "finalists")}
        )
    ]
    for case in results["cases"]:
        lines += [f"## {case['name']}", "", *_summary(case), "", *_table(case), ""]
    lines += ["## Growth with the number of intervals", "", *_growth(results["growth"])]
    return "\n".join(lines) + "\n"


def median(row: Row, key: str = "seconds") -> float:
    return statistics.median(row[key])


def good(row: Row, accuracy: float) -> bool:
    return "failure" not in row and abs(row["error"]) <= accuracy and row["excess"] <= HELD


def fastest(rows: list[Row], accuracy: float) -> Row | None:
    return min((row for row in rows if good(row, accuracy)), key=median, default=None)


def _summary(case: dict[str, Any]) -> list[str]:
    by_package: dict[str, list[Row]] = {}
    for row in case["rows"]:
        by_package.setdefault(row["package"], []).append(row)
    own = fastest(by_package.pop("occ"), case["accuracy"])
    lines = [
        f"Optimum {case['optimum']:.10g}.  occ is asked for a relative error of {case['accuracy']:g}, the others for "
        f"{case['peers_accuracy']:g}; limits are to be held to {HELD:g} between the nodes.",
        "",
    ]
    if own is None:
        return [*lines, "occ reaches its accuracy with none of its settings."]
    lines.append(
        f"* occ: {_ms(median(own))} ms, the call {_ms(median(own, 'call_seconds'))} ms, with {_setting(own)}, error "
        f"{own['error']:.1e}; the call with another radius, from the solution before it, "
        f"{_ms(median(own, 'resolve_seconds'))} ms; with finding mesh and back-off, making numbers and guess and "
        f"looking between the nodes {_ms(median(own, 'whole_seconds'))} ms."
    )
    best: Row | None = None
    for package, rows in by_package.items():
        row = fastest(rows, case["peers_accuracy"])
        if row is None:
            held = [abs(r["error"]) for r in rows if "failure" not in r and r["excess"] <= HELD]
            lines.append(f"* {package} does not reach it" + (f"; its least error is {min(held):.1e}." if held else "."))
            continue
        times = f"{_ms(median(row))} ms, the call {_ms(median(row, 'call_seconds'))} ms,"
        told = f"{times} with {_setting(row)}, error {row['error']:.1e}."
        lines.append(f"* {package} {row['version']}: {told}")
        best = row if best is None or median(row) < median(best) else best
    return lines if best is None else [*lines, "", *_ratios(case, own, best)]


def _ratios(case: dict[str, Any], own: Row, best: Row) -> list[str]:
    alone, call = (median(best, key) / median(own, key) for key in ("seconds", "call_seconds"))
    again = median(best, "call_seconds") / median(own, "resolve_seconds")
    # The solver alone against a whole call: what a reader who is hard on occ would compare.
    hard = median(best) / median(own, "call_seconds")
    target = 1 / case["target"]
    verdict = "met" if min(alone, call) >= target else "missed"
    return [
        f"occ takes one {alone:.1f}th of the time of the best of the others ({best['package']}), its call one "
        f"{call:.1f}th of the other's and one {hard:.1f}th of the other's solver alone, and with another radius one "
        f"{again:.1f}th; the target of one {target:.0f}th is {verdict}."
    ]


def _table(case: dict[str, Any]) -> list[str]:
    lines = ["| package | setting | error | excess | ms | call ms |", "|---|---|---|---|---|---|"]
    for row in case["rows"]:
        if "failure" in row:
            lines.append(f"| {row['package']} | {_setting(row)} | failed: {_cell(row['failure'])} | | | |")
        else:
            times = f"{_ms(median(row))} | {_ms(median(row, 'call_seconds'))}"
            numbers = f"{row['error']:.1e} | {row['excess']:.1e} | {times}"
            lines.append(f"| {row['package']} | {_setting(row)} | {numbers} |")
    return lines


def _growth(growth: dict[str, list[Row]]) -> list[str]:
    head = " | ".join(f"{solver} build s | solve s | memory MB | status" for solver in growth)
    lines = [
        "The first problem with degree 5: build of the program, one solve from the law's rotation, and what both add "
        "to the process's memory.",
        "",
        f"| intervals | {head} |",
        "|---" * (1 + 4 * len(growth)) + "|",
    ]
    for rows in zip(*growth.values(), strict=True):
        cells = [f"{r['build_s']:.3f} | {r['solve_s']:.4f} | {r['memory_MB']:.0f} | {r['status']}" for r in rows]
        lines.append(f"| {rows[0]['intervals']:.0f} | " + " | ".join(cells) + " |")
    lines.append("")
    for solver, rows in growth.items():
        times, build, solve = (rows[-1][key] / rows[0][key] for key in ("intervals", "build_s", "solve_s"))
        lines.append(
            f"* {solver}: for {times:.0f} times the intervals the build takes {build:.0f} times as long and the solve "
            f"{solve:.0f} times."
        )
    return [*lines, "", BLOCKS]


WORDS = (
    ("degree", "degree {}"),
    ("steps", "{} steps each"),
    ("control_order", "control of degree {}"),
    ("first", "first {:g}"),
    ("tolerance", "tol {:g}"),
    ("barrier", "mu {:g}"),
    ("flags", "compiled {}"),
)


def _setting(row: Row) -> str:
    s = row["setting"]
    words = [str(s[key]) for key in ("method", "solver") if key in s]
    refined = s.get("refined_to", s["intervals"])
    words.append(f"{s['intervals']} intervals" + (f" refined to {refined}" if refined != s["intervals"] else ""))
    for key, text in WORDS:
        if key in s:
            words.append(text.format(s[key]))
    if s.get("back_off"):
        words.append(f"limit less {s['back_off']:.1e}")
    return ", ".join(words)


def _cell(text: str) -> str:
    return text.replace("|", "/")[:80]


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g}"


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "reports")
    (folder / "benchmarks.md").write_text(report(json.loads((folder / "benchmarks.json").read_text())))
