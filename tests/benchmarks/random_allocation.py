"""Random wrenches: closed form, vertex enumeration, OSQP and CVXPY; `reports/random_allocation.*`.

    python -m tests.benchmarks.random_allocation [OUT] [PARTS]

Each part has 2,000 samples of one kind and criterion, for the youBot or for another four wheels.  No way is believed:
the closed form is proven sample by sample by residuals and dual bounds recomputed outside of every solver, and where
another way disagrees it is these that tell who is right.  A part whose rows are in the file already is not solved
again; the page is made from the rows alone.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from occ.allocation import LEAST_NORM, Criterion, ElectricPower, InputMap, LargestTorque, TorqueRange, WeightedNorm
from occ.allocation.allocator import solve
from occ.allocation.osqp_qp import OsqpAllocator
from occ.allocation.ranges import box
from occ.allocation.reach import zonotope
from occ.allocation.reference import least_excess, least_torques
from occ.allocation.residuals import certified, proven_excess
from occ.allocation.result import Allocation, Question, question
from tests.allocation.wrenches import (
    by_vertices,
    random_ranges,
    random_rates,
    random_wrenches,
    skewed_map,
    youbot_map,
)

SAMPLES = 2000
PARTS = 10
STACK = 250
"""Samples in one problem of CVXPY."""
AGREE = 1e-6
"""Values that differ by less, relative to the size of what they add up, are one; so are excesses, to the torques."""
NOTHING = 1e-8
"""A least excess of CVXPY below this, relative to the torques, is none."""
CLASSES = {
    "undecided": "the way says itself that it cannot tell: OSQP's 20,000 iterations end without a torque or a "
    "certificate that stands recomputation (linear programmes, and wrenches just out of reach), or Clarabel gives up; "
    "the closed form is proven there.",
    "border": "one says that the wrench is in reach and the other that it is not, and the limits have less than 1e-6 "
    "of the torques to spare or to lack; the closed form's word is proven.",
    "worse": "the way's value is larger than the proven one: its solver has stopped early.",
    "outside": "the way's value is smaller, and its torques pass the limits.",
    "unexplained": "none of these, or the closed form is not proven.",
}

CRITERIA: dict[str, Criterion] = {
    "least norm": LEAST_NORM,
    "weighted norm, copper loss": WeightedNorm((1.0, 4.0, 0.3, 2.0)),
    "largest torque": LargestTorque(),
    "electric power": ElectricPower(),
}
Sampled = tuple[np.ndarray, TorqueRange, np.ndarray]
"""Wrenches (3, N), ranges, wheel rates (4, N)."""


def plain_ranges(count: int, rng: np.random.Generator) -> TorqueRange:
    """Lower and upper limits [N m] that differ from wheel to wheel, and let each of them rest."""
    return TorqueRange(-rng.uniform(0.1, 2.0, (4, count)), rng.uniform(0.1, 2.0, (4, count)))


def in_reach(wheels: InputMap, count: int, seed: int) -> Sampled:
    """Wrenches of torques within their limits."""
    rng = np.random.default_rng(seed)
    ranges = plain_ranges(count, rng)
    return wheels.wrench(rng.uniform(ranges.lower, ranges.upper)), ranges, random_rates(count, seed)


def out_of_reach(wheels: InputMap, count: int, seed: int) -> Sampled:
    """Beyond the most that the limits allow in some direction, by much or by very little."""
    rng = np.random.default_rng(seed)
    ranges = plain_ranges(count, rng)
    direction = wheels.min_norm.T @ rng.normal(size=(4, count))
    rows = wheels.wheel_rates @ direction
    most = wheels.wrench(np.where(rows > 0, ranges.upper, ranges.lower))
    beyond = wheels.wrench(rows / np.linalg.norm(rows, axis=0)) * 10.0 ** rng.uniform(-5, 1, count)
    return most + beyond, ranges, random_rates(count, seed)


def degenerate_limits(wheels: InputMap, count: int, seed: int) -> Sampled:
    """Some ranges are points, some have no end, some do not let a wheel rest."""
    return random_wrenches(wheels, 1.0, count, seed), random_ranges(wheels, count, seed), random_rates(count, seed)


def zero_rates(wheels: InputMap, count: int, seed: int) -> Sampled:
    """One wheel stands, or two, three or all of them."""
    rates = random_rates(count, seed)
    rates[np.arange(4)[:, None] <= np.arange(count) % 4] = 0.0
    return random_wrenches(wheels, 0.8, count, seed), box(1.0, 4), rates


def grid(wheels: InputMap, count: int, seed: int) -> Sampled:
    """Torques of 0, half and all of the limit, rates of 0 and both signs: corners, kinks and borders, exactly."""
    index = np.arange(count) + seed * count
    torque, rates = (np.array(list(product(side, repeat=4))).T for side in ((-1, -0.5, 0, 0.5, 1), (-5.0, 0.0, 5.0)))
    return wheels.wrench(torque[:, index % 625]), box(1.0, 4), rates[:, index * 7 % 81]


KINDS: dict[str, Callable[[InputMap, int, int], Sampled]] = {
    "in reach": in_reach,
    "out of reach": out_of_reach,
    "degenerate limits": degenerate_limits,
    "zero rates": zero_rates,
    "grid": grid,
}


class Answer(NamedTuple):
    """What one way says.

    Args:
        torque: (4, N) [N m]; NaN where it says that there is none.
        unknown: (N,) where it says itself that it cannot tell.
        excess: (N,) [N m] by how much all limits would have to be wider; NaN where it has not asked.
    """

    torque: np.ndarray
    unknown: np.ndarray
    excess: np.ndarray


def vertices(asked: Question) -> Answer:
    """Every null torque at which something changes."""
    rates = np.broadcast_to(asked.rates, asked.min_norm.shape)
    torque = by_vertices(asked.wheels, asked.wrench, asked.ranges, rates, asked.criterion)
    return Answer(torque, np.zeros(torque.shape[1], dtype=bool), np.full(torque.shape[1], np.nan))


def osqp(asked: Question) -> Answer:
    """One OSQP workspace with updates; it cannot tell where its iterations end without a proof."""
    found = OsqpAllocator(asked.wheels, asked.criterion).solve(asked)
    return Answer(found.torque, found.failed, np.full(len(found.failed), np.nan))


def cvxpy(asked: Question) -> Answer:
    """CVXPY and Clarabel: first how much the limits lack, then the best torques where that is nothing."""
    stacks = [asked.of(slice(k, k + STACK)) for k in range(0, asked.min_norm.shape[1], STACK)]
    excess = np.hstack([least_excess(stack)[0] for stack in stacks])
    torque = np.full(asked.min_norm.shape, np.nan)
    reachable = np.flatnonzero(excess <= NOTHING * sizes(asked))
    for few in np.split(reachable, range(STACK, len(reachable), STACK)):
        if few.size:
            torque[:, few] = least_torques(asked.of(few))
    unknown = np.isnan(excess)
    unknown[reachable] = np.isnan(torque[0, reachable])
    return Answer(torque, unknown, excess)


WAYS = {"vertices": vertices, "OSQP": osqp, "CVXPY": cvxpy}


def sizes(asked: Question) -> np.ndarray:
    """(N,) [N m] What an excess is measured by."""
    return np.maximum(np.abs(asked.min_norm).max(axis=0), 1e-6)


def rows_of(name: str, kind: str, part: int, samples: int = SAMPLES) -> list[dict[str, Any]]:
    """Solve one part in every way."""
    wheels = skewed_map() if part % 2 else youbot_map()
    wrench, ranges, rates = KINDS[kind](wheels, samples, part)
    asked = question(wheels, wrench, ranges, CRITERIA[name], rates)
    found = solve(asked)
    proven = proven_answers(asked, found)
    head = {"criterion": name, "kind": kind, "part": part, "samples": samples, "reachable": int(found.reachable.sum())}
    head |= {"closed_form_unproven": int((~proven).sum())}
    return [head | {"way": way} | compared(asked, found, proven, run(asked)) for way, run in WAYS.items()]


def proven_answers(asked: Question, found: Allocation) -> np.ndarray:
    """(N,) Whether a torque is proven by its residuals and dual bound, or its absence by a facet."""
    proven = np.zeros(len(found.reachable), dtype=bool)
    good = found.reachable
    proven[good] = certified(asked.of(good), found.torque[:, good]).prove
    _, row = zonotope(asked.wheels).excess(asked.min_norm, asked.ranges)
    normals = zonotope(asked.wheels).normals[row].T
    lacking = [proven_excess(asked.wheels, asked.wrench, asked.ranges, side * normals) for side in (-1, 1)]
    proven[~good] = (np.max(lacking, axis=0) > 0)[~good]
    return proven


def compared(asked: Question, found: Allocation, proven: np.ndarray, answer: Answer) -> dict[str, Any]:
    """How many samples agree with another way's answer, by how much, and what each of the others is (`CLASSES`)."""
    torque, unknown, excess = answer
    there = np.isfinite(torque).all(axis=0)
    both, none = (there & found.reachable & ~unknown), ~(there | found.reachable | unknown)
    few, difference = asked.of(both), np.zeros(len(both))
    mine, other = (few.criterion.value(part[:, both], few.rates) for part in (found.torque, torque))
    difference[both] = (other - mine) / np.maximum(few.criterion.size(found.torque[:, both], few.rates), 1e-6)
    difference[none] = np.nan_to_num((excess - found.excess) / sizes(asked))[none]
    same = (both | none) & (np.abs(difference) <= AGREE)
    left = ~same & ~unknown & proven
    near = np.abs(zonotope(asked.wheels).excess(asked.min_norm, asked.ranges)[0]) < AGREE * sizes(asked)
    outside = asked.ranges.excess(np.where(there, torque, 0.0)) > 0
    classes = {
        "undecided": unknown & proven,
        "border": left & (there != found.reachable) & near,
        "worse": left & both & (difference > 0),
        "outside": left & both & (difference < 0) & outside,
    }
    known = np.any([same & proven, *classes.values()], axis=0)
    counts = {"agree": int(same.sum()), "greatest_difference": float(np.abs(difference[same]).max(initial=0.0))}
    return counts | {name: int(which.sum()) for name, which in classes.items()} | {"unexplained": int((~known).sum())}


