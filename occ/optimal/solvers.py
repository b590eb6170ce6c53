"""IPOPT and FATROP through CasADi: options checked by name, a solver for a program, and its state in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Any, Literal

import casadi as ca
from annotated_types import Ge

from occ.checks import Positive, check_fields
from occ.errors import Status
from occ.optimal.engines import NOT_FINITE
from occ.optimal.layout import Stages
from occ.optimal.program import Program

SolverName = Literal["ipopt", "fatrop"]

RESTART = 1e-6
"""Barrier parameter at the start of a solve from a solution nearby."""


FATROP_BOUNDED = 1e-7
"""Tolerance that FATROP reaches reliably with inequalities: at smaller barrier parameters its recursion through the
stages loses the digits of the reduced Hessian, and it goes on in tiny steps."""
PIVOTS = 1e-4
"""Relative threshold for the pivots of IPOPT's linear solver: with IPOPT's own, 1e-6, the signs of the pivots are lost
where conditions of very different sizes meet, and IPOPT damps steps that need none."""
ORDERINGS = {"own": 7, "minimum_degree": 0}
"""MUMPS' numbers (ICNTL(7)): its own choice, and approximate minimum degree."""
ACCEPTABLE = 1e-6
"""Tolerance with which IPOPT is content where it makes no progress any more; a row says so."""
STOPPED_SHORT = "Solved_To_Acceptable_Level"
"""IPOPT's word for that."""
PATIENCE = 150
"""Iterations after which FATROP is not expected to converge any more, and IPOPT takes over; most solves take ten."""


@dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """Of IPOPT or FATROP.  A word that a solver does not know can end the whole process, so that all are checked here.

    Args:
        solver: ``ipopt`` for any problem; ``fatrop`` factorises stage by stage.
        tolerance: of the optimality conditions.
        iterations: at most.
        seconds: at most, of wall time; FATROP, which has no clock, gets the iterations that fit into it.
        linear_solver: of IPOPT.
        ordering: of its unknowns; its own choice goes by the pattern alone, and where slacks and torque rates meet it
            delays pivots until the matrix fills: 512 intervals took 39 s instead of 1.1 s.
        barrier: parameter of the barrier at the start; None is the solver's own choice.
        compiled: the problem's functions in machine code, made by this machine's C compiler and kept for other
            processes: a few seconds for a new problem, faster solves ever after, the same numbers to the last bit.
            Where the states are integrals of the controls, FATROP then has no CasADi in between.

    Raises:
        InputError: a value that the solvers do not take.
    """

    solver: SolverName = "ipopt"
    tolerance: Positive = 1e-10
    iterations: Annotated[int, Ge(0)] = 500
    seconds: Positive = 60.0
    linear_solver: Literal["mumps"] = "mumps"
    ordering: Literal["own", "minimum_degree"] = "own"
    barrier: Positive | None = None
    compiled: bool = False

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class Effort:
    """What a solve was allowed and took.

    Args:
        iterations: at most.
        in_time: so few only because more would take longer than the seconds that there are.
        seconds: taken.
    """

    iterations: int
    in_time: bool
    seconds: float


@dataclass(frozen=True)
class Verdict:
    """How a solve ended, in words, and what it took.

    Args:
        status: ``OK`` where it converged.
        message: otherwise, why not.
        not_finite: a function was not.
        gave_up: another solver may do better.
        statistics: iterations and seconds.
    """

    status: Status
    message: str
    not_finite: bool = False
    gave_up: bool = False
    statistics: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


