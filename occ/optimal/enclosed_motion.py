"""A proven neighbourhood of the motion that wheel torques in time make.

The torques are polynomials in each interval.  Near the integrated motion polynomials v of the pseudo-velocities are
found that leave next to nothing of r = A v' + f(v) + Z v - C_phi^T M, eq. (2.16).  The gyroscopic force does no work,
so that the distance e of the true velocities from v obeys, with |e|_A^2 = e^T A e,

    d|e|_A / dt <= mu |e|_A + |r|_{A^-1},   mu = largest eigenvalue of -(sym f'(v) + Z) with respect to A.

Heading and position follow by integration.  Residuals, and the jumps of v from one interval to the next, are part of
the bounds; the platform's matrices are taken as exact.

Source: Soederlind, The logarithmic norm, BIT 46 (2006); Hairer, Norsett, Wanner, Solving Ordinary Differential
    Equations I, theorem I.10.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from occ.model.coefficients import Coefficients
from occ.optimal.between import chebyshev_places
from occ.optimal.driven import DrivenMotion
from occ.optimal.powers import (
    UNIT,
    Panels,
    chebyshev_coefficients,
    derivative,
    integral,
    integral_slack,
    lebesgue,
    size_of,
    stacked,
    through,
    values_at,
)
from occ.optimal.proof import Quantities, proven

DEGREE = 20
"""Of the polynomials of the velocities' rates."""
RESOLVED = 8.0
"""Widest panel in units of the fastest time constant: exp(-8 s) is within 4e-15 of a polynomial of that degree."""
PANELS = 16
"""In one interval at most."""
NEWTON = 3
"""Steps of Newton's method from the integrated motion."""
NEGLIGIBLE = 1e-10
"""[m/s] Rates of the position that need not be known any better."""
EIGENVALUES = 1e-9
"""[1/s] Allowed for the rounding of mu."""


class Matrices(NamedTuple):
    """A, H (3, 3, 3) with f_k = v^T H_k v / 2, Z and C_phi, as arrays."""

    inertia: np.ndarray
    gyroscopic: np.ndarray
    friction: np.ndarray
    wheel_rates: np.ndarray

    @classmethod
    def of(cls, k: Coefficients) -> Matrices:
        """Those of a platform."""
        gyroscopic = np.stack([np.array(h) for h in k.gyroscopic])
        return cls(np.array(k.inertia), gyroscopic, np.array(k.friction), np.array(k.wheel_rates))

    def balance(self, v: np.ndarray, rate: np.ndarray, torque: np.ndarray, sign: float = -1.0) -> np.ndarray:
        """(3, ..) A v' + f(v) + Z v - C_phi^T M from v, v' (3, ..) and M (n, ..); ``sign`` is that of the last term."""
        gyroscopic = np.einsum("kij,i...,j...->k...", self.gyroscopic, v, v) / 2
        linear = np.tensordot(self.inertia, rate, 1) + np.tensordot(self.friction, v, 1)
        return np.asarray(linear + gyroscopic + sign * np.tensordot(self.wheel_rates.T, torque, 1))

    def slope(self, v: np.ndarray) -> np.ndarray:
        """(.., 3, 3) f'(v) + Z for v (3, ..)."""
        return np.asarray(np.einsum("kij,j...->...ki", self.gyroscopic, v) + self.friction)

    @property
    def sizes(self) -> Matrices:
        """The same with absolute values."""
        return Matrices(*map(np.abs, self))


@dataclass(frozen=True)
class EnclosedVelocity:
    """pi'(t) within a distance of polynomials.

    Args:
        edges: (N + 1,) [s] of the torques' panels.
        powers: (3, N, d) polynomials v on them.
        distance: (N,) [J^(1/2)] largest |e|_A on each.
        inverse: (3, 3) A^-1.
    """

    edges: np.ndarray
    powers: np.ndarray
    distance: np.ndarray
    inverse: np.ndarray

    def within(self, rows: np.ndarray) -> np.ndarray:
        """(k, N) Largest |c . e| for rows c (k, 3): |e|_A (c . A^-1 c)^(1/2)."""
        return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", rows, self.inverse, rows))[:, None] * self.distance)


def panel_counts(matrices: Matrices, motion: DrivenMotion, edges: np.ndarray) -> np.ndarray:
    """(N,) Panels on which polynomials know the velocities and the rotation to rounding, for each of N intervals.

    Args:
        matrices: of the platform.
        motion: integrated.
        edges: (N + 1,) [s] of the torques' intervals.

    Returns:
        Whole numbers from 1 to ``PANELS``.
    """
    velocity, root = motion.edge_states[3:], _root(matrices)
    slopes = np.linalg.norm(root @ matrices.slope(velocity) @ root.T, 2, axis=(1, 2))
    fastest = max(slopes.max(), np.abs(velocity[2]).max())
    return np.clip(np.ceil(fastest * np.diff(edges) / RESOLVED), 1, PANELS).astype(int)


def _root(matrices: Matrices) -> np.ndarray:
    """(3, 3) L^-1 of A = L L^T."""
    return np.linalg.inv(np.linalg.cholesky(matrices.inertia))


