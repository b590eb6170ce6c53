"""Figs. 4, 8, 9 and 10: motions of the platform while B goes round its circle, and their work."""

from __future__ import annotations

import math

import numpy as np

from occ.laws import PathKeepingLaw, PrescribedRotation, ServoLaw
from occ.model.presets import youbot
from occ.objectives import INTEGRALS
from occ.paper.claims import best_turning_heading
from occ.paper.motions import Run, Simulated, platform_coefficients, replay_of, simulate
from occ.paper.numbers import RADIUS, RATE
from occ.paper.tables import CHOSEN, COMPUTED, PRINTED, FigureData, frame
from occ.theory.circle import circle_quantities
from occ.theory.stability import singular_point

HORIZON = 30.0
"""[s] Of Figs. 4, 9 and 10; chosen."""
SAMPLES = 301
CRITICAL_LAPS = 6
"""Of Fig. 8; chosen so that the extra turn is over."""
CRITICAL_STARTS = (0.0, -0.2)
"""[rad] psi~(0) of Fig. 8."""


def steady_rotation() -> FigureData:
    """Fig. 4: paths, yaw rate, Delta psi, forces and torques on the way into the stable steady rotation.

    Returns:
        A row for each time, from the full model.
    """
    steady = float(circle_quantities(platform_coefficients(), RADIUS, RATE).stable_heading)
    motion = simulate(Run(radius=RADIUS, duration=HORIZON), np.linspace(0, HORIZON, SAMPLES))
    columns = _time_history(motion) | {"heading_deviation_rad": motion.psi_tilde - steady}
    return FigureData(frame([columns]), [motion.agreement(4, "law")])


def near_translation() -> FigureData:
    """Fig. 9: the same with B at the point (4.20), where the platform hardly turns.

    Returns:
        A row for each time, from the full model.
    """
    point = singular_point(youbot(), RATE)
    motion = simulate(Run(radius=RADIUS, duration=HORIZON, point=point), np.linspace(0, HORIZON, SAMPLES))
    columns = _time_history(motion) | {"point_x_m": point[0], "point_y_m": point[1]}
    return FigureData(frame([columns]), [motion.agreement(9, "law")])


def _time_history(motion: Simulated) -> dict[str, np.ndarray | float | str]:
    samples, (x, y, heading) = motion.samples, motion.samples.state[:3]
    b_x, b_y = motion.run.task.point_motion(samples.state)[0]
    names = ("force_x_N", "force_y_N", "yaw_moment_Nm")
    return {
        "time_s": samples.t,
        "centre_x_m": x,
        "centre_y_m": y,
        "point_x_floor_m": b_x,
        "point_y_floor_m": b_y,
        "heading_rad": heading,
        "yaw_rate_rad_s": samples.state[5],
        **dict(zip(names, motion.wrench, strict=True)),
        **{f"torque_{i + 1}_Nm": torque for i, torque in enumerate(samples.torque)},
        "radius_m": motion.run.radius,
        "radius_source": PRINTED,
        "horizon_source": CHOSEN,
    }


def critical_starts() -> FigureData:
    """Fig. 8: paths of O for two starts beside the stable-unstable rotation, at R_B = R~_B.

    Returns:
        A row for each start and time, from the full model.
    """
    c = platform_coefficients()
    radius = float(circle_quantities(c, RADIUS, RATE).critical_radius)
    lap = 2 * math.pi / abs(RATE)
    t = np.linspace(0, CRITICAL_LAPS * lap, 100 * CRITICAL_LAPS + 1)
    parts, agreement = [], []
    for number, start in enumerate(CRITICAL_STARTS, 2):
        motion = simulate(Run(radius=radius, duration=float(t[-1]), psi_tilde=start), t)
        agreement.append(motion.agreement(8, f"psi~(0) = {start}"))
        parts.append(
            {
                "curve": number,
                "psi_tilde_0_rad": start,
                "time_s": t,
                "centre_x_m": motion.samples.state[0],
                "centre_y_m": motion.samples.state[1],
                "psi_tilde_rad": motion.psi_tilde,
                "radius_m": radius,
                "radius_source": COMPUTED,
            }
        )
    return FigureData(frame(parts), agreement)


def work_of_laws() -> FigureData:
    """Fig. 10: work of the control forces of the four motions of section 5, and of the best steady rotation.

    Returns:
        A row for each time, from the full model under each motion's torques.
    """
    t = np.linspace(0, HORIZON, SAMPLES)
    task = Run(radius=RADIUS, duration=HORIZON).task
    best = best_turning_heading()
    laws: dict[str, PathKeepingLaw] = {
        "law_J": ServoLaw(),
        "translation_J": PrescribedRotation(rate=0.0),
        "turning_J": PrescribedRotation(rate="program"),
        "turning_backwards_J": PrescribedRotation(rate="program", heading=math.pi),
        "turning_best_J": PrescribedRotation(rate="program", heading=best),
    }
    work = list(INTEGRALS).index("work")
    columns = {name: replay_of(task, law).samples().accumulated(t)[work] for name, law in laws.items()}
    motion = simulate(Run(radius=RADIUS, duration=HORIZON), t)
    table = frame([{"time_s": t, **columns, "best_heading_rad": best, "radius_m": RADIUS, "horizon_source": CHOSEN}])
    return FigureData(table, [motion.agreement(10, "law")])
