"""Data of a file in the place of a bag's content: one run of telemetry, and nothing else.

So regions, distortion and reports treat a file as they treat a bag.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import BagError, IdentificationError
from amb_core.ground.files.regular_files import shown
from amb_core.loop.records import LoopRecord
from amb_core.recording import TopicInfo
from amb_core.recording.content import BagContent
from amb_core.recording.messages.loop_samples import LOOP_SAMPLES
from amb_core.recording.run_ends import RunEnds

RUN = 1
NO_STEPS = "run and steps are not allowed; they are for bags with telemetry of this workbench"
"""Why a part of a file cannot be chosen."""


class FileContent(BagContent):
    """The content of a recording whose only run is the data of a file.

    Parameters
    ----------
    path : Path
        The file.
    data : IdentificationData
        Its data; only their telemetry needs a reference, currents in A and positions in m.
    """

    def __init__(self, path: Path, data: IdentificationData) -> None:
        self.path = path
        self.data = data
        self.topics = [TopicInfo("telemetry", LOOP_SAMPLES, len(data.experiments))]
        self.start = 0
        self.duration = data.samples * data.sample_time
        self.truncated = ""

    @cached_property
    def blocks(self) -> dict[int, list[LoopRecord]]:
        """The experiments, as blocks of one run."""
        try:
            records = [self.data.record(index) for index in range(len(self.data.experiments))]
        except IdentificationError as problem:
            raise BagError(f"data {shown(self.path)}: {problem}") from None
        return {RUN: records}

    def timed_messages_of(self, topic: str) -> Iterator[tuple[int, Any]]:
        """There are no messages."""
        raise BagError(f"data {shown(self.path)}: holds no messages of {topic}; it is a file, not a bag")

    @cached_property
    def run_ends(self) -> RunEnds:
        """The only run has no end before another one."""
        return RunEnds()

    def _timed(self, message_type: str, convert: Any) -> list[tuple[int, Any]]:
        return []
