"""The least mean power of any rotation strategy whatever, while B goes round its circle for ever.

Every motion on the circle pays Z u^2 + U(psi~) and, for each full turn of psi~, 2 pi times 2 Z omega_B; kinetic
energy is bounded and does not count.  For every h >= -min U, Z u^2 + U >= 2 sqrt(Z (U + h)) |u| - h, and one h makes
this tight:

    mean sqrt(U - min U) >= |omega_B| sqrt(Z):  no turn pays; steady rotation where U is least, mean power min U.
    otherwise:  mean sqrt(U + h) = |omega_B| sqrt(Z) has one root h > -min U; mean power -h, a motion that turns psi~
    for ever against omega_B with the yaw rate omega_B (1 - sqrt((U + h) / Z) / |omega_B|).

-h is Mane's critical value of the problem with a minus sign.  Both sides of the comparison are proportional to omega_B
and to the root of the friction, so that the radius R*_B at which the regimes change depends on neither.

Source: Contreras, Iturriaga, Global Minimizers of Autonomous Lagrangians, chapter 3; derivation in reports/proof.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ.theory.coefficients import YawCoefficients
from occ.theory.dissipation import CircleEnergy, circle_energy
from occ.theory.quadrature import Rule
from occ.theory.trigonometric import TURN, basis, least, recentred

BLOCK = 1024
"""Parameter points that are worked on at once: the tables of a block stay in the processor's cache."""
UNSURE = 0.02
"""Mean roots this close to their target (relative) are computed again to rounding; Gauss's rule is better than that."""
SMALLEST, LARGEST = 1e-6, 1e6
"""[m] Between which the switch radius is looked for."""
CLOSE = 0.02
"""Levels h + min U below this share of U's swing need the graded quadrature."""


class LongRun(NamedTuple):
    """The long-run optimum, each an array of the common shape."""

    mean_power: np.ndarray  # [W] least mean power of any rotation strategy
    steady: np.ndarray  # bool: steady rotation is optimal
    angle: np.ndarray  # [rad] argmin U in [0, 2 pi): psi~ of the best steady rotation
    steady_power: np.ndarray  # [W] min U, the mean power of the best steady rotation


def long_run(energy: CircleEnergy) -> LongRun:
    """The least mean power over all rotation strategies, for any number of circles.

    Args:
        energy: arrays of a common shape.

    Returns:
        Arrays of that shape.
    """
    shape = np.shape(energy.friction)
    power = np.reshape(energy.power, (5, -1))
    target = np.abs(np.ravel(energy.rate)) * np.sqrt(np.maximum(np.ravel(energy.friction), 0.0))
    angle, steady_power, mean_power = (np.empty(power.shape[1]) for _ in range(3))
    steady = np.empty(power.shape[1], dtype=bool)
    for first in range(0, power.shape[1], BLOCK):
        part = slice(first, first + BLOCK)
        angle[part], steady_power[part] = least(power[:, part])
        above, turns = _level_above_bottom(power[:, part], angle[part], target[part])
        steady[part] = ~turns
        mean_power[part] = steady_power[part] - above
    results = (mean_power, steady, np.mod(angle, TURN), steady_power)
    return LongRun(*(array.reshape(shape) for array in results))


