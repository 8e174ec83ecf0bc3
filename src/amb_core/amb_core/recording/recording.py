"""A recording: the content of a bag, read in one pass, as the library's own types.

Topics are found by message type, so a bag from any namespace can be read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import BagError
from amb_core.loop.experiments import (
    AppliedExcitation,
    controller_of,
    last_experiment,
    linear_controller_of,
    select_window,
)
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord, PlantRecord, sample_rate_of
from amb_core.loop.telemetry import StepCoverage, merge_blocks
from amb_core.parameters import part_of
from amb_core.recording.decoder import Decoder
from amb_core.recording.messages.excitation import EXCITATION, frequency_from_message
from amb_core.recording.messages.excitation_status import EXCITATION_STATUS, answer_from_message
from amb_core.recording.messages.loop_samples import LOOP_SAMPLES, block_from_message
from amb_core.recording.messages.machine import MACHINE, machine_from_message
from amb_core.recording.messages.parameters import PARAMETER_EVENT, ParameterValue, parameters_from_messages
from amb_core.recording.messages.plant_state import PLANT_STATE, plant_record_from_messages
from amb_core.recording.messages.state_space_model import STATE_SPACE_MODEL, model_from_message
from amb_core.recording.storage import Storage, open_storage

if TYPE_CHECKING:
    from amb_core.loop.control import ControllerParameters
    from amb_core.loop.known_controller import KnownController
    from amb_core.model import StateSpaceModel
    from amb_core.plant import PlantParameters
    from amb_core.regions import RegionState
    from amb_core.regions.region_map import RegionMap

T = TypeVar("T")

SIMULATOR_STATE = "amb_msgs/msg/SimulatorState"
DELEVITATED = 3  # mode in this message, see its definition
REGION_STATE = "amb_msgs/msg/RegionState"
REGION_MAP = "amb_msgs/msg/RegionMap"
KEPT = (
    LOOP_SAMPLES,
    MACHINE,
    PLANT_STATE,
    EXCITATION,
    EXCITATION_STATUS,
    SIMULATOR_STATE,
    STATE_SPACE_MODEL,
    REGION_STATE,
    REGION_MAP,
    PARAMETER_EVENT,
)
"""Message types that the library reads, except those of single samples, since there are too many of these."""

CONTROLLER_NODE, LINEAR_CONTROLLER_NODE, SIMULATOR_NODE = "pd_controller", "state_space_controller", "simulator"
CONTROLLER = "controller"
"""Last part of the name of the topic with linear controllers, whose message type is that of identified models."""


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag and the number of its messages."""

    name: str
    type: str
    messages: int


