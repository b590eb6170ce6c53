"""Sentences of the paper that a computation can confirm or refute."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from occ.laws import PathKeepingLaw, PrescribedRotation, ServoLaw
from occ.laws.base import law_motion, path_trajectory
from occ.model.presets import YouBot
from occ.motion import Circle
from occ.numeric import evaluate_many
from occ.paper.circle_formulas import CircleTruth
from occ.paper.formula import Check, claim
from occ.paper.numbers import PHASE, POINT, RADIUS, RATE
from occ.paper.printed import Printed
from occ.referee import judge
from occ.task import Start, Task
from occ.theory import circle_quantities, yaw_coefficients
from occ.theory.stability import singular_point, stable_radii

FAST = 250.0
"""[rad/s] A large |omega_B|."""
FASTEST_SPEED = 0.8
"""[m/s] Largest speed of the platform, section 4.1."""
PRINTED_CRITICAL_RADIUS = Printed("0.6485")
LAP = 2 * math.pi / abs(RATE)
LONG = 300.0
"""[s] In which the slow approach to a critical rotation shows to which one it goes."""
TOLERANCE = 1e-10


def paper_task(
    preset: YouBot, radius: float = RADIUS, point: tuple[float, float] = POINT, psi_tilde: float = -PHASE
) -> Task:
    """One lap of the paper's circle.

    Args:
        preset: the platform's parameters.
        radius: [m] R_B.
        point: (2,) [m] B.
        psi_tilde: [rad] psi~(0); the default is psi(0) = 0.

    Returns:
        The task, with Omega(0) = 0.
    """
    motion = Circle(radius=radius, rate=RATE, phase=PHASE)
    start = Start(heading=psi_tilde + PHASE)
    return Task(platform=preset.platform(), point=point, motion=motion, duration=LAP, start=start)


def claims(preset: YouBot) -> list[Check]:
    """The sentences of sections 4 and 5.

    Args:
        preset: the platform's parameters.

    Returns:
        In the order of the paper.
    """
    return [*_stability(preset), *_critical_starts(preset), *_translation(preset), *_work(preset)]


def _stability(preset: YouBot) -> Iterator[Check]:
    truth = CircleTruth(preset)
    rng = np.random.default_rng(11)
    speed = truth.spin[0]
    rate = rng.uniform(0.01, 300, 4000) * rng.choice([-1, 1], 4000)
    critical, alpha = truth.angles(rate)
    radius = critical * (1 + rng.exponential(1.0, 4000))
    root = np.sign(rate) * np.arccos(critical / radius) - alpha
    stable = truth.eigenvalues(root, radius, rate).real.max(axis=0) < 0
    c = yaw_coefficients(preset.platform(), POINT)
    within = radius * np.abs(rate) < speed
    yield claim("(4.8)", "sufficient for an asymptotically stable steady rotation", holds=bool(stable[within].all()))
    yield claim(
        "before Fig. 3",
        "all steady rotations unstable at large |omega_B|; right: those at -alpha + sign(omega_B) arccos(R~_B/R_B) are "
        "stable for every omega_B > 0, and for omega_B < 0 up to a radius R_c(omega_B) > R~_B",
        holds=not stable[np.abs(rate) > FAST].any(),
        otherwise=bool((stable == (radius < stable_radii(c, rate).upper)).all()),
    )
    yield claim(
        "before Fig. 3",
        f"V~_B is many times the largest speed 0.8 m/s (computed: {speed / FASTEST_SPEED:.0f} times)",
        holds=speed > 10 * FASTEST_SPEED,
    )
    light = CircleTruth(replace(preset, wheel_spin_inertia=0.0))
    psi = rng.uniform(-3, 3, 50)
    damping = -light.acceleration(psi, np.zeros(50), np.ones(50), np.full(50, RATE))[2]
    yield claim(
        "after (4.8)",
        "for J_1 = 0 the damping in (4.7) is xi_3",
        holds=bool(np.allclose(damping, light.yaw["xi_3"], rtol=1e-12, atol=0)),
    )
    threshold = float(truth.angles(RATE)[0])
    yield claim(
        "section 4.1, example",
        "the conditions (4.8) hold at R_B = 0.7 m, omega_B = -0.4 1/s, with R~_B and V~_B as printed and as computed",
        holds=max(threshold, 0.65) < RADIUS and RADIUS * abs(RATE) < min(speed, 26.58),
    )


def _critical_starts(preset: YouBot) -> Iterator[Check]:
    critical, alpha = CircleTruth(preset).angles(RATE)
    turns = []
    for radius in (float(critical), PRINTED_CRITICAL_RADIUS.number):
        for start in (0.0, -0.2):
            task = replace(paper_task(preset, radius, psi_tilde=start), duration=LONG)
            heading = _motion(ServoLaw(), task, np.array([0.0, LONG]))[0, 1]
            turns.append(round((heading - RATE * LONG - PHASE + float(alpha)) / (2 * math.pi)))
    yield claim(
        "before Fig. 8",
        "at R_B = R~_B (computed, printed) the platform makes an extra turn from psi~(0) = 0.0, and none from -0.2",
        holds=turns == [1, 0, 1, 0],
    )


def _motion(law: PathKeepingLaw, task: Task, t: np.ndarray) -> np.ndarray:
    """(3, N) heading, yaw rate and yaw acceleration."""
    motion, reason = law_motion(law, task, t, TOLERANCE)
    if motion is None:
        raise RuntimeError(reason)
    return motion


def _translation(preset: YouBot) -> Iterator[Check]:
    point = singular_point(preset.platform(), RATE)
    task = paper_task(preset, point=point)
    t = np.linspace(0, LAP, 400)
    near = _motion(ServoLaw(), task, t)
    fastest = float(np.abs(near[1]).max())
    yield claim(
        "end of section 4.3",
        f"Omega is negligible for B at (4.20) (computed: at most {fastest:.2e} 1/s)",
        holds=fastest < 1e-3 * abs(RATE),
    )
    forces = []
    for law, chosen in ((ServoLaw(), task), (PrescribedRotation(rate=0.0), paper_task(preset))):
        motion = _motion(law, chosen, t)
        forces.append(wrench(chosen, t, motion))
    apart = np.abs(forces[0] - forces[1]).max(axis=1) / np.abs(forces[1]).max(axis=1)
    yield claim(
        "section 5",
        f"the forces of the translation repeat those of Fig. 9 (computed: F_X and F_Y differ by {apart[:2].max():.1e}, "
        f"the small M_Omega by {apart[2]:.1e} of their peaks)",
        holds=bool(apart[:2].max() < 1e-3 and apart[2] < 0.05),
    )


def wrench(task: Task, t: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Pi_C = A pi'' + f + Z pi' along a motion with B on its program, by the derived model.

    Args:
        task: platform, point and program motion.
        t: (N,) [s].
        motion: (3, N) heading, yaw rate, yaw acceleration.

    Returns:
        (3, N) F_X [N], F_Y [N], M_Omega [N m].
    """
    path = path_trajectory(task, t, *motion)
    return evaluate_many(task.dynamics.inverse, path.state, path.state_rate[3:])[0]


