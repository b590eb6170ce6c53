"""The true motion under a control: the platform's own dynamics, integrated independently of every player."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import casadi as ca
import numpy as np

from occ.control import Control, HeldControl
from occ.model.coefficients import coefficients, packed_size, unpack
from occ.model.dynamics import friction_time, state_rate
from occ.model.platform import Platform
from occ.numeric import BufferedFunction, evaluate_many
from occ.objectives import measure_function
from occ.trajectory import lagrange_basis

LARGEST_STATE = 1e6
LARGEST_RATE = 1e12
"""A state, or its rate, beyond these (SI) or not a number is reported as unstable."""
SAME_TIME = 1e-12
"""A sample this near to the end of the horizon, relative to it, is none."""


@dataclass(frozen=True, kw_only=True)
class ReplaySettings:
    """How finely the referee looks.

    Args:
        tolerance: of the integrator, relative and, in SI units, absolute.
        nodes: of the Gauss-Lobatto rule on each step of the integrator.
        longest_step: of the integrator, in units of the platform's shortest time constant of friction: an explicit
            method works at the border of its stability otherwise, where its error estimate is blind.
    """

    tolerance: float = 1e-12
    nodes: int = 8
    longest_step: float = 1.5


class ReplayError(Exception):
    """The integration cannot be finished; carries the time [s] and the reason."""

    def __init__(self, t: float, reason: str) -> None:
        super().__init__(f"{reason} at t = {t:.6g} s")


@cache
def _forward(wheel_count: int) -> ca.Function:
    """CasADi function (coefficients, state, torque) -> d(state)/dt."""
    packed = ca.SX.sym("coefficients", packed_size(wheel_count))
    state, torque = ca.SX.sym("state", 6), ca.SX.sym("torque", wheel_count)
    acceleration = unpack(packed, wheel_count).acceleration(state[3:], torque)
    return ca.Function("forward", [packed, state, torque], [ca.densify(state_rate(state[2], state[3:], acceleration))])


@cache
def _energies(wheel_count: int) -> ca.Function:
    """CasADi function (coefficients, state) -> T, pi'^T Z pi', phi'."""
    packed, state = ca.SX.sym("coefficients", packed_size(wheel_count)), ca.SX.sym("state", 6)
    k, velocity = unpack(packed, wheel_count), state[3:]
    outputs = [k.kinetic_energy(velocity), ca.bilin(k.friction, velocity, velocity), k.wheel_rates @ velocity]
    return ca.Function("energies", [packed, state], [ca.densify(x) for x in outputs])


@dataclass(frozen=True)
class Samples:
    """A motion on quadrature nodes: integral of g dt = sum of weight * g.

    Args:
        t: (N,) [s] nodes, increasing; a panel's end and the next one's beginning are both there.
        weight: (N,) [s].
        state: (6, N).
        torque: (n, N) [N m].
        wheel_rates: (n, N) [rad/s].
        kinetic_energy: (N,) [J].
        dissipation: (N,) [W] pi'^T Z pi'.
        integrands: (m, N) of all integral objectives, in the order of INTEGRALS.
        nodes: of each panel; N is a multiple of it.
    """

    t: np.ndarray
    weight: np.ndarray
    state: np.ndarray
    torque: np.ndarray
    wheel_rates: np.ndarray
    kinetic_energy: np.ndarray
    dissipation: np.ndarray
    integrands: np.ndarray
    nodes: int

    @property
    def power(self) -> np.ndarray:
        """(n, N) [W] M_i phi_i'."""
        return self.torque * self.wheel_rates

    def accumulated(self, t: np.ndarray) -> np.ndarray:
        """Integrals of the integrands from 0 to t, by their interpolation polynomials in each panel.

        Args:
            t: (K,) [s] inside the horizon.

        Returns:
            (m, K).
        """
        count = self.nodes
        panels = self.t.reshape(-1, count)
        values = self.integrands.reshape(len(self.integrands), -1, count)
        sums = (values * self.weight.reshape(-1, count)).sum(axis=2)
        before = np.concatenate([np.zeros((len(sums), 1)), np.cumsum(sums, axis=1)], axis=1)
        k = np.clip(np.searchsorted(panels[:, 0], t, side="right") - 1, 0, len(panels) - 1)
        width = panels[k, -1] - panels[k, 0]
        s = (t - panels[k, 0]) / width
        x, w = np.polynomial.legendre.leggauss(count)
        places = s[:, None] * (x + 1) / 2
        basis = lagrange_basis(gauss_lobatto(count)[0], places.ravel()).reshape(count, len(t), count)
        inside = np.einsum("mkj,jkq,q->mk", values[:, k], basis, w / 2) * s * width
        return before[:, k] + inside


