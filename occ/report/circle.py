"""What the platform will do on a circle: a few lines for a reader, and JSON for a program."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import Any

from occ.report.contents import plain_unit
from occ.report.tables import amount, gap, significant
from occ.task import Limits, Task

DIGITS = 4
BOUND_DIGITS = 8
REGIMES = {
    "steady": "steady: the platform can turn with the circle, at a constant angle to its radius",
    "critical": "critical: the one steady rotation attracts from one side and repels on the other",
    "rotational": "rotational: no steady rotation exists; the radius to B overtakes the heading again and again",
}
KINDS = {
    "steady": "the steady rotation",
    "critical": "the stable-unstable rotation",
    "rotating": "a rotating motion",
    "oscillating": "oscillations about the steady rotation",
    "unsettled": "no regular motion within the time that was simulated",
}


def circle_json(summary: dict[str, Any]) -> str:
    """One JSON object; infinity is written as 1e999, which is JSON and is read as infinity.

    Args:
        summary: plain data.

    Returns:
        The text.
    """
    text = json.dumps(summary)
    # Strings stay as they are; NaN cannot occur in a summary.
    return re.sub(r'"(?:[^"\\]|\\.)*"|Infinity', lambda part: part[0] if part[0][0] == '"' else "1e999", text)


def circle_lines(task: Task, summary: dict[str, Any]) -> list[str]:
    """The answer in about ten lines.

    Args:
        task: on the circle.
        summary: of it.

    Returns:
        Lines of plain text.
    """
    return [
        f"circle: radius {_of(summary, 'radius_m')} m at {_of(summary, 'rate_rad_s')} rad/s, so that B = "
        f"({task.point[0]:g}, {task.point[1]:g}) m of {task.platform.name} moves at "
        f"{_number(summary['radius_m'] * abs(summary['rate_rad_s']))} m/s",
        f"regime: {REGIMES[summary['regime']]}",
        f"critical radius: {_of(summary, 'critical_radius_m')} m; {_distance(summary['radius_ratio'])}",
        *_stability(summary),
        *_steady(summary),
        *_rotation(summary),
        _ends(summary),
        *_wheels(summary, task.limits),
        *_long_run(summary, task.limits),
        *_long_run_bounds(summary),
    ]


def _number(value: float | None) -> str:
    return significant(value, DIGITS)


def _of(summary: dict[str, Any], key: str) -> str:
    return _number(summary[key])


def _degrees(angle: float) -> str:
    return f"{_number(angle)} rad ({_number(math.degrees(angle))} degrees)"


def _distance(ratio: float) -> str:
    if ratio == 0:
        return "no radius reaches it"
    if math.isinf(ratio):
        return "without friction every radius is beyond it"
    percent = 100 * (ratio - 1)
    side = "above" if percent > 0 else "below"
    return f"this one is {_number(abs(percent))} % {side} it" if abs(percent) > 1e-7 else "this one is it"


def _stability(summary: dict[str, Any]) -> Iterator[str]:
    holds = "hold" if summary["sufficient_conditions"] else "do not hold"
    speed = _number(summary["radius_m"] * abs(summary["rate_rad_s"]))
    yield (
        f"sufficient conditions (4.8): {holds}; speed of B {speed} m/s, critical speed "
        f"{_of(summary, 'critical_speed_m_s')} m/s"
    )
    radii = summary["stable_radii_m"]
    if radii is None:
        yield "stable radii at this rate: none"
    else:
        yield f"stable radii at this rate: {_number(radii[0])} m to {_number(radii[1])} m (exact)"


def _steady(summary: dict[str, Any]) -> Iterator[str]:
    if summary["steady"]:
        root = summary["steady"][0]
        values = " and ".join(_eigenvalue(value) for value in root["eigenvalues"])
        stable = "stable" if root["stable"] else "not stable"
        yield (
            f"steady rotation: heading {_degrees(root['psi_tilde_rad'])} from the radius to B; "
            f"{stable}, eigenvalues {values} 1/s"
        )


def _eigenvalue(value: float | list[float]) -> str:
    if isinstance(value, list):
        sign = "-" if value[1] < 0 else "+"
        return f"{_number(value[0])} {sign} {_number(abs(value[1]))}i"
    return _number(value)


def _rotation(summary: dict[str, Any]) -> Iterator[str]:
    if summary["regime"] != "rotational":
        return
    yield (
        f"rotation: period {_of(summary, 'period_s')} s (asymptotic {_of(summary, 'period_asymptotic_s')} s, corrected "
        f"{_of(summary, 'period_corrected_s')} s), mean yaw rate {_of(summary, 'mean_yaw_rate_rad_s')} rad/s, "
        f"amplitude {_number(summary.get('yaw_rate_amplitude_rad_s'))} rad/s"
    )


def _ends(summary: dict[str, Any]) -> str:
    found = summary["attractors"]
    time = summary["settling_time_s"]
    settles = f"; deviations fall to 2 % in {_number(time)} s" if math.isfinite(time) else ""
    if len(found) == 1 and found[0]["share"] == 1:
        return f"ends in: {KINDS[found[0]['kind']]}, from every start but a set of no area{settles}"
    shares = ", ".join(f"{KINDS[item['kind']]} from {100 * item['share']:.3g} %" for item in found)
    rate = _number(2 * abs(summary["rate_rad_s"]))
    return f"ends in: {shares} of the starts with any heading and a yaw rate up to {rate} rad/s{settles}"


def _wheels(summary: dict[str, Any], limits: Limits) -> Iterator[str]:
    rows = (
        ("peak_torque_Nm", "torques", "N m", limits.torque),
        ("peak_wheel_speed_rad_s", "speeds", "rad/s", limits.wheel_speed),
        ("peak_power_W", "powers", "W", limits.wheel_power),
    )
    for item in summary["attractors"]:
        if "mean_power_W" not in item:
            continue
        what = KINDS[item["kind"]]
        parts = [f"{name} {_list(item[key])} {unit}{_limit(item[key], limit)}" for key, name, unit, limit in rows]
        yield f"wheels in {what} (largest sizes): {'; '.join(parts)}"
        yield f"power in {what}: {_number(item['mean_power_W'])} W on average"


def _list(values: list[float]) -> str:
    return ", ".join(_number(value) for value in values)


def _limit(values: list[float], limit: float | None) -> str:
    if limit is None:
        return ""
    return f" (limit {limit:g}: {'passed' if max(values) > limit else 'kept'})"


def _long_run(summary: dict[str, Any], limits: Limits) -> Iterator[str]:
    """What the law settles at, beside the least possible."""
    law, least = summary["law_mean_power_W"], summary["least_mean_power_W"]
    if law is None or not least:
        return
    aside = ", limits of the wheels left aside" if limits != Limits() else ""
    motion = "a steady rotation" if summary["least_mean_power_regime"] == "steady" else "a rotating motion"
    yield (
        f"long run: the law settles at {amount(law)} W on average; the least possible{aside} is {amount(least)} W "
        f"(exact, {motion}); the law is {gap(summary['long_run_gap_percent'])} % above it"
    )


def _long_run_bounds(summary: dict[str, Any]) -> Iterator[str]:
    """Only where they were asked for."""
    for cost, item in summary.get("long_run_bounds", {}).items():
        motion = "a motion that turns against the circle" if item["turns"] else "a steady rotation"
        # Rounded outwards: what is printed holds, too.
        low = Context(BOUND_DIGITS, ROUND_FLOOR).create_decimal_from_float(item["lower"])
        high = Context(BOUND_DIGITS, ROUND_CEILING).create_decimal_from_float(item["upper"])
        yield (
            f"long run, least mean {cost.replace('_', ' ')}: between {low} and {high} "
            f"{plain_unit(item['unit'])} ({item['word']}; the larger number is that of {motion})"
        )
