"""Which messages are missing from a recording, topic by topic. Without ROS.

On telemetry, plant states and clock the step numbers show what is missing. On the other topics the publisher counts its
messages. Everything published from the start of the recording up to an awaited step must have arrived.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import RepeatedSteps, StepCoverage, describe_gaps

KEPT_RUNS = 10_000  # whose messages are accounted for; others may send any number of runs
K = TypeVar("K")
V = TypeVar("V")


@dataclass(frozen=True)
class Mark:
    """A place in a run: everything before this step.

    Attributes
    ----------
    run : int
        The run.
    step : int
        The step.
    """

    run: int
    step: int


class TelemetryAccount:
    """Blocks of telemetry, by their steps.

    Until the beginning of the recording is known, the first run may start at any step.

    Attributes
    ----------
    conflict : str
        Steps that arrived more than once with different samples, as text; empty if there are none in the recording.
    """

    def __init__(self) -> None:
        self._origin: Mark | None = None
        self._coverage: dict[int, StepCoverage] = {}
        self._repeated = RepeatedSteps()
        self.conflict = ""

    @property
    def runs(self) -> list[int]:
        """Runs with telemetry, in the order of arrival."""
        return list(self._coverage)

    def begin(self, origin: Mark | None) -> None:
        """The recording begins there: it must have that run from that step onwards, and later runs from step 0."""
        self._origin = origin
        if origin is not None:
            self._coverage = {run: coverage for run, coverage in self._coverage.items() if run >= origin.run}

    def note(self, run: int, block: LoopRecord) -> None:
        """A block has arrived."""
        if self._origin is not None and run < self._origin.run:
            return
        self._coverage.setdefault(run, StepCoverage()).add(block.first_step, block.steps)
        forget_oldest(self._coverage, KEPT_RUNS)
        self._repeated.add(run, block)
        self.conflict = self._repeated.conflict or self.conflict

    def stop(self, run: int) -> int:
        """Step after the last known one of a run; 0 if none is known."""
        return self._coverage[run].stop if run in self._coverage else 0

    def first_step(self, run: int) -> int:
        """First step of a run that belongs to the recording."""
        if self._origin is not None and run == self._origin.run:
            return self._origin.step
        if self._origin is None and run == next(iter(self._coverage), None):
            return self._coverage[run].first
        return 0

    def first_due(self, run: int) -> int:
        """First step of a run from which its other messages belong to the recording.

        The messages of the very beginning arrived before the recording.
        """
        return self.first_step(run) + 1 if self._origin is None or run == self._origin.run else 0

    def reached(self, awaited: Mark) -> bool:
        """Whether telemetry up to there has arrived."""
        return self.stop(awaited.run) >= awaited.step

    def lacks(self, awaited: Mark | None = None) -> list[str]:
        """What is missing, one text per run."""
        stops = {run: coverage.stop for run, coverage in self._coverage.items()}
        if awaited is not None:
            stops[awaited.run] = max(stops.get(awaited.run, 0), awaited.step)
        texts = []
        for run, stop in stops.items():
            missing = self._coverage.get(run, StepCoverage()).missing(self.first_step(run), stop)
            if missing:
                texts.append(f"telemetry of run {run} lacks {describe_gaps(missing)} ({_count(missing)} steps)")
        return texts


class PeriodicAccount:
    """Messages that are published every so many steps of a run.

    The state of a simulator, which contains this number, may arrive after the first messages of its run.

    Parameters
    ----------
    topic : str
        Its name, for texts.
    """

    KEPT = 10_000  # messages that arrived before their period was known

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._every: dict[int, int] = {}
        self._early: deque[tuple[int, int]] = deque(maxlen=self.KEPT)  # run and step
        self._seen: dict[int, StepCoverage] = {}

    def expect(self, run: int, every: int) -> None:
        """In this run a message is due at every multiple of `every` steps; 0: none is due."""
        self._every[run] = every
        forget_oldest(self._every, KEPT_RUNS)
        early, self._early = self._early, deque(maxlen=self.KEPT)
        for place in early:
            self.note(*place)

    def note(self, run: int, step: int) -> None:
        """The message of a step has arrived."""
        if run not in self._every:
            self._early.append((run, step))
            return
        every = self._every[run]
        if every and step % every == 0:
            self._seen.setdefault(run, StepCoverage()).add(step // every, 1)
            forget_oldest(self._seen, KEPT_RUNS)

    def reached(self, awaited: Mark) -> bool:
        """Whether the last message due up to and including that step has arrived."""
        every = self._every.get(awaited.run, 0)
        return not every or self._coverage(awaited.run).stop > awaited.step // every

    def lacks(self, run: int, first: int, stop: int) -> list[str]:
        """Missing messages among those due at the steps from `first` up to, not including, `stop`."""
        every = self._every.get(run, 0)
        if not every:
            return []
        missing = self._coverage(run).missing(-(-first // every), -(-stop // every))
        if not missing:
            return []
        spans = [(every * start, every * (end - 1) + 1) for start, end in missing]
        return [f"{self._topic} of run {run} lacks {describe_gaps(spans)} ({_count(missing)} messages)"]

    def _coverage(self, run: int) -> StepCoverage:
        return self._seen.get(run, StepCoverage())


class SequenceAccount:
    """Messages that their publisher counts. It also counts before a recording starts: then a gap at its start shows.

    Parameters
    ----------
    topic : str
        Its name, for texts.
    """

    KEPT = 10_000  # gaps; the messages of others are only counted

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._gaps: list[tuple[int, int]] = []
        self._further = 0  # messages missing beyond those gaps
        self.last = 0

    def start(self) -> None:
        """A recording starts here: forget what was missing before."""
        self._gaps.clear()
        self._further = 0

    def note(self, sequence: int) -> None:
        """A message has arrived. A lower number than before comes from a publisher that was restarted."""
        if sequence in (0, self.last):  # a publisher that does not count; the same message again
            return
        if self.last and sequence > self.last + 1:
            self._add(self.last + 1, sequence)
        elif 1 < sequence < self.last:
            self._add(1, sequence)
        self.last = sequence

    def note_dropped(self, sequence: int) -> None:
        """A message has arrived that is not in the recording."""
        if sequence in (0, self.last):
            return
        self.note(sequence)
        if self._gaps and self._gaps[-1][1] == sequence:
            self._gaps[-1] = (self._gaps[-1][0], sequence + 1)
        else:
            self._add(sequence, sequence + 1)

    def lacks(self) -> list[str]:
        """What is missing between messages that have arrived."""
        if not self._gaps:
            return []
        spans = describe_gaps(self._gaps, noun="messages")
        return [f"{self._topic} lacks {spans} ({_count(self._gaps) + self._further} messages)"]

    def _add(self, first: int, stop: int) -> None:
        if len(self._gaps) < self.KEPT:
            self._gaps.append((first, stop))
        else:
            self._further += stop - first


class AnswerAccount:
    """Excitations and the controller's answers to them: in a recording none is without the other.

    The ids of excitations have gaps: each publisher has a sequence of its own. Without a publisher of excitations the
    controller answers to its own.
    """

    KEPT = 1000  # of each kind: excitations, answers, and those without the other; either may arrive first

    def __init__(self) -> None:
        self._unanswered: dict[tuple[int, int], None] = {}
        self._answers: dict[tuple[int, int], None] = {}
        self._excitations: dict[tuple[int, int], None] = {}
        self._missing: dict[tuple[int, int], None] = {}  # answered, or arrived, but not in the recording

    def start(self) -> None:
        """A recording starts here: what was missing before is ignored."""
        self._unanswered.clear()
        self._missing.clear()

    def note_excitation(self, run: int, number: int) -> None:
        """An excitation has arrived; one of run 0 is meant for the run that its answer names."""
        self._keep(self._excitations, run, number)
        last = next(reversed(self._answers), (0, -1))
        self._missing.pop((run, number) if run else last, None)
        if (run, number) not in self._answers and (run or number != last[1]):
            self._keep(self._unanswered, run, number)

    def note_dropped(self, run: int, number: int) -> None:
        """An excitation has arrived that is not in the recording."""
        self._keep(self._excitations, run, number)
        self._keep(self._missing, run, number)

    def note_answer(self, run: int, number: int) -> None:
        """An answer has arrived."""
        self._unanswered.pop((run, number), None)
        self._unanswered.pop((0, number), None)
        if not any(key in self._excitations or key in self._answers for key in ((run, number), (0, number))):
            self._keep(self._missing, run, number)
        self._keep(self._answers, run, number)

    def reached(self, published: bool = True) -> bool:
        """Whether each excitation has its answer, and each answer its excitation, if these are published."""
        return not self._unanswered and not (published and self._missing)

    def lacks(self, published: bool = True) -> list[str]:
        """What is missing; excitations only if they are published."""
        texts = []
        if published and self._missing:
            texts.append(f"excitation lacks excitations {_ends(self._missing)} ({len(self._missing)} messages)")
        if self._unanswered:
            texts.append(
                f"excitation_status lacks the answers to excitations {_ends(self._unanswered)} "
                f"({len(self._unanswered)} messages)"
            )
        return texts

    def _keep(self, among: dict[tuple[int, int], None], run: int, number: int) -> None:
        among[run, number] = None
        forget_oldest(among, self.KEPT)


def forget_oldest(known: dict[K, V], kept: int) -> None:
    """Remove the oldest item of a dictionary that has more than it may keep."""
    if len(known) > kept:
        del known[next(iter(known))]


def _ends(numbers: Iterable[tuple[int, int]]) -> str:
    """The first and the last number of (run, number)."""
    every = [str(number) for _, number in numbers]
    return every[0] if len(every) == 1 else f"{every[0]} to {every[-1]}"


def _count(gaps: Iterable[tuple[int, int]]) -> int:
    return sum(stop - start for start, stop in gaps)