def enclosed_velocity(matrices: Matrices, motion: DrivenMotion, torque: Panels) -> EnclosedVelocity:
    """Polynomials near the true pseudo-velocities, and how near.

    Args:
        matrices: of the platform.
        motion: integrated with these torques.
        torque: the torques.

    Returns:
        Velocities with proven distances.
    """
    edges = torque.edges
    velocity = _polynomials(matrices, motion, edges, torque.powers)
    inverse = np.linalg.inv(matrices.inertia)
    residual = _residual(matrices, velocity, torque, inverse)
    ends = values_at(velocity, np.array([-1.0, 1.0]))
    jumps = ends[:, 1:, 0] - ends[:, :-1, 1]
    jumps = np.concatenate([(motion.start[3:] - ends[:, 0, 0])[:, None], jumps], axis=1)
    # Rounding of the values at the ends makes jumps, too.
    jumps = np.abs(jumps) + UNIT * velocity.shape[2] * 2 * size_of(velocity)
    steps = np.sqrt(np.einsum("ik,ij,jk->k", jumps, np.abs(matrices.inertia), jumps))
    growth = _growth(matrices, velocity) * np.diff(edges)
    distance, now = np.zeros(len(steps)), 0.0
    for k, width in enumerate(np.diff(edges)):
        before = now + steps[k]
        # Between its ends the bound is monotone: a linear equation with constant coefficients.
        now = before * np.exp(growth[k]) + residual[k] * width * _mean_growth(growth[k])
        distance[k] = max(before, now) * (1 + 1e-12)
    return EnclosedVelocity(edges, velocity, distance, inverse)


def _mean_growth(z: float) -> float:
    """(exp z - 1) / z."""
    return float(np.expm1(z) / z) if z else 1.0


