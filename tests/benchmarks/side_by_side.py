"""occ beside public packages on two problems, in one run on one core; writes `reports/benchmarks.json` and `.md`.

    python -m tests.benchmarks.side_by_side [PYTHON_OF_THE_PEERS] [OUT]

Every answer, whoever gave it, is a control in time that the referee replays: the error is that of the replayed cost,
and a limit is looked at between the nodes.  A package that passes the limit there is asked again with that much taken
off, and only its last solve is timed.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import casadi as ca
import numpy as np

from occ.errors import Status
from occ.motion import kinematics_function
from occ.optimal.attempt import transcription_of
from occ.optimal.between import limited_arcs
from occ.optimal.collocation import Collocation
from occ.optimal.exchange import Exchange
from occ.optimal.limits import with_knots
from occ.optimal.mesh import graded_mesh
from occ.optimal.problem import Nodes, Numbers
from occ.optimal.reduced import Reduced, path_control
from occ.optimal.solvers import SolverName, SolverOptions
from occ.optimal.starts import starts_of
from occ.optimal.transcription import Outcome, Transcription
from occ.referee import judge
from occ.task import Limits, Solution, Task
from occ.trajectory import PiecewisePolynomial
from tests.benchmarks.printed import HELD, good, report
from tests.tasks import paper_task

REPEATS = 7
PEERS = Path(__file__).parent / "peers"
OBJECTIVE = "torque_squared"
MEASURE = "torque_squared_N2m2s"
FIRST_WIDTHS = (0.02, 0.05)
"""Widths of the first interval of the graded meshes, of the horizon: the same meshes for everybody."""
SOLVED = ({"tolerance": 1e-8}, {"tolerance": 1e-5, "barrier": 1e-3})
"""How the solvers of the nonlinear programs are set, for everybody: carefully, or just as far as is needed."""


@dataclass(frozen=True)
class Case:
    """One problem: its task, its known optimum and the errors that count.

    Args:
        name: for the report.
        task: what to do.
        optimum: [N^2 m^2 s] from the check values of the paper's errata and of the limit's study.
        accuracy: relative error that occ is asked for.
        peers_accuracy: and that a peer has to reach to be compared.
        target: largest ratio of the times.
    """

    name: str
    task: Task
    optimum: float
    accuracy: float
    peers_accuracy: float
    target: float


CASES = (
    Case("P1: one lap, least sum of squared torques", paper_task(), 29.171567732, 1e-6, 1e-5, 1 / 20),
    Case(
        "P2: the same with 1.1 N m on each wheel", paper_task(limits=Limits(torque=1.1)), 29.23994, 1e-5, 1e-3, 1 / 10
    ),
)
LOOK = 2
"""Solves of each setting of another package, to find its fastest ones."""
FINALISTS = 3
"""Settings of each package that are timed as often as occ."""
FLAGS = {"rockit": ("-O1", "-O2")}
"""With which the functions of a package are compiled, of those whose options allow it: once for each way of solving."""
COMPILE = 120.0
"""[s] for one of them, with its solves."""
ROUNDS = 4
"""Back-offs of another package at most."""


def _spread(base: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each setting on each of the meshes, solved carefully and quickly."""
    return [setting | {"first": first} | solved for setting in base for first in FIRST_WIDTHS for solved in SOLVED]


SETTINGS: dict[str, list[dict[str, Any]]] = {
    "rockit": _spread(
        [
            *(
                {"method": "collocation", "intervals": n, "degree": degree, "control_order": order, "solver": "ipopt"}
                for order, degree, counts in ((1, 3, (8, 10, 12)), (2, 4, (6, 8, 10)), (3, 5, (4, 5, 6)))
                for n in counts
            ),
            *(
                {"method": "shooting", "intervals": n, "steps": 4, "control_order": 2, "solver": solver}
                for solver in ("ipopt", "fatrop")
                for n in (8, 12)
            ),
        ]
    ),
    "yapss": _spread([{"intervals": n, "degree": degree} for n, degree in ((6, 4), (8, 4), (4, 6), (6, 6))]),
}
OWN = _spread(
    [
        {"solver": solver, "intervals": n, "degree": degree}
        for solver in ("fatrop", "ipopt")
        for n, degree in ((4, 4), (6, 4), (8, 4), (4, 5), (5, 5), (6, 5), (8, 5))
    ]
)
INTERVALS = sorted({setting["intervals"] for many in SETTINGS.values() for setting in many})


@cache
def posed(task: Task) -> Reduced:
    formulation = Collocation(objective=OBJECTIVE).posed(task)
    assert isinstance(formulation, Reduced)
    return formulation


