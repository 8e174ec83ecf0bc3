"""A recording: the content of a bag as the library's own types; its runs, and what its nodes had and published."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_core.ground.errors import BagError
from amb_core.ground.files.parameter_files import BRIDGE_NODE
from amb_core.ground.given_values import path_of
from amb_core.ground.parameters import part_of
from amb_core.loop.experiments import controller_of, controller_of_bridge, linear_controller_of
from amb_core.loop.records import sample_rate_of
from amb_core.recording.content import DESCRIBING, BagContent
from amb_core.recording.messages.parameters import ParameterValue
from amb_core.recording.messages.state_space_model import model_from_message
from amb_core.recording.recorded_runs import RecordedRuns
from amb_core.recording.run_ends import RunEnds

if TYPE_CHECKING:
    from amb_core.linear.model import StateSpaceModel
    from amb_core.loop.known_controller import KnownController
    from amb_core.loop.pd_parameters import ControllerParameters
    from amb_core.plant import PlantParameters
    from amb_core.regions.region_map import RegionMap

CONTROLLER_NODE, LINEAR_CONTROLLER_NODE, SIMULATOR_NODE = "pd_controller", "state_space_controller", "simulator"


class Recording(RecordedRuns):
    """A bag read once: its messages are counted and checked, and those of known types are kept as stored.

    They are converted on request, so a wrong message affects only the data to which it belongs.

    Parameters
    ----------
    content : BagContent
        What was read of the bag.

    Attributes
    ----------
    path : Path
        Its folder or file.
    topics : list of TopicInfo
        Its topics, by name.
    start : int
        Time of its first message (ns since 1970); 0 if it has none.
    duration : float
        Time from its first to its last message (s).
    truncated : str
        Why it cannot be read to its end; empty for a complete bag. Everything before the damage is read.
    clearance : float or None
        Displacement from the centre at which the rotor touches its radial bearings (m), where a user gives it: it
        replaces what was recorded.
    clearance_of_axis : mapping of str to float
        Clearances (m) by axis that a file of data has in place of a recorded machine.
    """

    def __init__(self, content: BagContent) -> None:
        super().__init__(content)
        self.topics = content.topics
        self.start = content.start
        self.duration = content.duration
        self.truncated = content.truncated
        self.clearance: float | None = None
        self.clearance_of_axis: Mapping[str, float] = {}

    @classmethod
    def read(cls, path: str | Path) -> Recording:
        """Read a bag: a folder, an `.mcap` or a `.db3` file, also an incomplete one whose recording was interrupted.

        Parameters
        ----------
        path : str or Path
            Folder or file of the bag.

        Returns
        -------
        Recording
            The recording.

        Raises
        ------
        BagError
            If there is no bag, or if no message of a damaged one can be read.
        """
        return cls(BagContent(path_of("path", path, BagError)))

    @classmethod
    def read_stretch(cls, path: str | Path, run: int | None, first_step: int, stop: int) -> Recording:
        """Read telemetry of a run (None for the last) and what describes it, by the index of an MCAP bag.

        The rest of the bag is not read. Without an index, or where the steps are not found by it, the whole bag is
        read; errors as for `read`.

        Parameters
        ----------
        path : str or Path
            Folder or file of the bag.
        run : int or None
            Number of the run; None for the last one.
        first_step : int
            First step that is needed.
        stop : int
            Step after the last one that is needed.

        Returns
        -------
        Recording
            A recording with at least these steps, if the bag has them.
        """
        stretch = cls(BagContent(path_of("path", path, BagError), (run, first_step, stop)))
        covered = any(start <= first_step and stop <= end for start, end in stretch.spans(run))
        return stretch if covered else cls.read(path)

    @classmethod
    def read_description(cls, path: str | Path, run: int, step: int, run_ends: RunEnds) -> Recording:
        """Read what describes the machine and the nodes of a run, and no more telemetry than a step of it.

        Where the files have an index, no more than this is read.

        Parameters
        ----------
        path : str or Path
            Folder or file of the bag.
        run : int
            Number of the run.
        step : int
            A step that the run has.
        run_ends : RunEnds
            The ends of the runs of the bag.

        Returns
        -------
        Recording
            A recording with machine and parameters.

        Raises
        ------
        BagError
            If there is no bag, or if no message of a damaged one can be read.
        """
        return cls(BagContent(Path(path), (run, step, step + 1), DESCRIBING, run_ends))

    @property
    def content(self) -> BagContent:
        """Where the data come from."""
        return self._content

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(topic.messages for topic in self.topics)

    def parameters(self, run: int | None = None) -> dict[str, dict[str, ParameterValue]]:
        """The parameters of each node at the end of a run, by full node name and parameter name.

        A parameter that was recorded only later has its last known value.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        dict of str to dict of str to ParameterValue
            Values by node and parameter; a copy.
        """
        return self._content.parameters(run)

    def parameters_of(self, name: str, run: int | None = None) -> dict[str, ParameterValue] | None:
        """The parameters of the node of this name in any namespace, None when they were not recorded.

        Parameters
        ----------
        name : str
            Name of the node without its namespace.
        run : int, optional
            Number of the run at whose end the node had them; by default the last one.

        Returns
        -------
        dict of str to ParameterValue or None
            Values by parameter; a copy.
        """
        for node, values in self._content.parameters(run).items():
            if node.rsplit("/", 1)[-1] == name:
                return values
        return None

    def controller_parameters(self, run: int | None = None) -> ControllerParameters | None:
        """Parameters of the recorded controller (a node named pd_controller), None when they were not recorded.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        ControllerParameters or None
            Gains, limit and sample rate.

        Raises
        ------
        ParameterError
            If one is out of its range.
        """
        values = self.parameters_of(CONTROLLER_NODE, run)
        return None if values is None else controller_of(values, self._sample_rate_of(run))

    def controller(self, run: int | None = None) -> KnownController | None:
        """The recorded controller: PD, or a linear one from its topic or, without that, from the file that it named.

        That of a rig is the one that its bridge sent to the target. None if no controller was recorded, or more than
        one, so that which of them ran is not known.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        KnownController or None
            The controller that ran, if it is known.

        Raises
        ------
        ParameterError
            If a recorded parameter is out of its range, or the file that the controller named cannot be read.
        BagError, IdentificationError
            If the recorded controller is not complete.
        """
        recorded = self._controllers(run)
        if len(recorded) != 1:
            return None
        (node, values), *_ = recorded.items()
        if node == CONTROLLER_NODE:
            return self.controller_parameters(run)
        if node == BRIDGE_NODE:
            return controller_of_bridge(values, self._sample_rate_of(run))
        return linear_controller_of(values, self.published_controller(run))

    def current_limit(self, run: int | None = None) -> float | None:
        """Limit of the currents of the recorded controller (A), None if it was not recorded or there were two.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        float or None
            The limit (A).
        """
        recorded = self._controllers(run).values()
        known = [float(str(values["current_limit"])) for values in recorded if "current_limit" in values]
        return known[0] if len(known) == 1 else None

    def _controllers(self, run: int | None) -> dict[str, dict[str, ParameterValue]]:
        """Parameters of each recorded node that closes the loop."""
        nodes = {name: self.parameters_of(name, run) for name in (CONTROLLER_NODE, LINEAR_CONTROLLER_NODE, BRIDGE_NODE)}
        return {name: values for name, values in nodes.items() if values is not None}

    def _sample_rate_of(self, run: int | None) -> float | None:
        """Controller sample rate of a run (Hz), None without telemetry."""
        runs = self._content.blocks
        blocks = runs.get(next(reversed(runs), 0) if run is None else run)
        return sample_rate_of(blocks[0].sample_time) if blocks else None

    def published_controller(self, run: int | None = None) -> StateSpaceModel | None:
        """The linear controller of a run on the topic `controller`, None when there is none.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        StateSpaceModel or None
            The controller as a state-space model.
        """
        controller = self._content.controller(run)
        return None if controller is None else model_from_message(controller)

    def plant_parameters(self, run: int | None = None) -> PlantParameters | None:
        """Parameters of the simulated plant (a node named simulator), None if there are none, as for a real bearing.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        PlantParameters or None
            Parameters of the plant.

        Raises
        ------
        ParameterError
            If one is out of its range.
        """
        values = self.parameters_of(SIMULATOR_NODE, run)
        if values is None:
            return None
        from amb_core.plant import PlantParameters  # loads a compiler

        return part_of(PlantParameters, values)

    def model(self) -> StateSpaceModel | None:
        """The last model that was identified while recording, None when there is none.

        Returns
        -------
        StateSpaceModel or None
            The model.
        """
        return model_from_message(self._content.models[-1]) if self._content.models else None

    def region_map(self) -> RegionMap | None:
        """The last region map that was built while recording, None when there is none.

        Returns
        -------
        RegionMap or None
            The map.
        """
        if not self._content.region_maps:
            return None
        from amb_core.recording.messages.region_map import region_map_from_message  # loads a compiler

        return region_map_from_message(self._content.region_maps[-1])

    def messages_of(self, topic: str) -> Iterator[Any]:
        """The messages of a topic, decoded, as they were recorded; reads the files again.

        Parameters
        ----------
        topic : str
            Full name of the topic.

        Returns
        -------
        iterator of object
            The messages.

        Raises
        ------
        BagError
            If there is no such topic, or a message cannot be decoded.
        """
        return self._content.messages_of(topic)

    def timed_messages_of(self, topic: str) -> Iterator[tuple[int, Any]]:
        """As `messages_of`, each with the time at which it was recorded (ns since 1970).

        Parameters
        ----------
        topic : str
            Full name of the topic.

        Returns
        -------
        iterator of (int, object)
            Times and messages.
        """
        return self._content.timed_messages_of(topic)
