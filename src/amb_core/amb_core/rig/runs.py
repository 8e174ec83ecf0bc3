"""The telemetry of a target as runs: a run lasts from a levitation to the step at which the currents are off.

Step 0 of a run is the first one with currents, as step 0 of the simulator is the first one that the controller answers.
Samples of a rotor that is not levitated belong to no run.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.rig.link import TelemetryBlock

_STATE = 0b111  # of the status word: the state of the target
_FIRST, _LAST = 1, 3  # states in which the rotor is levitated: LEVITATING to LANDING
BEFORE = 1.0  # s before a trip that are kept
LATE = 2.0  # s of telemetry that may come before the news of a trip, whose answers may be lost


@dataclass(frozen=True, eq=False)
class RunSamples:
    """Consecutive samples of a run.

    Attributes
    ----------
    run : int
        Number of the run.
    record : LoopRecord
        The samples, with steps counted in the run.
    """

    run: int
    record: LoopRecord


class Runs:
    """Cuts telemetry into runs, and runs into blocks.

    Parameters
    ----------
    machine : Machine
        Gives axes and sample rate.
    block : int
        Steps in a block; the last one of a run, and one before a gap, may be shorter.
    new_run : callable
        Returns the number of a run that begins.

    Attributes
    ----------
    run : int
        The present run, or the last one; 0 before the first.
    levitated : bool
        Whether a run is in progress.
    next_step : int
        Step of the run after its last sample, blocks in the making included.
    next_target_step : int
        Step of the target after the last sample.
    position : ndarray, shape (axes,)
        Latest measured position (m); NaN before the first.
    """

    def __init__(self, machine: Machine, block: int, new_run: Callable[[], int]) -> None:
        self._axes, self._sample_time = machine.axis_names, 1.0 / machine.sample_rate
        self._block, self._new_run = block, new_run
        self._base = 0  # step of the target at step 0 of the run
        self._end = 0  # step of the target of the first sample after the run
        self._parts: list[TelemetryBlock] = []  # of the block in the making, consecutive
        self._held = 0  # samples in them
        self._past: deque[RunSamples] = deque()
        self._before_steps = round(BEFORE * machine.sample_rate)
        self._past_steps = round((BEFORE + LATE) * machine.sample_rate)
        self.run = 0
        self.levitated = False
        self.next_step = self.next_target_step = 0
        self.position = np.full(len(self._axes), np.nan)

    def add(self, samples: TelemetryBlock) -> list[RunSamples]:
        """The blocks that are whole now that these samples, with status words, have arrived.

        Parameters
        ----------
        samples : TelemetryBlock
            Samples of the target, with status words.

        Returns
        -------
        list of RunSamples
            Blocks that became whole, in the order of their steps.
        """
        assert samples.status is not None
        state = samples.status & _STATE
        levitated = (state >= _FIRST) & (state <= _LAST)
        done: list[RunSamples] = []
        for first, stop in _stretches(levitated):
            done += self._take(samples.part(first, stop), bool(levitated[first]))
        self.position = samples.position[-1]
        self.next_target_step = samples.first_step + samples.steps
        return done

    def flush(self) -> list[RunSamples]:
        """The block in the making, if there is one: no samples come for a while.

        Returns
        -------
        list of RunSamples
            This block, or nothing.
        """
        done = self._cut(self._held) if self._held else []
        self._remember(done)
        return done

    def end(self) -> list[RunSamples]:
        """The run is over: the target started anew, and counts its steps from 0 again.

        Returns
        -------
        list of RunSamples
            The last block of the run, if it had begun.
        """
        done = self.flush()
        self.levitated, self._end = False, self.next_target_step
        return done

    def step_of(self, target_step: int) -> int:
        """The step in the present run of a step of the target.

        Parameters
        ----------
        target_step : int
            Step of the target.

        Returns
        -------
        int
            Step of the run.
        """
        return target_step - self._base

    def target_step_of(self, step: int) -> int:
        """The step of the target at a step of the present run.

        Parameters
        ----------
        step : int
            Step of the run.

        Returns
        -------
        int
            Step of the target.
        """
        return self._base + step

    def holds(self, target_step: int) -> bool:
        """Whether a step of the target is one of the present run, or of the last one; its sample may be lost.

        Parameters
        ----------
        target_step : int
            Step of the target.

        Returns
        -------
        bool
            True for a step of such a run.
        """
        return self.run > 0 and target_step >= self._base and (self.levitated or target_step <= self._end)

    def before(self, target_step: int, kept: Sequence[TelemetryBlock] = ()) -> list[LoopRecord]:
        """What is known of the second before a step of the target, within the present run, in blocks.

        Parameters
        ----------
        target_step : int
            Step of the target.
        kept : sequence of TelemetryBlock, optional
            What the target itself has kept, in the order of its steps; it fills the gaps of telemetry. None by default.

        Returns
        -------
        list of LoopRecord
            Records in the order of their steps.
        """
        stop = self.step_of(target_step)
        whole = [*self._past, *([self._made(self._held)] if self._held else [])]
        records = [samples.record for samples in whole if samples.run == self.run]
        first = max(stop - self._before_steps, 0)
        known = [part for record in records for part in _between(record, first, stop)]
        spare = [_record_of(block, self.step_of(block.first_step), self._sample_time, self._axes) for block in kept]
        return _filled(known, spare, first, stop)

    def lacking_before(self, target_step: int, kept: Sequence[TelemetryBlock] = ()) -> str:
        """How much of the second before a step of the target, within the present run, is missing; empty: nothing.

        Parameters
        ----------
        target_step : int
            Step of the target.
        kept : sequence of TelemetryBlock, optional
            As for `before`.

        Returns
        -------
        str
            Text for a message.
        """
        wanted = min(self.step_of(target_step), self._before_steps)
        missing = wanted - sum(record.steps for record in self.before(target_step, kept))
        return f"{missing} of the {wanted} steps before it are missing here" if missing > 0 else ""

    def _take(self, samples: TelemetryBlock, levitated: bool) -> list[RunSamples]:
        """Samples with one and the same state."""
        if not levitated:
            if not self.levitated:
                return []
            ended = self.end()
            self._end = samples.first_step
            return ended
        done: list[RunSamples] = []
        if not self.levitated:
            self.levitated, self.run, self._base = True, self._new_run(), samples.first_step
        elif self.step_of(samples.first_step) != self.next_step:
            done = self.flush()  # a gap
        self._parts.append(samples)
        self._held += samples.steps
        self.next_step = self.step_of(samples.first_step + samples.steps)
        while self._held >= self._wanted():
            done += self._cut(self._wanted())
        self._remember(done)
        return done

    def _wanted(self) -> int:
        """Samples up to the next multiple of the size of a block."""
        return self._block - self.step_of(self._parts[0].first_step) % self._block if self._parts else self._block

    def _cut(self, steps: int) -> list[RunSamples]:
        made = self._made(steps)
        rest, self._parts = self._parts, []
        left = steps
        for part in rest:
            if part.steps > left:
                self._parts.append(part.part(left, part.steps))
            left = max(left - part.steps, 0)
        self._held -= steps
        return [made]

    def _made(self, steps: int) -> RunSamples:
        first = self.step_of(self._parts[0].first_step)
        reference, position, current = (
            _joined([getattr(part, name) for part in self._parts], steps)
            for name in ("reference", "position", "current")
        )
        return RunSamples(self.run, LoopRecord(first, self._sample_time, reference, position, current, self._axes))

    def _remember(self, done: list[RunSamples]) -> None:
        self._past.extend(done)
        while len(self._past) > 1 and sum(one.record.steps for one in self._past) > self._past_steps + self._block:
            self._past.popleft()


def _stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and stop of each stretch of equal flags."""
    edges = np.flatnonzero(flags[1:] != flags[:-1]) + 1 if len(flags) > 1 else np.zeros(0, int)
    bounds = [0, *edges.tolist(), len(flags)]
    return list(itertools.pairwise(bounds))


def _joined(columns: list[NDArray[np.float64]], steps: int) -> NDArray[np.float64]:
    return (columns[0] if len(columns) == 1 else np.concatenate(columns))[:steps]


def _record_of(block: TelemetryBlock, first_step: int, sample_time: float, axes: tuple[str, ...]) -> LoopRecord:
    return LoopRecord(first_step, sample_time, block.reference, block.position, block.current, axes)


def _filled(known: list[LoopRecord], spare: list[LoopRecord], first: int, stop: int) -> list[LoopRecord]:
    """Records in the order of their steps, with what fills the gaps between them; each step once."""
    done: list[LoopRecord] = []
    reached = first
    for record in known:
        done += [part for one in spare for part in _between(one, reached, record.first_step)]
        done.append(record)
        reached = record.first_step + record.steps
    return done + [part for one in spare for part in _between(one, reached, stop)]


def _between(record: LoopRecord, first: int, stop: int) -> list[LoopRecord]:
    """The part of a record between two steps, if there is one."""
    begin, end = max(first, record.first_step), min(stop, record.first_step + record.steps)
    return [record.window(begin, end - begin)] if begin < end else []
