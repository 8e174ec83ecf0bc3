"""The content of a bag: its messages counted and checked in one pass, and converted by type on request.

A child process reads the bag, see `bag_reader`.

Topics are found by message type, so a bag from any namespace can be read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from amb_core.ground.errors import BagError
from amb_core.loop.experiments import AppliedExcitation
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.recording.bag_reader import CONTROLLER, BagApart, kind_of
from amb_core.recording.messages.excitation import EXCITATION
from amb_core.recording.messages.excitation_status import EXCITATION_STATUS, answer_from_message
from amb_core.recording.messages.loop_samples import LOOP_SAMPLES, block_from_message
from amb_core.recording.messages.machine import MACHINE, machine_from_message
from amb_core.recording.messages.parameters import PARAMETER_EVENT, ParameterValue, parameters_from_messages
from amb_core.recording.messages.plant_state import PLANT_STATE
from amb_core.recording.messages.state_space_model import STATE_SPACE_MODEL
from amb_core.recording.run_ends import RunEnds
from amb_core.recording.topic_info import TopicInfo

if TYPE_CHECKING:
    from amb_core.regions import RegionState

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
OF_STRETCH = (LOOP_SAMPLES, MACHINE, EXCITATION, EXCITATION_STATUS, STATE_SPACE_MODEL, PARAMETER_EVENT)
"""Those that data of a stretch of telemetry need."""
DESCRIBING = (MACHINE, PARAMETER_EVENT)
"""Those that describe a machine and its nodes."""


class BagContent:
    """The messages of a bag: those of known types are kept as stored, until they are asked for.

    A wrong message affects only the data to which it belongs.

    Parameters
    ----------
    path : Path
        Folder or file of the bag.
    stretch : (int or None, int, int), optional
        Run (None for the last), first step and step after the last: where the files have an index, only what belongs to
        this telemetry is read.
    kept : sequence of str, optional
        Message types that are kept where there is no index.
    run_ends : RunEnds, optional
        The ends of the runs, where telemetry is not kept; by default from the telemetry that was read.

    Attributes
    ----------
    path : Path
        Folder or file of the bag.
    topics : list of TopicInfo
        Its topics, by name.
    start : int
        Time of its first message (ns since 1970).
    duration : float
        Time from its first to its last message (s).
    truncated : str
        Why it cannot be read to its end; empty for a complete bag.
    """

    def __init__(
        self,
        path: Path,
        stretch: tuple[int | None, int, int] | None = None,
        kept: Sequence[str] = KEPT,
        run_ends: RunEnds | None = None,
    ) -> None:
        self.path = path
        self._given_ends = run_ends
        self._reader = BagApart(path)
        survey = None
        if stretch is not None:
            survey = self._reader.call("survey", OF_STRETCH, [LOOP_SAMPLES, *stretch])
        if survey is None:
            survey = self._reader.call("survey", kept)
        self.topics = [TopicInfo(*topic) for topic in survey["counts"]]
        self.start = survey["start"]
        self.duration = survey["duration"]
        self.truncated = survey["damage"]
        if self.truncated and not self.topics:
            raise BagError(f"bag {path}: no message can be read: {self.truncated}")

    def messages_of(self, topic: str) -> Iterator[Any]:
        """The messages of a topic, decoded, as they were recorded; reads the files again.

        Raises
        ------
        BagError
            If there is no such topic, or a message cannot be decoded.
        """
        for _, message in self.timed_messages_of(topic):
            yield message

    def timed_messages_of(self, topic: str) -> Iterator[tuple[int, Any]]:
        """As `messages_of`, each with the time at which it was recorded (ns since 1970)."""
        if topic not in [known.name for known in self.topics]:
            there = ", ".join(known.name for known in self.topics) or "none"
            raise BagError(f"bag {self.path}: holds no topic {topic}; its topics: {there}")
        for message in BagApart(self.path).messages([topic]):
            yield message.log_time, message.content

    @cached_property
    def blocks(self) -> dict[int, list[LoopRecord]]:
        """Telemetry blocks by run, the run recorded last at the end."""
        blocks: dict[int, list[LoopRecord]] = {}
        for _, (run, block) in self._telemetry:
            if run in blocks and run != next(reversed(blocks)):
                blocks[run] = blocks.pop(run)
            blocks.setdefault(run, []).append(block)
        return blocks

    @cached_property
    def run_ends(self) -> RunEnds:
        """The ends of the runs."""
        if self._given_ends is not None:
            return self._given_ends
        ends = RunEnds()
        for time, (run, _) in self._telemetry:
            ends.add(run, time)
        return ends

    def machine(self, run: int | None = None) -> Machine | None:
        """The machine of a run, by default the last one; None if there is none."""
        return self._latest(self._machines, run)

    def controller(self, run: int | None = None) -> Any:
        """The published linear controller of a run, by default the last one, as a message; None if there is none."""
        return self._latest(self._controllers, run)

    def parameters(self, run: int | None = None) -> dict[str, dict[str, ParameterValue]]:
        """The parameters of each node at the end of a run, by default the last one, by full node name and name.

        Those that were recorded only later have their last value.
        """
        nodes = self._parameters_until(None)
        for node, values in self._parameters_until(self._end_of(run)).items():
            nodes[node] |= values
        return nodes

    @cached_property
    def plant_states(self) -> list[Any]:
        """The states of the plant as messages, in order."""
        return self._converted(PLANT_STATE, _unchanged)

    @cached_property
    def excitations(self) -> list[Any]:
        """The excitations as messages, in order."""
        return self._converted(EXCITATION, _unchanged)

    @cached_property
    def answers(self) -> list[AppliedExcitation]:
        """The controller's answers to excitations, in order."""
        return self._converted(EXCITATION_STATUS, answer_from_message)

    @cached_property
    def delevitations(self) -> dict[int, int]:
        """Step before which the rotor delevitated, by run."""
        steps: dict[int, int] = {}
        for message in self._converted(SIMULATOR_STATE, _unchanged):
            if message.mode == DELEVITATED:
                steps.setdefault(int(message.run), int(message.step))
        return steps

    @cached_property
    def models(self) -> list[Any]:
        """The identified models as messages, in order."""
        return self._converted(STATE_SPACE_MODEL, _unchanged)

    @cached_property
    def regions(self) -> list[tuple[int, RegionState]]:
        """The states of the region monitor and their runs, in order."""
        from amb_core.recording.messages.region_state import region_state_from_message  # loads a compiler

        return self._converted(REGION_STATE, lambda message: (int(message.run), region_state_from_message(message)))

    @cached_property
    def region_maps(self) -> list[Any]:
        """The region maps as messages, in order."""
        return self._converted(REGION_MAP, _unchanged)

    def topic_of(self, message_type: str) -> str | None:
        """Name of the topic of a kind of messages, which is their type or `CONTROLLER`; None when there is none."""
        names = [topic.name for topic in self.topics if kind_of(topic.name, topic.type) == message_type]
        if len(names) > 1 and message_type != PARAMETER_EVENT:
            raise BagError(f"bag {self.path}: {message_type} is on more than one topic: {', '.join(names)}")
        return names[0] if names else None

    @cached_property
    def _telemetry(self) -> list[tuple[int, tuple[int, LoopRecord]]]:
        """Times, and runs with blocks."""
        return self._timed(LOOP_SAMPLES, lambda message: (int(message.run), block_from_message(message)))

    @cached_property
    def _machines(self) -> list[tuple[int, Machine]]:
        return self._timed(MACHINE, machine_from_message)

    @cached_property
    def _controllers(self) -> list[tuple[int, Any]]:
        return self._timed(CONTROLLER, _unchanged)

    @cached_property
    def _parameter_changes(self) -> list[tuple[int, _ParameterChange]]:
        return self._timed(PARAMETER_EVENT, _ParameterChange.from_message)

    def _latest(self, timed: list[tuple[int, T]], run: int | None) -> T | None:
        """The last one at the end of a run, or else the first one after it: a latched message may come late."""
        end = self._end_of(run)
        known = [item for time, item in timed if end is None or time <= end]
        if known:
            return known[-1]
        return timed[0][1] if timed else None

    def _end_of(self, run: int | None) -> int | None:
        """Time (ns since 1970) up to which messages describe a run; None if all do."""
        return None if run is None else self.run_ends.of(run)

    def _parameters_until(self, end: int | None) -> dict[str, dict[str, ParameterValue]]:
        """The parameters of each node at a time (ns since 1970), None for the last ones."""
        nodes: dict[str, dict[str, ParameterValue]] = {}
        for time, change in self._parameter_changes:
            if end is None or time <= end:
                change.apply(nodes.setdefault(change.node, {}))
        return nodes

    def _converted(self, message_type: str, convert: Callable[[Any], T]) -> list[T]:
        """The messages of a type in order; their stored form is dropped."""
        return [item for _, item in self._timed(message_type, convert)]

    def _timed(self, message_type: str, convert: Callable[[Any], T]) -> list[tuple[int, T]]:
        """As `_converted`, each with the time at which it was recorded (ns since 1970)."""
        if self.topic_of(message_type) is None:
            return []
        return [(int(time), convert(message)) for time, message in self._reader.iterate("kept", message_type)]


class _ParameterChange(NamedTuple):
    """A ParameterEvent: values that a node has set, and names of parameters that it has deleted."""

    node: str
    values: dict[str, ParameterValue]
    deleted: list[str]

    @classmethod
    def from_message(cls, event: Any) -> _ParameterChange:
        values = parameters_from_messages([*event.new_parameters, *event.changed_parameters])
        return cls(str(event.node), values, [parameter.name for parameter in event.deleted_parameters])

    def apply(self, parameters: dict[str, ParameterValue]) -> None:
        parameters.update(self.values)
        for name in self.deleted:
            parameters.pop(name, None)


def _unchanged(message: Any) -> Any:
    return message
