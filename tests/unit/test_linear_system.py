"""The linear system: response, connections and conversions, against python-control and closed forms."""

import math

import control
import numpy as np
import pytest

from amb_core.linear import LinearSystem
from amb_core.linear.peak import peak_gain

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