def exported(task: Task) -> dict[str, Any]:
    """The problem for another package: equations with all numbers folded in, meshes, and the guess of occ."""
    formulation = posed(task)
    problem, t = formulation.problem(), ca.SX.sym("t")
    _, velocity, acceleration = kinematics_function(*task.motion_structure)(t, task.motion.values())
    values = problem.node_function(
        problem.state, problem.control, ca.vertcat(velocity, acceleration), ca.DM(formulation.parameters())
    )
    function = ca.Function("model", [t, problem.state, problem.control], list(values))
    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    steps = range(function.n_instructions())
    operations = [function.instruction_id(k) for k in steps]
    times = np.linspace(0.0, task.duration, 41)
    rotation = starts_of(task, 1, None)[0].rotation(times)
    return {
        "instructions": [
            [
                names[operation],
                function.instruction_output(k),
                function.instruction_input(k),
                function.instruction_constant(k) if operation == ca.OP_CONST else None,
            ]
            for k, operation in zip(steps, operations, strict=True)
        ],
        "outputs": [function.numel_out(i) for i in range(function.n_out())],
        "controls": problem.control.numel(),
        "duration": task.duration,
        "start": [task.start.heading, task.start.heading_rate],
        "limit": task.limits.torque,
        "guess_times": times.tolist(),
        "guess": [*rotation.tolist(), np.zeros(len(times)).tolist()],
        "meshes": {f"{n} {first}": graded_mesh(n, first).tolist() for n in INTERVALS for first in FIRST_WIDTHS},
    }


def replayed(case: Case, edges: np.ndarray, nodes: np.ndarray, values: np.ndarray) -> dict[str, float]:
    """The referee's word on a control: relative error of the cost, largest excess over the limit."""
    signal = PiecewisePolynomial(edges, nodes, values)
    task = case.task
    start = task.state_on_program(0.0, task.start.heading, task.start.heading_rate)
    measures = judge(task, Solution(control=path_control(task, signal), start_state=start)).measures
    if not measures:
        # A limit that is passed makes no measures: judge without it, and look at the peak.
        free = replace(task, limits=Limits())
        measures = judge(free, Solution(control=path_control(free, signal), start_state=start)).measures
    if not measures:
        return {"error": float("inf"), "excess": float("inf")}
    excess = 0.0 if task.limits.torque is None else measures["peak_torque_Nm"] / task.limits.torque - 1
    return {"error": measures[MEASURE] / case.optimum - 1, "excess": max(excess, 0.0)}


def of_peer(python: str, peer: str, case: Case) -> list[dict[str, Any]]:
    """All settings of one package, those that pass a limit again with a back-off; the fastest are timed once more."""
    model, rows = exported(case.task), []
    waiting = [dict(setting) for setting in SETTINGS[peer]]
    for _ in range(ROUNDS):
        judged = [_judged(case, peer, answer) for answer in _asked(python, peer, model, waiting, LOOK)]
        rows += judged
        passed = [row for row in judged if "failure" not in row and row["excess"] > HELD]
        waiting = [
            row["setting"] | {"back_off": row["setting"].get("back_off", 0.0) + 1.1 * row["excess"]} for row in passed
        ]
        if not waiting:
            break
    enough = [row for row in rows if good(row, case.peers_accuracy)]
    finalists = sorted(enough, key=lambda row: min(row["seconds"]))[:FINALISTS]
    timed = _asked(python, peer, model, [row["setting"] for row in finalists], REPEATS) if finalists else []
    for row, answer in zip(finalists, timed, strict=True):
        row.update(_judged(case, peer, answer))
    for setting in compiled_settings(case, enough, FLAGS.get(peer, ())):
        rows += [_judged(case, peer, answer) for answer in _asked(python, peer, model, [setting], REPEATS, COMPILE)]
    return rows


def compiled_settings(case: Case, enough: list[dict[str, Any]], flags: tuple[str, ...]) -> list[dict[str, Any]]:
    """The fastest setting of each way of solving with its functions compiled, which takes too long for all of them."""
    fastest: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in sorted(enough, key=lambda row: min(row["seconds"])):
        fastest.setdefault(tuple(row["setting"].get(key) for key in ("method", "solver")), row["setting"])
    if case.task.limits.torque is not None:
        # With the limit at every step the code of shooting has megabytes, and the compiler is at it for minutes.
        fastest = {way: setting for way, setting in fastest.items() if setting.get("method") != "shooting"}
    return [setting | {"flags": flag} for setting in fastest.values() for flag in flags]


