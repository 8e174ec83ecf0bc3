"""Telemetry: the blocks of loop samples that the controller publishes, checked for gaps and joined into one record."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from amb_core.ground.errors import AmbError, BagError
from amb_core.loop.records import LoopRecord


class StepCoverage:
    """The known steps of a run, as disjoint spans; adding is cheap while blocks arrive in order.

    Memory is bounded: beyond `MOST_SPANS` spans, steps that touch none of them count as unknown.
    """

    MOST_SPANS = 100_000

    def __init__(self) -> None:
        self._spans: list[tuple[int, int]] = []

    @property
    def first(self) -> int:
        """First known step; 0 when none is known."""
        return self._spans[0][0] if self._spans else 0

    @property
    def stop(self) -> int:
        """Step after the last known one; 0 when none is known."""
        return self._spans[-1][1] if self._spans else 0

    @property
    def spans(self) -> list[tuple[int, int]]:
        """Spans (first, stop) of known steps, in order."""
        return list(self._spans)

    def add(self, first_step: int, steps: int) -> None:
        """Mark `steps` steps from `first_step` onwards as known; known steps may be added again."""
        if steps < 1:
            return
        start, stop = first_step, first_step + steps
        later = []
        while self._spans and self._spans[-1][0] > stop:
            later.append(self._spans.pop())
        while self._spans and self._spans[-1][1] >= start:
            known = self._spans.pop()
            start, stop = min(start, known[0]), max(stop, known[1])
        if len(self._spans) + len(later) < self.MOST_SPANS:
            self._spans.append((start, stop))
        self._spans.extend(reversed(later))

    def missing(self, first_step: int, stop: int) -> list[tuple[int, int]]:
        """Spans (first, stop) of unknown steps from `first_step` up to, not including, `stop`."""
        gaps = []
        for start, end in self._spans:
            if first_step >= stop:
                break
            if start > first_step:
                gaps.append((first_step, min(start, stop)))
            first_step = max(first_step, end)
        if first_step < stop:
            gaps.append((first_step, stop))
        return gaps


class RepeatedSteps:
    """Finds steps that arrive twice with different samples, for example from two controllers.

    It compares with the latest blocks only, of at most so many steps, so memory use is bounded.

    Attributes
    ----------
    conflict : str
        The last finding, as text; empty if there is none in the present run, or none among its latest blocks.
    """

    COMPARED_BLOCKS = 100
    COMPARED_STEPS = 100_000

    def __init__(self) -> None:
        self._run: int | None = None
        self._blocks: deque[LoopRecord] = deque(maxlen=self.COMPARED_BLOCKS)
        self._stop = 0
        self._blocks_since = 0  # the conflict
        self.conflict = ""

    def add(self, run: int, block: LoopRecord) -> None:
        """Add a block of telemetry."""
        if run != self._run:
            self._run, self._stop, self.conflict = run, 0, ""
            self._blocks.clear()
        self._blocks_since += 1
        if self._blocks_since > self.COMPARED_BLOCKS:
            self.conflict = ""
        if block.first_step < self._stop and any(_contradict(known, block) for known in self._blocks):
            self.conflict = (
                f"telemetry of run {run}: steps {block.first_step} to {block.first_step + block.steps - 1} came twice "
                "with different samples; do two controllers publish it?"
            )
            self._blocks_since = 0
        self._blocks.append(block)
        while len(self._blocks) > 1 and sum(known.steps for known in self._blocks) > self.COMPARED_STEPS:
            self._blocks.popleft()
        self._stop = max(self._stop, block.first_step + block.steps)


def _contradict(known: LoopRecord, block: LoopRecord) -> bool:
    """Whether two blocks share steps and differ there."""
    start = max(known.first_step, block.first_step)
    steps = min(known.first_step + known.steps, block.first_step + block.steps) - start
    if steps < 1:
        return False
    one, other = known.window(start, steps), block.window(start, steps)
    return one.axes != other.axes or not all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
        for name in ("reference", "position", "current")
    )


def describe_gaps(gaps: Sequence[tuple[int, int]], shown: int = 3, noun: str = "steps") -> str:
    """Spans of steps as text, such as `steps 100 to 199 and 300 to 399`; at most `shown` of them are spelled out."""
    spans = [f"{start} to {stop - 1}" if stop > start + 1 else str(start) for start, stop in gaps[:shown]]
    if len(gaps) > shown:
        spans.append(f"{len(gaps) - shown} more spans")
    return f"{noun} " + (", ".join(spans[:-1]) + " and " if len(spans) > 1 else "") + spans[-1]


def merge_blocks(
    blocks: Iterable[LoopRecord],
    first_step: int | None = None,
    stop: int | None = None,
    error: type[AmbError] = BagError,
) -> LoopRecord:
    """Join the telemetry blocks of one run, in any order and with repetitions, into one record.

    Parameters
    ----------
    blocks : iterable of LoopRecord
        The blocks.
    first_step, stop : int, optional
        The requested steps, `stop` not included; by default from the first to the last step of the blocks.
    error : type[AmbError], optional
        Raised if these steps are missing from the blocks, or the blocks contradict each other or are empty.
    """
    ordered = sorted((block for block in blocks if block.steps), key=lambda block: block.first_step)
    if not ordered:
        raise error("telemetry: there are no samples")
    coverage = StepCoverage()
    for block in ordered:
        coverage.add(block.first_step, block.steps)
    first_step = coverage.first if first_step is None else first_step
    stop = coverage.stop if stop is None else stop
    if stop <= first_step:
        raise error(f"telemetry: steps {first_step} to {stop - 1} requested; at least one step is needed")
    gaps = coverage.missing(first_step, stop)
    if gaps:
        lacking = sum(end - start for start, end in gaps)
        raise error(
            f"telemetry: {describe_gaps(gaps)} are missing ({lacking} of {stop - first_step}); "
            f"there are samples from step {coverage.first} to {coverage.stop - 1}"
        )
    return _join(ordered, first_step, stop, error)


def _join(ordered: Sequence[LoopRecord], first_step: int, stop: int, error: type[AmbError]) -> LoopRecord:
    """Copy blocks without gaps into one record."""
    sample_time, axes = ordered[0].sample_time, ordered[0].axes
    signals = np.empty((3, stop - first_step, len(axes)))
    end = first_step
    for block in ordered:
        start, block_stop = max(block.first_step, first_step), min(block.first_step + block.steps, stop)
        if start >= block_stop:
            continue
        if block.sample_time != sample_time:
            raise error(f"telemetry: the sample time changes from {sample_time} s to {block.sample_time} s")
        if block.axes != axes:
            raise error(f"telemetry: the axes change from {', '.join(axes)} to {', '.join(block.axes)} at step {start}")
        part = block.window(start, block_stop - start)
        values = np.stack([part.reference, part.position, part.current])
        known = max(0, min(end, block_stop) - start)
        overlap = signals[:, start - first_step : start - first_step + known]
        if not np.array_equal(overlap, values[:, :known], equal_nan=True):
            raise error(
                f"telemetry: step {start} occurs twice with different samples; "
                "was the simulator restarted, or are two controllers publishing?"
            )
        signals[:, start - first_step + known : block_stop - first_step] = values[:, known:]
        end = max(end, block_stop)
    return LoopRecord(first_step, sample_time, signals[0], signals[1], signals[2], axes)
