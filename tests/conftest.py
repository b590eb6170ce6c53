"""Settings and fixtures shared by all tests."""

from __future__ import annotations

import os
from collections.abc import Callable
from decimal import Decimal

import pytest
from hypothesis import Phase, settings

# The matrices are small and the suite's processes share the cores: a second thread would only wait, and busily.
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# A deadline would measure CasADi's first compilation of a model, not the example.
settings.register_profile("occ", deadline=None, max_examples=25)
# Shrinking a failure that integrates a motion can take minutes; CI says that it fails, a developer shrinks it.
settings.register_profile(
    "ci", deadline=None, max_examples=40, derandomize=True, phases=(Phase.explicit, Phase.reuse, Phase.generate)
)
settings.load_profile("ci" if os.environ.get("CI") else "occ")


def half_a_unit(text: str) -> float:
    """Half a unit of the last digit of a printed number."""
    exponent = Decimal(text).as_tuple().exponent
    assert isinstance(exponent, int)
    return 0.5 * 10.0**exponent


@pytest.fixture(scope="session")
def printed() -> Callable[[str], object]:
    """``value == printed("41.93")``: agrees to half a unit of the last printed digit."""
    # The double nearest to a decimal number may itself lie past the half unit by a rounding error.
    return lambda text: pytest.approx(float(text), rel=1e-15, abs=half_a_unit(text) * (1 + 1e-9))