def _polynomials(matrices: Matrices, motion: DrivenMotion, edges: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """(3, N, d) From the integrated motion by Newton's method: v = v(start) + integral of A^-1 (..) at the nodes.

    They are the integrals of their rates: the derivative of what goes through rounded velocities would be that of the
    rounding, too, the more so the shorter the interval.
    """
    x = 2 * chebyshev_places(DEGREE) - 1
    half, count = np.diff(edges) / 2, len(x)
    middle = (edges[:-1] + edges[1:]) / 2
    times = middle[:, None] + half[:, None] * x
    # The ends belong to the panel, not to its neighbours.
    inside = np.clip(times, edges[:-1, None], np.nextafter(edges[1:, None], -np.inf))
    v = motion(inside.ravel())[3:].reshape(3, *times.shape)
    weights = _integrals()
    force, inverse = values_at(torque, x), np.linalg.inv(matrices.inertia)
    begin, size = v[:, :, 0].copy(), 3 * count
    constant = np.kron(np.eye(3), np.ones((count, 1)))
    for _ in range(NEWTON):
        rate = -np.tensordot(inverse, matrices.balance(v, np.zeros_like(v), force), 1)
        missing = v - begin[:, :, None] - half[:, None] * (rate @ weights)
        # d(missing at q)_i / d(v at p)_l = delta + h/2 weights_pq (A^-1 (f' + Z))_il at p.
        jacobian = np.einsum("n,pq,npil->niqlp", half, weights, inverse @ matrices.slope(v))
        jacobian += np.einsum("il,qp->iqlp", np.eye(3), np.eye(count))
        right = np.concatenate(
            [-missing.transpose(1, 0, 2).reshape(-1, size, 1), np.tile(constant, (len(half), 1, 1))], 2
        )
        steps = np.linalg.solve(jacobian.reshape(-1, size, size), right).reshape(-1, 3, count, 4)
        # Each interval begins where the one before ends: the integrator's errors would be jumps.
        change = np.empty((len(half), 3))
        now = motion.start[3:]
        for k, step in enumerate(steps):
            change[k] = now - begin[:, k]
            now = v[:, k, -1] + step[:, -1, 0] + step[:, -1, 1:] @ change[k]
        begin = begin + change.T
        v = v + (steps[..., 0] + np.einsum("niqj,nj->niq", steps[..., 1:], change)).transpose(1, 0, 2)
    rate = -np.tensordot(inverse, matrices.balance(v, np.zeros_like(v), force), 1)
    result = integral(through(rate), edges, np.zeros(3))
    # Each from its own beginning: a sum over all of them would gather rounding.
    result[:, :, 0] += begin - values_at(result, np.array([-1.0]))[..., 0]
    return result


@cache
def _integrals() -> np.ndarray:
    """(p, p) Integrals from -1 to place q of the polynomials that are 1 at place p and 0 at the others."""
    coefficients = chebyshev_coefficients(np.eye(DEGREE + 1))
    integrals = np.polynomial.chebyshev.chebint(coefficients, lbnd=-1.0, axis=1)
    return np.asarray(np.polynomial.chebyshev.chebval(2 * chebyshev_places(DEGREE) - 1, integrals.T))


def _residual(matrices: Matrices, velocity: np.ndarray, torque: Panels, inverse: np.ndarray) -> np.ndarray:
    """(N,) Largest |r|_{A^-1} of a polynomial r: the less of two bounds.

    No value is larger than the sum of the Chebyshev coefficients, or than Lebesgue's constant times the largest value
    at the Chebyshev points; the first is nearer where r is not small, the second keeps the digits where it is.
    """
    degree = max(2 * (velocity.shape[2] - 1), torque.powers.shape[2] - 1)
    x = 2 * chebyshev_places(degree) - 1
    rates = derivative(velocity, torque.edges)
    values = matrices.balance(values_at(velocity, x), values_at(rates, x), values_at(torque.powers, x))
    sizes = matrices.sizes.balance(size_of(velocity), size_of(rates), size_of(torque.powers), sign=1.0)
    # Rounding is that of the values; there are degree + 1 coefficients, and that many values in each.
    whole = np.abs(chebyshev_coefficients(values)).sum(axis=2) + UNIT * degree**2 * sizes
    largest = lebesgue(degree) * (np.abs(values).max(axis=2) + UNIT * velocity.shape[2] * sizes)
    bounds = np.minimum(whole, largest) + np.tensordot(np.abs(matrices.wheel_rates.T), torque.slack, 1)
    return np.asarray(np.sqrt(np.einsum("ik,ij,jk->k", bounds, np.abs(inverse), bounds)))


def _growth(matrices: Matrices, velocity: np.ndarray) -> np.ndarray:
    """(N,) [1/s] Bounds of mu: its value at the middle, and what the velocities' changes can add."""
    root = _root(matrices)
    slopes = root @ matrices.slope(velocity[:, :, 0]) @ root.T
    middle = np.linalg.eigvalsh(-(slopes + np.swapaxes(slopes, 1, 2)) / 2)[:, -1]
    each = root @ np.moveaxis(matrices.gyroscopic, 2, 0) @ root.T
    norms = np.linalg.norm((each + np.swapaxes(each, 1, 2)) / 2, 2, axis=(1, 2))
    return np.asarray(middle + norms @ np.abs(velocity[:, :, 1:]).sum(axis=2) + EIGENVALUES)


@dataclass(frozen=True)
class EnclosedPose:
    """Position of O and heading within distances of polynomials.

    Args:
        powers: (3, N, d) x, y, psi.
        point: (N,) [m] largest distance of B from where the polynomials have it.
    """

    powers: np.ndarray
    point: np.ndarray


def enclosed_pose(velocity: EnclosedVelocity, start: np.ndarray, point: tuple[float, float]) -> EnclosedPose:
    """psi = integral of Omega and r_O = integral of R(psi) (V_X, V_Y), and how far B may be from there.

    Args:
        velocity: with its distance.
        start: (3,) x, y, psi at the start.
        point: [m] B in the body frame.

    Returns:
        Pose with a proven distance.
    """
    edges = velocity.edges
    heading = integral(velocity.powers[2:], edges, start[2:])
    x = 2 * chebyshev_places(DEGREE) - 1
    (psi,), (v_x, v_y) = values_at(heading, x), values_at(velocity.powers[:2], x)
    rates = through(np.stack([np.cos(psi) * v_x - np.sin(psi) * v_y, np.sin(psi) * v_x + np.cos(psi) * v_y]))
    position = integral(rates, edges, start[:2])
    missed = np.hypot(*_missed(edges, heading, velocity.powers[:2], rates))
    # A chord is no longer than its arc: R(psi) moves a vector by at most its length times the change of psi.
    turned = integral_slack(heading, edges, velocity.within(np.eye(3)[2:]))[0]
    speed = np.hypot(*size_of(velocity.powers[:2]))
    slid = np.hypot(*velocity.within(np.eye(3)[:2]))
    moved = np.hypot(*integral_slack(position, edges, slid + (speed + slid) * turned + missed))
    return EnclosedPose(stacked([*position, *heading]), moved + np.hypot(*point) * turned)


def _missed(edges: np.ndarray, heading: np.ndarray, velocity: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """(2, N) [m/s] Largest |R(psi) V - p| for polynomials p."""
    powers = stacked([*heading, *velocity, *rates])
    quantities = Quantities(
        function=_miss(),
        edges=edges,
        powers=powers,
        slack=UNIT * powers.shape[2] * size_of(powers),
        numbers=np.zeros(0),
        scales=np.full(2, NEGLIGIBLE),
        smooth=np.ones(len(edges) - 1, dtype=bool),
    )
    return NEGLIGIBLE * proven(quantities).largest


@cache
def _miss() -> ca.Function:
    """R(psi) V - p: CasADi function (t, (psi, V, p) (5,), nothing) -> (2,) [m/s]."""
    psi, v, p = ca.SX.sym("psi"), ca.SX.sym("v", 2), ca.SX.sym("p", 2)
    c, s = ca.cos(psi), ca.sin(psi)
    rest = ca.vertcat(c * v[0] - s * v[1], s * v[0] + c * v[1]) - p
    return ca.Function("missed", [ca.SX.sym("t"), ca.vertcat(psi, v, p), ca.SX(0, 1)], [rest])
