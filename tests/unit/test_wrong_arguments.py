"""Arguments of the public Python calls that are not what is asked for: one line of AmbError with what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import amb_core as amb
from amb_core.data.analysis import classify_run
from amb_core.data.experiments import (
    RecordedLoop,
    advance_inputs,
    check_data,
    cure_drift,
    decimate,
    detrend,
    high_pass,
    merge,
    restore,
    split_at_invalid,
    write_data,
)
from amb_core.designs.excitation import TrialBench, check_excitation
from amb_core.excitation import (
    Multisine,
    Playback,
    definition_of,
    excitation_from_definition,
    excitation_from_request,
    excitation_from_settings,
    generate,
    instantaneous_frequency,
    steps_of,
)
from amb_core.ground.errors import AmbError, ParameterError
from amb_core.ground.files.parameter_files import ParameterFile
from amb_core.ground.parameters import load_parameters, validate
from amb_core.identification import (
    closed_loop_poles,
    estimate_uncertainty,
    focus_simulation,
    nrmse_fit,
    reduce_balanced,
    select_order,
    simulate_closed_loop,
    ssarx,
    to_continuous,
    to_predictor,
    to_scipy,
)
from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearController, LinearControllerParameters, pd_as_linear
from amb_core.loop.machine import ONE_BEARING, Machine
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters, describe, linearize, uniform_shaft
from amb_core.plant.simulation import simulate_first_bearing, with_values
from amb_core.recording import Recording, audit_steps, inspect_bag, recover_bag
from amb_core.regions import classify
from amb_core.regions.distortion import DistortionSettings, simulate_distortion
from amb_core.regions.region_map import MapSettings, RegionMap, build_map
from amb_core.regions.subharmonics import run_subharmonics
from amb_core.report.project import status_of
from amb_core.rig.running_speeds import identify_over_speeds
from amb_core.robustness import RobustnessSettings, assess, measured_sensitivity, peak_gain, sha256_of

WRONG = {
    "None": None,
    "dict": {"a": 1},
    "text": "abc",
    "list": [1, 2, 3],
    "rows of different lengths": [[1, 2], [3]],
    "NaN array": np.full((5, 2), np.nan),
    "array of three dimensions": np.zeros((2, 3, 4)),
    "array of texts": np.array([["a", "b"]]),
    "negative": -1,
    "truth value": True,
    "fraction": 2.5,
    "NaN": float("nan"),
    "infinity": float("inf"),
    "huge": 10**30,
    "object": object(),
    "folder": Path("/tmp"),
    "complex": 1j,
}
PD = ControllerParameters()
MULTISINE = Multisine(amplitude=20e-6, duration=0.2)
ZEROS = np.zeros((10, 2))


@pytest.fixture(scope="module")
def known(bearing) -> SimpleNamespace:
    record = bearing.experiment(2e-8, force=0.1).window(0, 3000)
    data = amb.IdentificationData.from_record(record)
    model = amb.identify(RecordedLoop(data, PD), order=4, method="ssarx").model
    return SimpleNamespace(record=record, data=data, model=model, plant=Plant(), controller=PdController(PD))


Call = Callable[[SimpleNamespace, Any], object]
CALLS: dict[str, Call] = {
    "LoopRecord reference": lambda k, w: LoopRecord(0, 1e-4, w, ZEROS, ZEROS),
    "LoopRecord sample_time": lambda k, w: LoopRecord(0, w, ZEROS, ZEROS, ZEROS),
    "LoopRecord axes": lambda k, w: LoopRecord(0, 1e-4, ZEROS, ZEROS, ZEROS, w),
    "LoopRecord.window": lambda k, w: k.record.window(0, w),
    "LoopRecord.identical_to": lambda k, w: k.record.identical_to(w),
    "Machine axes": lambda k, w: Machine("m", "simulator", 1e4, w, ONE_BEARING.bearings),
    "PdController": lambda k, w: PdController(w),
    "PdController.configure": lambda k, w: k.controller.configure(w),
    "PdController.update position": lambda k, w: k.controller.update(w, [0.0, 0.0]),
    "PdController.update reference": lambda k, w: k.controller.update([0.0, 0.0], w),
    "LinearController": lambda k, w: LinearController(w, LinearControllerParameters(), 2, 1e4),
    "LinearSystem": lambda k, w: LinearSystem(w, ZEROS.T, ZEROS, np.zeros((10, 10)), 1e-4),
    "LinearControl": lambda k, w: LinearControl(w, LinearControllerParameters()),
    "LinearControl.load": lambda k, w: LinearControl.load(w),
    "Plant": lambda k, w: Plant(w),
    "Plant.advance": lambda k, w: Plant().advance(w),
    "Plant.trace samples": lambda k, w: k.plant.trace([0.0, 0.0], w),
    "Plant.static_flux": lambda k, w: k.plant.static_flux(w, 0.0, 0.0),
    "linearize": lambda k, w: linearize(w),
    "describe": lambda k, w: describe(w),
    "simulate_first_bearing": lambda k, w: simulate_first_bearing(k.plant, PD, 10, w),
    "run_subharmonics plant": lambda k, w: run_subharmonics(w, PD),
    "run_subharmonics settings": lambda k, w: run_subharmonics(PlantParameters(), PD, w),
    "simulate_distortion controller": lambda k, w: simulate_distortion(PlantParameters(), w, DistortionSettings()),
    "build_map settings": lambda k, w: build_map(w, PlantParameters(), PD),
    "build_map plant": lambda k, w: build_map(MapSettings(), w, PD),
    "RegionMap.load": lambda k, w: RegionMap.load(w),
    "check_excitation": lambda k, w: check_excitation(w, w),
    "TrialBench": lambda k, w: TrialBench(w, PD),
    "classify record": lambda k, w: classify(w),
    "classify parameters": lambda k, w: classify(k.record, w),
    "identify_over_speeds": lambda k, w: identify_over_speeds(PlantParameters(), PD, w),
    "ssarx": lambda k, w: ssarx(w, ZEROS, 1e-4, 2),
    "estimate_uncertainty": lambda k, w: estimate_uncertainty(w, k.data),
    "focus_simulation": lambda k, w: focus_simulation(w, k.data, PD),
    "measured_sensitivity": lambda k, w: measured_sensitivity(w, PD),
    "peak_gain": lambda k, w: peak_gain(w),
    "sha256_of": lambda k, w: sha256_of(w),
    "status_of": lambda k, w: status_of(w),
    "cure_drift": lambda k, w: cure_drift(w),
    "uniform_shaft length": lambda k, w: uniform_shaft(w, 0.05, [-0.2, 0.2]),
    "with_values plant": lambda k, w: with_values(w, PD, {}),
    "with_values values": lambda k, w: with_values(PlantParameters(), PD, w),
    "simulate plant": lambda k, w: amb.simulate(w, k.controller, 10),
    "simulate controller": lambda k, w: amb.simulate(k.plant, w, 10),
    "simulate steps": lambda k, w: amb.simulate(k.plant, k.controller, w),
    "simulate excitation": lambda k, w: amb.simulate(k.plant, k.controller, 10, w),
    "simulate excitation_step": lambda k, w: amb.simulate(k.plant, k.controller, 10, ZEROS, w),
    "generate": lambda k, w: generate(w, 1e4),
    "generate sample_rate": lambda k, w: generate(MULTISINE, w),
    "generate machine": lambda k, w: generate(MULTISINE, 1e4, w),
    "steps_of": lambda k, w: steps_of(w, 1e4),
    "instantaneous_frequency": lambda k, w: instantaneous_frequency(w, 1e4),
    "Playback": lambda k, w: Playback(w, 1e4),
    "definition_of": lambda k, w: definition_of(w),
    "excitation_from_settings kind": lambda k, w: excitation_from_settings(w, {}),
    "excitation_from_settings values": lambda k, w: excitation_from_settings("multisine", w),
    "excitation_from_request values": lambda k, w: excitation_from_request("multisine", w),
    "excitation_from_definition": lambda k, w: excitation_from_definition("multisine", w),
    "named_controller": lambda k, w: amb.named_controller(w),
    "named_controller sample_rate": lambda k, w: amb.named_controller("paper", sample_rate=w),
    "identify data": lambda k, w: amb.identify(w),
    "identify order": lambda k, w: amb.identify(k.data, w),
    "identify method": lambda k, w: amb.identify(k.data, 2, w),
    "identify orders": lambda k, w: amb.identify(k.data, "auto", "ssarx", orders=w),
    "identify progress": lambda k, w: amb.identify(k.data, 2, "ssarx", progress=w),
    "validate model": lambda k, w: amb.validate(w, k.data),
    "validate uncertainty": lambda k, w: amb.validate(k.model, k.data, uncertainty=w),
    "validate plant": lambda k, w: amb.validate(k.model, k.data, plant=w),
    "validate lags": lambda k, w: amb.validate(k.model, k.data, lags=w),
    "certify model": lambda k, w: amb.certify(w, PD, k.data),
    "certify settings": lambda k, w: amb.certify(k.model, PD, k.data, settings=w),
    "certify validation": lambda k, w: amb.certify(k.model, PD, k.data, validation=w),
    "certify swept": lambda k, w: amb.certify(k.model, PD, k.data, swept=w),
    "assess settings": lambda k, w: assess(k.model, PD, w),
    "assess controller": lambda k, w: assess(k.model, w),
    "design values": lambda k, w: amb.design("multisine", w),
    "design plant": lambda k, w: amb.design("multisine", {"duration": 1.0}, plant=w),
    "estimate_response period": lambda k, w: amb.estimate_response(k.data, w),
    "write_certificate": lambda k, w: amb.write_certificate(w, "folder"),
    "from_record": lambda k, w: amb.IdentificationData.from_record(w),
    "IdentificationData": lambda k, w: amb.IdentificationData(w, 1e-4),
    "identify data of a RecordedLoop": lambda k, w: amb.identify(RecordedLoop(w, PD)),
    "StateSpaceModel.load": lambda k, w: amb.StateSpaceModel.load(w),
    "merge": lambda k, w: merge(w),
    "detrend": lambda k, w: detrend(w),
    "detrend kind": lambda k, w: detrend(k.data, w),
    "restore": lambda k, w: restore(w),
    "decimate": lambda k, w: decimate(w, 2),
    "decimate factor": lambda k, w: decimate(k.data, w),
    "high_pass length": lambda k, w: high_pass(k.data, w),
    "split_at_invalid": lambda k, w: split_at_invalid(w),
    "advance_inputs": lambda k, w: advance_inputs(k.data, w),
    "check_data": lambda k, w: check_data(w),
    "write_data": lambda k, w: write_data(w, "data.csv"),
    "write_data path": lambda k, w: write_data(k.data, w),
    "select_order": lambda k, w: select_order(w),
    "nrmse_fit": lambda k, w: nrmse_fit(w, ZEROS),
    "simulate_closed_loop": lambda k, w: simulate_closed_loop(k.model, PD, w),
    "closed_loop_poles model": lambda k, w: closed_loop_poles(w, PD),
    "closed_loop_poles controller": lambda k, w: closed_loop_poles(k.model, w),
    "reduce_balanced": lambda k, w: reduce_balanced(w, 2),
    "to_continuous": lambda k, w: to_continuous(w),
    "to_predictor": lambda k, w: to_predictor(w),
    "to_scipy": lambda k, w: to_scipy(w),
    "classify_run": lambda k, w: classify_run(w),
    "Recording.read": lambda k, w: Recording.read(w),
    "audit_steps": lambda k, w: audit_steps(w, 0),
    "inspect_bag": lambda k, w: inspect_bag(w),
    "recover_bag": lambda k, w: recover_bag(w, "out"),
    "load_parameters": lambda k, w: load_parameters(ControllerParameters, w, "pd_controller"),
    "ParameterFile": lambda k, w: ParameterFile(w),
    "validate values": lambda k, w: validate(ControllerParameters, w),
    "PlantParameters rotor": lambda k, w: PlantParameters(rotor=w),
    "PlantParameters without a name": lambda k, w: PlantParameters(w),
    "RobustnessSettings": lambda k, w: RobustnessSettings(actuator=w),
}

NONE = {"None"}
NUMBERS = {"negative", "fraction", "NaN", "infinity", "huge"}
TAKEN: dict[str, set[str]] = {
    "LoopRecord sample_time": NUMBERS,
    "Plant": NONE,
    "uniform_shaft length": {"fraction"},
    "run_subharmonics settings": NONE,
    "classify parameters": NONE,
    "identify_over_speeds": {"list"},
    "sha256_of": {"folder"},
    "status_of": {"folder"},
    "simulate excitation": NONE,
    "generate machine": NONE,
    "named_controller sample_rate": {"None", "fraction"},
    "identify orders": {"None", "list"},
    "identify progress": NONE,
    "validate uncertainty": NONE,
    "validate plant": NONE,
    "certify settings": NONE,
    "certify validation": NONE,
    "certify swept": NONE,
    "assess settings": NONE,
    "design plant": NONE,
    "estimate_response period": NONE,
}
"""What is not wrong there: defaults, and numbers where any is taken."""


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_argument_is_one_line_of_our_own_family(
    name: str, known: SimpleNamespace, tmp_path, monkeypatch
) -> None:
    """All wrong values of the table, so that no type of mistake reaches the inside of the library."""
    monkeypatch.chdir(tmp_path)
    for kind in WRONG.keys() - TAKEN.get(name, set()):
        with pytest.raises(AmbError) as caught:
            CALLS[name](known, WRONG[kind])
        assert "\n" not in str(caught.value), kind
    assert not list(tmp_path.iterdir())


def test_a_dict_in_place_of_a_parameter_set_is_refused_with_what_makes_one() -> None:
    values = {"rotor": {"mass": 2.0}}
    with pytest.raises(
        ParameterError, match=r"^parameters: dict .* PlantParameters\(\*\*values\) makes one of a dict$"
    ):
        Plant(values)  # type: ignore[arg-type]
    assert PlantParameters(**values).rotor.mass == 2.0


def test_a_record_takes_lists_and_refuses_unequal_lengths() -> None:
    rows = [[0.0, 0.0], [1e-6, 0.0]]
    assert LoopRecord(0, 1e-4, rows, rows, rows).position.shape == (2, 2)
    with pytest.raises(
        AmbError, match=r"^reference \(2, 2\), position \(1, 2\) and current \(2, 2\): .*\(steps, axes\)"
    ):
        LoopRecord(0, 1e-4, rows, rows[:1], rows)
    with pytest.raises(ValueError, match="position"):
        LoopRecord(0, 1e-4, rows, rows[:1], rows)


@pytest.mark.parametrize("wrong", [0.0, [0.0], [0.0] * 3, np.zeros((1, 2)), np.zeros((2, 1)), ["a", "b"], {1: 0, 2: 0}])
@pytest.mark.parametrize(
    "law",
    [PdController(PD), LinearController(pd_as_linear(PD), LinearControllerParameters(), 2, 1e4)],
    ids=["pd", "linear"],
)
def test_a_law_repeats_no_single_number_on_all_axes(law: Any, wrong: object) -> None:
    before = law.update([1e-6, 0.0], [0.0, 0.0])
    for sample in ((wrong, [0.0, 0.0]), ([0.0, 0.0], wrong)):
        with pytest.raises(ParameterError, match=r"is not allowed; allowed: 2 numbers each, one for each axis$"):
            law.update(*sample)
    law.reset()
    assert np.array_equal(law.update((1e-6, 0.0), np.zeros(2)), before), "what is refused leaves no trace"
    law.reset()


def test_a_controller_may_be_named_by_its_path(tmp_path: Path) -> None:
    file = tmp_path / "gains.yaml"
    file.write_text("/amb/pd_controller: {ros__parameters: {proportional_gain: 15000.0}}\n")
    assert amb.named_controller(file) == ControllerParameters(proportional_gain=15_000.0)
