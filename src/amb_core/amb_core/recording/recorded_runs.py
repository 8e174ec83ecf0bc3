"""The runs of a recording: samples of the loop, excitations, regions and states of the plant, step by step."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import BagError
from amb_core.loop.experiments import AppliedExcitation, last_experiment, select_window
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord, PlantRecord, sample_rate_of
from amb_core.loop.telemetry import StepCoverage, merge_blocks
from amb_core.recording.content import BagContent
from amb_core.recording.messages.excitation import frequency_from_message
from amb_core.recording.messages.loop_samples import LOOP_SAMPLES
from amb_core.recording.messages.plant_state import PLANT_STATE, plant_record_from_messages

if TYPE_CHECKING:
    from amb_core.regions import RegionState


class RecordedRuns:
    """What happened in each run of a bag.

    Parameters
    ----------
    content : BagContent
        What was read of the bag.

    Attributes
    ----------
    path : Path
        Folder or file of the bag.
    """

    def __init__(self, content: BagContent) -> None:
        self._content = content
        self.path: Path = content.path

    @property
    def runs(self) -> list[int]:
        """Runs with telemetry, in the order in which they were recorded."""
        return list(self._content.blocks)

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
        return sample_rate_of(self._content.blocks[self.runs[-1]][0].sample_time)

    def machine(self, run: int | None = None) -> Machine | None:
        """The machine of a run, None when it was not recorded (as by version 0.1).

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        Machine or None
            Axes, bearings and sample rate.
        """
        return self._content.machine(run)

    def telemetry(self, run: int | None = None, first_step: int | None = None, stop: int | None = None) -> LoopRecord:
        """The loop samples of a run.

        Parameters
        ----------
        run : int, optional
            The run; by default the last one.
        first_step, stop : int, optional
            The steps wanted, `stop` not included; by default all.

        Returns
        -------
        LoopRecord
            References (m), positions (m) and currents (A) of these steps.

        Raises
        ------
        BagError
            If there is no telemetry, no such run, or if steps are missing.
        """
        if self._content.topic_of(LOOP_SAMPLES) is None:
            there = ", ".join(topic.name for topic in self._content.topics) or "none"
            raise BagError(f"bag {self.path}: holds no telemetry ({LOOP_SAMPLES}); its topics: {there}")
        blocks = self._content.blocks
        run = self.runs[-1] if run is None else run
        if run not in blocks:
            raise BagError(f"bag {self.path}: holds no run {run}; its runs: {', '.join(map(str, blocks))}")
        try:
            return merge_blocks(blocks[run], first_step, stop)
        except BagError as problem:
            raise BagError(f"bag {self.path}, run {run}: {problem}") from None

    def spans(self, run: int | None = None) -> list[tuple[int, int]]:
        """Spans (first step, step after the last) for which there is telemetry of a run, by default the last one.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        list of (int, int)
            The spans, ascending.
        """
        coverage = StepCoverage()
        blocks = self._content.blocks
        for block in blocks.get(next(reversed(blocks), 0) if run is None else run, []):
            coverage.add(block.first_step, block.steps)
        return coverage.spans

    def experiment(self, first_step: int = -1, steps: int = 0) -> LoopRecord:
        """The samples of the last experiment of the last run, or of other steps of it, as `select_window` chooses them.

        Parameters
        ----------
        first_step : int, optional
            First step; -1 for that of the last experiment.
        steps : int, optional
            Number of steps; 0 for all up to the end of the experiment.

        Returns
        -------
        LoopRecord
            The samples.

        Raises
        ------
        BagError, IdentificationError
            If there are no such samples.
        """
        if not self.runs:
            return self.telemetry()  # its error lists what is available
        run = self.runs[-1]
        blocks = self._content.blocks[run]
        available = (
            min(block.first_step for block in blocks),
            max(block.first_step + block.steps for block in blocks),
        )
        window = select_window(available, last_experiment(self.excitations(run), run), first_step, steps)
        return self.telemetry(run, *window)

    def excitations(self, run: int | None = None) -> list[AppliedExcitation]:
        """The excitations of a run (by default the last with telemetry) as the controller answered them, in order.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one with telemetry.

        Returns
        -------
        list of AppliedExcitation
            The answers to all requests, refused ones too.
        """
        if run is None and not self.runs:
            return []
        run = self.runs[-1] if run is None else run
        return [answer for answer in self._content.answers if answer.run == run]

    def input_frequency(self, first_step: int, stop: int, run: int | None = None) -> NDArray[np.float64]:
        """Instantaneous input frequency at the steps of a run (by default the last with telemetry), as excited (Hz).

        Parameters
        ----------
        first_step, stop : int
            The steps wanted, `stop` not included.
        run : int, optional
            The run; None for the last one with telemetry.

        Returns
        -------
        ndarray, shape (stop - first_step,)
            NaN where there was no excitation, for a signal without an instantaneous frequency, or for a definition that
            this version of the library does not know.
        """
        known = {(int(item.run), int(item.id)): item for item in self._content.excitations}
        machine = self.machine(run)
        frequency = np.full(max(stop, 0), np.nan)
        for answer in self.excitations(run):
            if answer.accepted:  # also for a stop: an excitation ends where the next one begins
                frequency[answer.first_step :] = np.nan
                excitation = known.get((answer.run, answer.id), known.get((0, answer.id)))  # 0: the present run
                ends = excitation is None or not answer.steps
                part = np.zeros(0) if ends else frequency_from_message(excitation, machine)
                part = part[: max(len(frequency) - answer.first_step, 0)]
                frequency[answer.first_step : answer.first_step + len(part)] = part
        return frequency[first_step:]

    def delevitation(self, run: int | None = None) -> int | None:
        """Step before which the simulator ended a run (by default the last one) due to delevitation, or None.

        A simulation that continues after contact, and a real bearing, have none.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one.

        Returns
        -------
        int or None
            The step.
        """
        if run is None and not self.runs:
            return None
        run = self.runs[-1] if run is None else run
        return self._content.delevitations.get(run)

    def plant_states(self, run: int | None = None) -> PlantRecord:
        """Internal states of the plant during a run (by default the last recorded), at the published steps.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one with such states.

        Returns
        -------
        PlantRecord
            Currents, flux densities and forces over time.

        Raises
        ------
        BagError
            If there are none: the simulator publishes them only with its parameter `plant_state_steps`.
        """
        states = self._content.plant_states
        if run is not None:
            states = [message for message in states if message.run == run]
        if not states:
            where = "" if run is None else f" of run {run}"
            raise BagError(
                f"bag {self.path}: holds no states of the plant ({PLANT_STATE}){where}; the simulator publishes them "
                "if its parameter plant_state_steps is not 0"
            )
        return plant_record_from_messages([message for message in states if message.run == states[-1].run])

    def regions(self, run: int | None = None) -> list[RegionState]:
        """The states that the region monitor published in a run, by default the last with telemetry, in order.

        Parameters
        ----------
        run : int, optional
            Number of the run; by default the last one with telemetry.

        Returns
        -------
        list of RegionState
            The states.
        """
        if run is None and not self.runs:
            return []
        run = self.runs[-1] if run is None else run
        return [state for number, state in self._content.regions if number == run]
