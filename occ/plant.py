"""The real platform where it is not what the controllers know: other numbers, another start, a sampled controller."""

from __future__ import annotations

from dataclasses import dataclass

from occ.checks import Angle, Positive, check_fields
from occ.model.platform import Platform


@dataclass(frozen=True, kw_only=True)
class Plant:
    """How the real platform differs from the model that the controllers know.

    Args:
        platform: the real one; None is the model's.
        start_offset: x [m], y [m] and heading [rad] of the start beside that of the controllers' plan, turned about O.
        sample_rate: [Hz] at which the controllers see the state; their torques are held in between (zero-order hold).
            None is all the time.

    Raises:
        InputError: numbers that are not finite, or a sample rate that is not positive.
    """

    platform: Platform | None = None
    start_offset: tuple[float, float, Angle] = (0.0, 0.0, 0.0)
    sample_rate: Positive | None = None

    def __post_init__(self) -> None:
        check_fields(self)

    def differs_from(self, model: Platform) -> bool:
        """Whether anything is different at all."""
        return (
            (self.platform is not None and self.platform.parameters().tolist() != model.parameters().tolist())
            or any(self.start_offset)
            or self.sample_rate is not None
        )
