"""A smooth curve through way-points."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import casadi as ca
import numpy as np

from occ.checks import Vector2
from occ.errors import InputError
from occ.motion.base import ProgramMotion

DEGREE = 5
"""Of the polynomials between way-points: position and its first four derivatives are continuous."""
FEWEST_CLOSED = 4
"""Way-points of a closed spline, the repeated first one included: fewer do not span an area."""
EXACT = 1e-9
"""A spline that misses a way-point by more than this, relative to the extent of all, is refused."""


@dataclass(frozen=True, kw_only=True)
class SplineMotion(ProgramMotion):
    """r = sum_j c_kj u^j, u = (t - t_k) / (t_k+1 - t_k): the quintic spline (C^4) with r(t_k) = r_k.

    Open, it leads from rest to rest: velocity and acceleration vanish at both ends, and B rests there before and
    afterwards.  Closed, it repeats itself without an end.

    Args:
        points: (n, 2) [m] way-points r_k, at least 2; of a closed spline at least 4, the last one the first again.
        times: (n,) [s] t_k when B passes them, increasing from 0.
        closed: whether the motion is periodic with the last time as its period.

    Raises:
        InputError: times that do not belong to the points or do not increase, a way-point that follows itself, a
            closed spline that does not end where it begins.

    Source: de Boor, A Practical Guide to Splines, chapters IX and XIII.
    """

    kind: ClassVar[str] = "spline"
    points: tuple[Vector2, ...]
    times: tuple[float, ...]
    closed: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        count, least = len(self.points), FEWEST_CLOSED if self.closed else 2
        if count < least:
            what = "a closed spline" if self.closed else "an open spline"
            raise InputError(f"SplineMotion: points should be at least {least} for {what}, not {count}")
        if len(self.times) != count:
            raise InputError(
                f"SplineMotion: times should be {count} numbers, one for each of the points, not {len(self.times)}"
            )
        if self.times[0] != 0.0:
            raise InputError(f"SplineMotion: times should begin with 0 s, not {self.times[0]!r}")
        for k in range(1, count):
            if not self.times[k] > self.times[k - 1]:
                raise InputError(
                    f"SplineMotion: times should increase from way-point to way-point; number {k + 1} is "
                    f"{self.times[k]!r} s after {self.times[k - 1]!r} s"
                )
            if self.points[k] == self.points[k - 1]:
                raise InputError(
                    f"SplineMotion: points {k} and {k + 1} coincide at {list(self.points[k])} m; points that follow "
                    "each other should differ"
                )
        if self.closed and self.points[-1] != self.points[0]:
            raise InputError(
                f"SplineMotion: points of a closed spline should end with the first one, {list(self.points[0])} m, "
                f"not with {list(self.points[-1])} m"
            )
        if not _passes_its_points(self.points, _values(self.points, self.times, self.closed)):
            widths = np.diff(self.times)
            raise InputError(
                f"SplineMotion: times should be spaced more evenly; pieces from {widths.min():.3g} s to "
                f"{widths.max():.3g} s leave no digits for a smooth curve through the points"
            )

    def values(self) -> np.ndarray:
        return _values(self.points, self.times, self.closed).copy()

    def structure(self) -> tuple[int, ...]:
        """Number of pieces, and 1 where the spline is closed."""
        return len(self.points) - 1, int(self.closed)

    @classmethod
    def position(cls, t: ca.SX, values: ca.SX, structure: tuple[int, ...]) -> ca.SX:
        pieces, closed = structure
        times = values[: pieces + 1]
        coefficients = ca.reshape(values[pieces + 1 :], 2 * (DEGREE + 1), pieces)
        last = times[pieces]
        # CasADi takes floor as constant, and the derivatives at the held ends vanish anyway.
        inside = t - last * ca.floor(t / last) if closed else ca.fmin(ca.fmax(t, 0), last)
        table = ca.vertcat(coefficients, times[:pieces].T, ca.diff(times).T)
        # The piece is chosen, not blended: sums of differences of coefficients would lose digits.
        chosen = table[:, pieces - 1]
        for k in reversed(range(pieces - 1)):
            chosen = ca.if_else(inside < times[k + 1], table[:, k], chosen)
        u = (inside - chosen[-2]) / chosen[-1]
        position = ca.SX.zeros(2)
        for j in reversed(range(DEGREE + 1)):
            position = position * u + chosen[2 * j : 2 * j + 2]
        return position

    @property
    def period(self) -> float | None:
        return self.times[-1] if self.closed else None

    def knots(self, duration: float) -> np.ndarray:
        times = np.array(self.times)
        if self.closed:
            laps = np.arange(math.ceil(duration / self.times[-1]))
            times = (laps[:, None] * self.times[-1] + times[:-1]).ravel()
        return times[(times > 0.0) & (times < duration)]


@lru_cache(maxsize=64)
def _values(points: tuple[Vector2, ...], times: tuple[float, ...], closed: bool) -> np.ndarray:
    """(n + 12 (n - 1),) t_k, then c_k0, .., c_k5 of each piece, in metres for u from 0 to 1: all of one size.

    Not a number where the times are so uneven that the linear equations of the spline cannot be solved.
    """
    from scipy.interpolate import make_interp_spline
    from scipy.linalg import LinAlgWarning

    rest = [(1, np.zeros(2)), (2, np.zeros(2))]
    begins, widths = np.array(times[:-1]), np.diff(times)
    try:
        with warnings.catch_warnings():
            # The way-points that an inaccurate spline misses tell more than the condition of its equations.
            warnings.simplefilter("ignore", LinAlgWarning)
            spline = make_interp_spline(times, points, k=DEGREE, bc_type="periodic" if closed else (rest, rest))
    except (ValueError, np.linalg.LinAlgError):
        return np.full(len(times) + 2 * (DEGREE + 1) * len(widths), np.nan)
    derivatives = [spline(begins, nu=j) for j in range(DEGREE + 1)]
    coefficients = [d * (widths**j / math.factorial(j))[:, None] for j, d in enumerate(derivatives)]
    return np.concatenate([times, np.hstack(coefficients).ravel()])


def _passes_its_points(points: tuple[Vector2, ...], values: np.ndarray) -> bool:
    """Whether each piece begins and ends at its way-points, to `EXACT` of their extent."""
    wanted = np.array(points)
    pieces = values[len(points) :].reshape(len(points) - 1, DEGREE + 1, 2)
    missed = np.abs(np.concatenate([pieces[:, 0] - wanted[:-1], pieces.sum(axis=1) - wanted[1:]])).max()
    return bool(missed <= EXACT * np.ptp(wanted, axis=0).max())
