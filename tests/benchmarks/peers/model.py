"""The benchmark's equations as a list of elementary operations, for packages that pin other versions of CasADi.

Loaded in the peers' environment, which has no occ: nothing but the standard library here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "OP_ADD": lambda a, b: a + b,
    "OP_SUB": lambda a, b: a - b,
    "OP_MUL": lambda a, b: a * b,
    "OP_DIV": lambda a, b: a / b,
}
UNARY: dict[str, Callable[[Any], Any]] = {
    "OP_NEG": lambda a: -a,
    "OP_SQ": lambda a: a * a,
    "OP_TWICE": lambda a: a + a,
    "OP_INV": lambda a: 1.0 / a,
}


def evaluate(model: dict[str, Any], library: Any, *arguments: Sequence[Any]) -> list[list[Any]]:
    """The model's outputs; sin, cos and sqrt are the library's."""
    work: dict[int, Any] = {}
    outputs: list[list[Any]] = [[0.0] * size for size in model["outputs"]]
    for name, into, of, value in model["instructions"]:
        if name == "OP_CONST":
            work[into[0]] = value
        elif name == "OP_INPUT":
            work[into[0]] = arguments[of[0]][of[1]]
        elif name == "OP_OUTPUT":
            outputs[into[0]][into[1]] = work[of[0]]
        elif name in BINARY:
            work[into[0]] = BINARY[name](work[of[0]], work[of[1]])
        elif name in UNARY:
            work[into[0]] = UNARY[name](work[of[0]])
        else:
            work[into[0]] = getattr(library, name.removeprefix("OP_").lower())(work[of[0]])
    return outputs
