"""The true motion under a control: the platform's own dynamics, integrated independently of every player."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache, cached_property

import casadi as ca
import numpy as np

from occ.control import Control, HeldControl
from occ.integration import Settings, integrate
from occ.model.coefficients import coefficients, packed_size, unpack
from occ.model.dynamics import friction_time
from occ.model.platform import Platform
from occ.numeric import evaluate_many
from occ.objectives import measure_function
from occ.referee.drive import held, smooth
from occ.trajectory import lagrange_basis

LARGEST_STATE = 1e6
"""A state beyond this (SI) or not a number is reported as unstable."""
PLACES = 49
"""In each panel at which signs are looked at."""
BISECTIONS = 28
"""Of the brackets of sign changes."""
ROUNDING = 1e-12
"""Part of the largest power below which the sign of a power is rounding."""
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
        nodes: of each panel; N is a multiple of it.
    """

    t: np.ndarray
    weight: np.ndarray
    state: np.ndarray
    torque: np.ndarray
    wheel_rates: np.ndarray
    kinetic_energy: np.ndarray
    dissipation: np.ndarray
    nodes: int

    @cached_property
    def _measured(self) -> list[np.ndarray]:
        return evaluate_many(measure_function(len(self.torque)), self.torque, self.wheel_rates)

    @property
    def integrands(self) -> np.ndarray:
        """(m, N) of all integral objectives, in the order of INTEGRALS."""
        return self._measured[0]

    @property
    def kinks(self) -> np.ndarray:
        """(k, N) What an integrand has a kink at the zeros of."""
        return self._measured[1]

    @property
    def power(self) -> np.ndarray:
        """(n, N) [W] M_i phi_i'."""
        return self.torque * self.wheel_rates

    def with_panels(self, replaced: np.ndarray, others: Samples) -> Samples:
        """These samples with other panels in the place of some.

        Args:
            replaced: numbers of the panels that are left out.
            others: panels that cover the same times.

        Returns:
            All of them in the order of their times.
        """
        count = self.nodes

        def joined(mine: np.ndarray, theirs: np.ndarray) -> np.ndarray:
            kept = np.delete(mine.reshape(*mine.shape[:-1], -1, count), replaced, axis=-2)
            both = np.concatenate([kept, theirs.reshape(*theirs.shape[:-1], -1, count)], axis=-2)
            return both[..., order, :].reshape(*mine.shape[:-1], -1)

        begins = np.concatenate([np.delete(self.t[::count], replaced), others.t[::count]])
        order = np.argsort(begins, kind="stable")
        names = [item.name for item in fields(self) if item.name != "nodes"]
        arrays = {name: joined(getattr(self, name), getattr(others, name)) for name in names}
        return Samples(**arrays, nodes=count)

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
        IntegrationError: the state grows beyond any physical value, is not finite, or the integrator gives up.

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
        torques = None
        if sample_rate is None:
            step, enter = smooth(platform, control, self.edges, self.settings.tolerance)
        else:
            step, enter, torques = held(platform, control, self.edges, self.settings.tolerance)
        longest = min(self.settings.longest_step * friction_time(platform), duration / 40)
        bounds = Settings(longest=longest, largest=np.full(6, LARGEST_STATE))
        self._motion = integrate(step, self.edges, np.array(start, dtype=float), bounds, enter)
        if torques is not None:
            self.control = HeldControl(self.edges, np.column_stack(torques))
        self.end_state = self._motion.last

    def at(self, t: np.ndarray) -> np.ndarray:
        """x (6, N) at the times t (N,) [s]."""
        return self._motion(t)

    def sample(self, t: np.ndarray) -> Samples:
        """Motion, torques and energies at any times t (N,) [s]; the weights are zero."""
        return self._evaluate(t, np.zeros(len(t)), self.at(t), 1)

    def samples(self) -> Samples:
        """The motion on the nodes of a Gauss-Lobatto rule on every step, split where an integrand has a kink."""
        edges = self._motion.edges
        states = self._motion.on_each(gauss_lobatto(self.settings.nodes)[0])
        first = self._quadrature(edges[:-1], edges[1:], states)
        panel, times = crossings(first)
        if not times.size:
            return first
        split = np.unique(panel)
        breaks = np.unique(np.concatenate([edges[split], edges[split + 1], times]))
        # Between two panels that are split there may be others.
        inside = np.isin(np.searchsorted(edges, (breaks[:-1] + breaks[1:]) / 2) - 1, split)
        return first.with_panels(split, self._quadrature(breaks[:-1][inside], breaks[1:][inside]))

    def _quadrature(self, begin: np.ndarray, end: np.ndarray, state: np.ndarray | None = None) -> Samples:
        nodes, weights = gauss_lobatto(self.settings.nodes)
        h = end - begin
        t = (begin[:, None] + h[:, None] * nodes).ravel()
        # Every panel lies in one piece: its right end belongs to it and not to the next piece, whose torques it would
        # take otherwise.
        piece = np.clip(np.searchsorted(self.edges, (begin + end) / 2) - 1, 0, len(self.edges) - 2)
        inside = np.nextafter(self.edges[1:], self.edges[:-1])
        inside[-1] = self.duration
        state = self.at(t) if state is None else state
        torque = self.control.torque(np.minimum(t, np.repeat(inside[piece], len(nodes))), state)
        return self._evaluate(t, (h[:, None] * weights).ravel(), state, len(nodes), torque)

    def _evaluate(
        self, t: np.ndarray, weight: np.ndarray, state: np.ndarray, nodes: int, torque: np.ndarray | None = None
    ) -> Samples:
        if torque is None:
            torque = self.control.torque(t, state)
        packed = coefficients(self.platform)
        kinetic, dissipation, rates = evaluate_many(_energies(self.platform.wheel_count), packed, state, shared=(0,))
        return Samples(t, weight, state, torque, rates, kinetic[0], dissipation[0], nodes)


def crossings(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Where a kink's expression changes its sign, by its polynomial on the panel's nodes.

    An integrand with a kink that is missed by d is integrated wrongly by the order of d^2, so that the polynomial is
    near enough by far.

    Args:
        samples: on whole panels.

    Returns:
        (K,) panels and (K,) [s] times inside them.
    """
    count = samples.nodes
    nodes = 2 * gauss_lobatto(count)[0] - 1
    to_powers = np.linalg.inv(np.vander(nodes, increasing=True)).T
    places = np.linspace(-1.0, 1.0, PLACES)
    kinks = samples.kinks.reshape(len(samples.kinks), -1, count)
    powers = kinks @ to_powers
    # What is zero but for rounding has no sign, and what is larger in the middle than all the rest has one.
    sizes = np.abs(powers)
    small = np.abs(kinks).max(axis=2) < ROUNDING * np.abs(kinks).max(initial=0.0)
    row, panel = np.nonzero((sizes[:, :, 0] <= (1 + ROUNDING) * sizes[:, :, 1:].sum(axis=2)) & ~small)
    between = powers[row, panel] @ np.vander(places, count, increasing=True).T
    changes, place = np.nonzero(between[:, :-1] * between[:, 1:] < 0)
    row, panel = row[changes], panel[changes]
    own = powers[row, panel].T
    low, high, rising = places[place], places[place + 1], between[changes, place] < 0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        after = (np.polynomial.polynomial.polyval(middle, own, tensor=False) < 0) != rising
        low, high = np.where(after, low, middle), np.where(after, middle, high)
    t = samples.t.reshape(-1, count)[panel]
    return panel, t[:, 0] + (t[:, -1] - t[:, 0]) * (1 + (low + high) / 2) / 2


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