def _level_above_bottom(power: np.ndarray, angle: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The root d of mean sqrt(U - min U + d) = target, and where there is one; 0 elsewhere."""
    shape = _Shape(power, angle)
    mean = shape.rough_mean_root()
    unsure = np.flatnonzero(np.abs(mean - target) <= UNSURE * target)
    if unsure.size:
        mean[unsure] = shape.of(unsure).mean_root(np.zeros(unsure.size))[0]
    turns = mean < target
    level = np.zeros_like(target)
    k = np.flatnonzero(turns)
    shape, wanted = shape.of(k), target[k]
    # The mean root is concave in d: Newton's method from the left comes up to the root without passing it.  Jensen's
    # inequality gives a point on the left, the root's swing a least step where that point is negative.
    d = np.maximum(wanted**2 - shape.mean, 1e-14 * np.maximum(wanted**2, shape.mean))
    for _ in range(60):
        if not k.size:
            break
        mean, slope = shape.mean_root(d)
        step = (wanted - mean) / slope
        d = np.maximum(d + step, 0.1 * d)
        level[k] = d
        # Convergence is quadratic: after such a step the error is of the order of rounding.
        go_on = np.flatnonzero(np.abs(step) > 1e-7 * d)
        k, d, wanted, shape = k[go_on], d[go_on], wanted[go_on], shape.of(go_on)
    return level, turns


class _Shape:
    """U - min U about its lowest point, for many U: 2 sin^2(s/2) q(s), with q of degree one."""

    def __init__(self, power: np.ndarray, angle: np.ndarray) -> None:
        _, c_1, _, c_2, s_2 = recentred(power, angle)
        self.coefficients = np.stack([-(c_1 + 2 * c_2), -2 * c_2, -2 * s_2])
        self.mean = np.sum(self.coefficients * _MEANS[:, None], axis=0)
        self.swing = np.abs(c_1) + np.abs(c_2) + np.abs(s_2)
        # Where q nearly vanishes there is a second valley, nearly as deep as the first.
        size = np.hypot(self.coefficients[1], self.coefficients[2])
        self.second = np.arctan2(self.coefficients[2], self.coefficients[1]) + np.pi
        self.double = self.coefficients[0] - size < 0.2 * (self.coefficients[0] + size)

    def of(self, index: np.ndarray) -> _Shape:
        """The shapes at these places."""
        part = object.__new__(_Shape)
        part.coefficients, part.mean = self.coefficients[:, index], self.mean[index]
        part.swing, part.second, part.double = self.swing[index], self.second[index], self.double[index]
        return part

    def rough_mean_root(self) -> np.ndarray:
        """Mean of sqrt(U - min U), smooth from one passage of the lowest point to the next, by Gauss's rule."""
        return _SMOOTH.weight @ np.sqrt(np.maximum(_SMOOTH.shape.T @ self.coefficients, 0.0))

    def mean_root(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean of sqrt(U - min U + d), and its derivative in d."""
        mean, slope = np.empty_like(d), np.empty_like(d)
        far = d > CLOSE * self.swing
        for table, k in ((_UNIFORM, np.flatnonzero(far)), (_GRADED, np.flatnonzero(~far & ~self.double))):
            if k.size:
                above = table.shape.T @ self.coefficients[:, k] + d[k]
                root = np.sqrt(np.maximum(above, 1e-300))
                mean[k], slope[k] = table.weight @ root, table.weight @ (0.5 / root)
        k = np.flatnonzero(~far & self.double)
        if k.size:
            mean[k], slope[k] = self._two_valleys(k, d[k])
        return mean, slope

    def _two_valleys(self, k: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same with the circle cut at both valleys."""
        coefficients = self.coefficients[:, k]
        ridge = np.mod(self.second[k], TURN)
        mean, slope = np.zeros_like(d), np.zeros_like(d)
        for a, b in ((np.zeros_like(ridge), ridge), (ridge, np.full_like(ridge, TURN))):
            s = a + (b - a) * _SHARE[:, None]
            terms = _valley(s)
            above = terms[0] * coefficients[0] + terms[1] * coefficients[1] + terms[2] * coefficients[2] + d
            root = np.sqrt(np.maximum(above, 1e-300))
            weight = (b - a) / TURN * _WEIGHT[:, None]
            mean += np.sum(weight * root, axis=0)
            slope += np.sum(weight * (0.5 / root), axis=0)
        return mean, slope


class _Table(NamedTuple):
    shape: np.ndarray  # (3, n) 2 sin^2(s/2) times 1, cos s, sin s at the nodes
    weight: np.ndarray  # (n,) of the mean over the circle


def _valley(s: np.ndarray) -> np.ndarray:
    square = 2 * np.sin(s / 2) ** 2
    return square * basis(s)[:3]


_RULE = Rule.create(0.36, 36.0)
_SHARE = np.concatenate([_RULE.share, 1 - _RULE.share])
_WEIGHT = np.concatenate([_RULE.weight, _RULE.weight])
_EVEN = TURN * np.arange(144) / 144
_UNIFORM = _Table(_valley(_EVEN), np.full(144, 1 / 144))
# The distance from the lowest point keeps its digits on both sides of it.
_SIDES = np.concatenate([TURN * _RULE.share, -TURN * _RULE.share])
_GRADED = _Table(_valley(_SIDES), _WEIGHT)
_NODES, _GAUSS = np.polynomial.legendre.leggauss(24)
_SMOOTH = _Table(_valley(np.pi * (1 + _NODES)), _GAUSS / 2)
_MEANS = np.array([1.0, -0.5, 0.0])
"""Means of 2 sin^2(s/2) times 1, cos s, sin s."""


def switch_radius(c: YawCoefficients) -> np.ndarray:
    """R*_B [m]: on smaller circles a motion that keeps turning beats every steady rotation.

    mean sqrt(U - min U) = |omega_B| sqrt(Z); it does not depend on omega_B.

    Args:
        c: numbers or arrays.

    Returns:
        Of their shape; infinite where there is no such radius below 1000 km, NaN without friction.

    Source: Chandrupatla, A new hybrid quadratic/bisection algorithm, Advances in Engineering Software 28 (1997).
    """
    from scipy.optimize.elementwise import find_root

    shape = np.broadcast_shapes(*(np.shape(item) for item in c))
    flat = YawCoefficients(*(np.broadcast_to(item, shape).ravel() for item in c))
    friction = flat.inertia * flat.xi_3

    def excess(log_radius: np.ndarray, *coefficients: np.ndarray) -> np.ndarray:
        part = YawCoefficients(*coefficients)
        power = circle_energy(part, np.exp(log_radius), 1.0).power
        angle, _ = least(power)
        mean = _Shape(power, angle).mean_root(np.zeros_like(log_radius))[0]
        return np.asarray(mean - np.sqrt(np.maximum(part.inertia * part.xi_3, 0.0)))

    ends = np.log(SMALLEST), np.log(LARGEST)
    always, never = (excess(np.full(friction.shape, end), *flat) for end in ends)
    radius = np.where(never < 0, np.inf, np.where(friction > 0, 0.0, np.nan))
    k = np.flatnonzero((always < 0) & (never >= 0) & (friction > 0))
    if k.size:
        radius[k] = np.exp(find_root(excess, ends, args=tuple(flat.of(k))).x)
    return radius.reshape(shape)
