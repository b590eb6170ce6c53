"""Everything that an experiment can name as a controller."""

from __future__ import annotations

from occ.laws import LAWS
from occ.optimal.collocation import Collocation
from occ.task import Player

PLAYERS: tuple[type[Player], ...] = (*LAWS, Collocation)
