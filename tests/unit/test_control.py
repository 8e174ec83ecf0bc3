"""The PD control law against its difference equation."""

import numpy as np
import pytest

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters, PdController

T = 1e-4  # s


def law(**parameters: object) -> PdController:
    return PdController(ControllerParameters(**parameters))


def test_current_is_proportional_to_a_constant_error():
    controller = law()
    for _ in range(3):
        assert controller.update((-1e-6, 2e-6), (1e-6, 0.0)) == pytest.approx((20_000 * 2e-6, -20_000 * 2e-6))


def test_first_sample_has_no_derivative_because_the_past_is_unknown():
    assert law(proportional_gain=0.0).update((10e-6, 0.0), (0.0, 0.0)).tolist() == [0.0, 0.0]


def test_derivative_of_a_ramp_is_its_slope():
    controller = law(proportional_gain=0.0)
    slope = 1e-3  # m/s
    currents = [controller.update((slope * T * step, 0.0), (0.0, 0.0))[0] for step in range(5)]
    assert currents[1:] == pytest.approx([-38.0 * slope] * 4)


def test_filtered_derivative_approaches_the_slope_with_its_time_constant():
    filter_time = 1e-3
    controller = law(proportional_gain=0.0, derivative_filter=filter_time)
    slope = 1e-3
    currents = [-controller.update((slope * T * step, 0.0), (0.0, 0.0))[0] for step in range(40)]
    pole = filter_time / (filter_time + T)
    expected = 38.0 * slope * (1.0 - pole ** np.arange(40))
    np.testing.assert_allclose(currents, expected, rtol=1e-9)


@pytest.mark.parametrize(("differentiated", "kick"), [("error", 38.0 * 1e-6 / T), ("measurement", 0.0)])
def test_step_of_the_reference_kicks_only_with_derivative_on_error(differentiated, kick):
    controller = law(derivative_on=differentiated)
    controller.update((0.0, 0.0), (0.0, 0.0))
    assert controller.update((0.0, 0.0), (1e-6, 0.0))[0] == pytest.approx(0.02 + kick)


def test_movement_is_damped_alike_with_both_kinds_of_derivative():
    currents = []
    for differentiated in ("error", "measurement"):
        controller = law(derivative_on=differentiated)
        controller.update((0.0, 0.0), (0.0, 0.0))
        currents.append(controller.update((1e-6, -2e-6), (0.0, 0.0)))
    assert currents[0] == pytest.approx(currents[1])


def test_current_is_limited_on_both_sides():
    assert law(current_limit=2.0).update((1e-3, -1e-3), (0.0, 0.0)).tolist() == [-2.0, 2.0]


def test_axes_are_decoupled():
    controller, alone = law(), law()
    for step in range(20):
        x = 1e-6 * np.sin(step)
        assert controller.update((x, 5e-6 * np.cos(step)), (0.0, 0.0))[0] == alone.update((x, 0.0), (0.0, 0.0))[0]


def test_reset_forgets_the_past():
    controller = law()
    first = controller.update((1e-6, 1e-6), (0.0, 0.0))
    controller.update((5e-6, -1e-6), (0.0, 0.0))
    controller.reset()
    assert controller.update((1e-6, 1e-6), (0.0, 0.0)).tolist() == first.tolist()


def test_new_gains_apply_from_the_next_sample_on_and_keep_the_state():
    controller = law()
    controller.update((0.0, 0.0), (0.0, 0.0))
    controller.configure(ControllerParameters(proportional_gain=0.0, derivative_gain=10.0))
    assert controller.update((1e-6, 0.0), (0.0, 0.0))[0] == pytest.approx(-10.0 * 1e-6 / T)


def test_every_axis_of_a_machine_follows_the_law_of_one():
    machine, alone = (
        PdController(ControllerParameters(), 5),
        [PdController(ControllerParameters(), 1) for _ in range(5)],
    )
    for position in np.random.default_rng(1).normal(scale=50e-6, size=(50, 5)):
        expected = [law.update([x], [10e-6])[0] for law, x in zip(alone, position, strict=True)]
        assert machine.update(position, np.full(5, 10e-6)).tolist() == expected


def test_an_axis_may_have_gains_of_its_own():
    parameters = ControllerParameters(proportional_gains=(1e4, 2e4, 3e4), derivative_gains=(0.0, 10.0, 20.0))
    controller = PdController(parameters, 3)
    controller.update(np.zeros(3), np.zeros(3))
    assert controller.update(np.full(3, -1e-6), np.zeros(3)) == pytest.approx([0.01, 0.02 + 0.1, 0.03 + 0.2])


def test_nominal_reference_is_zero_or_given_per_axis():
    assert PdController(ControllerParameters(), 4).nominal_reference.tolist() == [0.0] * 4
    given = ControllerParameters(nominal_reference=(0.0, 40e-6, 0.0, 40e-6))
    assert PdController(given, 4).nominal_reference.tolist() == [0.0, 40e-6, 0.0, 40e-6]


@pytest.mark.parametrize("name", ["proportional_gains", "derivative_gains", "nominal_reference"])
def test_a_list_for_another_number_of_axes_is_refused_and_changes_nothing(name):
    controller = PdController(ControllerParameters(), 4)
    with pytest.raises(ParameterError, match=f"{name} has 2 values; the machine has 4 axes; allowed: 4, or none"):
        controller.configure(ControllerParameters(**{name: (1e-6, 1e-6)}))
    assert controller.parameters == ControllerParameters()


@pytest.mark.parametrize("wrong", [[1e9, 1.0], [float("nan"), 1.0], ["2e4"], 2e4, [True, 1.0], "[1, 2]", None])
def test_a_wrong_list_is_refused_in_one_line(wrong):
    with pytest.raises(ParameterError) as refused:
        validate(ControllerParameters, {"proportional_gains": wrong})
    message = str(refused.value)
    assert "proportional_gains" in message
    assert "a list of numbers from 0 to 1e+06 A/m" in message or "unknown parameter" in message
    assert "\n" not in message