def page(rows: list[dict[str, str]]) -> str:
    """The tables of the rows on disk."""

    def total(column: str, **wanted: str) -> int:
        return sum(int(row[column]) for row in rows if all(row[key] == value for key, value in wanted.items()))

    def greatest(**wanted: str) -> float:
        chosen = (row for row in rows if all(row[key] == value for key, value in wanted.items()))
        return max((float(row["greatest_difference"]) for row in chosen), default=0.0)

    one = next(iter(WAYS))
    lines = [
        "# Random wrenches: four ways of allocation",
        "",
        f"{total('samples', way=one)} samples for the youBot and for another four wheels (`random_allocation.csv`).  "
        "The closed form is compared with vertex enumeration, OSQP (one workspace for each part, updated) and CVXPY "
        f"({STACK} samples in one problem, Clarabel).",
        "",
        "No way is believed.  Each answer of the closed form is proven outside of every solver: a torque by its "
        "residuals and by the dual bound at its multipliers (1e-9, relative), the absence of one by a facet of the "
        f"reachable wrenches.  Without a proof: {total('closed_form_unproven', way=one)} samples.",
        "",
        f"Two ways agree where they agree on reach and their values differ by at most {AGREE:g} of the terms that the "
        "value adds up; out of reach CVXPY's least excess is compared, too, relative to the torques.",
        "",
        "| criterion | kind of sample | way | samples | in reach | agree | greatest difference | "
        + " | ".join(CLASSES)
        + " |",
        "| :--- | :--- | :--- | ---: | ---: | ---: | ---: |" + " ---: |" * len(CLASSES),
    ]
    for name, kind, way in product(CRITERIA, KINDS, WAYS):
        key = {"criterion": name, "kind": kind, "way": way}
        if total("samples", **key):
            counts = (f"{total(column, **key)}" for column in CLASSES)
            lines.append(
                f"| {name} | {kind} | {way} | {total('samples', **key)} | {total('reachable', **key)} | "
                f"{total('agree', **key)} | {greatest(**key):.1e} | {' | '.join(counts)} |"
            )
    for way in WAYS:
        counts = (f"{total(column, way=way)}" for column in CLASSES)
        lines.append(
            f"| all | all | {way} | {total('samples', way=way)} | {total('reachable', way=way)} | "
            f"{total('agree', way=way)} | {greatest(way=way):.1e} | {' | '.join(counts)} |"
        )
    lines += ["", "What the discrepancies are:", "", *(f"* **{name}**: {words}" for name, words in CLASSES.items())]
    return "\n".join(lines) + "\n"


