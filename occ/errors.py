"""Errors that name what is wrong and what would be right, and the words for the state of a result."""

from __future__ import annotations

from enum import StrEnum


class OccError(Exception):
    """Anything that occ raises on purpose."""


class InputError(OccError, ValueError):
    """What the user asked for cannot be meant: the message names the thing, its value and what would be right."""


class BoundViolation(OccError):
    """A feasible row lies below a certified lower bound of its own class: one of the two is wrong."""


class ExportError(OccError):
    """What was exported does not do what the model does, or does not compile; nothing was written."""


class Status(StrEnum):
    """The state of one row of a comparison.  Everything but ``OK`` carries its reason in the row's message."""

    OK = "ok"
    INFEASIBLE = "infeasible"
    FAILED = "failed"
    UNSTABLE = "unstable"
    CRASHED = "crashed"

    @property
    def advice(self) -> str:
        """What a user can do about it."""
        return _ADVICE[self]


_ADVICE = {
    Status.OK: "nothing to do",
    Status.INFEASIBLE: "raise the limit that the message names, or choose a controller that can respect it",
    Status.FAILED: "loosen the tolerance, refine the mesh, or start from another initial guess",
    Status.UNSTABLE: "shorten the horizon or choose another motion: the state grew beyond any physical value",
    Status.CRASHED: (
        "the message says why: what ran out of time wants more --time-limit or --patience; an error of the controller "
        "or a lost process should be reported"
    ),
}
