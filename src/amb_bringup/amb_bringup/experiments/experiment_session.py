"""One session of experiments from nothing: a graph if none runs, the experiments, the bag."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from amb_bringup.client import AmbClient, ClientError
from amb_bringup.client.errors import EndError
from amb_bringup.client.experiment import Experiment, ExperimentRun, graph_runs
from amb_bringup.graph.launcher import Graph, own_domain
from amb_bringup.graph.node_parameters import require_emulated_target
from amb_bringup.graph.own_graph import PATIENCE, own_graph
from amb_bringup.graph.packages import LaunchError, share_folder
from amb_core.excitation.signal import steps_of
from amb_core.ground.files.parameter_files import NODES, RIG_NODES
from amb_core.ground.parameters import load_parameters
from amb_core.ground.progress import Progress
from amb_core.plant import PlantParameters
from amb_core.plant.machine import machine_of


@dataclass(frozen=True)
class GraphChoice:
    """The graph to start if none runs.

    Attributes
    ----------
    params : Path or None
        Parameter file of all nodes; None for the paper's bearing, and for any graph that runs already.
    rig : bool
        Whether it is that of a rig.
    emulator : bool
        Whether a target is emulated, for a rig.
    """

    params: Path | None = None
    rig: bool = False
    emulator: bool = False


def run_session(
    experiments: Sequence[Experiment], bag: Path | None, choice: GraphChoice, progress: Progress
) -> list[ExperimentRun]:
    """Carry out experiments on the graph that runs in this domain, or on one started for them.

    Parameters
    ----------
    experiments : sequence of Experiment
        At least one.
    bag : Path or None
        New folder in which everything is recorded.
    choice : GraphChoice
        The graph to start if none runs.
    progress : callable
        See `amb_core.ground.progress.Progress`.

    Raises
    ------
    AmbError
        As for `amb_bringup.client.experiment.carry_out`; if parameters are given for a graph that runs already; and,
        before a simulator is started, if its sample rate or axes do not suit an excitation.
    """
    with _graph(choice, experiments, progress) as amb:
        return amb.experiment(experiments, bag, progress)


@contextmanager
def _graph(choice: GraphChoice, experiments: Sequence[Experiment], progress: Progress) -> Iterator[AmbClient]:
    if choice.emulator and choice.params is not None:
        require_emulated_target(choice.params)
    progress("graph", 0, 1)
    with AmbClient(timeout=PATIENCE, nodes=()) as amb:
        running = graph_runs(amb)
    if running:
        if choice != GraphChoice():
            raise ClientError(
                f"a graph runs in the DDS domain {os.environ.get('ROS_DOMAIN_ID', '0')}, with parameters of its own; "
                "leave out --params, --set, --rig and --emulator, or end it"
            )
        progress("graph", 1, 1)
        with AmbClient(timeout=PATIENCE, nodes=()) as amb:
            yield amb
        return
    if not choice.rig:
        require_playable(experiments, choice.params)
    domain = own_domain()
    arguments = {} if choice.params is None else {"params": str(choice.params.absolute())}
    if choice.rig:
        arguments["emulator"] = str(choice.emulator).lower()
    nodes, name = (RIG_NODES, "rig") if choice.rig else (NODES, "bearing")
    with own_graph(name, arguments, domain, nodes, PATIENCE) as (graph, amb):
        progress("graph", 1, 1)
        try:
            yield amb
        except ClientError as problem:
            _blame_ended_node(graph, problem)
            raise
        graph.check()


def _blame_ended_node(graph: Graph, problem: ClientError) -> None:
    """Raise the error of a node that has ended, which is the reason of a problem; what is left to do stays in it."""
    try:
        graph.check()
    except LaunchError as reason:
        if isinstance(problem, EndError):
            raise EndError(f"{reason}; {problem}") from problem
        raise


def require_playable(experiments: Sequence[Experiment], params: Path | None) -> None:
    """Refuse excitations that the simulator of a parameter file, by default the paper's, would refuse.

    Raises
    ------
    ExcitationError
        If a frequency lies above its Nyquist frequency, or it lacks an axis.
    """
    path = params or share_folder("amb_bringup") / "config" / "paper.yaml"
    plant = load_parameters(PlantParameters, path, "simulator", part=True)
    for experiment in experiments:
        steps_of(experiment.excitation, plant.integration.sample_rate, machine_of(plant))
