"""Random platforms, points, motions and starts for property tests.

Every platform is far from singular by construction, so that no example is thrown away.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from occ.model.platform import Platform, Wheel
from occ.model.presets import YouBot
from occ.motion import Circle, Ellipse, FigureEight, Line, ProgramMotion, RestToRestLine, SplineMotion
from occ.task import Start

YOUBOT = YouBot()


def reals(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers in [low, high]."""
    # Nine decimals: numbers like 1e-300 only ask how tolerances are written.
    return st.floats(low, high).map(lambda x: round(x, 9))


def yaw_inertia_of_offsets(mass: float, center: tuple[float, float], wheels: list[tuple[float, float, float]]) -> float:
    """What the distances of the masses from O contribute to I_s [kg m^2]; wheels as (mass, x, y)."""
    return mass * (center[0] ** 2 + center[1] ** 2) + sum(m * (x * x + y * y) for m, x, y in wheels)


@st.composite
def youbot_overrides(draw: st.DrawFn) -> dict[str, Any]:
    """Every number of the youBot within half and twice its value; frictions, wheel mass and spin inertia may vanish."""
    half_to_double = ("platform_mass", "half_track", "half_wheelbase", "wheel_radius")
    may_vanish = ("wheel_mass", "wheel_spin_inertia", "wheel_friction", "roller_friction")
    chosen: dict[str, Any] = {name: getattr(YOUBOT, name) * draw(reals(0.5, 2.0)) for name in half_to_double}
    # A roller is smaller than its wheel.
    largest = min(2.0, 0.9 * chosen["wheel_radius"] / YOUBOT.roller_radius)
    chosen["roller_radius"] = YOUBOT.roller_radius * draw(reals(0.5, largest))
    factor = st.one_of(st.just(0.0), reals(0.5, 2.0))
    chosen |= {name: getattr(YOUBOT, name) * draw(factor) for name in may_vanish}
    chosen["mass_center"] = (draw(reals(-0.08, 0.08)), draw(reals(-0.08, 0.08)))
    h, l = chosen["half_wheelbase"], chosen["half_track"]
    offsets = yaw_inertia_of_offsets(chosen["platform_mass"], chosen["mass_center"], [(chosen["wheel_mass"], h, l)] * 4)
    chosen["yaw_inertia"] = offsets + draw(reals(0.3, 6.0))
    return chosen


def youbots() -> st.SearchStrategy[Platform]:
    """YouBots with other numbers."""
    return youbot_overrides().map(lambda numbers: YouBot(**numbers).platform())


@st.composite
def wheels(draw: st.DrawFn, index: int, skew: float) -> Wheel:
    """One wheel; the first three of a platform stand around it so that no torque is without effect.

    Their roller axes are within 0.4 rad of directions that are 120 degrees apart, and all of them have a lever arm
    about O of at least half the wheel's distance: forces along them cannot be in equilibrium.
    """
    if index < 3:
        angle = 2 * math.pi * index / 3 + draw(reals(-0.2, 0.2))
        distance = draw(reals(0.15, 0.5))
        axis = angle + math.pi / 2 + skew + draw(reals(-0.2, 0.2)) + draw(st.sampled_from((0.0, math.pi)))
        x, y = distance * math.cos(angle), distance * math.sin(angle)
    else:
        x, y, axis = draw(reals(-0.5, 0.5)), draw(reals(-0.5, 0.5)), draw(reals(-math.pi, math.pi))
    roller_angle = draw(reals(-1.1, 1.1))
    return Wheel(
        position=(x, y),
        mounting_angle=axis - roller_angle,
        roller_angle=roller_angle,
        radius=draw(reals(0.03, 0.12)),
        roller_radius=draw(reals(0.005, 0.028)),
        mass=draw(st.one_of(st.just(0.0), reals(0.2, 4.0))),
        spin_inertia=draw(st.one_of(st.just(0.0), reals(1e-3, 2e-2))),
        friction=draw(st.one_of(st.just(0.0), reals(0.01, 0.3))),
        roller_friction=draw(st.one_of(st.just(0.0), reals(1e-3, 1e-2))),
    )


@st.composite
def wheeled_platforms(draw: st.DrawFn, fewest: int = 3, most: int = 6) -> Platform:
    """Platforms on three to six different wheels at random places and angles."""
    skew = draw(reals(-0.6, 0.6))
    chosen = tuple(draw(wheels(i, skew)) for i in range(draw(st.integers(fewest, most))))
    mass, center = draw(reals(5.0, 60.0)), (draw(reals(-0.1, 0.1)), draw(reals(-0.1, 0.1)))
    offsets = yaw_inertia_of_offsets(mass, center, [(wheel.mass, *wheel.position) for wheel in chosen])
    return Platform(mass=mass, mass_center=center, yaw_inertia=offsets + draw(reals(0.3, 6.0)), wheels=chosen)


