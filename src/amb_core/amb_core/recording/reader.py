"""Reads bags: what a bag holds, and its telemetry, excitations, parameters and model as the library's own types.

Topics are found by message type, so that a bag reads whatever namespace it was recorded in.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from amb_core.errors import BagError
from amb_core.loop.experiments import AppliedExcitation, controller_of, last_experiment, select_window
from amb_core.loop.records import LoopRecord, PlantRecord
from amb_core.loop.telemetry import StepCoverage, merge_blocks
from amb_core.recording.messages import (
    ParameterValue,
    block_from_message,
    excitation_frequency_from_message,
    excitation_from_message,
    model_from_message,
    parameters_from_messages,
    plant_record_from_messages,
)
from amb_core.recording.parameter_events import PARAMETER_EVENT
from amb_core.recording.storage import Definition, Storage, open_storage

if TYPE_CHECKING:
    from amb_core.loop.control import ControllerParameters
    from amb_core.model import StateSpaceModel

TELEMETRY = "amb_msgs/msg/LoopSamples"
PLANT_STATE = "amb_msgs/msg/PlantState"
EXCITATION = "amb_msgs/msg/Excitation"
EXCITATION_STATUS = "amb_msgs/msg/ExcitationStatus"
SIMULATOR_STATE = "amb_msgs/msg/SimulatorState"
DELEVITATED = 3  # its mode, see there
MODEL = "amb_msgs/msg/StateSpaceModel"

CONTROLLER_NODE = "pd_controller"


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag and the number of its messages."""

    name: str
    type: str
    messages: int


def read_bag(path: str | Path) -> Bag:
    """Open a bag: a folder, an `.mcap` or a `.db3` file, also one that was cut off while being written.

    The files are read through once, to check and count; messages are decoded when asked for.

    Raises
    ------
    BagError
        If there is no bag, or if not one message of a damaged one can be read.
    """
    return Bag(Path(path))


