"""What a bag holds, from the index at the end of its files: of an hour as fast as of a second."""

from __future__ import annotations

import contextlib
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mcap.reader import SeekingReader

from amb_core.ground.errors import BagError
from amb_core.ground.files.regular_files import open_regular
from amb_core.recording.bag_metadata import WRITTEN_BY
from amb_core.recording.mcap_scan import LARGEST, UNREADABLE
from amb_core.recording.storage import McapStorage, Storage, description_of, open_storage
from amb_core.recording.topic_info import TopicInfo

LONGEST_NAME = 80  # characters of the program that wrote a bag


@dataclass(frozen=True)
class BagOverview:
    """Topics and duration of a bag.

    Attributes
    ----------
    topics : list of TopicInfo
        Its topics with messages, by name.
    duration : float
        Time from its first to its last message (s).
    damage : str
        Why it cannot be read to its end; empty for a bag whose files all have an index.
    written_by : str
        Program and version that wrote it, where the bag says so; empty where it does not.
    """

    topics: list[TopicInfo]
    duration: float
    damage: str = ""
    written_by: str = ""

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(topic.messages for topic in self.topics)


def read_overview(path: Path) -> BagOverview:
    """What a bag holds: from the index of its files, or, without one, by counting messages, of which none is kept.

    Parameters
    ----------
    path : Path
        Folder of a bag, an `.mcap` or a `.db3` file.

    Returns
    -------
    BagOverview
        Topics with their counts, start, duration and damage.

    Raises
    ------
    BagError
        If there is no bag, or if no message of a damaged one can be read.
    """
    return replace(_content(path), written_by=_writer(path))


def _writer(path: Path) -> str:
    custom: Any = description_of(path).get("custom_data") if path.is_dir() else None
    writer = custom.get(WRITTEN_BY) if isinstance(custom, dict) else None
    return writer[:LONGEST_NAME] if isinstance(writer, str) else ""


def _content(path: Path) -> BagOverview:
    storage = open_storage(path)
    counts: Counter[tuple[str, str]] = Counter()
    times: list[int] = []
    if isinstance(storage, McapStorage) and all(_add_index(file, counts, times) for file in storage.files):
        return _overview(counts, times, "")
    counts.clear()
    return _counted(path, storage, counts)


def _add_index(file: Path, counts: Counter[tuple[str, str]], times: list[int]) -> bool:
    """Add what the index of a file says about its messages; False if it has none."""
    with contextlib.suppress(*UNREADABLE, OSError), open_regular(file) as stream:
        summary = SeekingReader(stream, record_size_limit=LARGEST).get_summary()
        statistics = summary.statistics if summary else None
        if not summary or not statistics or sum(statistics.channel_message_counts.values()) != statistics.message_count:
            return False
        for number, count in statistics.channel_message_counts.items():
            channel = summary.channels[number]
            counts[channel.topic, summary.schemas[channel.schema_id].name] += count
        if statistics.message_count:
            times += (statistics.message_start_time, statistics.message_end_time)
        return True
    return False


def _counted(path: Path, storage: Storage, counts: Counter[tuple[str, str]]) -> BagOverview:
    start, end = 2**63 - 1, 0
    for message in storage.messages():
        counts[message.topic, message.type] += 1
        start, end = min(start, message.log_time), max(end, message.log_time)
    if storage.damage and not counts:
        raise BagError(f"bag {path}: no message can be read: {storage.damage}")
    return _overview(counts, [start, end] if counts else [], storage.damage)


def _overview(counts: Counter[tuple[str, str]], times: list[int], damage: str) -> BagOverview:
    topics = [TopicInfo(name, kind, count) for (name, kind), count in sorted(counts.items()) if count]
    return BagOverview(topics, (max(times) - min(times)) / 1e9 if times else 0.0, damage)
