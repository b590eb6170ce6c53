"""The same allocation written as it is meant, in CVXPY: for tests and for readers."""

from __future__ import annotations

import numpy as np

from occ.allocation.input_map import InputMap
from occ.allocation.result import checked


def least_norm(wheels: InputMap, wrench: np.ndarray, limit: float) -> np.ndarray | None:
    """min |M|^2 subject to C_phi^T M = Pi, |M_i| <= limit.

    Args:
        wheels: the input map.
        wrench: (3,) [N, N, N m].
        limit: [N m].

    Returns:
        (n,) [N m], or None where the wrench is out of reach.

    Raises:
        InputError: a wrench that is not finite or not (3,), or a limit that is not positive.
    """
    import cvxpy as cp

    pi, box = checked(wheels, np.asarray(wrench)[..., None], limit)
    torque = cp.Variable(wheels.wheel_count)
    # In units of the limit, so that the solver's tolerances are parts of it.
    made = wheels.wheel_rates.T @ torque
    problem = cp.Problem(cp.Minimize(cp.sum_squares(torque)), [made == pi[:, 0] / box, cp.abs(torque) <= 1])
    problem.solve(solver=cp.CLARABEL)
    return None if torque.value is None else np.asarray(torque.value) * box


def least_peak(wheels: InputMap, wrench: np.ndarray) -> float:
    """min max_i |M_i| subject to C_phi^T M = Pi.

    Args:
        wheels: the input map.
        wrench: (3,) [N, N, N m].

    Returns:
        [N m].

    Raises:
        InputError: a wrench that is not finite or not (3,).
    """
    import cvxpy as cp

    pi, _ = checked(wheels, np.asarray(wrench)[..., None], 1.0)
    torque = cp.Variable(wheels.wheel_count)
    problem = cp.Problem(cp.Minimize(cp.norm_inf(torque)), [wheels.wheel_rates.T @ torque == pi[:, 0]])
    return float(problem.solve(solver=cp.CLARABEL))
