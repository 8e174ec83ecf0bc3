"""The paper's main experiment over ROS topics: levitate, shake with square waves, record, identify, validate.

The graph runs as separate processes. The same scenario is run a second time and once more without ROS; all three must
give the same samples bit for bit.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from amb_bringup.client.experiment import Experiment, settling_steps
from amb_bringup.demos.demo_run import after_settling, controller_of, plant_of, run_graph
from amb_core.excitation import Square, generate
from amb_core.ground.errors import ExcitationError
from amb_core.ground.parameters import load_parameters
from amb_core.ground.progress import Progress, as_stage
from amb_core.identification import StateSpaceModel, simulate_closed_loop
from amb_core.linear.step_response import fit_step_response
from amb_core.loop.bearing import BACKUP_BEARING_RADIUS
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.report.figures import save_loop_figures
from amb_sim_node.parameters import SimulatorParameters

SMALL_STEP = Square(amplitude=1e-6, duration=0.2, frequency=1.0, axes="x")
SQUARES = Square(amplitude=50e-6, duration=4.0, axes="in_turn")
ORDER = 10


@dataclass(frozen=True)
class DemoSummary:
    """Results of the demo; `results/demo/summary.json`.

    Fits are closed-loop NRMSE fits in percent with offsets included; natural frequency and damping ratio are those of
    the simulated loop for a step of 1 um on x; the sag is that of the settled rotor (um).
    """

    steps: int
    wall_s: float
    steps_per_s: float
    order: int
    fit_x: float
    fit_y: float
    unstable_poles: int
    closed_loop_natural_hz: float
    damping_ratio: float
    sag_um: float
    bit_identical: bool
    processes: int


def run_demo(
    folder: Path, parameter_file: Path, domain_id: int, progress: Progress, clear: bool = False
) -> DemoSummary:
    """Run the demo and write bag, model.json, summary.json and the figures to a folder.

    Parameters
    ----------
    folder : Path
        Must be empty or not exist, without `clear`.
    parameter_file : Path
        Parameters of all nodes.
    domain_id : int
        DDS domain in which the graph is started.
    progress : callable
        See `amb_core.ground.progress.Progress`.
    clear : bool, optional
        Whether the results of an earlier demo in the folder are removed, once the graph runs.

    Raises
    ------
    AmbError
        If a node fails, or the rotor delevitates.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plant = load_parameters(SimulatorParameters, parameter_file, "simulator")
    step, squares = (fitting(excitation, plant) for excitation in (SMALL_STEP, SQUARES))
    experiments = [
        Experiment("small step", step),
        Experiment("square waves", squares),
        Experiment("square waves again", squares),
    ]
    done = run_graph(experiments, ORDER, folder, parameter_file, domain_id, progress, clear=clear)
    recording, model = done.recording, done.model
    small, first, second = done.runs
    record = recording.telemetry(first)
    reference = _without_ros(parameter_file, squares, progress)
    identical = record.identical_to(reference) and recording.telemetry(second).identical_to(reference)
    poles = fit_step_response(after_settling(recording.telemetry(small)).position[:, 0], record.sample_time)
    experiment = after_settling(record)
    settling = settling_steps(1.0 / record.sample_time)
    progress("figures", 0, 1)
    _write_results(folder, model, experiment, controller_of(parameter_file))
    progress("figures", 1, 1)
    summary = DemoSummary(
        steps=done.steps,
        wall_s=done.wall,
        steps_per_s=done.steps / done.wall,
        order=model.order,
        fit_x=float(model.fit[0]),
        fit_y=float(model.fit[1]),
        unstable_poles=len(model.unstable_poles()),
        closed_loop_natural_hz=poles.natural_hz,
        damping_ratio=poles.damping_ratio,
        sag_um=-1e6 * float(record.position[settling - 100 : settling, 1].mean()),
        bit_identical=identical,
        processes=done.processes,
    )
    (folder / "summary.json").write_text(json.dumps(asdict(summary), indent=2) + "\n")
    return summary


def require_two_axes(plant: PlantParameters) -> None:
    """Refuse a bearing whose magnets pull along y only: the demo shakes and identifies x too."""
    actuators = plant.magnetic_circuit.actuators
    if actuators != "two_axis":
        raise ExcitationError(
            f"magnetic_circuit.actuators = '{actuators}' is not allowed: the demo shakes x and y, and these magnets "
            "pull along y only; `amb experiment square --axes y` shakes y"
        )


def fitting(excitation: Square, plant: PlantParameters) -> Square:
    """The excitation, smaller in a bearing with less clearance than the paper's."""
    share = min(1.0, plant.rotor.backup_bearing_radius / BACKUP_BEARING_RADIUS)
    return excitation.model_copy(update={"amplitude": share * excitation.amplitude})


def _without_ros(parameter_file: Path, squares: Square, progress: Progress) -> LoopRecord:
    controller = controller_of(parameter_file)
    signal = generate(squares, controller.sample_rate)
    settling = settling_steps(controller.sample_rate)
    return simulate(
        plant_of(parameter_file),
        PdController(controller),
        settling + signal.steps,
        signal.samples,
        settling,
        as_stage("without ROS", progress),
    )


def _write_results(
    folder: Path, model: StateSpaceModel, experiment: LoopRecord, controller: ControllerParameters
) -> None:
    model.save(folder / "model.json")
    simulation = simulate_closed_loop(
        model, controller, experiment.reference, experiment.first_step, experiment.current[0]
    )
    save_loop_figures(folder, experiment, simulation)