class Replay:
    """x(t): the motion of a platform under a control from a start state.

    Args:
        platform: the plant.
        control: the wheel torques.
        start: (6,) x(0).
        duration: [s] T.
        settings: tolerances.
        sample_rate: [Hz] at which the control sees the state, its torques being held in between; None is always.

    Raises:
        ReplayError: the state grows beyond any physical value, is not finite, or the integrator gives up.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5 and II.6 (DOP853, dense output).
    """

    def __init__(
        self,
        platform: Platform,
        control: Control,
        start: np.ndarray,
        duration: float,
        settings: ReplaySettings | None = None,
        sample_rate: float | None = None,
    ) -> None:
        self.platform, self.control, self.duration = platform, control, duration
        self.settings = settings or ReplaySettings()
        knots = control.knots if sample_rate is None else np.arange(1, duration * sample_rate) / sample_rate
        inner = knots[(knots > 0.0) & (knots < duration * (1 - SAME_TIME))]
        self.edges = np.concatenate([[0.0], inner, [duration]])
        self._longest_step = self.settings.longest_step * friction_time(platform)
        self._pieces = []
        state = np.asarray(start, dtype=float)
        held = []
        for begin, end in zip(self.edges[:-1], self.edges[1:], strict=True):
            torque = control.segment(begin, end)
            if sample_rate is not None:
                held.append(np.array(torque(begin, state)))
                torque = partial(_constant, held[-1])
            piece, state = self._integrate(begin, end, state, torque)
            self._pieces.append(piece)
        if sample_rate is not None:
            self.control = HeldControl(self.edges, np.column_stack(held))
        self.end_state = state

    def _integrate(
        self, begin: float, end: float, state: np.ndarray, torque: Callable[[float, np.ndarray], np.ndarray]
    ) -> tuple[Callable[..., np.ndarray], np.ndarray]:
        from scipy.integrate import solve_ivp

        forward = BufferedFunction(_forward(self.platform.wheel_count))
        forward.inputs[0][:] = coefficients(self.platform)
        _, state_in, torque_in = forward.inputs
        (result,) = forward.outputs

        def rate(t: float, x: np.ndarray) -> np.ndarray:
            torque_in[:] = torque(t, x)
            state_in[:] = x
            forward()
            if not (abs(result).max() < LARGEST_RATE and abs(x).max() < LARGEST_STATE):
                raise ReplayError(t, "the motion leaves every physical range")
            return result.copy()

        outcome = solve_ivp(
            rate,
            (begin, end),
            state,
            method="DOP853",
            dense_output=True,
            rtol=self.settings.tolerance,
            atol=self.settings.tolerance,
            max_step=min(self._longest_step, self.duration / 40),
        )
        if outcome.status != 0:
            raise ReplayError(float(outcome.t[-1]), "the step of the integrator shrinks to nothing")
        return outcome.sol, outcome.y[:, -1]

    def at(self, t: np.ndarray) -> np.ndarray:
        """x (6, N) at the times t (N,) [s]."""
        piece = np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, len(self._pieces) - 1)
        state = np.empty((6, len(t)))
        for k in np.unique(piece):
            chosen = piece == k
            state[:, chosen] = self._pieces[k](t[chosen])
        return state

    def sample(self, t: np.ndarray) -> Samples:
        """Motion, torques and energies at any times t (N,) [s]; the weights are zero."""
        return self._evaluate(t, np.zeros(len(t)), self.at(t), 1)

    def samples(self) -> Samples:
        """The motion on the nodes of a Gauss-Lobatto rule on every step, split where an integrand has a kink."""
        first = self._quadrature(self._steps())
        kinks = self._kinks(first)
        crossings = self._crossings(first, kinks)
        if not crossings.size:
            return first
        return self._quadrature(np.unique(np.concatenate([self._steps(), crossings])))

    def _steps(self) -> np.ndarray:
        return np.unique(np.concatenate([piece.ts for piece in self._pieces]))  # type: ignore[attr-defined]

    def _quadrature(self, breaks: np.ndarray) -> Samples:
        nodes, weights = gauss_lobatto(self.settings.nodes)
        h = np.diff(breaks)
        t = (breaks[:-1, None] + h[:, None] * nodes).ravel()
        # Every panel lies in one piece; its right end belongs to it and not to the next piece.
        middle = (breaks[:-1] + breaks[1:]) / 2
        piece = np.repeat(np.clip(np.searchsorted(self.edges, middle) - 1, 0, len(self._pieces) - 1), len(nodes))
        state = np.empty((6, len(t)))
        torque = np.empty((self.platform.wheel_count, len(t)))
        for k in np.unique(piece):
            chosen = piece == k
            state[:, chosen] = self._pieces[k](t[chosen])
            torque[:, chosen] = self._torque_on(k, t[chosen], state[:, chosen])
        return self._evaluate(t, (h[:, None] * weights).ravel(), state, len(nodes), torque)

    def _torque_on(self, k: int, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        """Torques inside piece k: its right end is moved inwards by one rounding unit, so that the piece's own signal
        is taken."""
        inside = np.nextafter(self.edges[k + 1], self.edges[k]) if k + 2 < len(self.edges) else self.edges[k + 1]
        return self.control.torque(np.minimum(t, inside), state)

    def _evaluate(
        self, t: np.ndarray, weight: np.ndarray, state: np.ndarray, nodes: int, torque: np.ndarray | None = None
    ) -> Samples:
        wheels = self.platform.wheel_count
        if torque is None:
            torque = self.control.torque(t, state)
        packed = coefficients(self.platform)
        kinetic, dissipation, rates = evaluate_many(_energies(wheels), packed, state, shared=(0,))
        integrands, _ = evaluate_many(measure_function(wheels), torque, rates)
        return Samples(t, weight, state, torque, rates, kinetic[0], dissipation[0], integrands, nodes)

    def _kinks(self, samples: Samples) -> np.ndarray:
        return evaluate_many(measure_function(self.platform.wheel_count), samples.torque, samples.wheel_rates)[1]

    def _crossings(self, samples: Samples, kinks: np.ndarray) -> np.ndarray:
        """(K,) [s] Times at which a kink expression changes its sign, all brackets at once."""
        from scipy.optimize.elementwise import find_root

        same_panel = np.arange(len(samples.t) - 1) % samples.nodes != samples.nodes - 1
        row, column = np.nonzero((kinks[:, :-1] * kinks[:, 1:] < 0) & same_panel)
        if not row.size:
            return np.array([])

        def kink(t: np.ndarray, which: np.ndarray) -> np.ndarray:
            values = self._kinks(self.sample(t.ravel()))
            return values[which.ravel(), np.arange(t.size)].reshape(t.shape)

        result = find_root(kink, (samples.t[column], samples.t[column + 1]), args=(row,))
        return np.asarray(result.x[result.success])


def _constant(torque: np.ndarray, t: float, state: np.ndarray) -> np.ndarray:
    return torque


@cache
def gauss_lobatto(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of the Gauss-Lobatto rule on [0, 1], exact for polynomials of degree 2 count - 3.

    Args:
        count: at least 2.

    Returns:
        Nodes (count,) and weights (count,).

    Source: Abramowitz and Stegun, Handbook of Mathematical Functions, 25.4.32.
    """
    legendre = np.polynomial.legendre.Legendre.basis(count - 1)
    x = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    w = 2.0 / (count * (count - 1) * legendre(x) ** 2)
    return (x + 1) / 2, w / 2
