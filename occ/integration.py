"""x' = f(t, x) by the explicit Runge-Kutta method of order 8 of Dormand and Prince, with its polynomial on every step.

The method and its numbers are those of SciPy's DOP853.  Here all stages of a step are one call of a CasADi function, so
that a step takes some ten microseconds and not a millisecond; where f is a Python function it is called stage by stage.
Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.4 to II.6.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np

from occ.numeric import BufferedFunction

SAFETY, SLOWEST, FASTEST = 0.9, 0.2, 10.0
"""Part of the step that the error allows, and the least and the largest factor from one step to the next."""
EXPONENT = -1 / 8
"""The error estimate is of order 7."""
FIRST = 0.1
"""Part of the longest step that is tried first."""
SHORTEST = 1e-14
"""A step that fails at this part of the horizon will fail at any length."""


class IntegrationError(Exception):
    """The integration cannot be finished; carries the time [s] and the reason."""

    def __init__(self, t: float, reason: str) -> None:
        super().__init__(f"{reason} at t = {t:.6g} s")
        self.t = t


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


class Step(Protocol):
    """One step of a method from (t, x)."""

    def begin(self, t: float, x: np.ndarray) -> bool:
        """Take (t, x) as the beginning; whether f is finite there."""
        ...

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
    t, x, h = float(edges[0]), start, FIRST * settings.longest
    times, states, shapes = [t], [x], []
    for k, end in enumerate(edges[1:].tolist()):
        enter(k, x)
        if not step.begin(t, x):
            raise IntegrationError(t, OUT_OF_RANGE)
        while t < end:
            h = min(h, settings.longest)
            # A last step that would be tiny is shared with the one before.
            cut = end - t if h >= end - t else (end - t) / 2 if 2 * h > end - t else h
            error = step.attempt(t, cut)
            if not error < 1.0:
                if cut <= SHORTEST * edges[-1]:
                    reason = "the step of the integrator shrinks to nothing" if np.isfinite(error) else OUT_OF_RANGE
                    raise IntegrationError(t, reason)
                h = cut * (max(SLOWEST, SAFETY * error**EXPONENT) if np.isfinite(error) else SLOWEST)
                continue
            t = end if cut == end - t else t + cut
            x, shape = step.accept()
            if not (np.abs(x) < settings.largest).all():
                raise IntegrationError(t, OUT_OF_RANGE)
            times.append(t)
            states.append(x)
            shapes.append(shape)
            following = cut * min(FASTEST, SAFETY * max(error, 1e-12) ** EXPONENT)
            # A step that was cut at the end of a piece says nothing against the length that it should have had.
            h = following if cut == h else max(h, following)
    return Steps(np.array(times), np.array(states[:-1]), np.array(shapes), x)


OUT_OF_RANGE = "the motion leaves every physical range"


class CompiledStep:
    """Steps of f(t, x, p), a CasADi function of SX.

    Args:
        rate: f; t (), x (n,), p (m,).
        tolerance: of the error, relative and absolute.
    """

    def __init__(self, rate: ca.Function, tolerance: float) -> None:
        self._rate, self._step = BufferedFunction(rate), BufferedFunction(_compiled(rate))
        self._step.inputs[5][0] = tolerance

    def parameters(self, values: Iterable[float] | np.ndarray) -> None:
        """Set p."""
        self._rate.inputs[2][:] = self._step.inputs[4][:] = values

    def begin(self, t: float, x: np.ndarray) -> bool:
        self._rate.inputs[0][0], self._rate.inputs[1][:] = t, x
        self._rate()
        self._step.inputs[2][:], self._step.inputs[3][:] = x, self._rate.outputs[0]
        return bool(np.isfinite(self._rate.outputs[0]).all())

    def attempt(self, t: float, h: float) -> float:
        step = self._step
        step.inputs[0][0], step.inputs[1][0] = t, h
        step()
        return float(step.outputs[0][0])

    def accept(self) -> tuple[np.ndarray, np.ndarray]:
        _, x, rate, shape = self._step.outputs
        self._step.inputs[2][:], self._step.inputs[3][:] = x, rate
        return x.copy(), shape.reshape(7, -1).copy()


class PythonStep:
    """Steps of f(t, x), a Python function.

    Args:
        rate: f; t [s], x (n,) -> (n,), an array that nobody else writes to.
        tolerance: of the error, relative and absolute.
    """

    def __init__(self, rate: Callable[[float, np.ndarray], np.ndarray], tolerance: float) -> None:
        from scipy.integrate import DOP853

        self._rate, self._tolerance, self._method = rate, tolerance, DOP853
        self._x = self._k = self._next = np.zeros(0)
        self._t = self._h = 0.0

    def begin(self, t: float, x: np.ndarray) -> bool:
        self._k = np.zeros((16, len(x)))
        self._x, self._k[0] = x, self._rate(t, x)
        return bool(np.isfinite(self._k[0]).all())

    def attempt(self, t: float, h: float) -> float:
        m, k, x = self._method, self._k, self._x
        # A trial step that is too long may go anywhere; its error tells.
        with np.errstate(all="ignore"):
            for i in range(1, 12):
                k[i] = self._rate(t + m.C[i] * h, x + h * (m.A[i, :i] @ k[:i]))
            self._t, self._h, self._next = t, h, x + h * (m.B @ k[:12])
            k[12] = self._rate(t + h, self._next)
            scale = self._tolerance * (1.0 + np.maximum(np.abs(x), np.abs(self._next)))
            return float(_error_norm(h * (m.E5 @ k[:13]) / scale, h * (m.E3 @ k[:13]) / scale, len(x), np.dot))

    def accept(self) -> tuple[np.ndarray, np.ndarray]:
        m, k, x, h = self._method, self._k, self._x, self._h
        for i, (a, c) in enumerate(zip(m.A_EXTRA, m.C_EXTRA, strict=True), start=13):
            k[i] = self._rate(self._t + c * h, x + h * (a[:i] @ k[:i]))
        change = self._next - x
        shape = [change, h * k[0] - change, 2 * change - h * (k[12] + k[0]), *(h * (m.D @ k))]
        self._x = self._next
        k[0] = k[12]
        return self._x, np.array(shape)


def _error_norm(fifth: Any, third: Any, size: int, dot: Callable[[Any, Any], Any]) -> Any:
    """|e5|^2 / sqrt(n (|e5|^2 + |e3|^2 / 100)), the estimate of order 7 from those of order 5 and 3."""
    of_fifth, of_third = dot(fifth, fifth), dot(third, third)
    return of_fifth / ((of_fifth + 0.01 * of_third) * size + 1e-300) ** 0.5


@lru_cache(maxsize=32)
def _compiled(rate: ca.Function) -> ca.Function:
    """CasADi function (t, h, x, f(t, x), p, tolerance) -> error, x(t + h), f(t + h, x), coefficients (n, 7)."""
    from scipy.integrate import DOP853

    n = rate.numel_in(1)
    t, h, tolerance = (ca.SX.sym(name) for name in ("t", "h", "tolerance"))
    x, first, p = ca.SX.sym("x", n), ca.SX.sym("rate", n), ca.SX.sym("p", rate.numel_in(2))
    k = [first]

    def change(weights: np.ndarray) -> ca.SX:
        return h * sum((float(w) * stage for w, stage in zip(weights, k, strict=False) if w), start=ca.SX(n, 1))

    for i in range(1, 12):
        k.append(rate(t + float(DOP853.C[i]) * h, x + change(DOP853.A[i]), p))
    whole = change(DOP853.B)
    k.append(rate(t + h, x + whole, p))
    scale = tolerance * (1 + ca.fmax(ca.fabs(x), ca.fabs(x + whole)))
    error = _error_norm(change(DOP853.E5) / scale, change(DOP853.E3) / scale, n, ca.dot)
    for a, c in zip(DOP853.A_EXTRA, DOP853.C_EXTRA, strict=True):
        k.append(rate(t + float(c) * h, x + change(a), p))
    shape = [whole, h * first - whole, 2 * whole - h * (k[12] + first), *map(change, DOP853.D)]
    outputs = [ca.densify(item) for item in (error, x + whole, k[12], ca.horzcat(*shape))]
    return ca.Function("step", [t, h, x, first, p, tolerance], outputs)
