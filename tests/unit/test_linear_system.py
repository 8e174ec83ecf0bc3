"""The linear system: response, connections and conversions, against python-control and closed forms."""

import math

import control
import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError, RobustnessError
from amb_core.linear import LinearSystem
from amb_core.linear.connections import beside, feedback, parallel, series
from amb_core.linear.peak import h_infinity_norm, peak_gain
from amb_core.linear.sampling import discretised
from amb_core.linear.simulation import simulate

STEP = 1e-4


def system(order: int = 4, inputs: int = 2, outputs: int = 3, seed: int = 0, step: float = STEP) -> LinearSystem:
    """Stable, with random matrices."""
    random = np.random.default_rng(seed)
    a = random.standard_normal((order, order))
    a = 0.9 * a / np.abs(np.linalg.eigvals(a)).max() if step else a - 3.0 * math.sqrt(order) * np.eye(order)
    b, c, d = (random.standard_normal(shape) for shape in ((order, inputs), (outputs, order), (outputs, inputs)))
    return LinearSystem(
        a, b, c, d, step, tuple(f"u{n}" for n in range(inputs)), tuple(f"y{n}" for n in range(outputs)),
        ("A",) * inputs, ("m",) * outputs, tuple(f"x{n}" for n in range(order)),
    )  # fmt: skip


@pytest.mark.parametrize("step", [STEP, 0.0])
def test_the_response_is_that_of_python_control(step: float) -> None:
    ours, frequency = system(step=step), np.geomspace(1.0, 4_900.0, 50)
    s = 2j * np.pi * frequency
    theirs = np.moveaxis(ours.to_control()(np.exp(s * step) if step else s), -1, 0)
    np.testing.assert_allclose(ours.response(frequency), theirs, rtol=1e-9)


def test_a_response_in_parts_is_that_of_single_points() -> None:
    ours, frequency = system(order=40), np.linspace(0.0, 5_000.0, 200)  # more entries than are held at once
    single = [ours.response([at])[0] for at in frequency]
    np.testing.assert_array_equal(ours.response(frequency), single)


def test_the_response_is_infinite_at_a_pole_and_nowhere_else() -> None:
    integrator = LinearSystem(np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), STEP)
    response = integrator.response([0.0, 5_000.0])[:, 0, 0]
    assert np.isinf(response[0])
    assert response[1] == pytest.approx(-0.5)


def test_the_slope_is_that_of_differences() -> None:
    ours, z, change = system(), np.exp(0.7j), 1e-6
    value, slope = ours.slope_at(z)
    np.testing.assert_allclose(value, ours.at(z)[0], rtol=1e-12)
    np.testing.assert_allclose(slope, (ours.at(z + change) - ours.at(z - change))[0] / (2.0 * change), rtol=1e-6)


def test_python_control_has_the_same_system_and_names() -> None:
    ours = system()
    back = LinearSystem.from_control(ours.to_control(name="ours"))
    for name in "abcd":
        np.testing.assert_array_equal(getattr(back, name), getattr(ours, name))
    assert (back.sample_time, back.input_names, back.output_names, back.state_names) == (
        STEP, ours.input_names, ours.output_names, ours.state_names,
    )  # fmt: skip
    assert isinstance(ours.to_control(), control.StateSpace)


def test_complex_matrices_of_python_control_are_refused() -> None:
    theirs = system().to_control()
    theirs.A = theirs.A + 1e-3j  # its constructor drops imaginary parts, with a warning
    with pytest.raises(IdentificationError, match=r"A: .* is not allowed; allowed: an array of real numbers"):
        LinearSystem.from_control(theirs)


def test_a_part_has_its_names_and_units() -> None:
    ours, frequency = system(), np.array([10.0, 300.0])
    part = ours.part([2, 0], slice(1, 2))
    assert (part.input_names, part.output_names, part.input_units, part.output_units) == (
        ("u1",), ("y2", "y0"), ("A",), ("m", "m"),
    )  # fmt: skip
    np.testing.assert_allclose(part.response(frequency), ours.response(frequency)[:, [2, 0], 1:], rtol=1e-12)


