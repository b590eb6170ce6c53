"""How wheel torques make a wrench, C_phi^T M = Pi, and what follows from the wheel set alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import casadi as ca
import numpy as np

from occ.errors import InputError
from occ.model.coefficients import PLATFORMS, coefficients, unpack
from occ.model.platform import Platform

PARALLEL = 1e-12
"""Two rows of the input map whose unit vectors have a least singular value below this are taken for parallel."""


@dataclass(frozen=True, eq=False)
class InputMap:
    """C_phi^T M = Pi and what follows from C_phi alone; n wheels.

    Args:
        wheel_rates: (n, 3) C_phi.
        min_norm: (n, 3) C_phi (C_phi^T C_phi)^-1: the torques of least norm of a wrench, the line after eq. (3.13).
        null_torque: (n, n - 3) orthonormal torques that make no wrench.
        facets: (F, n) rows y with sum |y_i| = 1 such that max |y M| over the rows is the least possible largest torque.
    """

    wheel_rates: np.ndarray
    min_norm: np.ndarray
    null_torque: np.ndarray
    facets: np.ndarray

    @property
    def wheel_count(self) -> int:
        """n."""
        return len(self.wheel_rates)

    def wrench(self, torque: np.ndarray) -> np.ndarray:
        """Pi = C_phi^T M; M (n, N) [N m], result (3, N) [N, N, N m]."""
        return self.wheel_rates.T @ torque

    def least_peak(self, torque: np.ndarray) -> np.ndarray:
        """min over all M' with C_phi^T M' = C_phi^T M of max_i |M'_i| = max over facets of |y M|.

        The reachable wrenches of |M_i| <= L are a zonotope, and each of its facets is normal to the wrenches of two
        wheels: y = C_phi w, w normal to two rows of C_phi, leaves those two wheels free and loads all others fully.

        Args:
            torque: (n, N) [N m] any torques of the wrenches.

        Returns:
            (N,) [N m].

        Source: Ziegler, Lectures on Polytopes, chapter 7 (zonotopes); duality of the largest and the sum norm.
        """
        return np.asarray(np.abs(self.facets @ torque).max(axis=0))


def input_map(wheel_rates: np.ndarray) -> InputMap:
    """What follows from C_phi, for any wheel set.

    Args:
        wheel_rates: (n, 3) C_phi [1/m, 1/m, 1].

    Returns:
        The map.

    Raises:
        InputError: not (n, 3), not finite, or a wheel set that leaves some wrench out of reach of every torque.
    """
    rates = np.asarray(wheel_rates, dtype=float)
    if rates.ndim != 2 or rates.shape[0] < 3 or rates.shape[1] != 3:
        raise InputError(f"wheel_rates should have the shape (n, 3) with n of at least 3, not {rates.shape}")
    if not np.all(np.isfinite(rates)):
        raise InputError("wheel_rates should be finite numbers")
    singular = np.linalg.svd(rates / np.maximum(np.abs(rates).max(axis=0), 1e-300), compute_uv=False)
    if singular[-1] < 1e-9 * singular[0]:
        raise InputError("wheel_rates should have rank 3: some wrench is out of reach of every torque")
    null = np.linalg.svd(rates.T)[2][3:].T
    return InputMap(rates, rates @ np.linalg.inv(rates.T @ rates), null, _facets(rates))


@lru_cache(maxsize=PLATFORMS)
def platform_input_map(platform: Platform) -> InputMap:
    """The input map of a platform."""
    k = unpack(ca.DM(coefficients(platform)), platform.wheel_count)
    return input_map(np.array(k.wheel_rates))


def _facets(rates: np.ndarray) -> np.ndarray:
    # The third column is a length times the others: without this the cross products mix units.
    scaled = rates / np.abs(rates).max(axis=0)
    units = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-300)
    rows = []
    for i, j in combinations(range(len(rates)), 2):
        # Of nearly parallel wheels a cross product is small, and not normal to them up to its own rounding.
        _, (_, least), normals = np.linalg.svd(units[[i, j]])
        y = scaled @ normals[2]
        y[[i, j]] = 0.0
        # A wheel parallel to one of the two is loaded by rounding only, and its torque may be without a limit.
        y[np.abs(y) <= PARALLEL * np.abs(y).sum()] = 0.0
        if least > PARALLEL and np.abs(y).sum() > PARALLEL:
            rows.append(y / np.abs(y).sum())
    return np.array(rows)