class Bag:
    """A bag opened for reading.

    Attributes
    ----------
    path : Path
        Its folder or file.
    topics : list of TopicInfo
        What it holds, by name.
    duration : float
        Time from its first to its last message (s).
    truncated : str
        Why it does not read to its end, empty for a whole bag. What comes before the damage is read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._storage: Storage = open_storage(path)
        self._decoder = _Decoder(path, self._storage.definitions)
        counts: dict[tuple[str, str], int] = {}
        start, end = 2**63 - 1, 0
        for message in self._storage.messages():
            key = (message.topic, message.type)
            counts[key] = counts.get(key, 0) + 1
            start, end = min(start, message.log_time), max(end, message.log_time)
        self.topics = [TopicInfo(name, kind, count) for (name, kind), count in sorted(counts.items())]
        self.duration = (end - start) / 1e9 if counts else 0.0
        self.truncated = self._storage.damage
        if self.truncated and not counts:
            raise BagError(f"bag {path}: no message can be read: {self.truncated}")
        self._telemetry: dict[int, list[LoopRecord]] | None = None

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(topic.messages for topic in self.topics)

    @property
    def runs(self) -> list[int]:
        """Runs with telemetry, in the order in which they were recorded."""
        return list(self._blocks()) if self._topic_of(TELEMETRY) else []

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
        if self._topic_of(TELEMETRY) is None:
            there = ", ".join(topic.name for topic in self.topics) or "none"
            raise BagError(f"bag {self.path}: holds no telemetry ({TELEMETRY}); its topics: {there}")
        blocks = self._blocks()
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
        blocks = self._blocks()
        for block in blocks.get(next(reversed(blocks), 0) if run is None else run, []):
            coverage.add(block.first_step, block.steps)
        return coverage.spans

    def plant_states(self, run: int | None = None) -> PlantRecord:
        """The inside of the plant during a run (by default the last recorded), at the steps that were published.

        Raises
        ------
        BagError
            If there are none: the simulator publishes them only with its parameter `plant_state_steps`.
        """
        states = list(self._decoded(PLANT_STATE))
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
            return self.telemetry()  # which says what is there instead
        run = self.runs[-1]
        blocks = self._blocks()[run]
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
        answers = (excitation_from_message(message) for message in self._decoded(EXCITATION_STATUS))
        return [answer for answer in answers if answer.run == run]

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
            NaN where nothing was excited, by a signal without an instantaneous frequency, or from a definition that
            this version of the library does not know.
        """
        known = {(int(item.run), int(item.id)): item for item in self._decoded(EXCITATION)}
        frequency = np.full(max(stop, 0), np.nan)
        for answer in self.excitations(run):
            if answer.accepted:  # also of a stop: an excitation ends where the next one begins
                frequency[answer.first_step :] = np.nan
                excitation = known.get((answer.run, answer.id))
                part = np.zeros(0) if excitation is None else excitation_frequency_from_message(excitation)
                part = part[: max(len(frequency) - answer.first_step, 0)]
                frequency[answer.first_step : answer.first_step + len(part)] = part
        return frequency[first_step:]

    def delevitation(self, run: int | None = None) -> int | None:
        """Step before which the simulator ended a run (by default the last one) since the rotor delevitated, or None.

        A simulation that goes on after contact, and a real bearing, have none.
        """
        if run is None and not self.runs:
            return None
        run = self.runs[-1] if run is None else run
        for message in self._decoded(SIMULATOR_STATE):
            if message.run == run and message.mode == DELEVITATED:
                return int(message.step)
        return None

    def parameters(self) -> dict[str, dict[str, ParameterValue]]:
        """The last known parameters of each node, by full node name and parameter name."""
        nodes: dict[str, dict[str, ParameterValue]] = {}
        for event in self._decoded(PARAMETER_EVENT):
            values = nodes.setdefault(event.node, {})
            values.update(parameters_from_messages([*event.new_parameters, *event.changed_parameters]))
            for parameter in event.deleted_parameters:
                values.pop(parameter.name, None)
        return nodes

    def model(self) -> StateSpaceModel | None:
        """The last model that was identified while recording, None when there is none."""
        last = None
        for message in self._decoded(MODEL):
            last = message
        return None if last is None else model_from_message(last)

    def messages_of(self, topic: str) -> Iterator[Any]:
        """The messages of a topic, decoded, as they were recorded.

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

    def controller_parameters(self) -> ControllerParameters | None:
        """Parameters of the recorded controller (a node named pd_controller), None when they were not recorded."""
        for node, values in self.parameters().items():
            if node.rsplit("/", 1)[-1] == CONTROLLER_NODE:
                return controller_of(values)
        return None

    def _blocks(self) -> dict[int, list[LoopRecord]]:
        """Telemetry blocks by run, the run recorded last at the end."""
        if self._telemetry is None:
            blocks: dict[int, list[LoopRecord]] = {}
            for message in self._decoded(TELEMETRY):
                run = int(message.run)
                if run in blocks and run != next(reversed(blocks)):
                    blocks[run] = blocks.pop(run)
                blocks.setdefault(run, []).append(block_from_message(message))
            self._telemetry = blocks
        return self._telemetry

    def _topic_of(self, message_type: str) -> str | None:
        """Name of the topic of a type, None when there is none."""
        names = [topic.name for topic in self.topics if topic.type == message_type]
        if len(names) > 1 and message_type != PARAMETER_EVENT:
            raise BagError(f"bag {self.path}: {message_type} is on more than one topic: {', '.join(names)}")
        return names[0] if names else None

    def _decoded(self, message_type: str) -> Iterator[Any]:
        """Messages of a type, decoded."""
        if self._topic_of(message_type) is None:
            return
        for message in self._storage.messages():
            if message.type == message_type:
                yield self._decoder.decode(message.type, message.data)


class _Decoder:
    """Decodes CDR by the definitions that the bag brings along."""

    def __init__(self, path: Path, definitions: dict[str, Definition]) -> None:
        self._path = path
        self._definitions = definitions
        self._types = get_typestore(Stores.EMPTY)

    def decode(self, message_type: str, data: bytes) -> Any:
        try:
            if message_type not in self._types.types:
                self._register(message_type)
            return self._types.deserialize_cdr(data, message_type)
        except (TypesysError, SerdeError) as problem:
            raise BagError(f"bag {self._path}: a message of type {message_type} cannot be decoded: {problem}") from None

    def _register(self, message_type: str) -> None:
        if message_type not in self._definitions:
            raise BagError(f"bag {self._path}: lacks the definition of {message_type}; record with Iron or later")
        definition = self._definitions[message_type]
        if definition.encoding == "ros2idl":
            self._types.register(get_types_from_idl(definition.text))
        else:
            self._types.register(get_types_from_msg(definition.text, message_type))
