"""The demo of a machine of several bearings: levitate, excite with an orthogonal multisine, identify, compare.

The graph runs as separate processes. The experiment is run twice over topics and once more without ROS; all three must
give the same samples bit for bit. The identified model is compared with the linearised plant: frequency response of all
entries, and modes in the loop.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_bringup.client.experiment import Experiment, settling_steps
from amb_bringup.demos.demo_run import after_settling, controller_of, plant_of, run_graph, samples_of
from amb_core.excitation import Excitation, Multisine
from amb_core.ground.progress import Progress, as_stage
from amb_core.identification import response_of, simulate_closed_loop
from amb_core.identification.modes import closed_loop_modes
from amb_core.identification.response_error import response_error
from amb_core.identification.validation.frequency import response_of_plant
from amb_core.linear.model import StateSpaceModel
from amb_core.linear.model.mode_pairs import pair_modes
from amb_core.linear.model.modes import modes_of
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters, linearize
from amb_core.plant.simulation import simulate
from amb_core.report.figures import bode_chart, save_loop_figures
from amb_core.rig.machine_experiment import amplitude, band_end, model_order, multisine


@dataclass(frozen=True)
class MachineDemoSummary:
    """Results of the demo; `summary.json`.

    Fits are closed-loop NRMSE fits by axis in percent with offsets included. `frf_error_percent` is the largest
    relative error of the model's frequency response against the linearised plant, 5 to 1000 Hz, over all entries that
    exceed 1 % of the largest at their frequency; `frf_worst` says where it is. `modes` are those in the loop,
    identified and computed (Hz, damping ratio, whirl direction); `modes_missing` counts computed ones that no
    identified one matches. The running speed is in Hz.
    """

    axes: list[str]
    steps: int
    wall_s: float
    steps_per_s: float
    order: int
    fit: dict[str, float]
    unstable_poles: int
    unstable_poles_computed: int
    frf_error_percent: float
    frf_worst: str
    modes: list[dict[str, Any]]
    modes_missing: int
    running_speed: float
    bit_identical: bool
    processes: int


def run_machine_demo(
    folder: Path, parameter_file: Path, domain_id: int, progress: Progress, clear: bool = False
) -> MachineDemoSummary:
    """Run the demo and write bag, model.json, summary.json and the figures to a folder.

    Parameters and errors are those of `amb_bringup.demos.demo.run_demo`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plant, controller = plant_of(parameter_file), controller_of(parameter_file)
    axes = plant.machine.axis_names
    excitation = excitation_for(plant)
    experiments = [Experiment("orthogonal multisine", excitation), Experiment("the same again", excitation)]
    # Predictions weigh fast errors most; the response below 50 Hz is determined by the simulated loop.
    done = run_graph(
        experiments,
        model_order(plant.parameters),
        folder,
        parameter_file,
        domain_id,
        progress,
        focus="simulation",
        clear=clear,
    )
    records = [done.recording.telemetry(run) for run in done.runs]
    reference = _without_ros(plant, controller, excitation, done.steps, progress)
    progress("comparison", 0, 1)
    computed = linearize(plant, controller)
    error = response_error(done.model, computed.discrete)
    pairs = pair_modes(closed_loop_modes(done.model, controller), modes_of(computed.closed_loop))
    done.model.save(folder / "model.json")
    _save_figures(folder, done.model, records[0], plant.parameters, controller, error.frequency)
    progress("comparison", 1, 1)
    summary = MachineDemoSummary(
        axes=list(axes),
        steps=done.steps,
        wall_s=done.wall,
        steps_per_s=done.steps / done.wall,
        order=done.model.order,
        fit=dict(zip(axes, done.model.fit.tolist(), strict=True)),
        unstable_poles=len(done.model.unstable_poles()),
        unstable_poles_computed=int((abs(computed.discrete.poles()) > 1.0).sum()),
        frf_error_percent=100.0 * error.largest,
        frf_worst=error.worst,
        modes=[pair.to_json() for pair in pairs.pairs],
        modes_missing=len(pairs.missing),
        running_speed=plant.parameters.rotor.running_speed,
        bit_identical=all(record.identical_to(reference) for record in records),
        processes=done.processes,
    )
    (folder / "summary.json").write_text(json.dumps(asdict(summary), indent=2) + "\n")
    return summary


def _without_ros(
    plant: Plant, controller: ControllerParameters, excitation: Excitation, steps: int, progress: Progress
) -> LoopRecord:
    """The same experiment in one process."""
    return simulate(
        plant,
        PdController(controller, len(plant.machine.axis_names)),
        steps,
        samples_of(excitation, plant.machine),
        settling_steps(plant.machine.sample_rate),
        as_stage("without ROS", progress),
    )


def _save_figures(
    folder: Path,
    model: StateSpaceModel,
    record: LoopRecord,
    plant: PlantParameters,
    controller: ControllerParameters,
    frequency: NDArray[np.float64],
) -> None:
    """The model's loop against the record, and its response against that of the plant."""
    experiment = after_settling(record)
    modelled = simulate_closed_loop(
        model, controller, experiment.reference, experiment.first_step, experiment.current[0]
    )
    save_loop_figures(folder, experiment, modelled)
    responses = [
        response_of(model, frequency, label="identified"),
        response_of_plant(plant, controller, frequency),
    ]
    bode_chart(responses).save(folder, "bode")


def excitation_for(plant: Plant) -> Multisine:
    """The orthogonal multisine of the demo."""
    end = band_end(plant.parameters)
    return multisine(plant.machine, end, amplitude(end))