def test_scaling_delay_and_balancing_act_on_the_response_as_they_should() -> None:
    ours, frequency = system(), np.array([10.0, 300.0, 4_000.0])
    expected = ours.response(frequency)
    scale = np.array([1.0, 1e3, 1e-3])
    np.testing.assert_allclose(
        ours.scaled(scale, 2.0).response(frequency), 2.0 * scale[:, np.newaxis] * expected, rtol=1e-12
    )
    late = np.exp(-2j * np.pi * frequency * STEP)[:, np.newaxis, np.newaxis]
    np.testing.assert_allclose(ours.delayed().response(frequency), late * expected, rtol=1e-12)
    np.testing.assert_allclose(ours.balanced().response(frequency), expected, rtol=1e-12)


def test_the_peak_gain_is_above_a_fine_grid_by_rounding_only() -> None:
    ours = system(seed=3)
    peak = peak_gain(ours)
    grid = np.linalg.norm(ours.response(np.linspace(0.0, 0.5 / STEP, 20_001)), 2, axis=(1, 2)).max()
    assert grid <= peak.value * (1.0 + 1e-12)
    assert ours.gain(peak.frequency) == pytest.approx(peak.value, rel=1e-12)
    assert peak.value == pytest.approx(grid, rel=1e-6)


def test_peaks_of_loops_with_identified_models_are_found() -> None:
    """The symplectic eigenvalues of 8 of these loops do not converge, those of the others end at a gain of 1.085."""
    a = [
        [-0.000836018, -1.00005, -0.298946, -0.0415101, -533.076],
        [1.14965, 2.10097, 0.349821, 0.0490095, 598.984],
        [-0.350098, -0.34176, 0.382721, -0.237414, -173.903],
        [0.0229909, 0.0231888, 0.00935834, 0.010701, 20.6541],
        [-0.000728289, -0.000711532, -0.000222043, -3.09257e-05, 0.605071],
    ]
    b = [[-1431430.0], [1608400.0], [-466968.0], [55460.8], [-1024.0]]
    c = [[7.1122e-07, 6.94855e-07, 2.16839e-07, 3.02009e-08, 0.0]]
    rng = np.random.default_rng(1)
    for _ in range(20):
        near = np.array(a) * (1.0 + 1e-7 * rng.standard_normal((5, 5)))
        loop = LinearSystem(near, np.array(b), np.array(c), np.eye(1), STEP)
        peak = peak_gain(loop)
        grid = np.linalg.norm(loop.response(np.linspace(320.0, 340.0, 4_001)), 2, axis=(1, 2)).max()
        assert peak.value == pytest.approx(grid, rel=1e-8)
        assert peak.frequency == pytest.approx(328.3, rel=1e-2)


def test_series_parallel_and_beside_are_products_sums_and_blocks_of_responses() -> None:
    first, second, frequency = system(seed=1), system(inputs=3, outputs=2, seed=2), np.array([10.0, 300.0, 4_000.0])
    one, two = first.response(frequency), second.response(frequency)
    chain = series(first, second)
    np.testing.assert_allclose(chain.response(frequency), two @ one, rtol=1e-9)
    assert (chain.input_names, chain.output_names) == (first.input_names, second.output_names)
    third = system(seed=5)
    np.testing.assert_allclose(parallel(first, third).response(frequency), one + third.response(frequency), rtol=1e-9)
    both = beside(first, second).response(frequency)
    np.testing.assert_allclose(both[:, :3, :2], one, rtol=1e-9)
    np.testing.assert_allclose(both[:, 3:, 2:], two, rtol=1e-9)
    assert not both[:, :3, 2:].any() and not both[:, 3:, :2].any()