def platforms() -> st.SearchStrategy[Platform]:
    """YouBots with other numbers, and platforms on three to six wheels."""
    return st.one_of(youbots(), wheeled_platforms())


def points() -> st.SearchStrategy[tuple[float, float]]:
    """Points B in the body frame [m]."""
    return st.tuples(reals(-0.6, 0.6), reals(-0.6, 0.6))


def angles() -> st.SearchStrategy[float]:
    """Headings and phases [rad]."""
    return reals(-math.pi, math.pi)


@st.composite
def circles(draw: st.DrawFn) -> Circle:
    """Circles of 0.1 to 2 m, in both directions."""
    rate = draw(reals(0.1, 1.5)) * draw(st.sampled_from((-1.0, 1.0)))
    return Circle(radius=draw(reals(0.1, 2.0)), rate=rate, phase=draw(angles()))


@st.composite
def lines(draw: st.DrawFn) -> Line:
    """Straight lines in any direction."""
    speed, direction = draw(reals(0.05, 1.0)), draw(angles())
    return Line(
        velocity=(speed * math.cos(direction), speed * math.sin(direction)),
        start=(draw(reals(-1.0, 1.0)), draw(reals(-1.0, 1.0))),
    )


def rates() -> st.SearchStrategy[float]:
    """Rates [rad/s] of closed curves, in both directions and far from zero."""
    return st.builds(lambda size, sign: size * sign, reals(0.1, 1.0), st.sampled_from((-1.0, 1.0)))


def semi_axes() -> st.SearchStrategy[tuple[float, float]]:
    """Half lengths and half widths [m]; either may be the longer one."""
    return st.tuples(reals(0.1, 1.5), reals(0.1, 1.5))


def ellipses() -> st.SearchStrategy[Ellipse]:
    """Ellipses of any tilt, in both directions."""
    return st.builds(Ellipse, semi_axes=semi_axes(), rate=rates(), phase=angles(), tilt=angles())


def figure_eights() -> st.SearchStrategy[FigureEight]:
    """Figure-eights from any of their points, in both directions."""
    return st.builds(FigureEight, semi_axes=semi_axes(), rate=rates(), phase=angles())


@st.composite
def splines(draw: st.DrawFn, closed: bool | None = None) -> SplineMotion:
    """Splines through two to six way-points, or around three to six that are then repeated.

    Way-points that follow each other are at least 0.2 m apart.
    """
    if closed is None:
        closed = draw(st.booleans())
    count = draw(st.integers(3, 6) if closed else st.integers(2, 6))
    points = [(draw(reals(-1.0, 1.0)), draw(reals(-1.0, 1.0)))]
    if closed:
        corners = [2 * math.pi * (k + draw(reals(-0.2, 0.2))) / count for k in range(count)]
        points = [(size * math.cos(a), size * math.sin(a)) for a in corners for size in [draw(reals(0.3, 1.0))]]
        points.append(points[0])
    else:
        for _ in range(count - 1):
            size, direction = draw(reals(0.2, 1.0)), draw(angles())
            x, y = points[-1]
            points.append((x + size * math.cos(direction), y + size * math.sin(direction)))
    times = [0.0]
    for _ in points[1:]:
        times.append(times[-1] + draw(reals(1.2, 3.0)))
    return SplineMotion(points=tuple(points), times=tuple(times), closed=closed)


@st.composite
def rest_to_rest_lines(draw: st.DrawFn) -> RestToRestLine:
    """Ways of 0.1 to 2 m in any direction."""
    size, direction = draw(reals(0.1, 2.0)), draw(angles())
    x, y = draw(reals(-1.0, 1.0)), draw(reals(-1.0, 1.0))
    end = (x + size * math.cos(direction), y + size * math.sin(direction))
    return RestToRestLine(start=(x, y), end=end, duration=draw(reals(2.0, 8.0)))


def motions() -> st.SearchStrategy[ProgramMotion]:
    """Program motions of every kind."""
    return st.one_of(circles(), ellipses(), figure_eights(), lines(), rest_to_rest_lines(), splines())


def starts() -> st.SearchStrategy[Start]:
    """Headings and yaw rates at t = 0."""
    return st.builds(Start, heading=angles(), heading_rate=reals(-2.0, 2.0))


def vectors(size: int, largest: float) -> st.SearchStrategy[np.ndarray]:
    """Vectors with entries up to `largest`."""
    return st.lists(reals(-largest, largest), min_size=size, max_size=size).map(np.array)


def states() -> st.SearchStrategy[np.ndarray]:
    """States (6,) of a platform that drives and turns within a few m/s and rad/s."""
    return vectors(6, 3.0)
