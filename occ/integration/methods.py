"""The method of Dormand and Prince for CasADi's functions and for Python's."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from occ.integration.loop import Loop, Run
from occ.integration.steps import Going, Piece, step_by_step
from occ.numeric import BufferedFunction


class CompiledStep:
    """Steps of f(t, x, p), a CasADi function of SX.

    Args:
        rate: f; t (), x (n,), p (m,).
        tolerance: of the error, relative and absolute.
    """

    def __init__(self, rate: ca.Function, tolerance: float) -> None:
        self._rate, self._step = BufferedFunction(rate), BufferedFunction(_compiled(rate))
        self._step.inputs[5][0] = tolerance
        self._loop = _loop(rate)
        self._run: Run | None = None

    def parameters(self, values: Iterable[float] | np.ndarray) -> None:
        """Set p."""
        self._rate.inputs[2][:] = self._step.inputs[4][:] = values

    def begin(self, t: float, x: np.ndarray) -> bool:
        self._rate.inputs[0][0], self._rate.inputs[1][:] = t, x
        self._rate()
        self._step.inputs[2][:], self._step.inputs[3][:] = x, self._rate.outputs[0]
        return bool(np.isfinite(self._rate.outputs[0]).all())

    def through(self, t: float, end: float, going: Going) -> Piece:
        self._run = self._run or self._loop.run(self._step.inputs)
        if self._run is not None:
            return self._run(t, end, going)
        piece = step_by_step(self, t, end, going)
        self._loop.count(len(piece.times))
        return piece

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

    def through(self, t: float, end: float, going: Going) -> Piece:
        return step_by_step(self, t, end, going)

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


@lru_cache(maxsize=32)
def _loop(rate: ca.Function) -> Loop:
    """Steps in machine code, once there have been many."""
    return Loop(_compiled(rate))
