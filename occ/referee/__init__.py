"""The referee: recomputes every number, believes no player."""

from occ.referee.judge import Tolerances, Verdict, examine, judge
from occ.referee.record import LABELS, MEASURES, Record

__all__ = ["LABELS", "MEASURES", "Record", "Tolerances", "Verdict", "examine", "judge"]
