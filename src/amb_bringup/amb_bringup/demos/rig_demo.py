"""The first session with a rig, on an emulated target: map check, levitate, sweep in A, identify, land, report.

Everything goes the way that it goes with hardware: the C target behind UDP in real time, the bridge, the nodes.
"""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from amb_bringup.client import AmbClient
from amb_bringup.client.experiment import Experiment, ExperimentRun, RigStand, landing
from amb_bringup.demos.demo_run import controller_of, plant_of, remove_results
from amb_bringup.graph.own_graph import own_graph
from amb_core.designs.excitation.beyond_a import highest_load
from amb_core.excitation import Excitation, Multisine, Sweep, generate
from amb_core.ground.errors import AmbError, ExcitationError
from amb_core.ground.files.parameter_files import RIG_NODES, ParameterFile, full_name
from amb_core.ground.progress import Progress
from amb_core.identification.response_error import response_error
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.plant import Plant, linearize
from amb_core.recording import Recording
from amb_core.regions import Region
from amb_core.regions.region_map import MapSettings, build_map
from amb_core.report.pages import write_report
from amb_core.report.pages.recording import recording_report
from amb_core.rig import machine_experiment
from amb_msgs.msg import RegionState
from amb_ros import topics
from amb_ros.qos import HISTORY
from amb_ros.subscriptions import create_subscription

SWEEP_AMPLITUDE = 4e-6  # m: well inside region A of the bearings of this project
PATIENT = {"plant_waits": True, "limits.missed_share": 1.0, "ideal": True}  # a busy computer, regions without noise
SWEEP_BAND = 5.0, 200.0  # Hz
SWEEP_DURATION = 10.0  # s: what an emulated target has room for with four axes
MAP = MapSettings(amplitude_low=2e-6, amplitude_high=50e-6, duration=5.0, initial_sweeps=4, max_sweeps=4)
"""Coarse: enough to see that the excitations stay far below its boundaries."""
LOUDER = 2.0  # amplitude of the multisine over that of a simulated experiment
PERIODS = 4
FILES = ("model.json", "report.html", "summary.json")


@dataclass(frozen=True)
class RigDemoSummary:
    """Results of the session; `summary.json`.

    Fits are closed-loop NRMSE fits by axis in percent, `frf_error_percent` is the largest relative error of the model's
    frequency response against the linearised plant of the emulator, 5 to 1000 Hz. Samples lost and doubled are those
    of telemetry, missed control steps those of the emulated target. `region` is the highest region of the session,
    `load` the highest load of its excitations on a coarse region map, 1 where region A may end.
    """

    axes: list[str]
    seconds: float
    run: int
    steps: int
    lost: int
    doubled: int
    missed: int
    trips: list[str]
    region: str
    load: float
    order: int
    fit: dict[str, float]
    unstable_poles: int
    frf_error_percent: float
    frf_worst: str
    bag: str
    report: str


def run_rig_demo(
    folder: Path, parameter_file: Path, domain_id: int, progress: Progress, clear: bool = False
) -> RigDemoSummary:
    """Run the session and write bag, model.json, report.html and summary.json to a folder.

    Parameters
    ----------
    folder : Path
        Must be empty or not exist, without `clear`.
    parameter_file : Path
        Parameters of all nodes: its simulator and controller are what the target emulates.
    domain_id : int
        DDS domain in which the graph is started.
    progress : callable
        See `amb_core.ground.progress.Progress`.
    clear : bool, optional
        Whether the results of an earlier session in the folder are removed, once the graph runs.

    Raises
    ------
    AmbError
        If a node fails, the target trips, or the rotor leaves region A.
    """
    began = time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    plant, controller = plant_of(parameter_file), controller_of(parameter_file)
    excitations: tuple[Excitation, ...] = (_sweep(), _multisine(plant))
    load = _load_on_a_map(excitations, plant, controller, progress)
    arguments = {"params": str(_unhurried(parameter_file, folder)), "emulator": "true"}
    with own_graph("rig", arguments, domain_id, RIG_NODES) as (graph, amb):
        if clear:
            remove_results(folder, FILES)
        highest, stand = HighestRegion(amb), RigStand(amb, progress)
        stand.prepare()
        bag = amb.start_recording(folder / "bag")
        with landing(stand, recorded=True):
            stand.levitate()
            for excitation in excitations:
                done = stand.excite(Experiment(excitation.kind, excitation))
                highest.require_a(done)
            model = _identified(amb, plant, progress)
        state = amb.rig.wait_for_state()
        graph.check()
    model.save(folder / "model.json")
    error = response_error(model, linearize(plant, controller).discrete)
    summary = RigDemoSummary(
        axes=list(plant.machine.axis_names),
        seconds=0.0,
        run=done.run,
        steps=int(state.step),
        lost=int(state.lost),
        doubled=int(state.doubled),
        missed=int(state.missed),
        trips=[str(trip.text) for trip in amb.rig.trips],
        region=highest.region.name,
        load=load,
        order=model.order,
        fit=dict(zip(plant.machine.axis_names, _fit(model), strict=True)),
        unstable_poles=len(model.unstable_poles()),
        frf_error_percent=100.0 * error.largest,
        frf_worst=error.worst,
        bag=str(bag),
        report=str(_report(folder, model.order, progress)),
    )
    summary = replace(summary, seconds=time.monotonic() - began)
    (folder / "summary.json").write_text(json.dumps(asdict(summary), indent=2) + "\n")
    return summary


