"""A recording in progress: the bag, what telemetry it lacks, how it failed. For several threads, free of ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from amb_core.bags import BagWriter
from amb_core.errors import BagError
from amb_core.messages import ParameterValue
from amb_core.telemetry import StepCoverage, describe_gaps


class Recording:
    """A bag being recorded.

    Parameters
    ----------
    writer : BagWriter
        The bag, with its topics added.
    origin : tuple of int or None
        Run and step at which the simulator is paused: telemetry must start there. None if it is not known to be
        paused; then that of the first run may start anywhere. Later runs must start at step 0.
    """

    def __init__(self, writer: BagWriter, origin: tuple[int, int] | None) -> None:
        self._writer = writer
        self._origin = origin
        self._coverage: dict[int, StepCoverage] = {}
        self._changed = threading.Condition()
        self._closed = False
        self.failure = ""

    @property
    def folder(self) -> Path:
        """Folder of the bag."""
        return self._writer.folder

    @property
    def messages(self) -> int:
        """Number of messages in the bag."""
        return self._writer.messages

    def write(self, topic: str, data: bytes) -> None:
        """Append a message as received. The first failure ends the recording and stays in `failure`."""
        self._attempt(lambda: self._writer.write(topic, data, time.time_ns()))

    def write_parameters(self, topic: str, node: str, values: Mapping[str, ParameterValue]) -> None:
        """Append the parameters of a node."""
        self._attempt(lambda: self._writer.write_parameters(topic, node, values, time.time_ns()))

    def note_telemetry(self, run: int, first_step: int, steps: int) -> None:
        """Note which steps the telemetry just written holds."""
        with self._changed:
            self._coverage.setdefault(run, StepCoverage()).add(first_step, steps)
            self._changed.notify_all()

    def flush(self) -> None:
        """Write the chunk in progress to the disk."""
        self._attempt(self._writer.flush)

    def wait_for(self, run: int, stop: int, timeout: float) -> None:
        """Wait until the telemetry of a run reaches the step before `stop`, the time is over or the bag is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or bool(self.failure) or self._reached(run) >= stop, timeout)

    def gaps(self, awaited: tuple[int, int] | None = None) -> list[str]:
        """What telemetry the bag lacks, one text per run; `awaited` is a run and the step after its last one."""
        with self._changed:
            stops = {run: coverage.stop for run, coverage in self._coverage.items()}
            if awaited is not None:
                stops[awaited[0]] = max(stops.get(awaited[0], 0), awaited[1])
            texts = []
            for run, stop in stops.items():
                missing = self._coverage.get(run, StepCoverage()).missing(self._first_step(run), stop)
                if missing:
                    texts.append(f"telemetry of run {run} lacks {describe_gaps(missing)}")
            return texts

    def close(self) -> None:
        """Close the bag; a second call does nothing.

        Raises
        ------
        BagError
            If it cannot be written to its end.
        """
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._changed.notify_all()
            self._writer.close()

    def _reached(self, run: int) -> int:
        return self._coverage[run].stop if run in self._coverage else 0

    def _first_step(self, run: int) -> int:
        if self._origin is not None and run == self._origin[0]:
            return self._origin[1]
        if self._origin is None and run == next(iter(self._coverage), None):
            return self._coverage[run].first
        return 0

    def _attempt(self, action: Callable[[], None]) -> None:
        with self._changed:
            if self._closed or self.failure:
                return
            try:
                action()
            except BagError as problem:
                self.failure = str(problem)
                self._changed.notify_all()
