"""The committed figure data, read once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pandas as pd
import pytest

COMMITTED = Path(__file__).parents[2] / "reports" / "paper"


@pytest.fixture(scope="session")
def committed() -> Callable[[int], pd.DataFrame]:
    return cache(lambda number: pd.read_csv(COMMITTED / f"fig{number:02d}.csv", dtype={"q": str}))
