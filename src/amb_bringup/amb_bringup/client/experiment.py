"""Experiments on a running graph, simulator or rig: levitate, excite, record, land, whatever happens in between.

The demos, `amb experiment` and `AmbClient.experiment` do their experiments here.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from amb_bringup.client.errors import ClientError, EndError, NoAnswerError
from amb_bringup.client.loop_calls import LoopCalls
from amb_core.excitation import Excitation
from amb_core.ground.errors import AmbError
from amb_core.ground.files.parameter_files import BRIDGE_NODE
from amb_core.ground.parameters import SIMULATOR
from amb_core.ground.progress import Progress
from amb_msgs.msg import BridgeState, SimulatorState
from amb_ros import interruptions
from amb_ros.machine import MachineInput

SETTLING = 0.2  # s; the rotor falls to its sag and comes to rest within a few periods of 63 Hz
FEWEST_SETTLING_STEPS = 2_000
RIG_SETTLING = 0.5  # s after levitation, and after each excitation
APPEARANCE = 3.0  # s in which a running graph is found
_ENDED = "the session has come to its end"
"""Note in an error that has left a session, once its end is done."""


def settling_steps(sample_rate: float) -> int:
    """Steps of the simulator from a reset until an excitation begins."""
    return max(FEWEST_SETTLING_STEPS, round(SETTLING * sample_rate))


@dataclass(frozen=True)
class Experiment:
    """An excitation of an experiment.

    Attributes
    ----------
    name : str
        Name of its stage.
    excitation : Excitation
        The excitation.
    """

    name: str
    excitation: Excitation


@dataclass(frozen=True)
class ExperimentRun:
    """An experiment that was carried out.

    Attributes
    ----------
    name : str
        Of the experiment.
    run, first_step, steps : int
        Run, first step of the excitation and its number of steps.
    wall : float
        Wall-clock time of all steps (s).
    """

    name: str
    run: int
    first_step: int
    steps: int
    wall: float

    @property
    def end(self) -> int:
        """The step after the last of the excitation."""
        return self.first_step + self.steps


class Stand(ABC):
    """Where experiments take place: levitates before the first, lands after the last.

    Attributes
    ----------
    unlanded : str
        What an error says whose cause `{}` has kept it from landing.
    """

    unlanded: ClassVar[str]

    def __init__(self, amb: LoopCalls, progress: Progress) -> None:
        self._amb = amb
        self._progress = progress
        self._machine: MachineInput | None = None

    @abstractmethod
    def prepare(self) -> None:
        """What comes before the recording begins."""

    @abstractmethod
    def levitate(self) -> None:
        """Levitate the rotor."""

    @abstractmethod
    def excite(self, experiment: Experiment) -> ExperimentRun:
        """Carry out an experiment, to its end; AmbError if the rotor falls or the target trips."""

    @abstractmethod
    def land(self) -> tuple[int, int]:
        """Bring the rotor to rest. Returns run and step that telemetry has reached."""

    def sample_rate(self) -> float:
        """Sample rate of the machine (Hz)."""
        found = self._machine = self._machine or MachineInput(self._amb.node)
        self._amb.wait_until(lambda: found.machine is not None, complaint="the axes and the sample rate are not known")
        assert found.machine is not None
        return found.machine.sample_rate

    def close_recording(self, run: int, step: int) -> None:
        """Close the bag once it has everything up to a step; ClientError, with what is missing, if that does not come.

        A recorder that answers has closed it, so only one that does not is asked again.
        """
        try:
            self._amb.stop_recording(run, step)
        except NoAnswerError as silence:
            try:
                self._amb.stop_recording()
            except ClientError as problem:
                raise ClientError(f"{silence}; then: {problem}") from None


class SimulatorStand(Stand):
    """The simulator: every experiment is a run of its own from a reset, after the rotor has settled."""

    unlanded = "the simulation is not paused: {}"

    def prepare(self) -> None:
        """Nothing: a run begins with its reset."""

    def levitate(self) -> None:
        """Nothing: the controller holds the rotor from the first step onwards."""

    def excite(self, experiment: Experiment) -> ExperimentRun:
        """Reset, excite after settling, run to the end."""
        name, excitation = experiment.name, experiment.excitation
        first_step = settling_steps(self.sample_rate())
        run = self._amb.reset()
        started = self._amb.start_excitation(excitation.kind, first_step=first_step, **excitation.model_dump())
        steps = started.first_step + started.steps
        self._progress(name, 0, steps)
        began = time.monotonic()
        end = self._amb.run(steps, lambda step: self._progress(name, step, steps))
        wall = time.monotonic() - began
        if end.delevitated:
            raise AmbError(f"{name}: the rotor delevitated before step {end.step}")
        return ExperimentRun(name, run, started.first_step, started.steps, wall)

    def land(self) -> tuple[int, int]:
        """Pause, where an experiment was interrupted."""
        state = self._amb.simulator_state
        if state is None:
            return 0, 0
        step = int(self._amb.pause()) if state.mode != SimulatorState.DELEVITATED else int(state.step)
        return int(state.run), step


class RigStand(Stand):
    """The rig behind a hardware bridge: one run from levitation to landing."""

    unlanded = "not landed: {}; look at the rig"

    def prepare(self) -> None:
        """Connect to the target, unless that is done; ClientError if another host levitates the rotor."""
        rig = self._amb.rig
        if rig.life_cycle() == "unconfigured":
            self._progress("connect", 0, 1)
            rig.connect()
            self._progress("connect", 1, 1)
        if rig.is_up():
            return
        self._amb.wait_until(
            lambda: rig.wait_for_state().mode != BridgeState.UNREACHABLE, complaint="the target does not answer"
        )
        if rig.wait_for_state().mode in (BridgeState.LEVITATING, BridgeState.LEVITATED):
            raise ClientError(
                "the rotor is levitated already, by another host or an earlier bridge; land it first, or take it over "
                "with amb rig levitate"
            )

    def levitate(self) -> None:
        """Levitate, unless the rotor is up."""
        if self._amb.rig.life_cycle() != "active":
            self._progress("levitate", 0, 1)
            self._amb.rig.levitate()
            self._progress("levitate", 1, 1)

    def excite(self, experiment: Experiment) -> ExperimentRun:
        """Excite once the rotor is at rest, and wait until it is at rest again."""
        rig, name, excitation = self._amb.rig, experiment.name, experiment.excitation
        rest = round(RIG_SETTLING * self.sample_rate())
        rig.wait_for_step(int(rig.wait_for_state().step) + rest)
        began = time.monotonic()
        started = self._amb.start_excitation(excitation.kind, **excitation.model_dump())
        first, steps = started.first_step, started.steps
        self._progress(name, 0, steps)
        rig.wait_for_step(
            first + steps + rest, lambda step: self._progress(name, min(max(step - first, 0), steps), steps)
        )
        self._progress(name, steps, steps)
        return ExperimentRun(name, started.run, first, steps, time.monotonic() - began)

    def land(self) -> tuple[int, int]:
        """Land a levitated rotor, and call off a levitation that waits; see `Rig.bring_down`."""
        state = self._amb.rig.wait_for_state()
        run = int(state.run)
        self._progress("land", 0, 1)
        self._amb.rig.bring_down()
        self._progress("land", 1, 1)
        return run, int(self._amb.rig.wait_for_state().step)


def running_stand(amb: LoopCalls, progress: Progress, patience: float | None = None) -> Stand:
    """The stand of the graph that a client is in; ClientError if none runs."""
    nodes: list[str] = []

    def look() -> bool:
        names = amb.node_names()
        nodes[:] = [name for name in (BRIDGE_NODE, SIMULATOR) if name in names]
        return bool(nodes)

    amb.wait_until(look, patience, f"no graph runs: neither {SIMULATOR} nor {BRIDGE_NODE} appeared; amb up starts one")
    return RigStand(amb, progress) if nodes[0] == BRIDGE_NODE else SimulatorStand(amb, progress)


def graph_runs(amb: LoopCalls) -> bool:
    """Whether a graph runs in the domain and the namespace of a client."""
    try:
        running_stand(amb, lambda *_: None, APPEARANCE)
    except ClientError:
        return False
    return True


@contextmanager
def landing(stand: Stand, recorded: bool) -> Iterator[None]:
    """Land at the end and close the recording, also after an error or Ctrl-C.

    A second Ctrl-C waits until that is done: a rotor is never left levitated by a session that has ended.

    Raises
    ------
    EndError
        If the rotor cannot be landed or the recording not closed, with the error before, if there was one.
    """
    try:
        yield
    except BaseException as problem:
        try:
            _end(stand, recorded)
        except EndError as second:
            raise EndError(f"{str(problem) or 'interrupted'}; then, at the end: {second}") from problem
        problem.add_note(_ENDED)
        raise
    _end(stand, recorded)


def has_ended(problem: BaseException) -> bool:
    """Whether the session that an error left, or one that led to it, has landed the rotor and closed the recording."""
    before = problem.__context__
    return _ENDED in getattr(problem, "__notes__", ()) or (before is not None and has_ended(before))


def _end(stand: Stand, recorded: bool) -> None:
    """Land, and close the recording in every case; EndError with all that is left to do."""
    left: list[str] = []
    reached = 0, 0  # whatever the recorder has, if the landing fails
    try:
        with interruptions.held_back() as interrupted:
            try:
                reached = stand.land()
            except ClientError as problem:
                left.append(stand.unlanded.format(problem))
            finally:
                if recorded:
                    left += _close(stand, *reached)
            if left:
                interrupted.clear()  # Ctrl-C must not hide what is left to do
                raise EndError("; ".join(left))
    except KeyboardInterrupt as later:  # came meanwhile
        later.add_note(_ENDED)
        raise


def _close(stand: Stand, run: int, step: int) -> list[str]:
    """Close the recording. Returns why that failed, if it did."""
    try:
        stand.close_recording(run, step)
    except ClientError as problem:
        return [f"the recording is not closed: {problem}"]
    return []


def carry_out(
    amb: LoopCalls, experiments: Sequence[Experiment], bag: str | Path | None, progress: Progress
) -> list[ExperimentRun]:
    """Carry out experiments, one after the other, on the graph of a client.

    Parameters
    ----------
    amb : LoopCalls
        In the graph.
    experiments : sequence of Experiment
        At least one.
    bag : str or Path, optional
        New folder in which everything is recorded.
    progress : callable
        See `amb_core.ground.progress.Progress`.

    Raises
    ------
    AmbError
        If a node fails, the rotor falls, or the target trips; the rotor is landed and the bag closed before.
    EndError
        If that fails, too: the text says what is left to do.
    """
    if not experiments:
        raise ClientError("there is no experiment to carry out; allowed: one or more")
    stand = running_stand(amb, progress)
    stand.prepare()
    if bag is not None:
        amb.start_recording(bag)
    with landing(stand, bag is not None):
        stand.levitate()
        return [stand.excite(experiment) for experiment in experiments]
