"""What is exported is the right thing: published numbers, derivatives of the exported code, other rooms' results."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from occ.allocation import allocate, platform_input_map
from occ.export.numbers import PlatformNumbers
from occ.export.program import Program
from occ.export.routine import Module, Routine
from occ.export.table import table_of
from occ.laws import ServoLaw
from occ.laws.base import law_motion
from occ.model.platform import Platform, parameter_names
from occ.model.presets import YouBot, omni3, youbot
from tests.export.latex_reader import evaluate_latex
from tests.export.printing import ARGUMENTS, KEYS, functions_of, modules_of
from tests.tasks import POINT, paper_task

CIRCLE = np.array([0.7, -0.4, math.pi / 2])
COMPLEX = frozenset({"add", "sub", "mul", "div", "neg", "inv", "sq", "twice", "sqrt", "sin", "cos"})
"""Operations that are analytic and that NumPy continues to complex numbers."""
STEP = 1e-4
# Weights of the central difference of order 8, Fornberg 1988.
WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}


def value_at(function: Callable[..., np.ndarray], inputs: list[np.ndarray]) -> np.ndarray:
    """(entries, points) of an exported function, row by row."""
    arguments = [column[0] if len(column) == 1 else column for column in inputs]
    return np.asarray(function(*arguments)).reshape(-1, inputs[0].shape[1])


def slope(
    function: Callable[..., np.ndarray], inputs: list[np.ndarray], place: int, entry: int, smooth: bool
) -> np.ndarray:
    """d(value)/d(entry of an argument) from values of the exported code alone."""
    if smooth:
        moved = [column.astype(complex) for column in inputs]
        moved[place][entry] += 1e-30j
        return value_at(function, moved).imag / 1e-30
    total = np.zeros(())
    step = STEP * np.maximum(np.abs(inputs[place][entry]), 0.1)
    for k, weight in WEIGHTS.items():
        for sign in (1, -1):
            moved = [column.copy() for column in inputs]
            moved[place][entry] += sign * k * step
            total = total + sign * weight * value_at(function, moved) / step
    return total


def derivative_error(module: Module, value: Routine, derivative: Routine, variable: str) -> float:
    """Largest error of an exported derivative: of smooth code by entry, otherwise in parts of the largest entry."""
    functions = functions_of(module)
    inputs = [column[:, :12] for column in table_of(value, 50).inputs]
    place = [argument.name for argument in value.arguments].index(variable)
    smooth = value.program.operations() <= COMPLEX
    entries = range(value.arguments[place].size)
    slopes = [slope(functions[value.name], inputs, place, entry, smooth) for entry in entries]
    wanted = np.stack(slopes, axis=1).reshape(-1, 12)
    difference = np.abs(value_at(functions[derivative.name], inputs) - wanted)
    if not smooth:
        # What is left are the roundings of the values, over the step.
        return float(difference.max() / np.abs(wanted).max()) * 1e-3
    scale = table_of(derivative, 50).scale[:, None]
    # What is zero by structure may be gathered from roundings in the values.
    scale = np.maximum(np.maximum(np.abs(wanted), scale), 1e-5 * scale.max() + 1e-300)
    return float((difference / scale).max())


EVERYTHING = (*ARGUMENTS, "parameters")


@pytest.fixture(scope="module")
def symbolic() -> list[Module]:
    """All exports with Jacobians, several numbers of the platform being symbols."""
    return modules_of(wrt=EVERYTHING, symbolic=("platform_mass", "half_track", "wheel_radius"))


def test_jacobians_are_slopes_of_the_exported_code(symbolic: list[Module]) -> None:
    checked = 0
    for module in symbolic:
        value, *jacobians = module.routines
        for jacobian in jacobians:
            variable = jacobian.name.removeprefix(f"{module.name}_d_")
            assert derivative_error(module, value, jacobian, variable) < 1e-11, jacobian.name
            checked += 1
    assert checked > 80


def test_hessians_are_slopes_of_the_exported_jacobians() -> None:
    """Of scalars the Hessian, of vectors its product with multipliers and a direction."""
    for module in modules_of(
        "power", "kinetic_energy", "servo_yaw_acceleration", "forward", wrt=("state",), second=True
    ):
        value, jacobian, second = module.routines
        if value.shape == (1, 1):
            assert derivative_error(module, jacobian, second, "state") < 1e-11
            continue
        functions = functions_of(module)
        table = table_of(second, 12).inputs
        *inputs, multiplier, direction = table
        moved = [column.astype(complex) for column in inputs]
        moved[0] += 1e-30j * direction
        arguments = [column[0] if len(column) == 1 else column for column in moved]
        rows = functions[jacobian.name](*arguments).imag / 1e-30
        wanted = np.einsum("ijn,in->jn", rows, multiplier)
        found = value_at(functions[second.name], table)
        assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


def mutated(routine: Routine, place: int) -> Routine:
    """The routine with one difference of its program turned into a sum."""
    steps = list(routine.program.steps)
    where = [k for k, step in enumerate(steps) if step.operation == "sub"][place]
    steps[where] = dataclasses.replace(steps[where], operation="add")
    wrong = dataclasses.replace(routine)
    wrong.__dict__["program"] = Program(tuple(steps), routine.program.results)
    return wrong


def test_a_wrong_sign_in_a_jacobian_is_seen(symbolic: list[Module]) -> None:
    module = next(module for module in symbolic if module.export.name == "forward")
    value, by_state, *others = module.routines
    for place in range(3):
        wrong = mutated(by_state, place)
        changed = dataclasses.replace(module, routines=(value, wrong, *others))
        assert derivative_error(changed, value, wrong, "state") > 1e-10


def test_published_numbers(printed: Callable[[str], object]) -> None:
    """Wrench at t = 0 and torques of the steady rotation, b = (0.40, 0.05) m on the circle; errata, check values."""
    by_name = {module.export.name: module for module in modules_of("servo_wrench", "servo_torque", "box_torque")}
    wrench = functions_of(by_name["servo_wrench"])["occ_servo_wrench"]
    torque = functions_of(by_name["servo_torque"])["occ_servo_torque"]
    start = wrench(0.0, np.zeros(6), np.array(POINT), CIRCLE)
    assert [float(x) for x in start] == [printed(text) for text in ("53.4941384707", "1.31216362546", "-2.14984147335")]
    # psi~ = psi - phi' where phi' = omega_B t + phi_B + pi/2 is the direction of the velocity.
    heading = -0.478863232355 + CIRCLE[2]
    heading -= math.pi / 2
    for turn in range(4):
        state = np.array([0.0, 0.0, heading + turn * math.pi / 2, 0.0, 0.0, -0.4])
        steady = wrench(0.0, state, np.array(POINT), CIRCLE)
        if abs(steady[0] - 19.9247438857) < 1e-6:
            assert torque(0.0, state, np.array(POINT), CIRCLE) == pytest.approx(
                [1.22530952523, -0.752096857947, 0.285639685538, 0.187572981747], abs=1e-9
            )
            return
    pytest.fail("no heading of the steady rotation")


def test_the_law_is_the_one_that_is_compared() -> None:
    task = paper_task()
    t = np.linspace(0.0, task.duration, 7)
    motion, _ = law_motion(ServoLaw(), task, t, 1e-11)
    states = task.states_on_program(t, motion[0], motion[1])
    (module,) = modules_of("servo_torque")
    exported = functions_of(module)["occ_servo_torque"](t, states, np.array(POINT), CIRCLE)
    assert exported == pytest.approx(ServoLaw().solve(task).control.torque(t, states), rel=1e-11, abs=1e-12)


def test_the_constraint_holds_on_the_program_and_its_rate_is_its_derivative() -> None:
    """g = 0 with B on its program; dg/dt = g_t + g_x x' with the exported Jacobians of g and any acceleration."""
    task = paper_task()
    t = np.linspace(0.0, 5.0, 6)
    random = np.random.default_rng(2)
    heading, rate, acceleration = random.normal(size=(2, 6)), 2.0, random.normal(size=(3, 6))
    states = task.states_on_program(t, heading[0], heading[1])
    constraint, speed, kinematics, position = modules_of(
        "constraint", "constraint_rate", "kinematics", "program_position", wrt=("t", "state")
    )
    g = functions_of(constraint)
    point = np.array(POINT)
    assert np.abs(g["occ_constraint"](t, states, point, CIRCLE)).max() < 1e-14
    states = states + rate * random.normal(size=(6, 6))
    moving = np.vstack([functions_of(kinematics)["occ_kinematics"](states), acceleration])
    wanted = g["occ_constraint_d_t"](t, states, point, CIRCLE) + np.einsum(
        "ijn,jn->in", g["occ_constraint_d_state"](t, states, point, CIRCLE), moving
    )
    found = functions_of(speed)["occ_constraint_rate"](t, states, acceleration, point, CIRCLE)
    assert found == pytest.approx(wanted, rel=1e-12, abs=1e-12)
    exported = functions_of(position)["occ_program_position"](t, CIRCLE)
    assert exported == pytest.approx(task.motion.at(t)[0], rel=1e-14, abs=1e-15)


