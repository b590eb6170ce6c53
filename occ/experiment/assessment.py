"""What is said about the rows of a case: bounds, gaps and the long run, worked out where the rows are.

The search for a proof is a solver's work, too: where it takes its process with it, the rows stay.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from occ.experiment.case import Case
from occ.experiment.child import Lost, Tell, unheard
from occ.experiment.for_ever import for_ever
from occ.experiment.pool import Engine
from occ.experiment.proven import with_bounds, without_proof


@dataclass(frozen=True)
class Rows:
    """The rows of one case, and what is to be said about them; plain data.

    Args:
        case: whose rows they are.
        rows: with its name.
        objectives: whose bounds and gaps are wanted.
        certify: whether to look for proofs.
        endless: whether the long run is wanted.
    """

    case: Case
    rows: tuple[dict[str, Any], ...]
    objectives: tuple[str, ...]
    certify: bool = False
    endless: bool = True


class Assessment(NamedTuple):
    """The rows with bounds and gaps, the long run of the case for the record, and whether this is all there is."""

    rows: list[dict[str, Any]]
    for_ever: dict[str, Any]
    complete: bool = True


def assess(item: Rows, _: Tell = unheard) -> Assessment:
    """Bounds, gaps and the long run of one case.

    Args:
        item: plain data.

    Returns:
        Of `occ.experiment.proven.with_bounds` and `occ.experiment.for_ever.for_ever`.

    Raises:
        BoundViolation: a feasible row below a proven bound of its class.
    """
    rows = with_bounds(item.case, item.rows, item.objectives, certify=item.certify)
    return Assessment(rows, for_ever(item.case, certify=item.certify) if item.endless else {})


def assessed(items: Iterable[Rows], engine: Engine) -> list[Assessment]:
    """`assess` of each, on an engine.

    Args:
        items: plain data.
        engine: where the work is done.

    Returns:
        In the order of the items; where one is lost, rows with local bounds that say so.

    Raises:
        BoundViolation: as in `assess`.
        InputError: there is no such cluster.
    """
    items = list(items)
    found: dict[int, Assessment] = {}
    # A limit on time is one of the cases; a search for proofs only has to end some time.
    for number, outcome in replace(engine, time_limit=None).each(assess, items):
        if isinstance(outcome, Lost):
            rows = without_proof(items[number].rows, items[number].objectives, outcome.reason)
            outcome = Assessment(rows, {}, complete=False)
        found[number] = outcome
    return [found[number] for number in range(len(items))]