def _judged(case: Case, peer: str, answer: dict[str, Any]) -> dict[str, Any]:
    row = {"package": peer, "version": answer["version"], "setting": answer["setting"]}
    if "failure" in answer:
        return row | {"failure": answer["failure"]}
    row |= replayed(case, *(np.array(answer[key]) for key in ("edges", "nodes", "values")))
    return row | {key: answer[key] for key in ("seconds", "call_seconds", "claim")}


def _asked(
    python: str, peer: str, model: dict[str, Any], settings: list[dict[str, Any]], repeats: int, limit: float = 1800.0
) -> list[dict[str, Any]]:
    request = json.dumps({"model": model, "settings": settings, "repeats": repeats})
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [os.path.abspath(python), str(PEERS / f"with_{peer}.py")]
    # CasADi compiles in the folder where it is.
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        try:
            done = subprocess.run(
                command, input=request, capture_output=True, text=True, env=clean, cwd=folder, timeout=limit
            )
        except subprocess.TimeoutExpired:
            return [{"setting": s, "version": "?", "failure": f"not finished after {limit:g} s"} for s in settings]
    if "@@" not in done.stdout:
        last = " ".join(done.stderr.split())[-200:]
        return [{"setting": s, "version": "?", "failure": f"the process ended: {last}"} for s in settings]
    answers: list[dict[str, Any]] = json.loads(done.stdout.rsplit("@@", 1)[1])
    return answers


def of_occ(case: Case) -> list[dict[str, Any]]:
    """Cold solves from the law's rotation: P1 on the first mesh as it is, P2 with edges at the switching times."""
    return [_occ_row(case, setting) for setting in OWN]


@dataclass(frozen=True)
class Solved:
    """One solve of occ: the program, its numbers, its guess and what came out."""

    transcription: Transcription
    numbers: Numbers
    guess: Nodes
    outcome: Outcome


def _solved(case: Case, edges: np.ndarray, degree: int, options: SolverOptions, taken: np.ndarray | None) -> Solved:
    """From the law's rotation, with a part taken off the limits of each interval."""
    formulation = posed(case.task)
    transcription = transcription_of(formulation.problem(), len(edges) - 1, degree, "radau", options)
    numbers = formulation.numbers(transcription, edges)
    if taken is not None:
        numbers = replace(numbers, path=formulation.path_bounds(taken, degree))
    guess = formulation.guess(transcription, edges, starts_of(case.task, 1, None)[0].rotation)
    return Solved(transcription, numbers, guess, transcription.solve(numbers, guess))


def _prepared(case: Case, setting: dict[str, Any], careful: SolverOptions, options: SolverOptions) -> Solved:
    """On a mesh with edges at the switching times, with the limits drawn in until they are held between the nodes."""
    formulation, degree = posed(case.task), setting["degree"]
    first = edges = graded_mesh(setting["intervals"], setting["first"]) * case.task.duration
    if case.task.limits.torque is None:
        return _solved(case, edges, degree, options, None)
    for _ in range(ROUNDS):
        solved = _solved(case, edges, degree, careful, None)
        arcs = limited_arcs(formulation, solved.transcription, solved.outcome.nodes, solved.numbers)
        assert arcs is not None
        edges = with_knots(first, arcs.switching_times())
    taken = np.zeros((arcs.hard, len(edges) - 1))
    for _ in range(2 * ROUNDS):
        solved = _solved(case, edges, degree, options, taken)
        arcs = limited_arcs(formulation, solved.transcription, solved.outcome.nodes, solved.numbers)
        assert arcs is not None
        if arcs.hard_excess.max() <= HELD / 3:
            break
        taken += 1.2 * arcs.hard_excess
    return solved


@contextmanager
def _timed_solver() -> Iterator[list[float]]:
    """Seconds of the solver alone, in each call of occ, as they are taken of the others."""
    seconds, original = [], Exchange.solve

    def timed(exchange: Exchange) -> dict[str, Any]:
        begin = time.process_time()
        statistics = original(exchange)
        seconds.append(time.process_time() - begin)
        return statistics

    Exchange.solve = timed
    try:
        yield seconds
    finally:
        Exchange.solve = original


