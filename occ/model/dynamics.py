"""The platform's dynamics as named CasADi functions and any derivative of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache, lru_cache

import casadi as ca
import numpy as np

from occ.errors import InputError
from occ.model.appell import derive
from occ.model.coefficients import PLATFORMS, coefficient_function, coefficients, packed_size, unpack
from occ.model.platform import Platform, parameter_names

STATE = ("x", "y", "heading", "velocity_x", "velocity_y", "yaw_rate")
"""Names of the state (x_O, y_O, psi, V_X, V_Y, Omega) [m, m, rad, m/s, m/s, rad/s]."""


def state_rate(heading: ca.SX, velocity: ca.SX, acceleration: ca.SX) -> ca.SX:
    """d/dt (x_O, y_O, psi, pi') = (V_X cos - V_Y sin, V_X sin + V_Y cos, Omega, pi''), eq. (2.1); result (6,)."""
    c, s = ca.cos(heading), ca.sin(heading)
    v_x, v_y, omega = ca.vertsplit(velocity)
    return ca.vertcat(v_x * c - v_y * s, v_x * s + v_y * c, omega, acceleration)


@cache
def parametric_functions(wheel_count: int) -> dict[str, ca.Function]:
    """All functions of the model with the platform's numbers as the last argument, ``parameters`` (4 + 10 n,).

    Args:
        wheel_count: n.

    Returns:
        Functions by name; arguments in the order (state, acceleration or torque or wrench, parameters).
    """
    model = derive(wheel_count)
    p = model.parameters
    state = ca.SX.sym("state", 6)
    torque = ca.SX.sym("torque", wheel_count)
    wrench = ca.SX.sym("wrench", 3)
    velocity = state[3:]
    matrices = coefficient_function(wheel_count)(p)
    inertia, rates, min_norm = matrices[0], matrices[5], matrices[6]
    friction_force = ca.substitute(model.friction_force, model.velocity, velocity)
    inertial = ca.substitute(model.inertial_force, model.velocity, velocity)
    gyroscopic = ca.substitute(inertial, model.acceleration, ca.SX.zeros(3))
    wheel_rates = ca.substitute(model.wheel_rates, model.velocity, velocity)
    roller_rates = ca.substitute(model.roller_rates, model.velocity, velocity)
    acceleration = ca.solve(inertia, rates.T @ torque - gyroscopic + friction_force)
    table: dict[str, tuple[list[ca.SX], list[str], ca.SX, str]] = {
        "wheel_rates": ([state, p], ["state", "parameters"], wheel_rates, "wheel_rates"),
        "roller_rates": ([state, p], ["state", "parameters"], roller_rates, "roller_rates"),
        "inertia_matrix": ([state, p], ["state", "parameters"], inertia, "inertia"),
        "gyroscopic": ([state, p], ["state", "parameters"], gyroscopic, "wrench"),
        "friction": ([state, p], ["state", "parameters"], friction_force, "wrench"),
        "input_map": ([state, p], ["state", "parameters"], rates.T, "map"),
        "forward": (
            [state, torque, p],
            ["state", "torque", "parameters"],
            state_rate(state[2], velocity, acceleration),
            "state_rate",
        ),
        "inverse": (
            [state, model.acceleration, p],
            ["state", "acceleration", "parameters"],
            inertial - friction_force,
            "wrench",
        ),
        "min_norm_torque": ([wrench, p], ["wrench", "parameters"], min_norm @ wrench, "torque"),
        "wheel_power": ([state, torque, p], ["state", "torque", "parameters"], torque * wheel_rates, "wheel_power"),
        "power": ([state, torque, p], ["state", "torque", "parameters"], ca.dot(torque, wheel_rates), "power"),
        "kinetic_energy": (
            [state, p],
            ["state", "parameters"],
            ca.substitute(model.kinetic_energy, model.velocity, velocity),
            "energy",
        ),
    }
    return {
        name: ca.Function(name, arguments, [expression], names, [output])
        for name, (arguments, names, expression, output) in table.items()
    }


@cache
def forward_function(wheel_count: int) -> ca.Function:
    """d/dt (x_O, y_O, psi, pi') with pi'' = A^-1 (C_phi^T M - f - Z pi'), eqs. (2.1), (2.16), of any such platform.

    Args:
        wheel_count: n.

    Returns:
        CasADi function (coefficients (45 + 6 n + n (n - 3),), state (6,), torque (n,) [N m]) -> d(state)/dt (6,).
    """
    packed = ca.SX.sym("coefficients", packed_size(wheel_count))
    state, torque = ca.SX.sym("state", 6), ca.SX.sym("torque", wheel_count)
    velocity = state[3:]
    rate = state_rate(state[2], velocity, unpack(packed, wheel_count).acceleration(velocity, torque))
    return ca.Function("forward", [packed, state, torque], [ca.densify(rate)])


class _Frozen(Mapping[str, ca.Function]):
    """The functions of a model at one platform's numbers, each made when it is first asked for."""

    def __init__(self, parametric: Mapping[str, ca.Function], numbers: np.ndarray) -> None:
        self._parametric, self._numbers = parametric, numbers
        self._made: dict[str, ca.Function] = {}

    def __getitem__(self, name: str) -> ca.Function:
        if name not in self._made:
            self._made[name] = self.freeze(self._parametric[name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parametric)

    def __len__(self) -> int:
        return len(self._parametric)

    def freeze(self, function: ca.Function) -> ca.Function:
        """A function whose last argument are the platform's numbers, without it."""
        arguments = [function.sx_in(i) for i in range(function.n_in() - 1)]
        results = function.call([*arguments, ca.SX(ca.DM(self._numbers))])
        names = [function.name_in(i) for i in range(function.n_in() - 1)]
        return ca.Function(function.name(), arguments, results, names, [function.name_out(0)])


class Dynamics:
    """Named CasADi functions of one platform: A pi'' + f - Pi_F = C_phi^T M, eq. (2.16).

    ``functions[name]``, or the attribute of that name:

    ================ ============================== =============================================
    name             arguments                      result
    ================ ============================== =============================================
    wheel_rates      state (6,)                     phi' (n,) [rad/s], eq. (2.4)
    roller_rates     state (6,)                     gamma' (n,) [rad/s], eq. (2.4)
    inertia_matrix   state (6,)                     A (3, 3) [kg, kg m, kg m^2], eq. (2.16)
    gyroscopic       state (6,)                     f (3,) [N, N, N m], eq. (2.16)
    friction         state (6,)                     Pi_F (3,) [N, N, N m], eq. (2.11)
    input_map        state (6,)                     C_phi^T (3, n), eq. (2.12)
    forward          state (6,), torque (n,) [N m]  d(state)/dt (6,)
    inverse          state (6,), acceleration (3,)  Pi_C (3,) [N, N, N m], eqs. (2.13)-(2.15)
    min_norm_torque  wrench (3,)                    M (n,) [N m], after eq. (3.13)
    wheel_power      state (6,), torque (n,)        M_i phi_i' (n,) [W]
    power            state (6,), torque (n,)        sum of the wheels' powers [W]
    kinetic_energy   state (6,)                     T [J]
    ================ ============================== =============================================

    The inertia matrix and the input map do not depend on the state; they take it because CasADi returns something else
    from a function without arguments.

    Args:
        platform: whose numbers are frozen into the functions.
    """

    def __init__(self, platform: Platform) -> None:
        self.platform = platform
        self._parametric = parametric_functions(platform.wheel_count)
        self.functions = _Frozen(self._parametric, platform.parameters())
        self.coefficients = unpack(ca.DM(coefficients(platform)), platform.wheel_count)

    def __getattr__(self, name: str) -> ca.Function:
        if name.startswith("_") or name == "functions":
            raise AttributeError(name)
        try:
            return self.functions[name]
        except KeyError:
            raise AttributeError(f"Dynamics has no function {name!r}; it has {', '.join(self.functions)}") from None

    def jacobian(self, of: str, wrt: str) -> ca.Function:
        """d(of)/d(wrt) as a CasADi function of the same arguments as ``of``, at this platform's numbers.

        Args:
            of: name of a function; matrices are taken column by column.
            wrt: one of its arguments, ``parameters`` for all numbers of the platform, or one of `parameter_names`.

        Returns:
            CasADi function with one output of shape (size of ``of``, size of ``wrt``).

        Raises:
            InputError: an unknown name; the message names the nearest valid one.
        """
        if of not in self._parametric:
            raise InputError(_unknown("function", of, list(self._parametric)))
        function = self._parametric[of]
        arguments = [function.sx_in(i) for i in range(function.n_in())]
        names = [function.name_in(i) for i in range(function.n_in())]
        single = parameter_names(self.platform.wheel_count)
        if wrt not in names and wrt not in single:
            raise InputError(_unknown(f"variable of {of}", wrt, [*names, *single]))
        value = ca.vec(ca.densify(function.call(arguments)[0]))
        # CasADi differentiates with respect to a whole symbol only, so one number is a column of the whole.
        whole = arguments[names.index(wrt)] if wrt in names else arguments[-1]
        derivative = ca.jacobian(value, whole)
        if wrt not in names:
            derivative = derivative[:, single.index(wrt)]
        name = f"d_{of}_d_{wrt}"
        return self.functions.freeze(ca.Function(name, arguments, [derivative], names, ["jacobian"]))


def _unknown(kind: str, name: str, valid: list[str]) -> str:
    near = get_close_matches(name, valid, 1)
    hint = f"; did you mean {near[0]!r}?" if near else f"; valid: {', '.join(valid)}"
    return f"unknown {kind} {name!r}{hint}"


@lru_cache(maxsize=PLATFORMS)
def dynamics(platform: Platform) -> Dynamics:
    """The dynamics of a platform, built once in a process for each of the latest platforms."""
    return Dynamics(platform)


@lru_cache(maxsize=PLATFORMS)
def friction_time(platform: Platform) -> float:
    """1 / max |eigenvalue of A^-1 Z|: the shortest time in which friction alone stops a motion.

    Args:
        platform: any platform.

    Returns:
        [s]; infinite without friction.
    """
    k = unpack(ca.DM(coefficients(platform)), platform.wheel_count)
    fastest = np.abs(np.linalg.eigvals(np.linalg.solve(np.array(k.inertia), np.array(k.friction)))).max()
    return float(1.0 / fastest) if fastest > 0 else np.inf
