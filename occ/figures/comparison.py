"""The figures of one experiment: which there are, what they are called, and writing them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from occ.figures.floor import path_figure
from occ.figures.off_program import off_program_figure
from occ.figures.over_time import Motions, cost_figure, force_figure, heading_figure
from occ.figures.reach import reach_figure, torque_box
from occ.figures.style import style, write
from occ.figures.sweep import front_figure, gap_figure, numeric_keys, value_figure, weight_keys
from occ.report.contents import plain_name
from occ.report.stored import Stored, load

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MANY_CASES = 6
"""With more cases than this only the first `DRAWN_CASES` have figures of their own, and the sweep has some, too."""
DRAWN_CASES = 3


Drawing: TypeAlias = "Callable[[Motions], Figure | None]"


@dataclass(frozen=True)
class Planned:
    """A figure that an experiment should have.

    Args:
        name: of its file, without the folder.
        caption: a plain sentence.
        case: whose motions it shows; empty for a figure of all cases.
        draw: makes it from the motions of that case; None where there is nothing to draw.
    """

    name: str
    caption: str
    case: str
    draw: Drawing


def plan(stored: Stored) -> list[Planned]:
    """Which figures belong to an experiment.

    Args:
        stored: its results.

    Returns:
        In the order of the report; one for which nothing is stored is left out when it comes to drawing.
    """
    many = len(stored.cases) > MANY_CASES
    planned: list[Planned] = []
    if many:
        for key in numeric_keys(stored):
            for item in stored.objectives:
                name = f"gap-{item.name}-{key}.svg"
                caption = f"{plain_name(item).capitalize()} above its bound against {key}."
                planned.append(Planned(name, caption, "", _of_all_cases(gap_figure, stored, item, key)))
    for key in numeric_keys(stored):
        for item in stored.objectives:
            name = f"{item.name}-{key}.svg"
            caption = f"{plain_name(item).capitalize()} of each controller against {key}."
            planned.append(Planned(name, caption, "", _of_all_cases(value_figure, stored, item, key)))
    for key in weight_keys(stored):
        for one, other in pairwise(stored.objectives):
            name = f"front-{one.name}-{other.name}-{key}.svg"
            caption = f"{plain_name(one).capitalize()} against {plain_name(other)}: the front of {key}."
            planned.append(Planned(name, caption, "", _of_all_cases(front_figure, stored, (one, other), key)))
    for case in stored.cases[:DRAWN_CASES] if many else stored.cases:
        planned += _of_case(stored, case)
    return planned


def _of_all_cases(figure: Callable[..., Figure | None], *arguments: object) -> Drawing:
    """A drawing that takes nothing from the motions of one case."""
    return lambda _: figure(*arguments)


def _of_case(stored: Stored, case: str) -> Iterator[Planned]:
    several = len(stored.cases) > 1
    prefix = f"{stored.slug(case)}-" if several else ""
    where = f", {case}" if several else ""
    for item in stored.objectives:
        if item.largest:
            continue
        yield Planned(
            f"{prefix}{item.name.replace('_', '-')}.svg",
            f"{plain_name(item).capitalize()} over time and its difference to {stored.controllers[0]}{where}.",
            case,
            partial(cost_figure, item, where=where),
        )
    yield Planned(
        f"{prefix}forces.svg",
        f"Generalised forces and wheel torques of each controller{where}.",
        case,
        partial(force_figure, where=where),
    )
    box = torque_box(stored.runs.get(case, {}).get("tables", {}))
    if box is not None:
        yield Planned(
            f"{prefix}reach.svg",
            f"Wrenches that the torque limit lets the wheels reach, and the wrenches of each motion{where}.",
            case,
            partial(reach_figure, box, where=where),
        )
    yield Planned(
        f"{prefix}off-program.svg",
        f"Distance of B from its program over time{where}.",
        case,
        partial(off_program_figure, where=where),
    )
    yield Planned(
        f"{prefix}paths.svg",
        f"Paths of B and of the platform's centre O, with the platform at even intervals of time{where}.",
        case,
        partial(path_figure, where=where),
    )
    yield Planned(f"{prefix}heading.svg", f"Heading and yaw rate{where}.", case, partial(heading_figure, where=where))


def write_figures(out: Path, progress: Callable[[str], None] | None = None) -> list[Path]:
    """Draw all figures of a stored experiment.

    Args:
        out: its folder; the files go to ``figures/`` in it.
        progress: called with the name of each file once it is written.

    Returns:
        What was written.
    """
    stored = load(out)
    written: list[Path] = []
    motions: dict[str, Motions] = {}
    with style():
        for item in plan(stored):
            if item.case and item.case not in motions:
                motions[item.case] = _motions(stored, item.case)
            if item.case and not motions[item.case]:
                continue
            figure = item.draw(motions.get(item.case, {}))
            if figure is None:
                continue
            path = out / "figures" / item.name
            write(figure, path)
            written.append(path)
            if progress:
                progress(item.name)
    return written


def drawn(out: Path) -> list[tuple[str, str]]:
    """The planned figures that are there.

    Args:
        out: folder of a stored experiment.

    Returns:
        Path from the folder, and caption, in the order of the report.
    """
    return [
        (f"figures/{item.name}", item.caption) for item in plan(load(out)) if (out / "figures" / item.name).is_file()
    ]


def _motions(stored: Stored, case: str) -> Motions:
    found = ((i, name, stored.motion(case, name)) for i, name in enumerate(stored.controllers))
    return {name: (i, motion) for i, name, motion in found if motion is not None}
