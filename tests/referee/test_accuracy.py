"""The replay against SciPy's own DOP853 at 1e-13, through another form of the dynamics, on one row of each sort."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp

from occ.allocation import BoxQp
from occ.control import Control
from occ.laws import PrescribedRotation, ServoLaw
from occ.numeric import BufferedFunction
from occ.optimal.collocation import Collocation
from occ.plant import Plant
from occ.referee import Tolerances, drive, examine
from occ.referee.loads import torque_rate_peak
from occ.referee.replay import Replay, ReplaySettings, Samples, crossings, gauss_lobatto
from occ.task import Limits, Player, Solution, Task
from tests.tasks import paper_task

DURATION = 4.0
ROWS: dict[str, tuple[Player, Task]] = {
    "smooth feedback": (ServoLaw(), paper_task(DURATION)),
    "rotating": (PrescribedRotation(rate="program"), paper_task(DURATION, rate=0.8)),
    "polynomials on a mesh": (Collocation(objective="torque_squared"), paper_task(DURATION)),
    "jumps at both ends": (Collocation(objective="work", tolerance=1e-4), paper_task(DURATION)),
    "at its limit": (
        Collocation(objective="torque_squared", tolerance=1e-4),
        paper_task(DURATION, limits=Limits(torque=0.9)),
    ),
    "allocated with kinks": (ServoLaw(allocation=BoxQp()), paper_task(DURATION, limits=Limits(torque=1.0))),
    "out of reach": (
        ServoLaw(allocation=BoxQp(out_of_reach="scale")),
        paper_task(DURATION, limits=Limits(torque=0.55)),
    ),
    "sampled": (ServoLaw(), paper_task(DURATION, plant=Plant(sample_rate=40.0, start_offset=(0.01, 0.0, 0.05)))),
}


def by_scipy(task: Task, control: Control, start: np.ndarray, replay: Replay, times: np.ndarray) -> np.ndarray:
    """x at the times, piece by piece, with the dynamics' own function of eq. (2.16)."""
    forward = BufferedFunction(task.dynamics.functions["forward"])
    held = task.plant is not None and task.plant.sample_rate is not None
    found = np.empty((6, len(times)))
    state = start
    for begin, end in pairwise(replay.edges):
        torque = control.segment(begin, end)
        first = np.array(torque(begin, state)) if held else None

        def rate(
            t: float, x: np.ndarray, torque: Callable[..., np.ndarray] = torque, first: np.ndarray | None = first
        ) -> np.ndarray:
            forward.inputs[1][:] = torque(t, x) if first is None else first
            forward.inputs[0][:] = x
            forward()
            return forward.outputs[0].copy()

        inside = (times >= begin) & (times <= end)
        at = np.unique(np.append(times[inside], end))
        outcome = solve_ivp(rate, (begin, end), state, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=at, max_step=0.1)
        found[:, inside] = outcome.y[:, np.searchsorted(at, times[inside])]
        state = outcome.y[:, -1]
    return found


def replayed(name: str, settings: ReplaySettings | None = None) -> tuple[Task, Control, np.ndarray, Replay]:
    task, solution = solved(name)
    control, start = solution.control, solution.start_state
    assert control is not None, solution.message
    assert start is not None
    offset = np.zeros(6) if task.plant is None else np.concatenate([task.plant.start_offset, np.zeros(3)])
    replay = examine(task, solution, Tolerances(integration=settings or ReplaySettings())).replay
    assert replay is not None
    return task, control, start + offset, replay


@cache
def solved(name: str) -> tuple[Task, Solution]:
    player, task = ROWS[name]
    return task, player.solve(task)


@pytest.mark.parametrize("name", ROWS)
def test_motion_against_an_independent_integration(name: str) -> None:
    task, control, start, replay = replayed(name)
    times = np.linspace(0.0, task.duration, 101)
    reference = by_scipy(task, control, start, replay, times)
    np.testing.assert_allclose(replay.at(times), reference, rtol=0, atol=2e-10)
    np.testing.assert_allclose(replay.end_state, reference[:, -1], rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", ["smooth feedback", "polynomials on a mesh", "jumps at both ends"])
def test_compiled_steps_are_those_of_the_python_function(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    task, _, _, compiled = replayed(name)
    monkeypatch.setattr(drive, "SymbolicControl", type(None))
    _, _, _, python = replayed(name)
    times = np.linspace(0.0, task.duration, 333)
    np.testing.assert_allclose(compiled.at(times), python.at(times), rtol=0, atol=1e-12)
    assert compiled.samples().t.shape == python.samples().t.shape


@pytest.mark.parametrize("name", ["smooth feedback", "jumps at both ends", "allocated with kinks"])
def test_measures_against_panels_many_times_shorter(name: str) -> None:
    coarse, fine = (replayed(name, settings)[3].samples() for settings in (None, ReplaySettings(longest_step=0.1)))
    assert len(fine.t) > 3 * len(coarse.t)
    np.testing.assert_allclose(coarse.integrands @ coarse.weight, fine.integrands @ fine.weight, rtol=3e-9)


def one_panel(power: Polynomial, length: float) -> Samples:
    """Wheel 1 has this power, the other wheels 1 W."""
    nodes, weights = gauss_lobatto(8)
    torque = np.ones((4, 8))
    torque[0] = power(length * nodes)
    ones = np.ones(8)
    return Samples(length * nodes, length * weights, np.zeros((6, 8)), torque, np.ones((4, 8)), ones, ones, 8)


def test_a_pair_of_kinks_between_two_nodes() -> None:
    """A power that dips below zero for a hundredth of a panel: its values at the nodes say nothing of that."""
    panel, times = crossings(one_panel(Polynomial.fromroots([0.85, 0.95]), 2.0))
    np.testing.assert_allclose(np.unique(times.round(7)), [0.85, 0.95], atol=1e-7)
    assert not panel.any()


def test_what_is_zero_but_for_rounding_has_no_kinks() -> None:
    samples = one_panel(Polynomial([1.0]), 2.0)
    noise = np.where(np.arange(8) % 2, 1e-17, -1e-17)
    samples.torque[0] = noise
    assert crossings(samples)[0].size == 0


@pytest.mark.parametrize("length", [1e-13, 1e-9, 1e-4, 1.0])
@pytest.mark.parametrize("rate", [0.0, 3.0])
def test_torque_rates_are_not_those_of_rounding(length: float, rate: float) -> None:
    """A power that changes its sign next to an edge makes a panel of a tenth of a picosecond."""
    samples = one_panel(Polynomial([1.7, rate]), length)
    samples.torque[:] *= 1 + 2e-16 * np.random.default_rng(1).integers(-2, 3, samples.torque.shape)
    # Below a nanosecond rounding hides it; above, it is seen.
    peak = torque_rate_peak(samples).value
    assert peak <= rate * (1 + 1e-9)
    assert peak >= rate * (1 - 1e-3) or length < 1e-8
