"""Everything that an experiment can name as a controller."""

from __future__ import annotations

from occ.laws import LAWS
from occ.open_loop import OpenLoop
from occ.optimal.collocation import Collocation
from occ.task import Player
from occ.theory.better_laws import BestOffset, SlowManifold

PLAYERS: tuple[type[Player], ...] = (*LAWS, BestOffset, SlowManifold, Collocation, OpenLoop)