@pytest.mark.parametrize("platform", ["youbot", "omni3"])
def test_allocation_is_that_of_the_room(platform: str) -> None:
    """In reach the same torques; the least possible largest torque tells what is in reach."""
    wheels = platform_input_map(youbot() if platform == "youbot" else omni3())
    box, peak = modules_of("box_torque", "least_peak_torque", platform=platform)
    wrench = np.random.default_rng(3).uniform(-1, 1, (3, 400)) * np.array([[90.0], [90.0], [30.0]])
    limit = 1.2 if platform == "youbot" else 2.0
    found = allocate(wheels, wrench, limit)
    assert 50 < found.reachable.sum() < 350
    torque = functions_of(box)["occ_box_torque"](wrench, limit)
    assert torque[:, found.reachable] == pytest.approx(found.torque[:, found.reachable], rel=1e-12, abs=1e-12)
    assert wheels.wrench(torque) == pytest.approx(wrench, rel=1e-12, abs=1e-10)
    least = functions_of(peak)["occ_least_peak_torque"](wrench)
    assert np.array_equal(least <= limit, found.reachable)
    assert least == pytest.approx(wheels.least_peak(wheels.min_norm @ wrench), rel=1e-12)


@pytest.mark.parametrize("key", KEYS)
def test_a_key_of_the_preset_is_the_platform_with_another_number(key: str) -> None:
    """A symbol in the place of a preset's key gives what freezing the changed preset gives."""
    value = 1.1 * getattr(YouBot(), key)
    (symbolic,) = modules_of("forward", symbolic=(key,))
    preset = YouBot(**{key: value})
    changed = {field: getattr(preset, field) for field in preset.__dataclass_fields__}
    state, torque = np.array([0.1, 0.2, 0.3, 0.4, -0.5, 0.6]), np.array([1.0, 2.0, -1.0, 0.5])
    frozen = frozen_forward(YouBot(**changed).platform(), state, torque)
    exported = functions_of(symbolic)["occ_forward"](state, torque, value)
    assert exported == pytest.approx(frozen, rel=1e-12)
    unchanged = frozen_forward(youbot(), state, torque)
    assert np.abs(exported - unchanged).max() > 1e-6


