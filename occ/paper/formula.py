"""A printed formula or sentence, and the numbers that decide whether it holds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

TOLERANCE = 1e-8
"""Relative error up to which two ways to the same number agree."""


class Judgement(StrEnum):
    """What the audit says of a printed item."""

    AGREES = "agrees"
    ROUNDING = "explained by rounding"
    UNEXPLAINED = "not explained"
    MISPRINT = "misprint"


@dataclass(frozen=True)
class Check:
    """A formula as printed and, where it is a misprint, the right form, each against an independent truth.

    Args:
        equation: and section, where it is printed.
        statement: what is printed and, after "right:", the right form.
        as_printed: largest relative error of the printed form; infinite where it has no value.
        right: the same of the right form; None where nothing else than the print is proposed.
        sentence: is true (error 0) or false (error 1).
    """

    equation: str
    statement: str
    as_printed: float
    right: float | None = None
    sentence: bool = False

    @property
    def verdict(self) -> Judgement:
        """`AGREES` where the print holds, `MISPRINT` where only the right form does, else `UNEXPLAINED`."""
        if self.as_printed <= TOLERANCE:
            return Judgement.AGREES
        if self.right is not None and self.right <= TOLERANCE:
            return Judgement.MISPRINT
        return Judgement.UNEXPLAINED

    @property
    def evidence(self) -> str:
        """The errors that decide; what is below the tolerance is rounding and differs between machines."""
        parts = [f"as printed {self._words(self.as_printed)}"]
        if self.right is not None:
            parts.append(f"right form {self._words(self.right)}")
        return ", ".join(parts)

    def _words(self, error: float) -> str:
        if self.sentence:
            return "false" if error else "true"
        return "no value" if error == np.inf else f"< {TOLERANCE:g}" if error <= TOLERANCE else f"{error:.2g}"


def relative(value: np.ndarray | float, truth: np.ndarray | float) -> float:
    """max |value - truth| / max |truth|.

    Args:
        value: of any shape.
        truth: of the same shape.

    Returns:
        The largest error, relative to the largest true value; infinite where the value is not a number.
    """
    error = float(np.abs(np.asarray(value) - truth).max() / np.abs(truth).max())
    return error if np.isfinite(error) else np.inf


def claim(equation: str, statement: str, *, holds: bool, otherwise: bool | None = None) -> Check:
    """A sentence that is true or false.

    Args:
        equation: where it is printed.
        statement: what is printed and, after "right:", what is true instead.
        holds: whether the computation confirms it.
        otherwise: whether the computation confirms what is said to be true instead.

    Returns:
        The check: error 0 for true, 1 for false.
    """
    right = None if otherwise is None else float(not otherwise)
    return Check(equation, statement, float(not holds), right, sentence=True)
