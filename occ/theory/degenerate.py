"""The degenerate problem (4.14), theta' = rho cos theta - 1 in signed time u = omega_B t, solved in closed form.

Each branch is written so that it holds for every start, both directions of time and any number of turns: nothing is
unwrapped afterwards and no branch of an inverse function is left to choose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occ.theory.equation import Array

TINY = 1e-150
"""Stands for rho = 0, where the integrals below are limits of quotients."""


EQUILIBRIUM = 4e-16
"""[1] An angle that is nearer to an equilibrium than this, relative to it, is taken for the equilibrium."""


class DegenerateFlow(NamedTuple):
    """theta(u) from theta(0), and what the first correction needs along it; arrays of the common shape."""

    angle: np.ndarray  # [rad] theta, not wrapped
    slope: np.ndarray  # [1] theta' = rho cos theta - 1, without cancellation
    sine: np.ndarray  # [1] integral of sin theta over u
    cosine: np.ndarray  # [1] integral of cos theta over u


def degenerate_flow(ratio: Array, start: Array, u: Array) -> DegenerateFlow:
    """Solve theta' = rho cos theta - 1, eqs. (4.14)-(4.19).

    Args:
        ratio: [1] rho >= 0, finite.
        start: [rad] theta(0).
        u: [rad] omega_B t, of either sign.

    Returns:
        Angle, its derivative and two integrals.
    """
    rho, theta, turn = np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in (ratio, start, u)))
    shape = rho.shape
    flow = np.empty((4, rho.size))
    regions = (
        (rho.ravel() < 1, _rotating),
        (rho.ravel() == 1, _critical),
        (rho.ravel() > 1, _settling),
    )
    for where, solve in regions:
        if where.any():
            flow[:, where] = solve(rho.ravel()[where], theta.ravel()[where], turn.ravel()[where])
    return DegenerateFlow(*flow.reshape(4, *shape))


def _rotating(rho: np.ndarray, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    """tan(phi/2) = sqrt((1 + rho)/(1 - rho)) tan(theta/2) turns uniformly: phi' = -sqrt(1 - rho^2), eqs. (4.16)-(4.18).

    With b = rho/(1 + sqrt(1 - rho^2)), phi = theta + 2 arg(1 - b e^(-i theta)) has no branches (as the true and the
    eccentric anomaly of Kepler's problem).
    """
    rho = np.maximum(rho, TINY)
    frequency = np.sqrt((1 - rho) * (1 + rho))
    b = rho / (1 + frequency)
    first = theta + 2 * np.arctan2(b * np.sin(theta), 1 - b * np.cos(theta))
    phi = first - frequency * u
    back, back_first = (np.arctan2(b * np.sin(x), 1 + b * np.cos(x)) for x in (phi, first))
    slope = -(frequency**2) / (1 + rho * np.cos(phi))
    # theta - theta(0) + u = rho times the integral of cos theta; 1 - sqrt(1 - rho^2) = rho b.
    lag = rho * b * u - 2 * (back - back_first)
    angle = theta - u + lag
    start_slope = -(frequency**2) / (1 + rho * np.cos(first))
    # slope/start_slope - 1 without its cancellation at small rho.
    growth = rho * (np.cos(first) - np.cos(phi)) / (1 + rho * np.cos(phi))
    near = np.abs(growth) < 0.5
    logarithm = np.where(near, np.log1p(np.where(near, growth, 0.0)), np.log(slope / start_slope))
    return np.array([angle, slope, -logarithm / rho, lag / rho])


def _critical(rho: np.ndarray, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    """cot(theta/2) = u + cot(theta(0)/2), arccot in (0, pi), on the turn of theta(0); 2 pi k stays (errata 9)."""
    turn = 2 * np.pi * np.floor(theta / (2 * np.pi))
    half = (theta - turn) / 2
    # (cot, 1) times sin(theta(0)/2): no infinity where the start is an equilibrium.
    sine = np.sin(half)
    cotangent = np.cos(half) + u * sine
    size = np.hypot(cotangent, sine)
    angle = turn + 2 * np.arctan2(sine, cotangent)
    # slope = -2 sin^2(theta/2), and the ratio of two slopes is the square of the ratio of the sines.
    return np.array([angle, -2 * (sine / size) ** 2, 2 * np.log(size), angle - theta + u])


def _settling(rho: np.ndarray, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    """(a cos, sin)(theta/2) is linear in exp(+-x), x = sqrt(rho^2 - 1) u/2, a = sqrt((rho - 1)/(rho + 1)), eq. (4.19).

    tan(theta/2)/a = tanh(x + C_2/2) inside the equilibria and coth outside (errata 10); as a rotation of the vector
    (cos, sin)(theta/2), which turns by less than pi, both branches, theta = pi and the equilibria are one formula.
    """
    root = np.sqrt((rho - 1) * (rho + 1))
    a = np.sqrt((rho - 1) / (rho + 1))
    cosine, sine = np.cos(theta / 2), np.sin(theta / 2)
    # The start in the coordinates that grow and decay like exp(+-x).
    grows, decays = (_cleared(a * cosine, other, theta) / 2 for other in (sine, -sine))
    at_rest = grows * decays == 0
    x = np.where(at_rest, 0.0, root * u / 2)
    # The new (cos, sin) of the half angle, times exp(-|x|) so that nothing overflows.
    up, down = np.exp(x - np.abs(x)), np.exp(-x - np.abs(x))
    new_cosine, new_sine = (grows * up + decays * down) / a, grows * up - decays * down
    size = np.hypot(new_cosine, new_sine)
    turned = np.arctan2(cosine * new_sine - sine * new_cosine, cosine * new_cosine + sine * new_sine)
    angle = theta + 2 * turned
    # rho cos theta - 1 = 4 (rho + 1) grows decays/(cos^2 + sin^2), and the product of the two does not change.
    slope = 4 * (rho + 1) * grows * decays * np.exp(-2 * np.abs(x)) / size**2
    sine_integral = np.where(at_rest, u * np.sin(theta), 2 * (np.log(size) + np.abs(x)) / rho)
    return np.array([angle, slope, sine_integral, (angle - theta + u) / rho])


def _cleared(one: np.ndarray, other: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """One + other without what rounding leaves of it: a start on an unstable equilibrium stays there."""
    value = one + other
    return np.where(np.abs(value) <= EQUILIBRIUM * np.maximum(np.abs(one), np.abs(angle)), 0.0, value)
