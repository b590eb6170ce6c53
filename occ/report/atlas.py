"""The report of an atlas: where the law is near the optimum, in numbers, and the maps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from occ.atlas.dataset import FILE, slabs
from occ.atlas.variables import REGIMES
from occ.experiment.store import write_text
from occ.report.tables import Column, Table, markdown, markdown_text, significant

if TYPE_CHECKING:
    import xarray as xr

NEAR = (0.2, 1.0, 3.0, 10.0)
"""[%] Gaps up to which points are counted."""
READING = """\
Blue is where the law is within 1 % of the optimum; from yellow to red it is not. The borders between the colours are
gaps of 0.2, 1, 3, 10, 30 and 100 %, the white line is that of 1 %; few points are drawn as cells. The solid line is the
law's critical radius: on smaller circles it has no steady rotation and the platform rotates for ever. The broken line
is the same for the optimum. Least mean powers are exact (a closed form with one quadrature and one root); the mean
power of a rotating law is that of its computed periodic orbit (measured). Grey: no value. The long run says nothing of
a finite horizon, nor of limits.
"""
FINITE = """\
Works over the finite horizon begin at the start of the experiment; the least work is the exact infimum over all motions
with B on its program and a free end, without limits.
"""
COMPARED = """\
In a full comparison each row is the referee's; a gap is that of an `ok` row to the largest bound of its class (exact
for the work, local optima otherwise). Rows that are not `ok` have no gap and are counted below.
"""


def atlas_tables(data: xr.Dataset) -> list[Table]:
    """Shares of points by gap, and regimes.

    Args:
        data: the atlas.

    Returns:
        Tables for report and terminal.
    """
    tables = [_gaps(data), _regimes(data)]
    if "status" in data:
        tables.append(_statuses(data))
    return tables


def _gaps(data: xr.Dataset) -> Table:
    columns = [Column("Gap of the law"), *(Column(f"up to {limit:g} %", "% of points", True) for limit in NEAR)]
    columns += [Column("median", "%", True), Column("largest", "%", True), Column("no value", "% of points", True)]
    rows = []
    for name, values in _gap_columns(data):
        known = values[np.isfinite(values)]
        shares = [f"{100 * np.mean(values <= limit):.1f}" for limit in NEAR]
        ends = [significant(float(f(known)), 3) if known.size else "–" for f in (np.median, np.max)]
        rows.append((name, *shares, *ends, f"{100 * (1 - known.size / values.size):.1f}"))
    return Table("Where the law is near the optimum", tuple(columns), tuple(rows))


def _gap_columns(data: xr.Dataset) -> list[tuple[str, np.ndarray]]:
    found = [("long run", data["long_run_gap_percent"].values.ravel())]
    for name, values in data.data_vars.items():
        if str(name).endswith("_gap_percent") and name != "long_run_gap_percent":
            one = values.isel(controller=0) if "controller" in values.dims else values
            what = str(name).removesuffix("_gap_percent").replace("_", " ")
            found.append((f"{what}, finite horizon", one.values.ravel()))
    return found


def _regimes(data: xr.Dataset) -> Table:
    counts: Counter[tuple[str, str]] = Counter()
    for part in slabs(data[["law_regime", "least_mean_power_regime"]]):
        law, best = ({name: texts == name for name in REGIMES} for texts in (v.values for v in part.values()))
        counts.update({(a, b): int(np.count_nonzero(law[a] & best[b])) for a in REGIMES for b in REGIMES})
    laws, optima = (sorted({pair[k] for pair in counts if counts[pair]}) for k in range(2))
    rows = [(a, b, f"{100 * counts[a, b] / counts.total():.1f}") for a in laws for b in optima]
    return Table("Regimes", (Column("law"), Column("optimum"), Column("share", "% of points", True)), tuple(rows))


def _statuses(data: xr.Dataset) -> Table:
    names = [str(name) for name in data["controller"].values]
    words = np.unique(data["status"].values)
    rows = [
        (name, *(str(int((data["status"].isel(controller=k).values == word).sum())) for word in words))
        for k, name in enumerate(names)
    ]
    return Table(
        "Rows by status", (Column("controller"), *(Column(str(word), "", True) for word in words)), tuple(rows)
    )


def write_atlas_report(
    data: xr.Dataset,
    folder: Path,
    tables: Sequence[Table],
    maps: Sequence[tuple[str, str]],
    failures: Sequence[tuple[str, ...]],
) -> None:
    """Write ``report.md``.

    Args:
        data: the atlas.
        folder: of the experiment.
        tables: of `atlas_tables`.
        maps: path from the folder, and caption, of each.
        failures: place, controller, status and reason of each row without a value.

    Raises:
        InputError: the folder cannot be written.
    """
    sizes = " × ".join(f"{data.sizes[key]} values of {key}" for key in data.dims if key != "controller")
    text = [f"# {markdown_text(data.attrs['title'] or 'Atlas')}", ""]
    text += [markdown_text(data.attrs["question"]), ""] if data.attrs["question"] else []
    text += [f"{sizes}; the values are in `{FILE}`.", ""]
    for table in tables:
        text += [f"**{table.caption}**", "", markdown(table), ""]
    text += ["## How to read the maps", "", READING]
    if data.attrs["depth"] == "least_work":
        text += [FINITE]
    if "controller" in data.dims:
        text += [COMPARED]
    for path, caption in maps:
        text += [f"![{caption}]({path})", "", caption, ""]
    if failures:
        text += ["## Rows without a value", "", f"All {len(failures)} are in `failures.csv`; the first ten:", ""]
        columns = (Column("place"), Column("controller"), Column("status"), Column("reason"))
        text += [markdown(Table("", columns, tuple(failures[:10]))), ""]
    write_text(folder / "report.md", "\n".join(text).rstrip() + "\n")
