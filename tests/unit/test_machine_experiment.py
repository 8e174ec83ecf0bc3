"""The experiment that identifies a machine: its data determine a model of the order that the machine asks for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from amb_bringup.demos.demo_run import controller_of, plant_of
from amb_core.data.experiments.checks import Severity, check_excitation, highest_excited_order
from amb_core.designs.excitation import excited_order
from amb_core.excitation import Multisine, generate
from amb_core.ground.parameters import flatten, part_of, validate
from amb_core.identification import IdentificationData
from amb_core.loop.control import PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import FlexibleRotorParameters, Plant, PlantParameters, RotorParameters, uniform_shaft
from amb_core.plant.simulation import simulate
from amb_core.rig import machine_experiment

CONFIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config"


def plant(name: str, **changed: Any) -> Plant:
    """The plant of a parameter file of ours, with some parameters changed."""
    given = part_of(PlantParameters, plant_of(CONFIG / f"{name}.yaml").parameters.model_dump())
    return Plant(validate(PlantParameters, {**flatten(given.model_dump()), **changed}))


def excitation_of(machine: Plant, band_end: float) -> Multisine:
    """That of the demo over a band, with short periods."""
    amplitude = machine_experiment.amplitude(band_end)
    return machine_experiment.multisine(machine.machine, band_end, amplitude, band_start=10.0, period=0.1)


def record_of(name: str, machine: Plant, band_end: float) -> LoopRecord:
    """What the loop of a parameter file records in this experiment, after the rotor has settled."""
    rate, axes = machine.machine.sample_rate, len(machine.machine.axes)
    controller = controller_of(CONFIG / f"{name}.yaml").model_copy(update={"sample_rate": rate})
    signal = generate(excitation_of(machine, band_end), rate, machine.machine).samples
    rest = round(0.2 * rate)
    record = simulate(machine, PdController(controller, axes), rest + len(signal), signal, rest)
    return record.window(rest, len(signal))


@pytest.mark.parametrize(
    ("name", "sample_rate", "order", "band_end"),
    [("rig", 10e3, 12, 600.0), ("rig", 20e3, 12, 1200.0), ("thrust", 10e3, 17, 1000.0), ("flexible", 10e3, 20, 1692.2)],
)
def test_the_inputs_excite_the_order_of_the_model(name: str, sample_rate: float, order: int, band_end: float) -> None:
    machine = plant(name, **{"integration.sample_rate": sample_rate})
    assert machine_experiment.model_order(machine.parameters) == order
    assert machine_experiment.band_end(machine.parameters) == pytest.approx(band_end, rel=1e-4)
    data = IdentificationData.from_record(record_of(name, machine, machine_experiment.band_end(machine.parameters)))
    assert check_excitation(data, order).severity < Severity.ERROR


def test_a_band_to_600_hz_excites_too_few_lags_for_five_axes() -> None:
    """Hundreds of lines, but without noise eight lags of them are collinear to 1e-6; scales of signals do not matter.

    The design of excitations and identification agree on it.
    """
    record = record_of("thrust", plant("thrust"), 600.0)
    data = IdentificationData.from_record(record)
    assert check_excitation(data, 17).severity is Severity.ERROR
    highest = highest_excited_order(data, 17)
    assert highest < 17
    assert excited_order(record.current, record.position, record.sample_time, 17).order == highest
    scaled = IdentificationData.from_arrays(record.current * [1.0, 1e3, 1e-3, 1.0, 1e6], record.position, 1e-4)
    assert highest_excited_order(scaled, 17) == highest


def test_the_excitation_of_the_rig_has_the_amplitude_and_band_of_a_rigid_rotor() -> None:
    machine = plant("rig")
    end = machine_experiment.band_end(machine.parameters)
    excitation = machine_experiment.multisine(machine.machine, end, machine_experiment.amplitude(end))
    assert (excitation.amplitude, excitation.frequency_start, excitation.frequency_end) == (1.5e-6, 2.0, 600.0)
    assert (excitation.axes, excitation.odd, excitation.periods, excitation.duration) == ("orthogonal", True, 2, 4.0)


def test_a_wider_band_has_a_smaller_amplitude() -> None:
    assert machine_experiment.amplitude(300.0) == machine_experiment.amplitude(600.0) == 1.5e-6
    assert machine_experiment.amplitude(1200.0) == pytest.approx(0.75e-6)


def test_bending_modes_that_the_sample_rate_does_not_show_are_left_out(tmp_path: Path) -> None:
    modes = tmp_path / "shaft.npz"
    uniform_shaft(0.9, 0.048, (-0.3, 0.3), bending_modes=4).save(modes)  # 273, 752, 1470 and 2440 Hz
    flexible = PlantParameters(
        rotor=RotorParameters(model="flexible"), flexible_rotor=FlexibleRotorParameters(modal_data=str(modes))
    )
    assert machine_experiment.model_order(flexible) == 2 * (4 + 2 * 3) + 4
    assert machine_experiment.band_end(flexible) == 2000.0  # a fifth of the sample rate
    assert machine_experiment.model_order(flexible, band_end=800.0) == 2 * (4 + 2 * 2) + 4


def test_a_point_mass_with_a_thrust_bearing_has_an_experiment() -> None:
    parameters = PlantParameters(rotor=RotorParameters(axial=True))
    assert machine_experiment.model_order(parameters) == 2 * 2 + 4 + 3
    assert machine_experiment.band_end(parameters) == 1000.0
