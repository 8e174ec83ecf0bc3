"""The paper's main experiment over ROS topics: levitate, shake with square waves, record, identify, validate.

The graph runs as separate processes. The same scenario is run a second time and once more without ROS; all three must
give the same samples bit for bit.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from amb_bringup.client import AmbClient
from amb_bringup.launcher import Graph, launch_file
from amb_controller_node.parameters import PdControllerParameters
from amb_core.errors import AmbError
from amb_core.excitation import Square, generate
from amb_core.figures import save_loop_figures
from amb_core.identification import StateSpaceModel, simulate_closed_loop
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.parameters import load_parameters
from amb_core.plant import Plant
from amb_core.recording import Recording
from amb_core.simulation import simulate_first_bearing
from amb_core.step_response import fit_step_response
from amb_sim_node.parameters import SimulatorParameters

SETTLING_STEPS = 2_000  # the rotor falls to its sag and comes to rest within a few periods of 63 Hz
SMALL_STEP = Square(amplitude=1e-6, duration=0.2, frequency=1.0, axes="x")
SQUARES = Square(amplitude=50e-6, duration=4.0, axes="in_turn")
ORDER = 10

Progress = Callable[[str, int, int], None]
"""Called with the name of the stage, the number of finished steps and the number of all steps."""


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


def run_demo(folder: Path, parameter_file: Path, domain_id: int, progress: Progress) -> DemoSummary:
    """Run the demo and write bag, model.json, summary.json and the figures to a folder.

    Parameters
    ----------
    folder : Path
        Must be empty or not exist.
    parameter_file : Path
        Parameters of all nodes.
    domain_id : int
        DDS domain in which the graph is started.
    progress : callable
        See `Progress`.

    Raises
    ------
    AmbError
        If a node fails, or the rotor delevitates.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bag = folder / "bag"
    environment = {"ROS_DOMAIN_ID": str(domain_id)}
    with (
        Graph.from_launch_file(launch_file("bearing"), {"params": str(parameter_file)}, environment) as graph,
        AmbClient(domain_id=domain_id) as amb,
    ):
        amb.start_recording(str(bag.absolute()))
        small, _ = _experiment(amb, SMALL_STEP, "small step", progress)
        first, wall = _experiment(amb, SQUARES, "square waves", progress)
        second, _ = _experiment(amb, SQUARES, "square waves again", progress)
        steps = SETTLING_STEPS + generate(SQUARES, _controller(parameter_file).sample_rate).steps
        model = amb.identify(
            order=ORDER, progress=lambda now: progress(f"identification, {now.stage}", now.done, now.total)
        )
        amb.stop_recording(second, steps)
        graph.check()
        processes = len(graph.processes)

    recording = Recording.read(bag)
    record = recording.telemetry(first)
    reference = _without_ros(parameter_file, progress)
    identical = record.identical_to(reference) and recording.telemetry(second).identical_to(reference)
    poles = fit_step_response(_after_settling(recording.telemetry(small)).position[:, 0], record.sample_time)
    experiment = _after_settling(record)
    progress("figures", 0, 1)
    _write_results(folder, model, experiment, _controller(parameter_file))
    progress("figures", 1, 1)
    summary = DemoSummary(
        steps=steps,
        wall_s=wall,
        steps_per_s=steps / wall,
        order=model.order,
        fit_x=float(model.fit[0]),
        fit_y=float(model.fit[1]),
        unstable_poles=len(model.unstable_poles()),
        closed_loop_natural_hz=poles.natural_hz,
        damping_ratio=poles.damping_ratio,
        sag_um=-1e6 * float(record.position[SETTLING_STEPS - 100 : SETTLING_STEPS, 1].mean()),
        bit_identical=identical,
        processes=processes,
    )
    (folder / "summary.json").write_text(json.dumps(asdict(summary), indent=2) + "\n")
    return summary


def _experiment(amb: AmbClient, excitation: Square, name: str, progress: Progress) -> tuple[int, float]:
    """Reset, excite after settling, run to the end. Returns the run and the wall-clock time of its steps (s)."""
    run = amb.reset()
    started = amb.start_excitation(excitation.kind, first_step=SETTLING_STEPS, **excitation.model_dump())
    steps = started.first_step + started.steps
    progress(name, 0, steps)
    began = time.monotonic()
    end = amb.run(steps, lambda step: progress(name, step, steps))
    if end.delevitated:
        raise AmbError(f"{name}: the rotor delevitated before step {end.step}")
    return run, time.monotonic() - began


def _without_ros(parameter_file: Path, progress: Progress) -> LoopRecord:
    controller = _controller(parameter_file)
    signal = generate(SQUARES, controller.sample_rate)
    steps = SETTLING_STEPS + signal.steps
    plant = Plant(load_parameters(SimulatorParameters, parameter_file, "simulator"))
    return simulate_first_bearing(
        plant, controller, steps, signal.samples, SETTLING_STEPS, lambda step: progress("without ROS", step, steps)
    )


def _controller(parameter_file: Path) -> ControllerParameters:
    return load_parameters(PdControllerParameters, parameter_file, "pd_controller")


def _after_settling(record: LoopRecord) -> LoopRecord:
    return record.window(SETTLING_STEPS, record.steps - SETTLING_STEPS)


def _write_results(
    folder: Path, model: StateSpaceModel, experiment: LoopRecord, controller: ControllerParameters
) -> None:
    model.save(folder / "model.json")
    simulation = simulate_closed_loop(
        model, controller, experiment.reference, experiment.first_step, experiment.current[0]
    )
    save_loop_figures(folder, experiment, simulation)