def main(out: Path, parts: int) -> None:
    """Solve what is missing on two processors, and write the page."""
    path = out / "random_allocation.csv"
    rows = list(csv.DictReader(path.read_text().splitlines())) if path.exists() else []
    done = {(row["criterion"], row["kind"], int(row["part"])) for row in rows}
    # The first part of everything before the second one of anything: a page half done shows all kinds.
    missing = [key for part in range(parts) for key in product(CRITERIA, KINDS, [part]) if key not in done]
    with ProcessPoolExecutor(2) as pool:
        for future in as_completed([pool.submit(rows_of, *key) for key in missing]):
            rows += [{key: str(value) for key, value in row.items()} for row in future.result()]
            rows.sort(key=_place)
            write(path, rows)
            (out / "random_allocation.md").write_text(page(rows))


def write(path: Path, rows: list[dict[str, str]]) -> None:
    """All rows, by way of another file: a half-written one is never read."""
    half = path.with_suffix(".part")
    with half.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    half.replace(path)


def _place(row: dict[str, str]) -> tuple[int, ...]:
    orders = ((CRITERIA, "criterion"), (KINDS, "kind"), (WAYS, "way"))
    criterion, kind, way = (list(family).index(row[column]) for family, column in orders)
    return criterion, kind, int(row["part"]), way


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports"), int(sys.argv[2]) if len(sys.argv) > 2 else PARTS)
