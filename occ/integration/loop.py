"""All steps of a piece as one call of machine code: what `step_by_step` does, to the last bit."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import partial

import casadi as ca
import numpy as np

from occ.integration.steps import (
    EXPONENT,
    FASTEST,
    LEAST_ERROR,
    OUT_OF_RANGE,
    SAFETY,
    SHRINKS,
    SLOWEST,
    Going,
    IntegrationError,
    Piece,
)
from occ.native import Often, pointers

ROOM = 256
"""Steps of one call."""
REASONS = {1: SHRINKS, 2: OUT_OF_RANGE}


class Loop:
    """Steps of one method for one f.

    Args:
        step: CasADi function (t, h, x, f(t, x), p, tolerance) -> error, x(t + h), f(t + h, x), coefficients (n, 7).
    """

    def __init__(self, step: ca.Function) -> None:
        self._size = step.numel_in(2)
        self._often = Often(step, partial(_source, self._size))

    def count(self, steps: int) -> None:
        """So many have been made otherwise."""
        self._often.used(steps)

    def run(self, inputs: Sequence[np.ndarray]) -> Run | None:
        """Steps of one motion.

        Args:
            inputs: of the step's function, with x, f(t, x), p and the tolerance; x and f are changed.

        Returns:
            What makes them; None while nothing is compiled.
        """
        compiled = self._often.compiled
        return None if compiled is None else Run(compiled.occ_steps, inputs[2:6], self._size)


class Run:
    """Steps of one motion in machine code.

    Args:
        steps: `occ_steps`.
        inputs: x, f(t, x), p and the tolerance; x and f are changed.
        size: of x.
    """

    def __init__(self, steps: Callable[..., int], inputs: Sequence[np.ndarray], size: int) -> None:
        self._steps, self._clock, self._largest = steps, np.zeros(5), np.zeros(size)
        self._made = Piece(np.empty(ROOM), np.empty((ROOM, size)), np.empty((ROOM, 7, size)))
        self._given = pointers([self._clock, *inputs, self._largest]), pointers(self._made), ctypes.c_int(ROOM)

    def __call__(self, t: float, end: float, going: Going) -> Piece:
        """From t to the end of a piece.

        Args:
            t: [s].
            end: [s].
            going: changed.

        Raises:
            IntegrationError: x leaves its range, or no step is short enough.
        """
        self._clock[:] = t, going.h, end, going.settings.longest, going.shortest
        self._largest[:] = going.settings.largest
        found = []
        while self._clock[0] < end:
            failure = ctypes.c_int(0)
            count = self._steps(*self._given, ctypes.byref(failure))
            if failure.value:
                raise IntegrationError(float(self._clock[0]), REASONS[failure.value])
            found.append(Piece(*(part[:count].copy() for part in self._made)))
        going.h = float(self._clock[1])
        return found[0] if len(found) == 1 else Piece(*map(np.concatenate, zip(*found, strict=True)))


def _source(size: int) -> str:
    """``occ_steps(in, out, room, failure)``: number of the steps that were made."""
    return f"""
int occ_steps(double** in, double** out, int room, int* failure) {{
  double* clock = in[0];
  double *x = in[1], *rate = in[2], *largest = in[5];
  double t = clock[0], h = clock[1], end = clock[2], longest = clock[3], shortest = clock[4];
  double cut, error, next[{size}], slope[{size}], shape[{7 * size}];
  const double* arg[] = {{&t, &cut, x, rate, in[3], in[4]}};
  double* res[] = {{&error, next, slope, shape}};
  int made = 0;
  while (t < end && made < room) {{
    double left = end - t, factor, following;
    if (longest < h) h = longest;
    cut = h >= left ? left : 2 * h > left ? left / 2 : h;
    evaluate(arg, res);
    if (!(error < 1.0)) {{
      if (cut <= shortest) {{
        *failure = isfinite(error) ? 1 : 2;
        break;
      }}
      factor = isfinite(error) ? {SAFETY!r} * pow(error, {EXPONENT!r}) : 0.0;
      h = cut * (factor > {SLOWEST!r} ? factor : {SLOWEST!r});
      continue;
    }}
    t = cut == left ? end : t + cut;
    for (int i = 0; i < {size}; ++i)
      if (!(fabs(next[i]) < largest[i])) *failure = 2;
    if (*failure) break;
    out[0][made] = t;
    for (int i = 0; i < {size}; ++i) {{
      x[i] = out[1][made * {size} + i] = next[i];
      rate[i] = slope[i];
    }}
    for (int i = 0; i < {7 * size}; ++i) out[2][made * {7 * size} + i] = shape[i];
    ++made;
    factor = {SAFETY!r} * pow(error > {LEAST_ERROR!r} ? error : {LEAST_ERROR!r}, {EXPONENT!r});
    following = cut * (factor < {FASTEST!r} ? factor : {FASTEST!r});
    h = cut == h || following > h ? following : h;
  }}
  clock[0] = t;
  clock[1] = h;
  return made;
}}
"""