class Recording:
    """A bag read once: its messages are counted and checked, and those of known types are kept as stored.

    They are converted on request, so a wrong message affects only the data to which it belongs.

    Attributes
    ----------
    path : Path
        Its folder or file.
    topics : list of TopicInfo
        Its topics, by name.
    duration : float
        Time from its first to its last message (s).
    truncated : str
        Why it cannot be read to its end; empty for a complete bag. Everything before the damage is read.
    """

    def __init__(self, path: Path, storage: Storage) -> None:
        self.path = path
        self._storage = storage
        self._decoder = Decoder(path, storage.definitions)
        self._stored: dict[str, list[bytes]] = {}
        counts: dict[tuple[str, str], int] = {}
        start, end = 2**63 - 1, 0
        for message in storage.messages():
            key = (message.topic, message.type)
            counts[key] = counts.get(key, 0) + 1
            start, end = min(start, message.log_time), max(end, message.log_time)
            if message.type in KEPT:
                self._stored.setdefault(_kind(*key), []).append(message.data)
        self.topics = [TopicInfo(name, kind, count) for (name, kind), count in sorted(counts.items())]
        self.duration = (end - start) / 1e9 if counts else 0.0
        self.truncated = storage.damage
        if self.truncated and not counts:
            raise BagError(f"bag {path}: no message can be read: {self.truncated}")

    @classmethod
    def read(cls, path: str | Path) -> Recording:
        """Read a bag: a folder, an `.mcap` or a `.db3` file, also an incomplete one whose recording was interrupted.

        Raises
        ------
        BagError
            If there is no bag, or if no message of a damaged one can be read.
        """
        return cls(Path(path), open_storage(Path(path)))

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(topic.messages for topic in self.topics)

    @property
    def runs(self) -> list[int]:
        """Runs with telemetry, in the order in which they were recorded."""
        return list(self._blocks)

    def telemetry(self, run: int | None = None, first_step: int | None = None, stop: int | None = None) -> LoopRecord:
        """The loop samples of a run.

        Parameters
        ----------
        run : int, optional
            The run; by default the last one.
        first_step, stop : int, optional
            The steps wanted, `stop` not included; by default all.

        Raises
        ------
        BagError
            If there is no telemetry, no such run, or if steps are missing.
        """
        if self._topic_of(LOOP_SAMPLES) is None:
            there = ", ".join(topic.name for topic in self.topics) or "none"
            raise BagError(f"bag {self.path}: holds no telemetry ({LOOP_SAMPLES}); its topics: {there}")
        blocks = self._blocks
        run = self.runs[-1] if run is None else run
        if run not in blocks:
            raise BagError(f"bag {self.path}: holds no run {run}; its runs: {', '.join(map(str, blocks))}")
        try:
            return merge_blocks(blocks[run], first_step, stop)
        except BagError as problem:
            raise BagError(f"bag {self.path}, run {run}: {problem}") from None

    def spans(self, run: int | None = None) -> list[tuple[int, int]]:
        """Spans (first step, step after the last) for which there is telemetry of a run, by default the last one."""
        coverage = StepCoverage()
        blocks = self._blocks
        for block in blocks.get(next(reversed(blocks), 0) if run is None else run, []):
            coverage.add(block.first_step, block.steps)
        return coverage.spans

    def plant_states(self, run: int | None = None) -> PlantRecord:
        """Internal states of the plant during a run (by default the last recorded), at the published steps.

        Raises
        ------
        BagError
            If there are none: the simulator publishes them only with its parameter `plant_state_steps`.
        """
        states = self._plant_states
        if run is not None:
            states = [message for message in states if message.run == run]
        if not states:
            where = "" if run is None else f" of run {run}"
            raise BagError(
                f"bag {self.path}: holds no states of the plant ({PLANT_STATE}){where}; the simulator publishes them "
                "if its parameter plant_state_steps is not 0"
            )
        return plant_record_from_messages([message for message in states if message.run == states[-1].run])

    def experiment(self, first_step: int = -1, steps: int = 0) -> LoopRecord:
        """The samples of the last experiment of the last run, or of other steps of it, as `select_window` chooses them.

        Raises
        ------
        BagError, IdentificationError
            If there are no such samples.
        """
        if not self.runs:
            return self.telemetry()  # its error lists what is available
        run = self.runs[-1]
        blocks = self._blocks[run]
        available = (
            min(block.first_step for block in blocks),
            max(block.first_step + block.steps for block in blocks),
        )
        window = select_window(available, last_experiment(self.excitations(run), run), first_step, steps)
        return self.telemetry(run, *window)

    def excitations(self, run: int | None = None) -> list[AppliedExcitation]:
        """The excitations of a run (by default the last with telemetry) as the controller answered them, in order."""
        if run is None and not self.runs:
            return []
        run = self.runs[-1] if run is None else run
        return [answer for answer in self._answers if answer.run == run]

    def input_frequency(self, first_step: int, stop: int, run: int | None = None) -> NDArray[np.float64]:
        """Instantaneous input frequency at the steps of a run (by default the last with telemetry), as excited (Hz).

        Parameters
        ----------
        first_step, stop : int
            The steps wanted, `stop` not included.
        run : int, optional
            The run.

        Returns
        -------
        ndarray, shape (stop - first_step,)
            NaN where there was no excitation, for a signal without an instantaneous frequency, or for a definition that
            this version of the library does not know.
        """
        known = {(int(item.run), int(item.id)): item for item in self._excitations}
        machine = self.machine()
        frequency = np.full(max(stop, 0), np.nan)
        for answer in self.excitations(run):
            if answer.accepted:  # also for a stop: an excitation ends where the next one begins
                frequency[answer.first_step :] = np.nan
                excitation = known.get((answer.run, answer.id))
                part = np.zeros(0) if excitation is None else frequency_from_message(excitation, machine)
                part = part[: max(len(frequency) - answer.first_step, 0)]
                frequency[answer.first_step : answer.first_step + len(part)] = part
        return frequency[first_step:]

    def delevitation(self, run: int | None = None) -> int | None:
        """Step before which the simulator ended a run (by default the last one) due to delevitation, or None.

        A simulation that continues after contact, and a real bearing, have none.
        """
        if run is None and not self.runs:
            return None
        run = self.runs[-1] if run is None else run
        return self._delevitations.get(run)

    def parameters(self) -> dict[str, dict[str, ParameterValue]]:
        """The last known parameters of each node, by full node name and parameter name."""
        return {node: dict(values) for node, values in self._parameters.items()}

    def parameters_of(self, name: str) -> dict[str, ParameterValue] | None:
        """The last known parameters of the node of this name in any namespace, None when they were not recorded."""
        for node, values in self._parameters.items():
            if node.rsplit("/", 1)[-1] == name:
                return dict(values)
        return None

    def machine(self) -> Machine | None:
        """The machine as it was last published, None when it was not recorded (as by version 0.1)."""
        return self._machines[-1] if self._machines else None

    @property
    def sample_rate(self) -> float:
        """Controller sample rate f_s of the last run (Hz).

        Raises
        ------
        BagError
            If there is no telemetry.
        """
        if not self.runs:
            self.telemetry()  # its error lists what is available
        return sample_rate_of(self._blocks[self.runs[-1]][0].sample_time)

    def controller_parameters(self) -> ControllerParameters | None:
        """Parameters of the recorded controller (a node named pd_controller), None when they were not recorded.

        Raises
        ------
        ParameterError
            If one is out of its range.
        """
        values = self.parameters_of(CONTROLLER_NODE)
        return None if values is None else controller_of(values, self.sample_rate if self.runs else None)

    def controller(self) -> KnownController | None:
        """The recorded controller: PD, or a linear one from its topic or, without that, from the file that it named.

        None if it was not recorded, or if both controller nodes were, so that which of them ran is not known.

        Raises
        ------
        ParameterError
            If a recorded parameter is out of its range, or the file that the controller named cannot be read.
        BagError, IdentificationError
            If the recorded controller is not complete.
        """
        values = self.parameters_of(LINEAR_CONTROLLER_NODE)
        if values is None:
            return self.controller_parameters()
        if self.parameters_of(CONTROLLER_NODE) is not None:
            return None
        return linear_controller_of(values, self.published_controller())

    def current_limit(self) -> float | None:
        """Limit of the currents of the recorded controller (A), None if it was not recorded or there were two."""
        nodes = [self.parameters_of(name) for name in (CONTROLLER_NODE, LINEAR_CONTROLLER_NODE)]
        known = [float(str(values["current_limit"])) for values in nodes if values and "current_limit" in values]
        return known[0] if len(known) == 1 else None

    def published_controller(self) -> StateSpaceModel | None:
        """The last linear controller on the topic `controller`, None when there is none."""
        return model_from_message(self._controllers[-1]) if self._controllers else None

    def plant_parameters(self) -> PlantParameters | None:
        """Parameters of the simulated plant (a node named simulator), None if there are none, as for a real bearing.

        Raises
        ------
        ParameterError
            If one is out of its range.
        """
        values = self.parameters_of(SIMULATOR_NODE)
        if values is None:
            return None
        from amb_core.plant import PlantParameters  # loads a compiler

        return part_of(PlantParameters, values)

    def model(self) -> StateSpaceModel | None:
        """The last model that was identified while recording, None when there is none."""
        return model_from_message(self._models[-1]) if self._models else None

    def regions(self, run: int | None = None) -> list[RegionState]:
        """The states that the region monitor published in a run, by default the last with telemetry, in order."""
        if run is None and not self.runs:
            return []
        run = self.runs[-1] if run is None else run
        return [state for number, state in self._regions if number == run]

    def region_map(self) -> RegionMap | None:
        """The last region map that was built while recording, None when there is none."""
        if not self._region_maps:
            return None
        from amb_core.recording.messages.region_map import region_map_from_message  # loads a compiler

        return region_map_from_message(self._region_maps[-1])

    def messages_of(self, topic: str) -> Iterator[Any]:
        """The messages of a topic, decoded, as they were recorded; reads the files again.

        Raises
        ------
        BagError
            If there is no such topic, or a message cannot be decoded.
        """
        if topic not in [known.name for known in self.topics]:
            there = ", ".join(known.name for known in self.topics) or "none"
            raise BagError(f"bag {self.path}: holds no topic {topic}; its topics: {there}")
        for message in self._storage.messages():
            if message.topic == topic:
                yield self._decoder.decode(message.type, message.data)

    @cached_property
    def _blocks(self) -> dict[int, list[LoopRecord]]:
        """Telemetry blocks by run, the run recorded last at the end."""

        def block_of_run(message: Any) -> tuple[int, LoopRecord]:
            return int(message.run), block_from_message(message)

        blocks: dict[int, list[LoopRecord]] = {}
        for run, block in self._converted(LOOP_SAMPLES, block_of_run):
            if run in blocks and run != next(reversed(blocks)):
                blocks[run] = blocks.pop(run)
            blocks.setdefault(run, []).append(block)
        return blocks

    @cached_property
    def _machines(self) -> list[Machine]:
        return self._converted(MACHINE, machine_from_message)

    @cached_property
    def _plant_states(self) -> list[Any]:
        return self._converted(PLANT_STATE, _unchanged)

    @cached_property
    def _excitations(self) -> list[Any]:
        return self._converted(EXCITATION, _unchanged)

    @cached_property
    def _answers(self) -> list[AppliedExcitation]:
        return self._converted(EXCITATION_STATUS, answer_from_message)

    @cached_property
    def _delevitations(self) -> dict[int, int]:
        """Step before which the rotor delevitated, by run."""
        steps: dict[int, int] = {}
        for message in self._converted(SIMULATOR_STATE, _unchanged):
            if message.mode == DELEVITATED:
                steps.setdefault(int(message.run), int(message.step))
        return steps

    @cached_property
    def _parameters(self) -> dict[str, dict[str, ParameterValue]]:
        nodes: dict[str, dict[str, ParameterValue]] = {}
        for event in self._converted(PARAMETER_EVENT, _unchanged):
            values = nodes.setdefault(event.node, {})
            values.update(parameters_from_messages([*event.new_parameters, *event.changed_parameters]))
            for parameter in event.deleted_parameters:
                values.pop(parameter.name, None)
        return nodes

    @cached_property
    def _models(self) -> list[Any]:
        return self._converted(STATE_SPACE_MODEL, _unchanged)

    @cached_property
    def _controllers(self) -> list[Any]:
        return self._converted(CONTROLLER, _unchanged)

    @cached_property
    def _regions(self) -> list[tuple[int, RegionState]]:
        from amb_core.recording.messages.region_state import region_state_from_message  # loads a compiler

        return self._converted(REGION_STATE, lambda message: (int(message.run), region_state_from_message(message)))

    @cached_property
    def _region_maps(self) -> list[Any]:
        return self._converted(REGION_MAP, _unchanged)

    def _topic_of(self, message_type: str) -> str | None:
        """Name of the topic of a kind of messages, which is their type or `CONTROLLER`; None when there is none."""
        names = [topic.name for topic in self.topics if _kind(topic.name, topic.type) == message_type]
        if len(names) > 1 and message_type != PARAMETER_EVENT:
            raise BagError(f"bag {self.path}: {message_type} is on more than one topic: {', '.join(names)}")
        return names[0] if names else None

    def _converted(self, message_type: str, convert: Callable[[Any], T]) -> list[T]:
        """The messages of a type in order; their stored form is dropped."""
        if self._topic_of(message_type) is None:
            return []
        stored_as = STATE_SPACE_MODEL if message_type == CONTROLLER else message_type
        converted = [convert(self._decoder.decode(stored_as, data)) for data in self._stored[message_type]]
        del self._stored[message_type]
        return converted


def _kind(topic: str, message_type: str) -> str:
    """What the messages of a topic are: their type, or `CONTROLLER`."""
    return CONTROLLER if message_type == STATE_SPACE_MODEL and topic.rsplit("/", 1)[-1] == CONTROLLER else message_type


def _unchanged(message: Any) -> Any:
    return message
