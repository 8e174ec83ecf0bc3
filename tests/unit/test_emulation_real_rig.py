"""The plant of the emulator as on a rig: where the rotor lies, what its sensors show, how it lifts off and how not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.parameters import load_parameters, validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.rig.emulation import as_on_a_rig
from amb_core.rig.link import TargetState, TripReason, commands
from tests.emulated_host import Bench

CONFIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config"


def of(config: str) -> tuple[PlantParameters, ControllerParameters]:
    file = CONFIG / f"{config}.yaml"
    plant = load_parameters(PlantParameters, file, "simulator", part=True)
    return as_on_a_rig(plant), load_parameters(ControllerParameters, file, "pd_controller", part=True)


@pytest.mark.parametrize("seconds", [0.0, 0.5])
@pytest.mark.parametrize("config", ["paper", "rig"])
def test_it_lifts_off_from_its_backup_bearing_and_settles(config: str, seconds: float) -> None:
    plant, controller = of(config)
    with Bench(plant, controller) as bench:
        axes = bench.connect().axes
        bench.run(10)
        bench.done(commands.nominal_reference(controller.references(axes)))
        bench.done(commands.stream(5, 1), commands.levitate(seconds))
        bench.run(12_000)
        status = bench.command(commands.heartbeat()).status
        assert (status.state, status.trips) == (TargetState.LEVITATED, ())
        position = np.concatenate([block.position for block in bench.blocks()])
        down = list(bench.emulator.plant.machine.axis_names).index("y" if config == "paper" else "y_a")
        assert position[0, down] == pytest.approx(-245e-6, abs=1e-6)
        still = position[-2_000:, down]
        assert 0.0 < np.std(still) < 1e-6
        np.testing.assert_allclose(still / 10e-9, np.round(still / 10e-9), atol=1e-6)  # the steps of the converter


def test_a_sensor_with_the_wrong_sign_trips_by_itself_and_not_by_an_amplifier() -> None:
    plant, controller = of("paper")
    with Bench(plant, controller, sensor={"inverted": "y"}) as bench:
        bench.connect()
        bench.run(10)
        bench.done(commands.levitate(1.0))
        first = bench.emulator.steps
        bench.run(12_000)
        (trip, *_) = bench.command(commands.heartbeat()).status.trips
        assert trip.reason in (TripReason.DISPLACEMENT, TripReason.SATURATED)
        assert trip.step - first < 10_000  # within the ramp: the currents do not press for longer


def test_noise_and_resolution_that_are_given_stay() -> None:
    given = validate(PlantParameters, {"sensor.noise": 1e-6, "converters.position_resolution": 2e-6})
    assert as_on_a_rig(given).sensor.noise == 1e-6
    assert as_on_a_rig(given).converters.position_resolution == 2e-6
