"""Counts the samples of a run in a bag: which are missing, which are there twice, which are not in order.

It reads block after block, so memory use depends on the number of gaps, not on the length of the recording.
"""

from __future__ import annotations

from pathlib import Path

from amb_core.ground.errors import BagError
from amb_core.ground.given_values import path_of
from amb_core.loop.telemetry import StepCoverage, describe_gaps
from amb_core.recording.bag_reader import BagApart
from amb_core.recording.messages.loop_samples import LOOP_SAMPLES, block_from_message


class StepAudit:
    """Blocks of telemetry of one run, in the order in which they were recorded.

    Attributes
    ----------
    samples : int
        Number of samples, with repetitions.
    doubled : int
        Samples of steps that were there before.
    out_of_order : int
        Samples that follow a later step.
    """

    def __init__(self) -> None:
        self.samples = self.doubled = self.out_of_order = 0
        self._coverage = StepCoverage()

    def add(self, first_step: int, steps: int) -> None:
        """Add a block of `steps` samples from `first_step` onwards.

        Parameters
        ----------
        first_step : int
            Step of the first sample.
        steps : int
            Number of samples.
        """
        stop = first_step + steps
        earlier = max(min(stop, self._coverage.stop) - first_step, 0)
        if earlier:
            new = sum(end - start for start, end in self._coverage.missing(first_step, stop))
            self.doubled += steps - new
        self.out_of_order += earlier
        self.samples += steps
        self._coverage.add(first_step, steps)

    @property
    def first(self) -> int:
        """The first step."""
        return self._coverage.first

    @property
    def stop(self) -> int:
        """The step after the last one."""
        return self._coverage.stop

    def gaps(self, first: int | None = None, stop: int | None = None) -> list[tuple[int, int]]:
        """Spans (first step, step after the last) that are missing from a range, by default within the recording.

        Parameters
        ----------
        first : int, optional
            First step of the range; by default that of the recording.
        stop : int, optional
            Step after the range; by default the end of the recording.

        Returns
        -------
        list of (int, int)
            The spans, ascending.
        """
        return self._coverage.missing(self.first if first is None else first, self.stop if stop is None else stop)

    def lost(self, first: int | None = None, stop: int | None = None) -> int:
        """Number of missing samples.

        Parameters
        ----------
        first : int, optional
            First step of the range; by default that of the recording.
        stop : int, optional
            Step after the range; by default the end of the recording.

        Returns
        -------
        int
            Samples missing from the range.
        """
        return sum(end - start for start, end in self.gaps(first, stop))

    def describe(self, first: int | None = None, stop: int | None = None) -> str:
        """All of it in one line, such as `steps 0 to 999, none missing`.

        Parameters
        ----------
        first : int, optional
            First step of the range; by default that of the recording.
        stop : int, optional
            Step after the range; by default the end of the recording.

        Returns
        -------
        str
            One line of text.
        """
        first, stop = self.first if first is None else first, self.stop if stop is None else stop
        gaps = self.gaps(first, stop)
        texts = [f"steps {first} to {stop - 1}"]
        texts.append(f"{self.lost(first, stop)} missing ({describe_gaps(gaps)})" if gaps else "none missing")
        texts += [f"{self.doubled} doubled"] if self.doubled else []
        texts += [f"{self.out_of_order} out of order"] if self.out_of_order else []
        return ", ".join(texts)


def audit_steps(path: str | Path, run: int) -> StepAudit:
    """Count the samples of a run in a bag.

    Parameters
    ----------
    path : str or Path
        The bag; also one that was not closed.
    run : int
        The run.

    Returns
    -------
    StepAudit
        Its `lost`, `doubled` and `out_of_order` are all 0 if each sample is in the bag once and in order.

    Raises
    ------
    BagError
        If there is no bag, or it holds no such run.
    """
    audit = StepAudit()
    for message in BagApart(path_of("path", path, BagError)).messages(types=[LOOP_SAMPLES]):
        if message.content.run == run:
            block = block_from_message(message.content)
            audit.add(block.first_step, block.steps)
    if not audit.samples:
        raise BagError(f"bag {path}: holds no run {run}")
    return audit
