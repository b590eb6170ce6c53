"""Steps from piece to piece: the control of their lengths, and the polynomials that they leave behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

SAFETY, SLOWEST, FASTEST = 0.9, 0.2, 10.0
"""Part of the step that the error allows, and the least and the largest factor from one step to the next."""
EXPONENT = -1 / 8
"""The error estimate is of order 7."""
FIRST = 0.1
"""Part of the longest step that is tried first."""
LEAST_ERROR = 1e-12
"""Smaller ones are taken for this."""
SHORTEST = 1e-14
"""A step that fails at this part of the horizon will fail at any length."""


class IntegrationError(Exception):
    """The integration cannot be finished; carries the time [s] and the reason."""

    def __init__(self, t: float, reason: str) -> None:
        super().__init__(f"{reason} at t = {t:.6g} s")
        self.t, self.reason = t, reason


@dataclass(frozen=True)
class Steps:
    """x(t) on consecutive steps, on each of them a polynomial of degree 7.

    Args:
        edges: (S + 1,) [s] ends of the steps.
        first: (S, n) x at the beginning of each step.
        shape: (S, 7, n) coefficients of s, s (1 - s), s^2 (1 - s), .. on it, s from 0 to 1.
        last: (n,) x at the end.
    """

    edges: np.ndarray
    first: np.ndarray
    shape: np.ndarray
    last: np.ndarray

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """x (n, N) at the times t (N,) [s]."""
        k = np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, len(self.first) - 1)
        s = ((t - self.edges[k]) / (self.edges[k + 1] - self.edges[k]))[:, None]
        sides = (s, 1.0 - s)
        x = np.zeros((len(t), self.first.shape[1]))
        for i in range(7):
            x += self.shape[k, 6 - i]
            x *= sides[i % 2]
        return np.asarray((self.first[k] + x).T)

    def on_each(self, places: np.ndarray) -> np.ndarray:
        """x (n, S m) at the places s (m,) in [0, 1] of every step, one step after the other."""
        s = places[:, None]
        # s, s (1 - s), s^2 (1 - s), s^2 (1 - s)^2, ..
        basis = s ** ((np.arange(7) + 2) // 2) * (1.0 - s) ** ((np.arange(7) + 1) // 2)
        x = self.first[:, None] + basis @ self.shape
        return np.asarray(x.reshape(-1, x.shape[-1]).T)


class Step(Protocol):
    """Steps of a method."""

    def begin(self, t: float, x: np.ndarray) -> bool:
        """Take (t, x) as the beginning; whether f is finite there."""
        ...

    def through(self, t: float, end: float, going: Going) -> Piece:
        """All steps from the beginning to the end of a piece."""
        ...


class Attempts(Protocol):
    """One step after the other."""

    def attempt(self, t: float, h: float) -> float:
        """The error of a step of length h, relative to what is allowed."""
        ...

    def accept(self) -> tuple[np.ndarray, np.ndarray]:
        """Go on from the end of the attempted step: x (n,) there, and the coefficients (7, n) of its polynomial."""
        ...


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How an integration goes.

    Args:
        longest: [s] step.
        largest: (n,) values of |x| at which the motion has left every physical range.
    """

    longest: float
    largest: np.ndarray


def integrate(
    step: Step, edges: np.ndarray, start: np.ndarray, settings: Settings, enter: Callable[[int, np.ndarray], None]
) -> Steps:
    """x(t) over consecutive pieces, on each of which f is smooth.

    Args:
        step: with its tolerance.
        edges: (K + 1,) [s] ends of the pieces.
        start: (n,) x at the first of them.
        settings: bounds of steps and states.
        enter: told, before each piece, its number and x (n,) at its beginning; f may be changed there.

    Returns:
        All steps.

    Raises:
        IntegrationError: x leaves `largest`, or no step is short enough.
    """
    t, x = float(edges[0]), start
    going = Going(FIRST * settings.longest, settings, SHORTEST * float(edges[-1]))
    found = []
    for k, end in enumerate(edges[1:].tolist()):
        enter(k, x)
        if not step.begin(t, x):
            raise IntegrationError(t, OUT_OF_RANGE)
        if t < end:
            found.append(step.through(t, end, going))
            t, x = end, found[-1].states[-1]
    states = np.concatenate([start[None], *(piece.states for piece in found)])
    times = np.concatenate([edges[:1], *(piece.times for piece in found)])
    return Steps(times, states[:-1], np.concatenate([piece.shapes for piece in found]), x)


class Piece(NamedTuple):
    """Steps: their ends (S,) [s], x there (S, n), and their coefficients (S, 7, n)."""

    times: np.ndarray
    states: np.ndarray
    shapes: np.ndarray


@dataclass
class Going:
    """Length of the next step, which is carried from piece to piece, and the bounds of all.

    Args:
        h: [s] of the next step.
        settings: of the integration.
        shortest: [s] that a step may be.
    """

    h: float
    settings: Settings
    shortest: float


def step_by_step(step: Attempts, t: float, end: float, going: Going) -> Piece:
    """Steps from t to the end of a piece, with the control of their lengths.

    Args:
        step: begun at t.
        t: [s].
        end: [s].
        going: changed.

    Returns:
        All steps.

    Raises:
        IntegrationError: x leaves `largest`, or no step is short enough.
    """
    times, states, shapes = [], [], []
    longest, h = going.settings.longest, going.h
    while t < end:
        h = min(h, longest)
        # A last step that would be tiny is shared with the one before.
        cut = end - t if h >= end - t else (end - t) / 2 if 2 * h > end - t else h
        error = step.attempt(t, cut)
        if not error < 1.0:
            if cut <= going.shortest:
                raise IntegrationError(t, SHRINKS if np.isfinite(error) else OUT_OF_RANGE)
            h = cut * (max(SLOWEST, SAFETY * error**EXPONENT) if np.isfinite(error) else SLOWEST)
            continue
        t = end if cut == end - t else t + cut
        x, shape = step.accept()
        if not (np.abs(x) < going.settings.largest).all():
            raise IntegrationError(t, OUT_OF_RANGE)
        times.append(t)
        states.append(x)
        shapes.append(shape)
        following = cut * min(FASTEST, SAFETY * max(error, LEAST_ERROR) ** EXPONENT)
        # A step that was cut at the end of a piece says nothing against the length that it should have had.
        h = following if cut == h else max(h, following)
    going.h = h
    return Piece(np.array(times), np.array(states), np.array(shapes))


OUT_OF_RANGE = "the motion leaves every physical range"
SHRINKS = "the step of the integrator shrinks to nothing"