def frozen_forward(platform: Platform, state: np.ndarray, torque: np.ndarray) -> np.ndarray:
    from occ.model.dynamics import Dynamics

    return np.array(Dynamics(platform).forward(state, torque)).ravel()


def test_frozen_derivatives_are_those_of_the_symbols() -> None:
    (frozen,) = modules_of("servo_wrench", wrt=("wheel_friction", "wheel2_mass", "parameters"))
    (symbolic,) = modules_of("servo_wrench", wrt=("parameters",), symbolic=("wheel_friction", "wheel2_mass"))
    (every,) = modules_of("servo_wrench", wrt=("parameters",), symbolic=("parameters",))
    inputs = [column[:, 0] if len(column) > 1 else column[0, 0] for column in table_of(frozen.routines[0], 1).inputs]
    one = functions_of(frozen)
    numbers = np.array([0.11, 1.40])
    both = functions_of(symbolic)["occ_servo_wrench_d_parameters"](*inputs, numbers)
    assert one["occ_servo_wrench_d_wheel_friction"](*inputs) == pytest.approx(both[:, 0], rel=1e-12)
    assert one["occ_servo_wrench_d_wheel2_mass"](*inputs) == pytest.approx(both[:, 1], rel=1e-12)
    all_of_them = functions_of(every)["occ_servo_wrench_d_parameters"](*inputs, youbot().parameters())
    assert one["occ_servo_wrench_d_parameters"](*inputs) == pytest.approx(all_of_them, rel=1e-9, abs=1e-12)
    # A preset's key decides about four wheels: its derivative is the sum of theirs.
    columns = [parameter_names(4).index(f"wheel{k}_friction") for k in (1, 2, 3, 4)]
    assert all_of_them[:, columns].sum(axis=1) == pytest.approx(both[:, 0], rel=1e-11)


def test_names_of_numbers() -> None:
    numbers = PlatformNumbers(youbot(), "youbot", YouBot())
    assert set(parameter_names(4)) < set(numbers.names())
    (track,) = numbers.find(["half_track"])
    assert dict(track.places) == {parameter_names(4).index(f"wheel{k}_y"): (-1) ** (k + 1) for k in (1, 2, 3, 4)}


def test_latex_of_all_values_read_back() -> None:
    """The formulas of the document, evaluated, are the function."""
    for module in modules_of(wrt=("state", "wrench"), symbolic=("wheel_friction", "platform_mass")):
        for routine in module.routines:
            table = table_of(routine, 3)
            for k in range(3):
                found = evaluate_latex(routine, [float(x) for column in table.inputs for x in column[:, k]])
                size = np.maximum(np.abs(table.results[:, k]), table.scale)
                assert (np.abs(found.ravel() - table.results[:, k]) <= 1e-12 * size).all(), routine.name
