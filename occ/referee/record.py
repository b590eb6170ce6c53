"""One flat row of a comparison, and what each of its columns means."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from occ.errors import Status
from occ.objectives import INTEGRALS

MEASURES: dict[str, str] = {
    **{item.column: item.meaning for item in INTEGRALS.values()},
    "kinetic_change_J": "T(end) - T(start)",
    "dissipation_J": "integral of pi'^T Z pi' dt",
    "energy_residual_J": "work - kinetic change - dissipation; zero up to the referee's rounding",
    "peak_torque_Nm": "largest |M_i| over wheels and time",
    "peak_wheel_speed_rad_s": "largest |phi_i'| over wheels and time",
    "peak_power_W": "largest |M_i phi_i'| over wheels and time",
    "velocity_error_m_s": "largest distance of B's velocity from its program",
    "position_error_m": "largest distance of B from its program",
    "position_error_end_m": "distance of B from its program at the end",
    "tube_radius_m": "distance that B may have from its program; 0 on the path, empty where only the ends are kept",
    "defect": "largest residual of the claimed motion in the equations of motion, relative to max(1, |x'|)",
    "replay_error_m": "largest distance between claimed and true positions of O and B",
    "limit_excess": "largest excess over a limit, relative to it; 0 where every limit is held",
}
"""Columns of numbers, all recomputed by the referee, with their meaning."""

LABELS = ("case", "controller", "status", "message", "keep", "start", "end")


@dataclass(frozen=True, kw_only=True)
class Record:
    """What the referee says of one solution.

    Args:
        status: ``OK`` only if every claim holds.
        message: why not, in words with numbers and units; notes where it is.
        keep: class of the path constraint.
        start: class of the start.
        end: class of the end.
        measures: by the names of `MEASURES`; empty where there was no motion to measure.
        local_objective: objective of which the player claims a local optimum.
    """

    status: Status
    message: str = ""
    keep: str
    start: str
    end: str
    measures: dict[str, float] = field(default_factory=dict)
    local_objective: str | None = None

    @property
    def row(self) -> dict[str, Any]:
        """One flat row: labels first, then every measure (None where there is none)."""
        labels = {
            "status": self.status.value,
            "message": self.message,
            "keep": self.keep,
            "start": self.start,
            "end": self.end,
        }
        return labels | {name: self.measures.get(name) for name in MEASURES}