def nonlinear_solver(
    program: Program, options: SolverOptions, sizes: Stages | None, *, bounded: bool, restart: bool
) -> ca.Function:
    """A CasADi solver of a program whose derivatives are given.

    Args:
        program: functions and derivatives.
        options: validated; its iterations are those of this solver.
        sizes: of the stages, for FATROP.
        bounded: with inequalities.
        restart: for starts from a solution nearby: a small barrier parameter, and no push off the bounds.

    Returns:
        The solver; multipliers are never handed in.
    """
    general: dict[str, Any] = {
        "print_time": False,
        # Multipliers of the parameters would cost as much as the solution, and nobody asks for them.
        "calc_lam_p": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
        "cache": program.functions,
    }
    if options.solver == "ipopt":
        general["no_nlp_grad"] = True
        own = _settings(options, restart) | {
            "sb": "yes",
            "linear_solver": options.linear_solver,
            "mumps_pivtol": PIVOTS,
            "mumps_pivot_order": ORDERINGS[options.ordering],
            "acceptable_tol": ACCEPTABLE,
            "constr_viol_tol": options.tolerance,
            "max_wall_time": options.seconds,
            "fixed_variable_treatment": "make_parameter",
        }
    else:
        assert sizes is not None
        own = fatrop_settings(options, bounded=bounded, restart=restart)
        general |= {
            "structure_detection": "manual",
            "N": len(sizes.states) - 1,
            "nx": sizes.states.tolist(),
            "nu": sizes.controls.tolist(),
            "ng": sizes.conditions.tolist(),
        }
    return ca.nlpsol("collocation", options.solver, program.nlp, general | {options.solver: own})


def fatrop_settings(options: SolverOptions, *, bounded: bool, restart: bool) -> dict[str, float]:
    """Tolerance, iterations and barrier of FATROP.

    Args:
        options: as of `nonlinear_solver`.
        bounded: with inequalities.
        restart: for starts from a solution nearby.

    Returns:
        By FATROP's own names.
    """
    tolerance = max(options.tolerance, FATROP_BOUNDED) if bounded else options.tolerance
    return _settings(options, restart) | {"tol": tolerance}


def _settings(options: SolverOptions, restart: bool) -> dict[str, Any]:
    """Those that both solvers call by the same name."""
    own: dict[str, Any] = {"tol": options.tolerance, "max_iter": options.iterations, "print_level": 0}
    if options.barrier is not None:
        own["mu_init"] = options.barrier
    if restart:
        own |= {"mu_init": RESTART, "bound_push": RESTART, "bound_frac": RESTART}
    return own


_WORDS = {
    "Infeasible_Problem_Detected": (Status.INFEASIBLE, "the solver found the constraints to contradict each other"),
    "Maximum_Iterations_Exceeded": (Status.FAILED, "the solver used all its {iterations} iterations"),
    "Maximum_WallTime_Exceeded": (Status.FAILED, "the solver used all its time, {seconds:g} s"),
    "Restoration_Failed": (Status.FAILED, "the solver came to where it found no way back to the conditions"),
    "Search_Direction_Becomes_Too_Small": (Status.FAILED, "the solver's steps became too small to make progress"),
    "Diverging_Iterates": (Status.FAILED, "the solver's unknowns grew without end"),
    NOT_FINITE: (Status.FAILED, "a function of the problem is not finite"),
}


def read_verdict(statistics: dict[str, Any], options: SolverOptions, effort: Effort) -> Verdict:
    """The state of a finished solve.

    Args:
        statistics: of the CasADi solver.
        options: with which it ran.
        effort: what it was allowed and took.

    Returns:
        Status and message, iterations and seconds.
    """
    kept: dict[str, Any] = {
        "solver": options.solver,
        # FATROP counts one too many where it runs out of them.
        "iterations": min(int(statistics["iter_count"]), effort.iterations),
        "seconds": effort.seconds,
        "return_status": str(statistics["return_status"]),
    }
    if statistics["success"]:
        return Verdict(Status.OK, "", statistics=kept)
    reason, gave_up = str(statistics["return_status"]), False
    if options.solver == "fatrop" and reason != NOT_FINITE:
        # FATROP says no more than that it failed.
        out = kept["iterations"] >= effort.iterations
        reason = "no solution: it found no step that makes progress"
        if out and effort.in_time:
            reason = "Maximum_WallTime_Exceeded"
        elif out and effort.iterations == options.iterations:
            reason = "Maximum_Iterations_Exceeded"
        else:
            gave_up = True
    kept["exhausted"] = reason.startswith("Maximum_")
    status, words = _WORDS.get(reason, (Status.FAILED, f"the solver stopped with {reason}"))
    message = words.format(iterations=options.iterations, seconds=options.seconds)
    return Verdict(status, message, reason == NOT_FINITE, gave_up, kept)
