"""What every demo does: start the graph, run one experiment after another, record them, identify a model."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_bringup.client import AmbClient
from amb_bringup.launcher import Graph, launch_file
from amb_controller_node.parameters import PdControllerParameters
from amb_core.errors import AmbError
from amb_core.excitation import Excitation, generate
from amb_core.identification import Focus, StateSpaceModel
from amb_core.loop.control import ControllerParameters
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.parameters import load_parameters
from amb_core.plant import Plant
from amb_core.recording import Recording
from amb_sim_node.parameters import SimulatorParameters

SETTLING_STEPS = 2_000  # the rotor falls to its sag and comes to rest within a few periods of 63 Hz
PATIENCE = 120.0  # s; longest wait for the nodes, which start all at once, on a machine that has other work too

Progress = Callable[[str, int, int], None]
"""Called with the name of the stage, the number of finished steps and the number of all steps."""


@dataclass(frozen=True)
class Experiment:
    """An excitation from step `SETTLING_STEPS` of a run, and the name of its stage."""

    name: str
    excitation: Excitation


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
) -> GraphRun:
    """Run experiments over topics, each from a reset, identify from the last one, and record everything.

    Raises
    ------
    AmbError
        If a node fails, or the rotor delevitates.
    """
    bag = folder / "bag"
    environment = {"ROS_DOMAIN_ID": str(domain_id)}
    with (
        Graph.from_launch_file(launch_file("bearing"), {"params": str(parameter_file)}, environment) as graph,
        AmbClient(domain_id=domain_id, timeout=PATIENCE) as amb,
    ):
        amb.start_recording(str(bag.absolute()))
        runs, walls = [], []
        for experiment in experiments:
            run, steps, wall = _run(amb, experiment, progress)
            runs.append(run)
            walls.append(wall)
        model = amb.identify(
            order=order,
            focus=focus,
            progress=lambda now: progress(f"identification, {now.stage}", now.done, now.total),
        )
        amb.stop_recording(runs[-1], steps)
        graph.check()
        processes = len(graph.processes)
    return GraphRun(Recording.read(bag), runs, model, steps, walls[-2], processes)


def _run(amb: AmbClient, experiment: Experiment, progress: Progress) -> tuple[int, int, float]:
    """Reset, excite after settling, run to the end. Returns the run, its steps and their wall-clock time (s)."""
    name, excitation = experiment.name, experiment.excitation
    run = amb.reset()
    started = amb.start_excitation(excitation.kind, first_step=SETTLING_STEPS, **excitation.model_dump())
    steps = started.first_step + started.steps
    progress(name, 0, steps)
    began = time.monotonic()
    end = amb.run(steps, lambda step: progress(name, step, steps))
    if end.delevitated:
        raise AmbError(f"{name}: the rotor delevitated before step {end.step}")
    return run, steps, time.monotonic() - began


def plant_of(parameter_file: Path) -> Plant:
    """The plant of a parameter file."""
    return Plant(load_parameters(SimulatorParameters, parameter_file, "simulator"))


def controller_of(parameter_file: Path) -> ControllerParameters:
    """The PD controller of a parameter file, at the rate of its simulator."""
    return load_parameters(PdControllerParameters, parameter_file, "pd_controller")


def after_settling(record: LoopRecord) -> LoopRecord:
    """The samples from the first step of the excitation on."""
    return record.window(SETTLING_STEPS, record.steps - SETTLING_STEPS)


def samples_of(excitation: Excitation, machine: Machine) -> NDArray[np.float64]:
    """The samples of an excitation for a machine (m), shape (steps, axes)."""
    return generate(excitation, machine.sample_rate, machine).samples
