"""The controllers of the C target: the currents of the Python laws bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.linear_control import LinearController, LinearControllerParameters, pd_as_linear
from amb_core.rig.link import Code, Law, Limits, TargetState, commands, controller_upload
from tests.target_rig import Rig, small_controller

STEPS = 2_000
STILL = Limits(excitation_amplitude=1.0, sensor_range=1.0, trip_share=1e9, alarm_share=1.0, contact_share=1e9,
               saturation_time=1e9)  # fmt: skip


def positions(axes: int) -> np.ndarray:
    """Some microns, and now and then so much that the currents are limited."""
    rng = np.random.default_rng(axes)
    return rng.normal(0.0, 1e-6, (STEPS, axes)) * np.where(rng.random((STEPS, 1)) < 0.01, 200.0, 1.0)


def differing(rig: Rig, law: PdController | LinearController) -> int:
    """Steps in which a current of the target differs from that of the law in any bit."""
    axes = rig.session.axes
    rig.step(np.zeros(axes))
    assert rig.command(commands.levitate()).code == Code.DONE
    count = 0
    for number, position in enumerate(positions(axes)):
        rig.step(position)
        count += law.update(position, law.nominal_reference).tobytes() != rig.target.current.tobytes()
        if number == STEPS // 2:
            assert rig.status().state == TargetState.LEVITATED
    return count


@pytest.mark.parametrize("axes", [1, 2, 4, 5, 16])
def test_pd_currents_equal_those_of_the_law(axes: int) -> None:
    rig = Rig(axes, STILL)
    assert differing(rig, PdController(ControllerParameters(), axes)) == 0


def test_pd_with_all_its_options_equals_the_law() -> None:
    parameters = ControllerParameters(
        derivative_filter=3e-4, derivative_on="measurement", proportional_gains=(19e3, 21e3, 22e3, 23e3),
        derivative_gains=(31.0, 33.0, 37.0, 39.0), nominal_reference=(1e-6, -2e-6, 3e-6, 4e-6), current_limit=2.5,
    )  # fmt: skip
    rig = Rig(4, STILL)
    for command in (
        commands.gains(parameters, 4), commands.nominal_reference(parameters.nominal_reference),
        commands.limits(Limits(**{**vars(STILL), "control_current": 2.5})),
    ):  # fmt: skip
        assert rig.command(command).code == Code.DONE
    assert differing(rig, PdController(parameters, 4)) == 0


@pytest.mark.parametrize("kind", ["errors", "references and positions"])
@pytest.mark.parametrize("axes", [2, 4])
def test_state_space_currents_equal_those_of_the_law(axes: int, kind: str) -> None:
    with_filter = ControllerParameters(derivative_filter=2e-4)
    model = small_controller(axes) if kind == "errors" else pd_as_linear(with_filter, axes)
    rig = Rig(axes, STILL)
    assert rig.upload(controller_upload(1, model)).code == Code.DONE
    assert rig.command(commands.controller(Law.STATE_SPACE)).code == Code.DONE
    assert differing(rig, LinearController(model, LinearControllerParameters(), axes, 10_000.0)) == 0


def test_gains_change_while_levitated_and_the_state_is_kept() -> None:
    rig, law = Rig(2, STILL), PdController(ControllerParameters())
    differing(rig, law)
    law.configure(changed := ControllerParameters(proportional_gain=25_000.0))
    assert rig.command(commands.gains(changed, 2)).code == Code.DONE
    rig.noise(round(STILL.settle_time * 10_000.0))  # on the way to them
    rig.step(np.zeros(2))
    law.update((0.0, 0.0), (0.0, 0.0))  # which remembers the latest position
    for position in positions(2)[:10]:
        rig.step(position)
        assert law.update(position, (0.0, 0.0)).tobytes() == rig.target.current.tobytes()


def test_a_second_levitation_starts_the_law_anew() -> None:
    rig = Rig(2, STILL)
    assert differing(rig, PdController(ControllerParameters())) == 0
    assert rig.command(commands.delevitate()).code == Code.DONE
    rig.step()
    assert (rig.target.enabled, rig.target.current.tolist()) == (False, [0.0, 0.0])
    assert differing(rig, PdController(ControllerParameters())) == 0


def test_the_controller_does_not_change_under_a_levitated_rotor() -> None:
    rig = Rig(2)
    assert rig.command(commands.controller(Law.STATE_SPACE)).code == Code.WRONG_STATE  # there is none
    assert rig.upload(controller_upload(1, small_controller())).code == Code.DONE
    rig.levitate()
    assert rig.command(commands.controller(Law.STATE_SPACE)).code == Code.WRONG_STATE


@pytest.mark.parametrize(
    "command",
    [
        commands.gains(ControllerParameters(), 1),
        commands.nominal_reference((200e-6, 0.0)),
        commands.nominal_reference((np.nan, 0.0)),
        commands.landing_reference((0.0, -np.inf)),
        commands.limits(Limits(control_current=3.01)),
        commands.levitate(np.nan),
        commands.levitate(-1.0),
        commands.stream(5, 8),
        commands.stream(1000),
    ],
    ids=lambda command: f"{command.type.name} of {len(command.body)}",
)
def test_values_that_are_not_allowed_change_nothing(command) -> None:
    rig = Rig(2)
    before = rig.status()
    code = rig.command(command).code
    assert code in (Code.BAD_LENGTH, Code.BAD_VALUE, Code.TOO_LARGE)
    rig.levitate()
    law = PdController(ControllerParameters())
    assert rig.status().trips == before.trips == ()
    assert law.update((1e-3, 0.0), (0.0, 0.0))[0] == -3.0


def test_levitation_ramps_from_where_the_rotor_lies_to_its_reference() -> None:
    rig = Rig(2, Limits(reference_slew=0.5))
    rig.command(commands.stream(4, 1))
    rig.step((-200e-6, 100e-6))
    rig.command(commands.levitate(0.0004))
    for _ in range(7):
        rig.step((-200e-6, 100e-6))
    blocks = rig.answers()
    x = np.concatenate([block.reference[:, 0] for block in blocks])
    np.testing.assert_allclose(x[1:6], [-200e-6, -150e-6, -100e-6, -50e-6, 0.0], atol=1e-18)
