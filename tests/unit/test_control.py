"""The PD control law against its difference equation."""

import numpy as np
import pytest

from amb_core.loop.control import ControllerParameters, PdController

T = 1e-4  # s


def law(**parameters: object) -> PdController:
    return PdController(ControllerParameters(**parameters))


def test_current_is_proportional_to_a_constant_error():
    controller = law()
    for _ in range(3):
        assert controller.update(-1e-6, 2e-6, 1e-6, 0.0) == pytest.approx((20_000 * 2e-6, -20_000 * 2e-6))


def test_first_sample_has_no_derivative_because_the_past_is_unknown():
    assert law(proportional_gain=0.0).update(10e-6, 0.0, 0.0, 0.0) == (0.0, 0.0)


def test_derivative_of_a_ramp_is_its_slope():
    controller = law(proportional_gain=0.0)
    slope = 1e-3  # m/s
    currents = [controller.update(slope * T * step, 0.0, 0.0, 0.0)[0] for step in range(5)]
    assert currents[1:] == pytest.approx([-38.0 * slope] * 4)


def test_filtered_derivative_approaches_the_slope_with_its_time_constant():
    filter_time = 1e-3
    controller = law(proportional_gain=0.0, derivative_filter=filter_time)
    slope = 1e-3
    currents = [-controller.update(slope * T * step, 0.0, 0.0, 0.0)[0] for step in range(40)]
    pole = filter_time / (filter_time + T)
    expected = 38.0 * slope * (1.0 - pole ** np.arange(40))
    np.testing.assert_allclose(currents, expected, rtol=1e-9)


@pytest.mark.parametrize(("differentiated", "kick"), [("error", 38.0 * 1e-6 / T), ("measurement", 0.0)])
def test_step_of_the_reference_kicks_only_with_derivative_on_error(differentiated, kick):
    controller = law(derivative_on=differentiated)
    controller.update(0.0, 0.0, 0.0, 0.0)
    assert controller.update(0.0, 0.0, 1e-6, 0.0)[0] == pytest.approx(0.02 + kick)


def test_movement_is_damped_alike_with_both_kinds_of_derivative():
    currents = []
    for differentiated in ("error", "measurement"):
        controller = law(derivative_on=differentiated)
        controller.update(0.0, 0.0, 0.0, 0.0)
        currents.append(controller.update(1e-6, -2e-6, 0.0, 0.0))
    assert currents[0] == pytest.approx(currents[1])


def test_current_is_limited_on_both_sides():
    assert law(current_limit=2.0).update(1e-3, -1e-3, 0.0, 0.0) == (-2.0, 2.0)


def test_axes_are_decoupled():
    controller, alone = law(), law()
    for step in range(20):
        x = 1e-6 * np.sin(step)
        assert controller.update(x, 5e-6 * np.cos(step), 0.0, 0.0)[0] == alone.update(x, 0.0, 0.0, 0.0)[0]


def test_reset_forgets_the_past():
    controller = law()
    first = controller.update(1e-6, 1e-6, 0.0, 0.0)
    controller.update(5e-6, -1e-6, 0.0, 0.0)
    controller.reset()
    assert controller.update(1e-6, 1e-6, 0.0, 0.0) == first


def test_new_gains_apply_from_the_next_sample_on_and_keep_the_state():
    controller = law()
    controller.update(0.0, 0.0, 0.0, 0.0)
    controller.configure(ControllerParameters(proportional_gain=0.0, derivative_gain=10.0))
    assert controller.update(1e-6, 0.0, 0.0, 0.0)[0] == pytest.approx(-10.0 * 1e-6 / T)
