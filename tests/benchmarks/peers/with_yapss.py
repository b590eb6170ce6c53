"""yapss on the benchmark: Legendre-Gauss-Radau points in segments, derivatives by CasADi, IPOPT."""

from __future__ import annotations

import json
import sys
import time
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import yapss.math
from yapss import Problem
from yapss._private import solver as yapss_solver

sys.path.insert(0, str(Path(__file__).parent))
from model import evaluate


def solve(model: dict[str, Any], setting: dict[str, Any], repeats: int) -> dict[str, Any]:
    count, degree, controls = setting["intervals"], setting["degree"], model["controls"]
    limited = model["limit"] is not None
    problem = Problem(name="lap", nx=[2], nu=[controls], nq=[1], nh=[4 if limited else 0])

    def objective(arg: Any) -> None:
        arg.objective = arg.phase[0].integral[0]

    def continuous(arg: Any) -> None:
        phase = arg.phase[0]
        rate, integrand, torque = evaluate(model, yapss.math, [phase.time], list(phase.state), list(phase.control))
        phase.dynamics[:] = rate
        phase.integrand[:] = integrand
        if limited:
            phase.path[:] = torque

    problem.functions.objective, problem.functions.continuous = objective, continuous
    bounds = problem.bounds.phase[0]
    bounds.initial_time.lower = bounds.initial_time.upper = 0.0
    bounds.final_time.lower = bounds.final_time.upper = model["duration"]
    bounds.initial_state.lower[:] = bounds.initial_state.upper[:] = model["start"]
    if limited:
        limit = model["limit"] * (1 - setting.get("back_off", 0.0))
        bounds.path.lower[:], bounds.path.upper[:] = -limit, limit
    guess = problem.guess.phase[0]
    guess.time = model["guess_times"]
    guess.state, guess.control = model["guess"][:2], model["guess"][2 : 2 + controls]
    mesh = np.array(model["meshes"][f"{count} {setting['first']}"])
    problem.mesh.phase[0].fraction = tuple(np.diff(mesh))
    problem.mesh.phase[0].collocation_points = (degree,) * count
    problem.spectral_method = "lgr"
    problem.derivatives.method, problem.derivatives.order = "auto", "second"
    problem.ipopt_options.print_level = 0
    problem.ipopt_options.tol = setting["tolerance"]
    if "barrier" in setting:
        problem.ipopt_options.mu_init = setting["barrier"]
    whole, inner = [], []
    original = yapss_solver._solve_ipopt_problem

    def timed(*args: Any, **kwargs: Any) -> Any:
        begin = time.process_time()
        result = original(*args, **kwargs)
        inner.append(time.process_time() - begin)
        return result

    yapss_solver._solve_ipopt_problem = timed
    try:
        for _ in range(repeats):
            begin = time.process_time()
            solution = problem.solve()
            whole.append(time.process_time() - begin)
    finally:
        yapss_solver._solve_ipopt_problem = original
    edges = mesh * model["duration"]
    phase = solution.phase[0]
    times = np.array(phase.time_c).reshape(count, degree)
    nodes = ((times - edges[:-1, None]) / np.diff(edges)[:, None])[0]
    return {
        "claim": float(solution.objective),
        # The solve alone: without the derivation of the program, which yapss repeats in every call.
        "seconds": inner,
        "call_seconds": whole,
        "edges": edges.tolist(),
        "nodes": nodes.tolist(),
        "values": np.array(phase.control).reshape(controls, count, degree).tolist(),
    }


def main() -> None:
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", "A builtin ctypes object gave a PEP3118")
    request = json.load(sys.stdin)
    answers = []
    for setting in request["settings"]:
        try:
            answer = solve(request["model"], setting, request["repeats"])
        except Exception as error:  # a package that fails is a row that says so
            answer = {"failure": " ".join(f"{type(error).__name__} {error}".split())[-200:]}
        answers.append({"setting": setting, "version": version("yapss")} | answer)
    sys.stdout.write("\n@@" + json.dumps(answers))


if __name__ == "__main__":
    main()