def _occ_row(case: Case, setting: dict[str, Any]) -> dict[str, Any]:
    careful = SolverOptions(solver=setting["solver"], compiled=True)
    options = replace(careful, tolerance=setting["tolerance"], barrier=setting.get("barrier"))
    whole = []
    for _ in range(2):
        # The second time around all programs are built already, as in a sweep.
        begin = time.process_time()
        solved = _prepared(case, setting, careful, options)
        whole.append(time.process_time() - begin)
    transcription, numbers = solved.transcription, solved.numbers
    call_seconds = []
    with _timed_solver() as seconds:
        for _ in range(REPEATS):
            begin = time.process_time()
            outcome = transcription.solve(numbers, solved.guess)
            call_seconds.append(time.process_time() - begin)
    found = {"refined_to": transcription.intervals}
    row = {"package": "occ", "version": version("occ"), "setting": setting | found}
    if outcome.status is not Status.OK or outcome.statistics["solver"] != setting["solver"]:
        return row | {"failure": outcome.message or outcome.statistics["instead"]}
    nodes = outcome.nodes
    row |= replayed(case, numbers.edges, transcription.scheme.points, nodes.control)
    return row | {
        "seconds": seconds,
        "call_seconds": call_seconds,
        "whole_seconds": [whole[1]],
        "claim": outcome.cost,
        "resolve_seconds": _resolved(case, transcription, numbers, nodes),
    }


def _resolved(case: Case, transcription: Transcription, numbers: Numbers, nodes: Nodes) -> list[float]:
    """Solves with another radius, each from the solution before it: numbers only, nothing is built."""
    seconds = []
    for k in range(REPEATS):
        motion = replace(case.task.motion, radius=0.7 + 0.002 * (k % 3 - 1))
        other = posed(replace(case.task, motion=motion))
        changed = replace(other.numbers(transcription, numbers.edges), path=numbers.path)
        begin = time.process_time()
        outcome = transcription.solve(changed, nodes, restart=case.task.limits.torque is not None)
        seconds.append(time.process_time() - begin)
        nodes = outcome.nodes
    return seconds[1:]


GROWN: dict[str, tuple[SolverName, bool]] = {
    "ipopt": ("ipopt", False),
    "fatrop": ("fatrop", False),
    "fatrop, compiled": ("fatrop", True),
}
"""Solver, and whether its functions are compiled."""


def growth(name: str) -> list[dict[str, float]]:
    """Build and solve time and memory with the number of intervals, degree 5, each in a process of its own."""
    rows = []
    for intervals in (50, 100, 200, 400, 800, 1600):
        code = f"from tests.benchmarks import side_by_side as s; s.print_growth({name!r}, {intervals})"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    return rows


def print_growth(name: str, intervals: int) -> None:
    """One row of `growth`, on standard output."""
    case = CASES[0]
    formulation = posed(case.task)
    solver, compiled = GROWN[name]
    options, problem = SolverOptions(solver=solver, compiled=compiled), formulation.problem()
    # What is done once for any number of intervals, such as to call the compiler.
    Transcription(problem, 4, 5, options=options)
    before = _resident_bytes()
    begin = time.process_time()
    transcription = Transcription(problem, intervals, 5, options=options)
    built = time.process_time() - begin
    edges = graded_mesh(intervals, min(FIRST_WIDTHS[0], 0.5 / intervals)) * case.task.duration
    numbers = formulation.numbers(transcription, edges)
    guess = formulation.guess(transcription, edges, starts_of(case.task, 1, None)[0].rotation)
    seconds = []
    for _ in range(3):
        begin = time.process_time()
        outcome = transcription.solve(numbers, guess)
        seconds.append(time.process_time() - begin)
    memory = (_resident_bytes() - before) / 1e6
    row = {"intervals": intervals, "build_s": built, "solve_s": statistics.median(seconds), "memory_MB": memory}
    print(json.dumps(row | {"error": outcome.cost / case.optimum - 1, "status": outcome.status}))


def _resident_bytes() -> int:
    """What the process holds at present; Linux tells it in pages."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def main() -> None:
    """Measure, store, print."""
    python = sys.argv[1] if len(sys.argv) > 1 else sys.executable
    out = Path(sys.argv[2] if len(sys.argv) > 2 else "reports")
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    results: dict[str, Any] = {
        "machine": {"processor": platform.processor() or platform.machine(), "python": platform.python_version()},
        "versions": {name: version(name) for name in ("occ", "casadi", "numpy")},
        "repeats": REPEATS,
        "finalists": FINALISTS,
        "cases": [],
    }
    for case in CASES:
        rows = of_occ(case)
        for peer in SETTINGS:
            rows += of_peer(python, peer, case)
        keys = ("name", "optimum", "accuracy", "peers_accuracy", "target")
        results["cases"].append({key: getattr(case, key) for key in keys} | {"rows": rows})
    results["growth"] = {name: growth(name) for name in GROWN}
    out.mkdir(parents=True, exist_ok=True)
    (out / "benchmarks.json").write_text(json.dumps(results, indent=1) + "\n")
    (out / "benchmarks.md").write_text(report(results))


if __name__ == "__main__":
    main()