def _identified(amb: AmbClient, plant: Plant, progress: Progress) -> StateSpaceModel:
    """The model from the telemetry of the last run."""
    return amb.identify(
        order=machine_experiment.model_order(plant.parameters),
        focus="simulation",
        progress=lambda now: progress(f"identification, {now.stage}", now.done, now.total),
    )


def _load_on_a_map(
    excitations: tuple[Excitation, ...], plant: Plant, controller: ControllerParameters, progress: Progress
) -> float:
    """The highest load of the excitations on a coarse region map of the machine.

    Raises
    ------
    ExcitationError
        If one may leave region A.
    """
    region_map = build_map(
        MAP,
        plant.parameters,
        controller,
        progress=lambda now: progress("region map", now.done, now.total),
    )
    rate = plant.machine.sample_rate
    loads = [highest_load(generate(item, rate, plant.machine), region_map, controller) for item in excitations]
    for excitation, load in zip(excitations, loads, strict=True):
        if load.load >= 1.0:
            raise ExcitationError(f"the {excitation.kind} may leave region A on {load.axis}: load {load.load:.2f}")
    return max(load.load for load in loads)


def _unhurried(parameter_file: Path, folder: Path) -> Path:
    """The parameters with an emulator that may share its computer with this session, where they do not say more."""
    file = ParameterFile(parameter_file)
    values = {**PATIENT, **file.values(full_name("target_emulator"))}
    path = folder / "parameters.yaml"
    path.write_text(file.with_values({"target_emulator": values}))
    return path


class HighestRegion:
    """The highest region that the monitor has reported, over all runs since this object was made."""

    def __init__(self, amb: AmbClient) -> None:
        self._seen: list[int] = []
        self._processed = 0, 0  # run, and the step before which the monitor has processed its telemetry
        self._amb = amb
        create_subscription(amb.node, RegionState, topics.REGION, self._note, HISTORY)

    def _note(self, message: RegionState) -> None:
        self._seen.append(message.region)
        self._processed = message.run, message.next_step

    def require_a(self, done: ExperimentRun) -> None:
        """Raise AmbError if the rotor left region A before the end of an experiment, or nobody looked until then."""

        def processed() -> bool:
            run, step = self._processed
            return run == done.run and step >= done.end

        self._amb.wait_until(
            processed, complaint=f"{done.name}: no region up to step {done.end} received; is region_monitor running?"
        )
        if self.region > Region.A:
            reached = self.region.name
            raise AmbError(f"the rotor left region A during the {done.name}: region {reached}; lower the amplitude")

    @property
    def region(self) -> Region:
        """Region A before the first message."""
        return Region(max(self._seen, default=Region.A))


def _sweep() -> Sweep:
    low, high = SWEEP_BAND
    return Sweep(
        amplitude=SWEEP_AMPLITUDE, duration=SWEEP_DURATION, axes="in_turn", frequency_start=low, frequency_end=high
    )


def _multisine(plant: Plant) -> Multisine:
    """As of the demo of machines, larger and longer: a rig has noise."""
    end = machine_experiment.band_end(plant.parameters)
    return machine_experiment.multisine(plant.machine, end, LOUDER * machine_experiment.amplitude(end), periods=PERIODS)


def _fit(model: StateSpaceModel) -> list[float]:
    return [float(value) for value in model.fit]


def _report(folder: Path, order: int, progress: Progress) -> Path:
    path = folder / "report.html"
    recording = Recording.read(folder / "bag")
    write_report(
        recording_report(recording, None, order, lambda stage, _done, _total: progress(f"report, {stage}", 0, 1)), path
    )
    return path
