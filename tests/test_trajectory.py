"""Piecewise polynomials, sampled motions, and functions and controls evaluated in two ways."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from occ.control import PythonControl, SymbolicControl
from occ.errors import InputError
from occ.numeric import BufferedFunction, evaluate_many
from occ.trajectory import PiecewisePolynomial, Trajectory, lagrange_basis
from tests.strategies import vectors

EDGES = np.array([0.0, 0.4, 0.5, 1.7, 2.0])


def nodes_of(degree: int) -> np.ndarray:
    """Uneven nodes in [0, 1] that include the right end, as those of a Radau scheme do."""
    return (1 - np.cos(np.pi * np.arange(1, degree + 1) / degree)) / 2


def sampled(function: Callable[[np.ndarray], np.ndarray], edges: np.ndarray, nodes: np.ndarray) -> PiecewisePolynomial:
    times = edges[:-1, None] + np.diff(edges)[:, None] * nodes[None, :]
    values = np.array([function(row) for row in times])  # (K, m, d)
    return PiecewisePolynomial(edges, nodes, values.transpose(1, 0, 2))


def steps() -> PiecewisePolynomial:
    """Two signals that jump at every edge."""
    generator = np.random.default_rng(5)
    return PiecewisePolynomial(EDGES, nodes_of(3), generator.normal(size=(2, 4, 3)))


class TestPiecewisePolynomial:
    @pytest.mark.parametrize("degree", [1, 2, 3, 5, 9])
    def test_polynomials_below_the_number_of_nodes_are_reproduced(self, degree: int) -> None:
        generator = np.random.default_rng(degree)
        coefficients = generator.normal(size=(3, degree))

        def exact(t: np.ndarray) -> np.ndarray:
            return np.array([np.polyval(row, t) for row in coefficients])

        signal = sampled(exact, EDGES, nodes_of(degree))
        t = np.linspace(0.0, 2.0, 101)
        np.testing.assert_allclose(signal(t), exact(t), rtol=0, atol=1e-12 * np.abs(exact(t)).max())
        assert signal(t).shape == (3, 101)

    def test_a_polynomial_of_the_degree_of_the_nodes_is_not_reproduced(self) -> None:
        signal = sampled(lambda t: t[None, :] ** 3, EDGES, nodes_of(3))
        t = np.linspace(0.0, 2.0, 101)
        assert np.abs(signal(t) - t**3).max() > 1e-3

    @given(count=st.integers(1, 6), s=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5))
    def test_the_basis_is_one_at_its_node_zero_at_the_others_and_sums_to_one(self, count: int, s: list[float]) -> None:
        nodes = nodes_of(count)
        np.testing.assert_array_equal(lagrange_basis(nodes, nodes), np.eye(count))
        np.testing.assert_allclose(lagrange_basis(nodes, np.array(s)).sum(axis=0), 1.0, rtol=1e-12)
        signal = PiecewisePolynomial(np.array([0.0, 1.0]), nodes, np.zeros((1, 1, count)))
        np.testing.assert_array_equal(signal.basis(np.array(s)), lagrange_basis(nodes, np.array(s)))

    def test_one_time_and_many_times_agree(self) -> None:
        signal = steps()
        for k, (left, right) in enumerate(itertools.pairwise(EDGES)):
            inside = np.linspace(left, right, 12)[:-1]
            together = signal(inside)
            for i, t in enumerate(inside):
                np.testing.assert_allclose(signal.within(k, t), together[:, i], rtol=0, atol=1e-13)

    def test_nodes_give_back_their_values(self) -> None:
        # Binary fractions, so that the places come out as the nodes exactly, where quotients would divide by zero.
        nodes, values = np.array([0.25, 0.5, 1.0]), np.random.default_rng(6).normal(size=(2, 2, 3))
        signal = PiecewisePolynomial(np.array([0.0, 1.0, 3.0]), nodes, values)
        for k, (start, length) in enumerate([(0.0, 1.0), (1.0, 2.0)]):
            for j, node in enumerate(nodes):
                found = signal.within(k, start + length * node)
                np.testing.assert_allclose(found, values[:, k, j], rtol=0, atol=1e-14)

    def test_an_inner_edge_belongs_to_the_interval_on_its_right(self) -> None:
        signal = steps()
        at_edges = signal(EDGES[1:-1])
        for i, edge in enumerate(EDGES[1:-1]):
            np.testing.assert_allclose(at_edges[:, i], signal.within(i + 1, edge), rtol=0, atol=1e-13)
            # The other one-sided value is that of the polynomial on the left, whose last node is its end.
            np.testing.assert_allclose(signal.within(i, edge), signal.values[:, i, -1], rtol=0, atol=1e-13)
            assert np.all(np.abs(signal.within(i, edge) - signal.within(i + 1, edge)) > 1e-3)

    def test_the_ends_belong_to_the_first_and_the_last_interval(self) -> None:
        signal = steps()
        ends = signal(EDGES[[0, -1]])
        np.testing.assert_allclose(ends[:, 0], signal.within(0, EDGES[0]), rtol=0, atol=1e-13)
        np.testing.assert_allclose(ends[:, 1], signal.values[:, -1, -1], rtol=0, atol=1e-13)


class TestTrajectory:
    t, state = np.array([0.0, 0.5, 1.5]), np.zeros((6, 3))

    def test_fitting_arrays_are_kept(self) -> None:
        assert Trajectory(self.t, self.state, self.state).state is self.state

    @pytest.mark.parametrize(
        "t",
        [
            np.array([0.0]),
            np.array([]),
            np.zeros((1, 3)),
            np.array([0.0, 0.5, 0.5]),
            np.array([0.0, 0.7, 0.5]),
            np.array([0.0, np.nan, 1.0]),
        ],
    )
    def test_times_that_do_not_increase_are_refused(self, t: np.ndarray) -> None:
        state = np.zeros((6, t.size))
        with pytest.raises(InputError, match=r"^Trajectory: t should be .*increasing"):
            Trajectory(t, state, state)

    @pytest.mark.parametrize("shape", [(6, 2), (5, 3), (3, 6), (6,), (6, 3, 1)])
    @pytest.mark.parametrize("name", ["state", "state_rate"])
    def test_arrays_of_another_shape_are_refused_by_name(self, name: str, shape: tuple[int, ...]) -> None:
        arrays = {"state": self.state, "state_rate": self.state} | {name: np.zeros(shape)}
        with pytest.raises(InputError, match=rf"^Trajectory: {name} should have the shape \(6, 3\), not \("):
            Trajectory(self.t, **arrays)


class TestBufferedFunction:
    def test_it_gives_what_the_function_gives_call_after_call(self) -> None:
        matrix, vector, nothing = ca.SX.sym("matrix", 2, 3), ca.SX.sym("vector", 3), ca.SX.sym("nothing", 0)
        outputs = [matrix @ vector, matrix.T + 1, ca.vertcat(0, ca.sin(vector)), ca.dot(vector, vector)]
        function = ca.Function("f", [matrix, vector, nothing], [ca.densify(output) for output in outputs])
        call = BufferedFunction(function)
        generator = np.random.default_rng(8)
        for _ in range(5):
            inputs = [generator.normal(size=function.size_in(i)) for i in range(function.n_in())]
            for buffer, value in zip(call.inputs, inputs, strict=True):
                buffer[:] = value.ravel(order="F")
            call()
            for found, expected in zip(call.outputs, function(*inputs), strict=True):
                np.testing.assert_array_equal(found, np.array(expected).ravel(order="F"))

    def test_two_of_them_do_not_share_their_buffers(self) -> None:
        x = ca.SX.sym("x")
        function = ca.Function("f", [x], [x**2])
        first, second = BufferedFunction(function), BufferedFunction(function)
        first.inputs[0][:], second.inputs[0][:] = 2.0, 3.0
        first()
        second()
        assert (*first.outputs[0], *second.outputs[0]) == (4.0, 9.0)


class TestEvaluateMany:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y", 3)
    function = ca.Function("f", [x, y], [ca.densify(ca.vertcat(x[0] * y[0], 0, x[1] - y[2])), ca.sin(x)])

    @pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 9])
    @pytest.mark.parametrize("shared", [(), (0,), (1,)])
    def test_many_points_are_the_points_one_after_the_other(self, count: int, shared: tuple[int, ...]) -> None:
        generator = np.random.default_rng(count)
        arguments = [generator.normal(size=(k,) if i in shared else (k, count)) for i, k in enumerate((2, 3))]
        outputs = evaluate_many(self.function, *arguments, shared=shared)
        assert [output.shape for output in outputs] == [(3, count), (2, count)]
        for j in range(count):
            point = [a if i in shared else a[:, j] for i, a in enumerate(arguments)]
            for output, expected in zip(outputs, self.function(*point), strict=True):
                np.testing.assert_array_equal(output[:, j], np.array(expected)[:, 0])

    def test_functions_with_one_name_are_not_taken_for_each_other(self) -> None:
        points = np.array([[0.5, 1.5, 2.5]])
        for power in range(1, 6):
            x = ca.SX.sym("x")
            (found,) = evaluate_many(ca.Function("f", [x], [x**power]), points)
            np.testing.assert_allclose(found, points**power, rtol=1e-14)


def law(signals: int) -> ca.Function:
    """Two torques that depend on everything that a control may depend on."""
    t, state, signal, data = ca.SX.sym("t"), ca.SX.sym("x", 6), ca.SX.sym("u", signals), ca.SX.sym("d", 3)
    feedback = ca.vertcat(ca.sin(t) * data[0] + state[2] * state[5], ca.cos(state[0] + t) * data[1] - data[2])
    torque = feedback + (ca.vertcat(signal[0], signal[1] * state[3]) if signals else 0)
    return ca.Function("law", [t, state, signal, data], [ca.densify(torque)])


class TestControls:
    data = np.array([0.7, -1.1, 0.3])

    @given(state=vectors(6, 2.0), place=st.floats(0.0, 1.0))
    def test_a_symbolic_control_gives_the_same_torques_one_by_one_as_together(
        self, state: np.ndarray, place: float
    ) -> None:
        signal = steps()
        control = SymbolicControl(law(2), self.data, signal)
        for k, (left, right) in enumerate(itertools.pairwise(EDGES)):
            t = left + place * (right - left)
            found = np.array(control.segment(left, right)(t, state))
            u = signal.within(k, t)
            feedback = [
                np.sin(t) * 0.7 + state[2] * state[5] + u[0],
                np.cos(state[0] + t) * -1.1 - 0.3 + u[1] * state[3],
            ]
            np.testing.assert_allclose(found, feedback, rtol=0, atol=1e-12)
            if t < right:
                together = control.torque(np.array([t, t]), np.column_stack([state, np.zeros(6)]))
                assert together.shape == (2, 2)
                np.testing.assert_allclose(found, together[:, 0], rtol=0, atol=1e-12)

    def test_at_its_right_end_a_segment_has_the_limit_from_inside(self) -> None:
        control = SymbolicControl(law(2), self.data, steps())
        state = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
        for left, right in itertools.pairwise(EDGES):
            torque = control.segment(left, right)
            end = np.array(torque(right, state))
            near = np.array(torque(right - 1e-9, state))
            np.testing.assert_allclose(end, near, rtol=0, atol=1e-6)

    def test_a_part_of_a_segment_belongs_to_its_interval(self) -> None:
        # The referee may cut its horizon at more knots than the signal has.
        control = SymbolicControl(law(2), self.data, steps())
        state = np.full(6, 0.2)
        whole, part = control.segment(0.5, 1.7), control.segment(0.9, 1.3)
        for t in (0.9, 1.0, 1.3):
            np.testing.assert_array_equal(np.array(whole(t, state)), np.array(part(t, state)))

    def test_a_pure_feedback_has_no_knots_and_the_same_torques_either_way(self) -> None:
        control = SymbolicControl(law(0), self.data)
        assert control.knots.size == 0
        times, states = np.linspace(0.0, 2.0, 7), np.random.default_rng(9).normal(size=(6, 7))
        together = control.torque(times, states)
        torque = control.segment(0.0, 2.0)
        for i, t in enumerate(times):
            np.testing.assert_allclose(np.array(torque(t, states[:, i])), together[:, i], rtol=0, atol=1e-14)

    def test_the_knots_of_a_signal_are_its_inner_edges(self) -> None:
        np.testing.assert_array_equal(SymbolicControl(law(2), self.data, steps()).knots, EDGES[1:-1])

    def test_a_python_control_gives_the_same_torques_one_by_one_as_together(self) -> None:
        control = PythonControl(lambda t, x: np.array([t + x[0], t * x[5], 1.0]), knots=np.array([0.5]))
        times, states = np.linspace(0.0, 1.0, 5), np.random.default_rng(10).normal(size=(6, 5))
        together = control.torque(times, states)
        np.testing.assert_array_equal(together, [times + states[0], times * states[5], np.ones(5)])
        for i, t in enumerate(times):
            np.testing.assert_array_equal(control.segment(0.0, 0.5)(t, states[:, i]), together[:, i])
        np.testing.assert_array_equal(control.knots, [0.5])
        assert PythonControl(lambda t, x: x).knots.size == 0
