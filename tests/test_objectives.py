"""Integrands computed by hand, and the places where they are not smooth."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given

from occ.errors import InputError
from occ.objectives import COPPER_LOSS, INTEGRALS, OBJECTIVES, measure_function, objective
from tests.strategies import vectors

# Powers of the wheels (2, -2, -3, 2) W, squares of the torques 1 + 4 + 9 + 0.25.
BRAKING = np.array([1.0, -2.0, 3.0, 0.5]), np.array([2.0, 1.0, -1.0, 4.0])
# Powers (4, -2, 1) W, squares 1 + 4 + 0.25.
DRIVING = np.array([1.0, -2.0, 0.5]), np.array([4.0, 1.0, 2.0])

# By hand; k = 1.257 W/(N m)^2.  To add an objective: its two values here.
BY_HAND = {
    "work": (-1.0, 3.0),
    "positive_work": (4.0, 5.0),
    "absolute_work": (9.0, 7.0),
    "bus_work": (0.0, 3.0),
    "torque_squared": (14.25, 5.25),
    "copper_loss": (17.91225, 6.59925),
    "electric": (16.91225, 9.59925),
    "electric_drawn": (16.91225, 9.59925),
}
# The contract of the results: one column for each objective.
COLUMNS = {
    "work": "work_J",
    "positive_work": "positive_work_J",
    "absolute_work": "absolute_work_J",
    "bus_work": "bus_work_J",
    "torque_squared": "torque_squared_N2m2s",
    "copper_loss": "copper_loss_J",
    "electric": "electric_J",
    "electric_drawn": "electric_drawn_J",
    "peak_torque": "peak_torque_Nm",
}
WITH_KINKS = {"positive_work", "absolute_work", "bus_work", "electric_drawn"}

every_objective = pytest.mark.parametrize("name", list(INTEGRALS))


def measures(torque: np.ndarray, rates: np.ndarray) -> tuple[dict[str, float], np.ndarray]:
    integrands, kinks = measure_function(len(torque))(torque, rates)
    return dict(zip(INTEGRALS, np.array(integrands)[:, 0], strict=True)), np.array(kinks)[:, 0]


def own_kinks(name: str, torque: np.ndarray, rates: np.ndarray) -> np.ndarray:
    kinks = OBJECTIVES[name].clipped
    if kinks is None:
        return np.array([])
    symbols = ca.SX.sym("torque", len(torque)), ca.SX.sym("rates", len(rates))
    return np.array(ca.Function("kinks", [*symbols], [ca.densify(kinks(*symbols))])(torque, rates))[:, 0]


@every_objective
def test_integrands_are_those_computed_by_hand(name: str) -> None:
    if name not in BY_HAND:
        pytest.fail(f"the objective {name!r} has no values computed by hand: add them to BY_HAND in {__name__}")
    for value, (torque, rates) in zip(BY_HAND[name], (BRAKING, DRIVING), strict=True):
        assert measures(torque, rates)[0][name] == pytest.approx(value, rel=1e-14, abs=1e-14)


def test_every_objective_has_the_column_of_the_contract() -> None:
    assert {name: OBJECTIVES[name].column for name in COLUMNS} == COLUMNS
    assert len({item.column for item in OBJECTIVES.values()}) == len(OBJECTIVES)
    assert all(name == item.name for name, item in OBJECTIVES.items())


def test_the_copper_loss_is_that_of_the_motors_data() -> None:
    # R_a = 0.942 ohm, k_t = 0.0335 N m/A, gear ratio 25.84, to the four digits that the constant states.
    assert pytest.approx(0.942 / (0.0335 * 25.84) ** 2, abs=5e-4) == COPPER_LOSS


@given(torque=vectors(4, 3.0), rates=vectors(4, 10.0))
def test_kinks_are_the_wheels_powers_their_sum_and_the_electric_power(torque: np.ndarray, rates: np.ndarray) -> None:
    powers = torque * rates
    found = measures(torque, rates)[1]
    expected = [*powers, powers.sum(), powers.sum() + COPPER_LOSS * torque @ torque]
    np.testing.assert_allclose(sorted(np.abs(found)), sorted(np.abs(expected)), rtol=1e-12, atol=1e-12)


def second_difference(name: str, torque: np.ndarray, rates: np.ndarray, change: np.ndarray, step: float) -> float:
    """[f(x + s d) - 2 f(x) + f(x - s d)] / s: of the order of s where f is smooth, a jump of slope at a kink."""
    n = len(torque)
    values = [
        measures(torque + k * step * change[:n], rates + k * step * change[n:])[0][name] for k in (-1.0, 0.0, 1.0)
    ]
    return (values[0] - 2 * values[1] + values[2]) / step


@every_objective
def test_integrands_are_smooth_where_no_kink_changes_its_sign(name: str) -> None:
    generator = np.random.default_rng(3)
    tried = 0
    for _ in range(60):
        torque, rates, change = generator.normal(size=3), generator.normal(size=3), generator.normal(size=6)
        if np.min(np.abs(own_kinks(name, torque, rates)), initial=1.0) > 1e-2:
            assert abs(second_difference(name, torque, rates, change, 1e-5)) < 1e-2
            tried += 1
    assert tried > 30


@given(torque=vectors(4, 3.0), rates=vectors(4, 10.0))
def test_clipped_powers_counted_with_their_signs_are_no_more_and_the_same_where_all_drive(
    torque: np.ndarray, rates: np.ndarray
) -> None:
    assert {item.name for item in OBJECTIVES.values() if item.signed} == WITH_KINKS
    found, driving = measures(torque, rates)[0], measures(torque, np.copysign(rates, torque))[0]
    for item in INTEGRALS.values():
        if item.signed:
            size = 1e-13 * (1.0 + found["absolute_work"] + found["copper_loss"])
            assert found[item.name] >= found[item.signed] - size
            assert driving[item.name] == pytest.approx(driving[item.signed], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", sorted(WITH_KINKS))
def test_integrands_have_a_kink_where_theirs_changes_sign(name: str) -> None:
    generator = np.random.default_rng(4)
    k = COPPER_LOSS if name == "electric_drawn" else 0.0
    for _ in range(20):
        torque, rates, change = generator.normal(size=3), generator.normal(size=3), generator.normal(size=6)
        if name in ("bus_work", "electric_drawn"):
            rates[2] = -(torque[:2] @ rates[:2] + k * torque @ torque) / torque[2]
            slope = change[:3] @ rates + torque @ change[3:] + 2 * k * torque @ change[:3]
        else:
            rates[0] = 0.0
            slope = torque[0] * change[3]
        before, after = (own_kinks(name, torque + k * change[:3], rates + k * change[3:]) for k in (-1e-6, 1e-6))
        assert np.any(before * after < 0)
        jump = second_difference(name, torque, rates, change, 1e-6)
        factor = 2.0 if name == "absolute_work" else 1.0
        assert jump == pytest.approx(factor * abs(slope), rel=1e-3, abs=1e-3)


def test_the_largest_torque_is_no_integral() -> None:
    assert set(OBJECTIVES) - set(INTEGRALS) == {"peak_torque"}
    assert OBJECTIVES["peak_torque"].meaning == "largest |M_i| over wheels and time"


def test_smooth_objectives_name_no_kink() -> None:
    for name in set(INTEGRALS) - WITH_KINKS:
        assert own_kinks(name, *DRIVING).size == 0


@given(torque=vectors(4, 3.0), rates=vectors(4, 10.0))
def test_measures_are_ordered_as_their_definitions_order_them(torque: np.ndarray, rates: np.ndarray) -> None:
    found = measures(torque, rates)[0]
    slack = 1e-12 * (1 + found["absolute_work"])
    assert found["work"] <= found["bus_work"] + slack
    assert found["bus_work"] <= found["positive_work"] + slack
    assert found["positive_work"] <= found["absolute_work"] + slack
    assert found["absolute_work"] == pytest.approx(2 * found["positive_work"] - found["work"], abs=slack)
    assert found["electric_drawn"] == pytest.approx(max(found["electric"], 0.0), abs=slack)
    assert math.isclose(found["electric"], found["work"] + found["copper_loss"], abs_tol=slack, rel_tol=1e-12)


def test_an_unknown_objective_is_refused_with_the_valid_ones() -> None:
    assert objective("work") is OBJECTIVES["work"]
    with pytest.raises(InputError, match=r"unknown objective 'wrk'.*work, positive_work"):
        objective("wrk")
