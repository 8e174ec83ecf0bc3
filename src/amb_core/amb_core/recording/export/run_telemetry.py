"""Telemetry of one run of a bag, block after block in the order of its steps.

The bag is read twice: to find its runs, axes and gaps, and to give out the samples. Memory use does not depend on the
length of the recording: only blocks that were recorded before an earlier one wait for it, and only steps that are in
the bag more than once are kept, to be compared.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.ground.errors import BagError
from amb_core.ground.given_values import path_of
from amb_core.ground.progress import Progress, unseen
from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import StepCoverage
from amb_core.recording.bag_reader import BagApart, ReadMessage
from amb_core.recording.export.repeated_samples import RepeatedSamples
from amb_core.recording.mcap_file import StoredTopic
from amb_core.recording.messages.loop_samples import LOOP_SAMPLES, block_from_message
from amb_core.recording.run_ends import RunEnds

BATCH = 1 << 14
"""Most steps of a batch; with five axes a batch takes 2 MiB."""
_REPORTED = 100  # blocks between two calls


@dataclass
class _RunSurvey:
    """What the first reading found of a run."""

    axes: tuple[str, ...]
    sample_time: float
    coverage: StepCoverage = field(default_factory=StepCoverage)
    repeated: StepCoverage = field(default_factory=StepCoverage)

    def add(self, block: LoopRecord) -> None:
        first, stop = block.first_step, block.first_step + block.steps
        if first < self.coverage.stop and self.coverage.missing(first, stop) != [(first, stop)]:
            self.repeated.add(first, block.steps)
        self.coverage.add(first, block.steps)


class RunTelemetry:
    """The loop samples of one run of a bag, or of a part of it.

    Parameters
    ----------
    path : str or Path
        Folder or file of the bag; also one that was not closed.
    run : int, optional
        The run; by default the last one with telemetry.
    start, end : float, optional
        Times of the run (s): samples from `start` up to, not including, `end`; by default all.
    progress : callable, optional
        See `amb_core.ground.progress.Progress`. None for no calls.

    Attributes
    ----------
    path : Path
        The bag.
    run : int
        The run.
    axes : tuple of str
        Names of the axes.
    sample_time : float
        Sample time (s).
    spans : list of (int, int)
        Steps for which there are samples: first step and step after the last of each stretch without a gap.
    run_ends : RunEnds
        The ends of all runs of the bag.
    damage : str
        Why the bag cannot be read to its end; empty for a whole one.

    Raises
    ------
    BagError
        If there is no such bag, it has no telemetry of this workbench or not of this run and these times, or the axes
        or the sample time change within the run.
    """

    def __init__(
        self,
        path: str | Path,
        run: int | None = None,
        start: float | None = None,
        end: float | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.path = path_of("path", path, BagError)
        self.run_ends = RunEnds()
        self._progress = progress or unseen
        runs = self._survey()
        if run is not None and run not in runs:
            raise BagError(f"bag {self.path}: holds no run {run}; its runs: {', '.join(map(str, runs))}")
        self.run = next(reversed(runs)) if run is None else run
        survey = runs[self.run]
        self.axes, self.sample_time = survey.axes, survey.sample_time
        self.spans = self._within(survey.coverage.spans, start, end)
        self._repeated = survey.repeated.spans

    @property
    def steps(self) -> int:
        """Number of steps with samples."""
        return sum(stop - first for first, stop in self.spans)

    @property
    def missing(self) -> list[tuple[int, int]]:
        """Steps that are missing between the stretches: first step and step after the last of each gap."""
        return [(one[1], other[0]) for one, other in zip(self.spans, self.spans[1:], strict=False)]

    def batches(self, steps: int = BATCH) -> Iterator[LoopRecord]:
        """All samples in the order of their steps, each once; a batch has no gap in it.

        Parameters
        ----------
        steps : int, optional
            Most steps of a batch.

        Yields
        ------
        LoopRecord
            Consecutive samples.

        Raises
        ------
        BagError
            If a step came twice with different samples, or a message cannot be decoded.
        """
        done, parts = 0, list[LoopRecord]()
        for block in self._in_order():
            done += block.steps
            self._progress("exporting", done, self.steps)
            if parts and (
                parts[-1].first_step + parts[-1].steps != block.first_step
                or sum(part.steps for part in parts) + block.steps > steps
            ):
                yield _joined(parts)
                parts = []
            parts.append(block)
        if parts:
            yield _joined(parts)

    def stored_messages(self, types: Collection[str]) -> Iterator[tuple[StoredTopic, bytes, Any]]:
        """Messages of some types in the order in which they were recorded: topic, data as stored, and decoded.

        Parameters
        ----------
        types : collection of str
            Types of the messages, as `package/msg/Name`.

        Returns
        -------
        iterator of (StoredTopic, bytes, object)
            Topic, data as stored, and decoded message.

        Raises
        ------
        BagError
            If one cannot be decoded.
        """
        for message in BagApart(self.path).messages(types=list(types), stored=True):
            encoding, text = self._definition(message.type)
            yield (
                StoredTopic(message.topic, message.type, encoding, text.encode()),
                message.data or b"",
                message.content,
            )

    def _definition(self, message_type: str) -> tuple[str, str]:
        if message_type not in self._definitions:
            encoding, text = self._reader.call("definition", message_type)
            self._definitions[message_type] = (encoding, text)
        return self._definitions[message_type]

    def _survey(self) -> dict[int, _RunSurvey]:
        """What there is of each run, the run recorded last at the end."""
        self._reader = BagApart(self.path)
        self._definitions: dict[str, tuple[str, str]] = {}
        content = self._reader.call("survey", [])
        self.damage = content["damage"]
        telemetry = {topic for topic, kind, _ in content["counts"] if kind == LOOP_SAMPLES}
        others = {topic for topic, _, _ in content["counts"]} - telemetry
        runs: dict[int, _RunSurvey] = {}
        for number, message in enumerate(BagApart(self.path).messages(types=[LOOP_SAMPLES])):
            if number % _REPORTED == 0:
                self._progress("reading", 0, None)
            run, block = self._decoded(message)
            self.run_ends.add(run, message.log_time)
            self._note(runs, run, block)
        if len(telemetry) > 1:
            raise BagError(f"bag {self.path}: {LOOP_SAMPLES} is on more than one topic: {', '.join(sorted(telemetry))}")
        if not runs:
            there = ", ".join(sorted(others | telemetry)) or "none"
            raise BagError(
                f"bag {self.path}: holds no telemetry of this workbench ({LOOP_SAMPLES}); its topics: {there}"
            )
        return runs

    def _note(self, runs: dict[int, _RunSurvey], run: int, block: LoopRecord) -> None:
        if not block.steps:
            return
        known = runs.pop(run, None) or _RunSurvey(block.axes, block.sample_time)
        runs[run] = known  # now the last one
        if (block.axes, block.sample_time) != (known.axes, known.sample_time):
            raise BagError(
                f"bag {self.path}, run {run}: axes or sample time change at step {block.first_step}, from "
                f"{', '.join(known.axes)} at {known.sample_time:g} s to {', '.join(block.axes)} at "
                f"{block.sample_time:g} s"
            )
        known.add(block)

    def _decoded(self, message: ReadMessage) -> tuple[int, LoopRecord]:
        try:
            return int(message.content.run), block_from_message(message.content)
        except BagError as problem:
            raise BagError(f"bag {self.path}: {problem}") from None

    def _within(self, spans: list[tuple[int, int]], start: float | None, end: float | None) -> list[tuple[int, int]]:
        """The parts of spans between two times."""
        lowest, highest = (None if time is None else _step_from(time, self.sample_time) for time in (start, end))
        kept = [
            (first if lowest is None else max(first, lowest), stop if highest is None else min(stop, highest))
            for first, stop in spans
        ]
        kept = [(first, stop) for first, stop in kept if first < stop]
        if not kept:
            there = f"{spans[0][0] * self.sample_time:g} s to {spans[-1][1] * self.sample_time:g} s"
            asked = (
                f"{'the start' if start is None else f'{start:g} s'} to {'the end' if end is None else f'{end:g} s'}"
            )
            raise BagError(f"bag {self.path}: run {self.run} has no samples from {asked}; it has samples from {there}")
        return kept

    def _in_order(self) -> Iterator[LoopRecord]:
        """Blocks in the order of their steps, without what came twice and what is not wanted."""
        waiting: list[tuple[int, int, LoopRecord]] = []
        given = self.spans[0][0]
        for number, block in enumerate(self._blocks()):
            heapq.heappush(waiting, (block.first_step, number, block))
            while waiting and waiting[0][0] <= self._next_there(given):
                part = self._new_part(heapq.heappop(waiting)[2], given)
                if part is not None:
                    given = part.first_step + part.steps
                    yield part

    def _next_there(self, step: int) -> int:
        """The first step from `step` onwards for which there is a sample; behind the last one, any."""
        return next((max(step, first) for first, stop in self.spans if stop > step), np.iinfo(np.int64).max)

    def _new_part(self, block: LoopRecord, given: int) -> LoopRecord | None:
        first = max(block.first_step, given)
        stop = min(block.first_step + block.steps, self.spans[-1][1])
        return block.window(first, stop - first) if first < stop else None

    def _blocks(self) -> Iterator[LoopRecord]:
        """Blocks of the run as recorded."""
        repeated = RepeatedSamples(self._repeated, len(self.axes))
        for message in BagApart(self.path).messages(types=[LOOP_SAMPLES]):
            run, block = self._decoded(message)
            if run != self.run or not block.steps:
                continue
            if repeated.contradict(block):
                raise BagError(
                    f"bag {self.path}: telemetry of run {run}: steps {block.first_step} to "
                    f"{block.first_step + block.steps - 1} came twice with different samples; do two controllers "
                    "publish it?"
                )
            yield block


def _step_from(time: float, sample_time: float) -> int:
    """The first step that is not before a time (s)."""
    steps = time / sample_time
    nearest = round(steps)
    return nearest if abs(steps - nearest) < 1e-6 else int(np.ceil(steps))


def _joined(parts: list[LoopRecord]) -> LoopRecord:
    """Consecutive blocks as one."""
    if len(parts) == 1:
        return parts[0]
    reference, position, current = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("reference", "position", "current")
    )
    return LoopRecord(parts[0].first_step, parts[0].sample_time, reference, position, current, parts[0].axes)
