"""Closed forms at many points: where the law ends up, what that costs, and the least that any motion costs."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from occ.atlas.motion import keeps_rotating
from occ.atlas.points import Points
from occ.atlas.variables import CRITICAL, MISSING, ROTATIONAL, STEADY, UNSTABLE, place
from occ.model.coefficients import coefficient_function
from occ.model.constraint import path_functions
from occ.numeric import on_arrays
from occ.theory.asymptotics import asymptotic_period
from occ.theory.circle import CircleQuantities, circle_quantities, side_of_critical
from occ.theory.coefficients import YawCoefficients
from occ.theory.dissipation import circle_energy
from occ.theory.equation import ScaledEquation
from occ.theory.law_power import rotations
from occ.theory.long_run import long_run, switch_radius
from occ.theory.stability import eigenvalues

Columns = dict[str, np.ndarray]


def long_run_columns(points: Points) -> tuple[Columns, list[tuple[int, str]]]:
    """Every variable of `occ.atlas.variables.LONG_RUN` at each point.

    Args:
        points: any number of circles.

    Returns:
        (N,) each, texts as places, and number and reason of the points whose law has no value.
    """
    c, radius, rate = points.coefficients, points.radius, points.rate
    q, side = _quantities(c, radius, rate)
    energy = circle_energy(c, radius, rate)
    with np.errstate(invalid="ignore"):  # where there is no steady rotation
        roots = eigenvalues(q.stable_damping, q.stiffness)
    leading = np.take_along_axis(roots, np.argmax(roots.real, axis=0)[None], axis=0)[0]
    regime = np.array([place(CRITICAL), place(STEADY), place(ROTATIONAL)])[side]
    with np.errstate(invalid="ignore"):
        law_regime = np.where((regime == place(STEADY)) & ~(q.stable_damping > 0), place(UNSTABLE), regime)
    eq = ScaledEquation(rate, np.sign(rate) * q.epsilon, q.radius_ratio, q.k, q.alpha, q.beta - q.alpha)
    candidates = np.flatnonzero(law_regime == place(STEADY))
    rotates, unknown = keeps_rotating(c.of(candidates), eq.of(candidates), points.of(candidates))
    law_regime[candidates[rotates]] = place(ROTATIONAL)
    reasons = [(int(candidates[i]), reason) for i, reason in unknown]
    law_regime[[i for i, _ in reasons]] = place(MISSING)
    settled = (law_regime != place(UNSTABLE)) & (law_regime != place(MISSING))
    power = np.where(settled, energy.dissipation(q.stable_heading, rate), np.nan)
    turning = np.flatnonzero(law_regime == place(ROTATIONAL))
    period, mean_yaw_rate = np.full(len(points), np.nan), np.where(settled, rate, np.nan)
    asymptotic = period.copy()
    if turning.size:
        some = eq.of(turning)
        found = rotations(circle_energy(c.of(turning), radius[turning], rate[turning]), some)
        power[turning], period[turning], mean_yaw_rate[turning] = found
        inside = some.ratio < 1
        asymptotic[turning[inside]] = asymptotic_period(some.of(inside))
    best = long_run(energy)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = 100 * (power - best.mean_power) / best.mean_power
    columns = {
        "critical_radius_m": q.critical_radius,
        "critical_speed_m_s": q.critical_speed,
        "alpha_rad": q.alpha,
        "beta_rad": q.beta,
        "epsilon": q.epsilon,
        "radius_ratio": q.radius_ratio,
        "regime": regime.astype(np.int8),
        "stable_psi_tilde_rad": q.stable_heading,
        "unstable_psi_tilde_rad": q.unstable_heading,
        "eigenvalue_real_1_s": leading.real,
        "eigenvalue_imaginary_1_s": np.abs(leading.imag),
        "law_regime": law_regime.astype(np.int8),
        "period_s": period,
        "period_asymptotic_s": asymptotic,
        "mean_yaw_rate_rad_s": mean_yaw_rate,
        "law_mean_power_W": power,
        "law_torque_Nm": steady_torque(points, q),
        "least_mean_power_W": best.mean_power,
        "least_mean_power_regime": np.where(best.steady, place(STEADY), place(ROTATIONAL)).astype(np.int8),
        "optimal_switch_radius_m": _switch_radius(points, c),
        "long_run_gap_percent": gap,
        "platform_speed_m_s": radius * np.abs(rate),
    }
    return columns, reasons


def _quantities(c: YawCoefficients, radius: np.ndarray, rate: np.ndarray) -> tuple[CircleQuantities, np.ndarray]:
    """The quantities of circles and their sides of the critical radius (N,); the roots there are those at R~_B."""
    q = circle_quantities(c, radius, rate)
    side = side_of_critical(q.radius_ratio)
    if np.all(side):
        return q, side
    # Rounding must not take the one root away.
    roots = circle_quantities(c, np.where(side == 0, q.critical_radius, radius), rate)
    return roots._replace(radius_ratio=q.radius_ratio, k=q.k), side


def _switch_radius(points: Points, c: YawCoefficients) -> np.ndarray:
    """It depends on platform and point B only, which many points, and most blocks of an atlas, share."""
    _, place_of = np.unique(points.point[0] + 1j * points.point[1], return_inverse=True)
    _, first, back = np.unique(
        place_of * len(points.parameters) + points.platform, return_index=True, return_inverse=True
    )
    return _switch_radii(np.array(c.of(first)).tobytes())[back]


@lru_cache(maxsize=16)
def _switch_radii(coefficients: bytes) -> np.ndarray:
    return switch_radius(YawCoefficients(*np.frombuffer(coefficients).reshape(len(YawCoefficients._fields), -1)))


def steady_torque(points: Points, q: CircleQuantities) -> np.ndarray:
    """max_i |M_i| of least norm in the law's steady rotation, eqs. (3.11)-(3.13) at Omega = omega_B, Omega' = 0.

    Args:
        points: of the circles.
        q: of the same circles.

    Returns:
        (N,) [N m]; NaN where there is no steady rotation.
    """
    torque = np.full(len(points), np.nan)
    rows = np.flatnonzero(np.isfinite(q.stable_heading))
    if not rows.size:
        return torque
    # With the program seen from its own radius the heading is psi~, and velocity and acceleration are along the axes.
    radius, rate = points.radius[rows], points.rate[rows]
    packed = np.array([_packed(points.wheel_count, numbers) for numbers in points.parameters])
    (torques,) = on_arrays(
        path_functions(points.wheel_count)["torque"],
        packed[0] if len(packed) == 1 else packed[points.platform[rows]].T,
        points.point[:, rows],
        (q.stable_heading[rows],),
        (rate,),
        (0.0, radius * rate),
        (-radius * rate**2, 0.0),
        (0.0,),
        np.zeros(points.wheel_count - 3),
    )
    torque[rows] = np.abs(torques).max(axis=0)
    return torque


def _packed(wheel_count: int, numbers: np.ndarray) -> np.ndarray:
    """`occ.model.coefficients.coefficients` of a platform's numbers; no null torque is asked for."""
    matrices = [np.array(matrix) for matrix in coefficient_function(wheel_count)(numbers)]
    matrices.append(np.zeros((wheel_count, wheel_count - 3)))
    return np.concatenate([matrix.ravel(order="F") for matrix in matrices])
