"""Whether an excitation leaves region A of a map, and the guard of the bridge that asks for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_core.designs.excitation import check_excitation
from amb_core.designs.excitation.beyond_a import highest_load
from amb_core.excitation import ExcitationSignal, Square, Sweep, Tones, generate
from amb_core.ground.errors import ExcitationError, ParameterError, RegionError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.regions.region_map import RegionMap
from amb_sim_node.bridge_parameters import BridgeParameters
from amb_sim_node.region_guard import guard_of
from tests.target_rig import small_controller

FILE = Path(__file__).parent / "data" / "paper_map.json"
MAP = RegionMap.load(FILE)
RATE = 10_000.0
PD = ControllerParameters()


def tone(frequency: float, amplitude: float, machine: Machine | None = None) -> ExcitationSignal:
    return generate(Tones(frequencies=(frequency,), amplitudes=(amplitude,), axes="all", duration=1.0), RATE, machine)


def four_axes() -> Machine:
    axes = [
        MachineAxis(f"{name}_{bearing}", bearing, 0.0, 0.0, (1.0, 0.0, 0.0), 2.5, 10.0)
        for bearing in "ab"
        for name in "xy"
    ]
    return Machine("rig", "bridge", RATE, tuple(axes), tuple(MachineBearing(name, 250e-6) for name in "ab"))


@pytest.mark.parametrize(("frequency", "amplitude"), [(50.0, 10e-6), (300.0, 20e-6), (1000.0, 5e-6), (1500.0, 40e-6)])
def test_its_load_is_that_of_the_check_on_one_bearing(frequency: float, amplitude: float) -> None:
    signal = tone(frequency, amplitude)
    checked = check_excitation(signal, MAP)
    assert highest_load(signal, MAP, PD).load == pytest.approx(
        max(axis.load.linear for axis in checked.axes), rel=0.05
    )  # the check takes the static current off the limit


def test_the_load_rises_with_the_amplitude_through_the_end_of_region_a() -> None:
    loads = [highest_load(tone(1200.0, amplitude), MAP, PD).load for amplitude in (1e-6, 5e-6, 20e-6, 50e-6)]
    assert loads == sorted(loads)
    assert loads[0] < 1.0 < loads[-1]


def test_a_machine_of_four_axes_is_looked_at_axis_by_axis() -> None:
    one = highest_load(tone(300.0, 20e-6), MAP, PD)
    machine = four_axes()
    assert highest_load(tone(300.0, 20e-6, machine), MAP, PD).load == pytest.approx(one.load, rel=1e-9)
    stiff = validate(ControllerParameters, {"derivative_gains": [38.0, 38.0, 38.0, 95.0]})
    load = highest_load(tone(300.0, 20e-6, machine), MAP, stiff)
    assert load.axis == "y_b"
    assert load.load > one.load
    only = generate(Square(amplitude=5e-6, duration=0.5, axes="y_a"), RATE, machine)
    assert highest_load(only, MAP, PD).axis == "y_a"


def test_the_guard_lets_small_signals_pass_and_refuses_others_with_axis_and_load() -> None:
    guard = guard_of(BridgeParameters(region_map=str(FILE)), PD)
    guard(generate(Sweep(amplitude=2e-6, duration=2.0, frequency_start=5.0, frequency_end=200.0), RATE))
    with pytest.raises(ExcitationError, match=r"may leave region A of the map on [xy]: load \d+\.\d\d, where 1"):
        guard(tone(1500.0, 60e-6))
    with pytest.raises(ExcitationError, match="waveform cannot be checked"):
        guard(None)


def test_without_a_map_or_by_name_everything_passes() -> None:
    for settings in (BridgeParameters(), BridgeParameters(region_map=str(FILE), beyond_region_a="allow")):
        guard = guard_of(settings, PD)
        guard(tone(1500.0, 60e-6))
        guard(None)


def test_a_map_that_cannot_be_used_is_noticed_when_the_bridge_is_configured(tmp_path: Path) -> None:
    with pytest.raises(RegionError):
        guard_of(BridgeParameters(region_map=str(tmp_path / "none.json")), PD)
    small = small_controller()
    law = LinearControl.load(_saved(small, tmp_path))
    with pytest.raises(ParameterError, match="region_map is for the PD law"):
        guard_of(BridgeParameters(region_map=str(FILE)), law)


def _saved(model, folder: Path) -> Path:
    assert np.isfinite(model.a).all()
    path = folder / "controller.json"
    model.save(path)
    return path