def test_systems_that_do_not_fit_are_not_connected() -> None:
    with pytest.raises(ValueError, match="do not fit together"):
        series(system(), system())
    with pytest.raises(ValueError, match="do not fit together"):
        beside(system(), system(step=0.0))
    with pytest.raises(ValueError, match="direct feedthrough"):
        feedback(system(), system(inputs=3, outputs=2))


def test_feedback_solves_the_equations_of_the_loop() -> None:
    """u = F r + G y + w_u and y = P u + w_y, with a further input and output of the plant left open."""
    plant, law, frequency = system(inputs=3, outputs=3), system(inputs=3, outputs=2, seed=7), np.array([20.0, 2_000.0])
    plant = plant.with_matrices(plant.a, plant.b, plant.c, np.zeros((3, 3)))
    p, (f, g) = plant.response(frequency), np.split(law.response(frequency), [1], axis=2)
    loop = feedback(plant, law, references=1).response(frequency)  # from (r, w_u, w_y, v) to (u, y, z)
    # u = G (P_yu u + P_yv v + w_y) + F r + w_u
    drive = np.concatenate([f, np.broadcast_to(np.eye(2), (2, 2, 2)), g, g @ p[:, :2, 2:]], axis=2)
    u = np.linalg.solve(np.eye(2) - g @ p[:, :2, :2], drive)
    y = p[:, :2, :2] @ u + np.concatenate([np.zeros((2, 2, 3)), np.tile(np.eye(2), (2, 1, 1)), p[:, :2, 2:]], axis=2)
    z = p[:, 2:, :2] @ u + np.concatenate([np.zeros((2, 1, 5)), p[:, 2:, 2:]], axis=2)
    np.testing.assert_allclose(loop, np.concatenate([u, y, z], axis=1), rtol=1e-8, atol=1e-12)


def test_a_loop_names_its_signals() -> None:
    plant = LinearSystem(np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)), STEP, ["i"], ["x"], state_names=["p"])
    law = LinearSystem(np.eye(1), np.ones((1, 2)), np.eye(1), np.zeros((1, 2)), STEP, ["r", "x"], state_names=["s"])
    loop = feedback(plant, law, references=1)
    assert (loop.input_names, loop.output_names, loop.state_names) == (("r", "w_i", "w_x"), ("i", "x"), ("p", "s"))


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0])
def test_a_held_input_acts_after_its_delay(delay: float) -> None:
    """A double integrator, whose samples under held inputs are parabolas."""
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    continuous = LinearSystem(a, b, np.eye(1, 2), np.zeros((1, 1)), 0.0, ["f"], ["x"], state_names=["x", "v"])
    discrete = discretised(continuous, 1.0, delay)
    assert discrete.state_names == (("x", "v", "held_f") if delay else ("x", "v"))
    position = simulate(discrete, np.ones((6, 1)))[:, 0]
    np.testing.assert_allclose(position, 0.5 * np.maximum(np.arange(6) - delay, 0.0) ** 2, atol=1e-12)


def test_a_simulation_has_the_response_of_python_control() -> None:
    ours, signals = system(), np.random.default_rng(1).standard_normal((100, 2))
    start = np.arange(4.0)
    theirs = control.forced_response(ours.to_control(), None, signals.T, start).outputs.T
    np.testing.assert_allclose(simulate(ours, signals, start), theirs, rtol=1e-9, atol=1e-9)


def test_the_norm_of_an_unstable_system_is_infinite() -> None:
    ours = system()
    assert h_infinity_norm(ours) == peak_gain(ours).value
    assert h_infinity_norm(ours.with_matrices(2.0 * ours.a, ours.b, ours.c, ours.d)) == math.inf


@pytest.mark.parametrize("gain", [peak_gain, h_infinity_norm])
def test_a_gain_needs_discrete_time_and_finite_matrices(gain) -> None:
    ours = system()
    with pytest.raises(RobustnessError, match="sample time of 0 s is not allowed"):
        gain(system(step=0.0))
    with pytest.raises(RobustnessError, match="B holds values that are not finite"):
        gain(ours.with_matrices(ours.a, ours.b * math.nan, ours.c, ours.d))