def _work(preset: YouBot) -> Iterator[Check]:
    task = paper_task(preset)
    best = best_turning_heading(preset)
    steady = float(circle_quantities(yaw_coefficients(task.platform, POINT), RADIUS, RATE).stable_heading) + PHASE
    still = _lap_work(PrescribedRotation(rate=0.0), task)
    forwards, backwards, turning, settled = (
        _lap_work(PrescribedRotation(rate="program", heading=psi), task) for psi in (0.0, math.pi, best, steady)
    )
    law = _lap_work(ServoLaw(), task)
    yield claim(
        "end of section 5",
        f"psi = omega_B t needs less work than psi = omega_B t + 180 deg (computed: {forwards:.2f} and "
        f"{backwards:.2f} J per lap)",
        holds=forwards < backwards,
    )
    yield claim(
        "section 5, Fig. 10",
        f"the law needs the least work of the four motions of Fig. 10 (computed: {law:.2f} J per lap; translation "
        f"{still:.2f} J)",
        holds=law < min(still, forwards, backwards),
    )
    yield claim(
        "section 5",
        f"the law is the most preferable of all the laws considered, psi(0) arbitrary; right: psi = omega_B t + "
        f"{best:.4f} rad needs {turning:.2f} J per lap, less than the law from psi(0) = 0, {law:.2f} J, and than the "
        f"law in its steady rotation, {settled:.2f} J",
        holds=law < min(turning, still, forwards, backwards),
        otherwise=turning < min(law, settled),
    )


def best_turning_heading(preset: YouBot | None = None) -> float:
    """argmin over psi(0) of the work of psi = omega_B t + psi(0): the constant power pi'^T Z pi' is smallest.

    Args:
        preset: the platform's parameters; (2.17) by default.

    Returns:
        [rad] in (-pi, pi].
    """
    from scipy.optimize import minimize_scalar

    s = CircleTruth(preset or YouBot()).symbols

    def power(psi: float) -> float:
        v_x = RATE * (POINT[1] - RADIUS * math.cos(psi))
        v_y = RATE * (RADIUS * math.sin(psi) - POINT[0])
        return s.zeta_X * v_x**2 + s.zeta_Y * v_y**2

    grid = np.linspace(-math.pi, math.pi, 181)
    start = float(grid[np.argmin([power(psi) for psi in grid])])
    bounds = start - 0.1, start + 0.1
    return float(minimize_scalar(power, bounds=bounds, method="bounded", options={"xatol": 1e-12}).x)


def _lap_work(law: PathKeepingLaw, task: Task) -> float:
    """[J] One lap, by the referee."""
    return judge(task, law.solve(task)).measures["work_J"]
