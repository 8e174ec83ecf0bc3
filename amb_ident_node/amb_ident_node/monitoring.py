"""Regions of a monitored loop: runs, gaps, delevitation, and which states are published. Without ROS."""

from __future__ import annotations

import math

from amb_core.ground.errors import RegionError
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import RepeatedSteps, describe_gaps
from amb_core.regions import (
    RegionClassifier,
    RegionParameters,
    RegionState,
    layout_of,
    layout_without_machine,
)


class RegionWatch:
    """Classifies the telemetry of one run after the other.

    The result depends on the samples alone, not on how they are divided into blocks.

    Parameters
    ----------
    parameters : RegionParameters
        Thresholds and times of the classifier.
    publish_period : float
        Run time (s) after which an unchanged state is returned again.

    Attributes
    ----------
    run : int or None
        The run of the last telemetry; None before the first.
    sample_time : float
        Controller sample time of that run (s).
    state : RegionState or None
        Latest state of that run; None before its first.
    restarts : int
        How often the classification restarted within a run.
    refused : int
        Blocks that were not classified.
    problem : str
        The last gap or error in the telemetry of this run; empty if there is none.
    next_step : int
        Step that continues the telemetry of this run: all steps before it have been processed.
    awaited : int or None
        A later run that has begun and of which no telemetry has come yet; None if there is none.
    """

    def __init__(self, parameters: RegionParameters, publish_period: float) -> None:
        self._thresholds = parameters
        self._period = publish_period
        self.run: int | None = None
        self.sample_time = 0.0
        self.state: RegionState | None = None
        self.restarts = 0
        self.refused = 0
        self.problem = ""
        self.awaited: int | None = None
        self._classifier: RegionClassifier | None = None
        self._used_machine = False  # in this run
        self.next_step = 0
        self._repeated = RepeatedSteps()
        self._standing: tuple[int, int] | None = None  # run, and the step at which the simulator stands still
        self._told_step = 0  # next_step when a state was last returned
        self._machine: Machine | None = None
        self._step_at_machine = 0  # next_step when it arrived
        self._delevitated: tuple[int, int] | None = None  # run, and the step before which the rotor delevitated
        self._told_periods = -1

    def add_block(self, run: int, block: LoopRecord) -> list[RegionState]:
        """Process a block of telemetry. Returns the states to publish, oldest first.

        A block of another run starts a new classification. A block that does not continue the last one restarts it.

        Raises
        ------
        RegionError
            If the block cannot be classified, for example because a sample is not finite; it is left out.
        """
        try:
            if run != self.run or block.sample_time != self.sample_time or self._classifier is None:
                self._start(run, block)
            assert self._classifier is not None
            states = self._classifier.feed(block)
        except RegionError as problem:
            self.refused += 1
            self.problem = str(problem)
            raise
        if block.first_step != self.next_step:
            self._note_restart(block.first_step)
        self.next_step = block.first_step + block.steps
        self._repeated.add(run, block)
        return self._returned(self._worth_telling(states) + self._end_of_run())

    def use(self, machine: Machine) -> None:
        """Take the bearings and clearances of a machine, from the next run on."""
        self._machine, self._step_at_machine = machine, self.next_step

    @property
    def not_judged(self) -> str:
        """What could not be judged in the present run, and why; empty if everything was."""
        return "" if self._classifier is None else "; ".join(self._classifier.judged.reservations)

    @property
    def machine_problem(self) -> str:
        """How the bearings of the present run are not those of the machine; empty if they are, or without telemetry."""
        if self._classifier is None or self.awaited is not None:
            return ""
        layout = self._classifier.layout
        if self._machine is not None and layout == layout_of(self._machine):
            return ""
        if self._machine is not None and self._used_machine:
            if self.next_step <= self._step_at_machine:  # the run may be over
                return ""
            return f"the machine changed within run {self.run}; its bearings hold from the next run on"
        bearings = "; ".join(f"{bearing.name}: {', '.join(bearing.axes)}" for bearing in layout.bearings)
        text = f"run {self.run} is classified without its machine, with bearings by the names of the axes ({bearings})"
        unknown = not all(self._classifier.judged.contact.values())
        return f"{text}; D not judged: the clearance is not known" if unknown else text

    @property
    def conflict(self) -> str:
        """Steps of the present run that arrived twice with different samples; empty if there are none."""
        return "" if self.awaited is not None else self._repeated.conflict

    def begin(self, run: int) -> None:
        """Note that a run has begun, which is known before its first telemetry."""
        if run > (self.run or 0):
            self.awaited = run

    def stand(self, run: int, step: int) -> list[RegionState]:
        """Note that the simulator stands still before a step. Returns the states to publish.

        Once all telemetry up to that step has arrived, the last state is returned even if it has not changed. A
        listener then knows that no other one will follow.
        """
        self._standing = (run, step)
        return self._returned([])

    def delevitate(self, run: int, step: int) -> list[RegionState]:
        """Note that the rotor of a run delevitated before a step. Returns the states to publish.

        The telemetry does not contain the position there, and may arrive after this call.
        """
        self._delevitated = (run, step)
        return self._returned(self._end_of_run())

    def _start(self, run: int, block: LoopRecord) -> None:
        self.run, self.sample_time = run, block.sample_time
        self.state, self.problem, self.awaited = None, "", None
        self._classifier = None
        self._used_machine = self._machine is not None and self._machine.axis_names == block.axes
        layout = layout_without_machine(block.axes)
        if self._machine is not None and self._used_machine:
            layout = layout_of(self._machine)
        self._classifier = RegionClassifier(self._thresholds, block.sample_time, layout)
        self.next_step, self._told_step = block.first_step, 0
        self._told_periods = -1

    def _note_restart(self, first_step: int) -> None:
        self.restarts += 1
        self._told_periods = -1
        if first_step > self.next_step:
            self.problem = f"telemetry lacks {describe_gaps([(self.next_step, first_step)])}"
        else:
            self.problem = f"telemetry goes back from step {self.next_step - 1} to step {first_step}"
        self.problem += f" of run {self.run}; the classification restarted"

    def _end_of_run(self) -> list[RegionState]:
        if self._classifier is None or self._delevitated != (self.run, self.next_step):
            return []
        self._delevitated = None
        return self._worth_telling([self._classifier.delevitate()])

    def _returned(self, states: list[RegionState]) -> list[RegionState]:
        """These states, or the last one if the run stands still and the last one was returned too early."""
        if not states and self._standing == (self.run, self.next_step) and self._told_step < self.next_step:
            states = [self.state] if self.state is not None else []
        if states:
            self._told_step = self.next_step
        return states

    def _worth_telling(self, states: list[RegionState]) -> list[RegionState]:
        """The states in which something changed, and one per period."""
        chosen = []
        for state in states:
            periods = math.floor((state.step + 1) * self.sample_time / self._period + 1e-6)
            if periods > self._told_periods or self.state is None or _marks(state) != _marks(self.state):
                chosen.append(state)
            self._told_periods = periods
            self.state = state
        return chosen


def _marks(state: RegionState) -> tuple[object, ...]:
    """What is published at once when it changes."""
    axes = [
        (axis.region, axis.since.step, axis.sampling_beat, axis.drift is None, axis.oscillation is None, axis.frozen)
        for axis in state.axes
    ]
    return (state.region, state.since.step, state.settled, *axes)
