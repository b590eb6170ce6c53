"""rockit-meco on the benchmark: collocation by IPOPT or shooting by IPOPT or FATROP, piecewise polynomial controls."""

from __future__ import annotations

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from rockit import DirectCollocation, MultipleShooting, Ocp
from rockit.sampling_method import FunctionGrid

sys.path.insert(0, str(Path(__file__).parent))
from model import evaluate


def solve(model: dict[str, Any], setting: dict[str, Any], repeats: int) -> dict[str, Any]:
    count, order = setting["intervals"], setting["control_order"]
    ocp = Ocp(T=model["duration"])
    x = [ocp.state(), ocp.state()]
    u = [ocp.control(order=order) for _ in range(model["controls"])]
    rate, integrand, torque = evaluate(model, ca, [ocp.t], x, u)
    for state, slope in zip(x, rate, strict=True):
        ocp.set_der(state, slope)
    ocp.add_objective(ocp.integral(integrand[0]))
    for state, value in zip(x, model["start"], strict=True):
        ocp.subject_to(ocp.at_t0(state) == value)
    if model["limit"] is not None:
        limit = model["limit"] * (1 - setting.get("back_off", 0.0))
        for value in torque:
            ocp.subject_to(-limit <= (value <= limit), grid="integrator", refine=setting.get("refine", 1))
    for state, guess in zip((*x, *u), model["guess"], strict=False):
        ocp.set_initial(state, ca.interpolant("g", "linear", [model["guess_times"]], guess)(ocp.t))
    quiet = {"print_level": 0, "tol": setting["tolerance"]}
    if "barrier" in setting:
        quiet["mu_init"] = setting["barrier"]
    options = {"expand": True, "print_time": False, "record_time": True, "error_on_fail": True}
    if "flags" in setting:
        # Steps of a shooting method stay calls: one long function would take minutes to compile.
        jit = {"flags": [setting["flags"]], "verbose": False}
        options |= {"expand": setting["method"] != "shooting", "jit": True, "compiler": "shell", "jit_options": jit}
    if setting["solver"] == "ipopt":
        ocp.solver("ipopt", options | {"ipopt": quiet | {"sb": "yes"}})
    else:
        structure = {"structure_detection": "auto", "fatrop": quiet}
        ocp.solver("fatrop", options | structure)
    mesh = model["meshes"][f"{count} {setting['first']}"]
    grid = FunctionGrid(lambda n: mesh)
    if setting["method"] == "collocation":
        ocp.method(DirectCollocation(N=count, M=1, degree=setting["degree"], grid=grid))
    else:
        ocp.method(MultipleShooting(N=count, M=setting["steps"], intg="rk", grid=grid))
    # The first call derives and builds the program.
    ocp.solve()
    seconds, call_seconds = [], []
    for _ in range(repeats):
        begin = time.process_time()
        solution = ocp.solve()
        call_seconds.append(time.process_time() - begin)
        # The solver's own time: without rockit's reading and writing of values.
        seconds.append(solution.stats["t_proc_total"])
    edges = np.array(mesh) * model["duration"]
    nodes = np.linspace(0.0, 1.0, order + 1) if order else np.array([0.5])
    inside = 1e-9 + (1 - 2e-9) * nodes
    t = edges[:-1, None] + np.diff(edges)[:, None] * inside
    sampler = solution.sampler(u)
    values = np.array(sampler(t.ravel())).reshape(len(u), *t.shape)
    return {
        "claim": float(solution.value(ocp.objective)),
        "seconds": seconds,
        "call_seconds": call_seconds,
        "edges": edges.tolist(),
        "nodes": nodes.tolist(),
        "values": values.tolist(),
    }


def main() -> None:
    request = json.load(sys.stdin)
    answers = []
    for setting in request["settings"]:
        try:
            answer = solve(request["model"], setting, request["repeats"])
        except Exception as error:  # a package that fails is a row that says so
            answer = {"failure": " ".join(str(error).split())[-200:]}
        answers.append({"setting": setting, "version": version("rockit-meco")} | answer)
    sys.stdout.write("\n@@" + json.dumps(answers))


if __name__ == "__main__":
    main()
