"""What every demo does: start the graph, run one experiment after another, record them, identify a model."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_bringup.client.experiment import Experiment, SimulatorStand, landing, settling_steps
from amb_bringup.graph.own_graph import PATIENCE, own_graph
from amb_controller_node.parameters import PdControllerParameters
from amb_core.excitation import Excitation, generate
from amb_core.ground.parameters import load_parameters
from amb_core.ground.progress import Progress
from amb_core.identification import Focus, StateSpaceModel
from amb_core.loop.machine import Machine
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.recording import Recording
from amb_sim_node.parameters import SimulatorParameters

FILES = (
    "model.json",
    "summary.json",
    *(f"{name}.{kind}" for name in ("orbit", "response", "bode") for kind in ("png", "html")),
)


@dataclass(frozen=True)
class GraphRun:
    """What the graph did.

    Attributes
    ----------
    recording : Recording
        The bag.
    runs : list of int
        Run of each experiment.
    model : StateSpaceModel
        Identified from the last one.
    steps, wall : int, float
        Steps of the last experiment, and the wall-clock time of those of the last but one (s).
    processes : int
        Number of node processes.
    """

    recording: Recording
    runs: list[int]
    model: StateSpaceModel
    steps: int
    wall: float
    processes: int


def run_graph(
    experiments: list[Experiment],
    order: int,
    folder: Path,
    parameter_file: Path,
    domain_id: int,
    progress: Progress,
    focus: Focus = "prediction",
    clear: bool = False,
) -> GraphRun:
    """Run experiments over topics, each from a reset, identify from the last one, and record everything.

    With `clear`, results of an earlier demo in the folder are removed once the graph runs.

    Raises
    ------
    AmbError
        If a node fails, or the rotor delevitates.
    """
    bag = folder / "bag"
    with own_graph("bearing", {"params": str(parameter_file)}, domain_id, timeout=PATIENCE) as (graph, amb):
        if clear:
            remove_results(folder, FILES)
        stand = SimulatorStand(amb, progress)
        amb.start_recording(bag)
        with landing(stand, recorded=True):
            done = [stand.excite(experiment) for experiment in experiments]
            model = amb.identify(
                order=order,
                focus=focus,
                progress=lambda now: progress(f"identification, {now.stage}", now.done, now.total),
            )
        graph.check()
        processes = len(graph.processes)
    return GraphRun(Recording.read(bag), [item.run for item in done], model, done[-1].end, done[-2].wall, processes)


def remove_results(folder: Path, files: Iterable[str]) -> None:
    """Remove bag and files of an earlier demo, and nothing else."""
    shutil.rmtree(folder / "bag", ignore_errors=True)
    for name in files:
        (folder / name).unlink(missing_ok=True)


def plant_of(parameter_file: Path) -> Plant:
    """The plant of a parameter file."""
    return Plant(load_parameters(SimulatorParameters, parameter_file, "simulator"))


def controller_of(parameter_file: Path) -> ControllerParameters:
    """The PD controller of a parameter file, at the rate of its simulator."""
    return load_parameters(PdControllerParameters, parameter_file, "pd_controller")


def after_settling(record: LoopRecord) -> LoopRecord:
    """The samples from the first step of the excitation on."""
    settling = settling_steps(1.0 / record.sample_time)
    return record.window(settling, record.steps - settling)


def samples_of(excitation: Excitation, machine: Machine) -> NDArray[np.float64]:
    """The samples of an excitation for a machine (m), shape (steps, axes)."""
    return generate(excitation, machine.sample_rate, machine).samples
