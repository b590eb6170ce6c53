"""The law in the long run, at many points: how it ends up, and the mean power of that.

Where a steady rotation exists and is stable the law ends up in it; inside the critical radius it rotates for ever.  The
mean power of a rotation is an average over its orbit, p(theta) = theta' in signed time,

    mean D = int D dtheta/p / int dtheta/p,  1/p = -(d + e p')/q,  q = 1 - rho cos theta,

and with cosines of the numerators the integrals over q are exact up to the critical radius, where the period is
infinite and the mean is the power of the steady rotation there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ.theory.dissipation import CircleEnergy
from occ.theory.equation import ScaledEquation
from occ.theory.orbits import TOLERANCE, guess, resolved
from occ.theory.trigonometric import basis, recentred

STEADY, ROTATIONAL, UNSTABLE, CRITICAL = "steady", "rotational", "unstable", "critical"


class Rotations(NamedTuple):
    """Rotational motions, each entry (N,); NaN where none was found."""

    mean_power: np.ndarray  # [W]
    period: np.ndarray  # [s] in which psi~ makes one turn
    mean_yaw_rate: np.ndarray  # [rad/s]


def rotations(energy: CircleEnergy, eq: ScaledEquation) -> Rotations:
    """The rotational motions, and the mean of D over them: inside the critical radius, and beyond it where there are.

    Args:
        energy: of the circles, entries (N,).
        eq: of the same circles.

    Returns:
        Arrays.
    """
    table = np.full((3, len(eq.rate)), np.nan)
    for rows, slope in resolved(eq, guess(eq), TOLERANCE):
        one = ScaledEquation(*(values[rows] for values in eq))
        part = CircleEnergy(*(values[..., rows] for values in energy))
        table[:, rows] = _means(part, one, slope)
    return Rotations(*table)


def _means(energy: CircleEnergy, eq: ScaledEquation, slope: np.ndarray) -> np.ndarray:
    count = slope.shape[1]
    order = np.arange(count // 2 + 1)
    spectrum = np.fft.rfft(slope, axis=1)
    gradient = 1j * order * spectrum
    gradient[:, -1] = 0.0
    # p has less than 3/8 of the harmonics that the grid can hold, and products of D, d and p' three times as many.
    fine = 3 * count
    p, push = (np.fft.irfft(values, fine, axis=1) * (fine / count) for values in (spectrum, gradient))
    angle = 2 * np.pi * np.arange(fine) / fine
    spin = (eq.epsilon * eq.k)[:, None]
    passage = 1 + spin * np.sin(angle + eq.delta[:, None]) + eq.epsilon[:, None] * push
    dissipation = _dissipation(energy, eq, p, basis(angle))
    f = np.sqrt(np.maximum((1 - eq.ratio) * (1 + eq.ratio), 0.0))
    b = np.minimum(eq.ratio, 1.0) / (1 + f)
    total, time = (_weighted(values, b) for values in (dissipation * passage, passage))
    # Beyond the critical radius p stays away from zero.
    beyond = eq.ratio >= 1
    total[beyond], time[beyond], f[beyond] = (dissipation / -p).mean(axis=1)[beyond], (-1 / p).mean(axis=1)[beyond], 1.0
    # du = -dtheta/p in units of 1/|omega_B|; p is negative, psi~ turns against omega_B.
    turn = 2 * np.pi * time / f
    return np.array([total / time, turn / np.abs(eq.rate), eq.rate * (1 - 2 * np.pi / turn)])


def _weighted(values: np.ndarray, b: np.ndarray) -> np.ndarray:
    """f times the mean of values/(1 - rho cos theta): the sum of cosines with the weights 1, 2 b, 2 b^2, .."""
    count = values.shape[1]
    cosines = np.fft.rfft(values, axis=1).real / count
    order = np.arange(cosines.shape[1])
    weight = np.where(order == 0, 1.0, 2.0) * b[:, None] ** order
    return np.asarray((cosines * weight).sum(axis=1))


def _dissipation(energy: CircleEnergy, eq: ScaledEquation, p: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """D = Z u^2 + 2 (Z omega_B + d_2) u + U with u = omega_B p; `waves` are 1, cos theta, .. (5, M)."""
    power, drag = (recentred(values, -eq.alpha).T @ waves for values in (energy.power, energy.drag))
    friction, rate = energy.friction[:, None], eq.rate[:, None]
    u = rate * p
    return np.asarray((friction * u + 2 * (friction * rate + drag)) * u + power)
