"""x' = f(t, x, M): the platform's own dynamics under a control, ready to be integrated piece by piece."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache

import casadi as ca
import numpy as np

from occ.control import Control, SymbolicControl
from occ.integration import CompiledStep, PythonStep, Step
from occ.model.coefficients import PLATFORMS, coefficients, packed_size, unpack
from occ.model.dynamics import state_rate
from occ.model.platform import Platform
from occ.numeric import BufferedFunction

Enter = Callable[[int, np.ndarray], None]
"""Told, before each piece, its number and the state at its beginning."""


def smooth(platform: Platform, control: Control, edges: np.ndarray, tolerance: float) -> tuple[Step, Enter]:
    """M = M(t, x) on pieces at whose ends it may jump.

    Args:
        platform: the plant.
        control: the wheel torques.
        edges: (K + 1,) [s] ends of the pieces.
        tolerance: of the steps.

    Returns:
        Steps of the motion, and what is to be told before each piece.
    """
    if type(control) is SymbolicControl and control.law.is_a("SXFunction"):
        return _compiled(platform, control, edges, tolerance)
    forward = BufferedFunction(_forward(platform.wheel_count))
    forward.inputs[0][:] = _constants(platform)
    _, state_in, torque_in = forward.inputs
    (result,) = forward.outputs
    torque = control.segment(*edges[:2])

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        torque_in[:] = torque(t, x)
        state_in[:] = x
        forward()
        return result.copy()

    def enter(k: int, state: np.ndarray) -> None:
        nonlocal torque
        torque = control.segment(edges[k], edges[k + 1])

    return PythonStep(rate, tolerance), enter


def held(
    platform: Platform, control: Control, edges: np.ndarray, tolerance: float
) -> tuple[Step, Enter, list[np.ndarray]]:
    """M = M(t_k, x(t_k)) on each piece, which begins at t_k: what a sampled control does.

    Args:
        platform: the plant.
        control: the wheel torques.
        edges: (K + 1,) [s] the samples, and the end.
        tolerance: of the steps.

    Returns:
        Steps of the motion, what is to be told before each piece, and the torques (n,) [N m] of the pieces that were
        told.
    """
    wheels = platform.wheel_count
    step = CompiledStep(_rate(None, wheels, wheels, 1), tolerance)
    constants, scale = _constants(platform), np.array([0.0, 1.0])
    torques: list[np.ndarray] = []

    def enter(k: int, state: np.ndarray) -> None:
        torques.append(np.array(control.segment(edges[k], edges[k + 1])(edges[k], state)))
        step.parameters(np.concatenate([constants, scale, torques[-1]]))

    return step, enter, torques


def _compiled(
    platform: Platform, control: SymbolicControl, edges: np.ndarray, tolerance: float
) -> tuple[CompiledStep, Enter]:
    signal = control.signal
    count, degree = (0, 0) if signal is None else (len(signal.values), len(signal.nodes))
    step = CompiledStep(_rate(control.law, platform.wheel_count, count, degree), tolerance)
    constants = np.concatenate([_constants(platform), control.data])
    middles = (edges[:-1] + edges[1:]) / 2

    def enter(k: int, state: np.ndarray) -> None:
        if signal is None:
            step.parameters(np.concatenate([constants, [0.0, 1.0]]))
            return
        i = signal.interval(middles[k])
        begin, end = signal.edges[i], signal.edges[i + 1]
        scale = np.array([(begin + end) / 2, (end - begin) / 2])
        step.parameters(np.concatenate([constants, scale, signal.powers[:, i].ravel()]))

    return step, enter


@lru_cache(maxsize=PLATFORMS)
def _constants(platform: Platform) -> np.ndarray:
    """The packed matrices of eq. (2.16) and A^-1, the first argument of `_forward`."""
    packed = coefficients(platform)
    inertia = np.array(unpack(ca.DM(packed), platform.wheel_count).inertia)
    return np.concatenate([packed, np.linalg.inv(inertia).ravel(order="F")])


@cache
def _forward(wheel_count: int) -> ca.Function:
    """CasADi function (constants, state, torque) -> d(state)/dt, eq. (2.16)."""
    size = packed_size(wheel_count)
    constants = ca.SX.sym("constants", size + 9)
    state, torque = ca.SX.sym("state", 6), ca.SX.sym("torque", wheel_count)
    k, velocity = unpack(constants[:size], wheel_count), state[3:]
    force = k.wheel_rates.T @ torque - k.gyroscopic_force(velocity) - k.friction @ velocity
    acceleration = ca.reshape(constants[size:], 3, 3) @ force
    return ca.Function(
        "forward", [constants, state, torque], [ca.densify(state_rate(state[2], velocity, acceleration))]
    )


@lru_cache(maxsize=32)
def _rate(law: ca.Function | None, wheel_count: int, signals: int, degree: int) -> ca.Function:
    """CasADi function (t, state, p) -> d(state)/dt under the torques law(t, state, u(t), data), or u where law is None.

    The parameters p are the platform's constants, the law's data, middle and half width of the interval of u, and the
    coefficients of u, signal by signal, in the powers of the time from the middle over the half width.
    """
    forward = _forward(wheel_count)
    sizes = [forward.numel_in(0), law.numel_in(3) if law else 0, 2, signals * degree]
    t, state, p = ca.SX.sym("t"), ca.SX.sym("state", 6), ca.SX.sym("p", sum(sizes))
    constants, data, scale, powers = ca.vertsplit(p, np.cumsum([0, *sizes]).tolist())
    signal = ca.SX(signals, 1)
    table = ca.reshape(powers, degree, signals).T
    for j in reversed(range(degree)):
        signal = signal * ((t - scale[0]) / scale[1]) + table[:, j]
    torque = law(t, state, signal, data) if law else signal
    return ca.Function("rate", [t, state, p], ca.cse([ca.densify(forward(constants, state, torque))]))
