"""The file `metadata.yaml` of a bag, as rosbag2 writes it (version 9)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from amb_core.recording.mcap_file import PROGRAM, FileContent, StoredTopic

METADATA = "metadata.yaml"
VERSION = 9
WRITTEN_BY = "written_by"  # key of the program in rosbag2's custom data


def write_metadata(
    folder: Path, topics: Sequence[StoredTopic], files: Sequence[FileContent], ros_distro: str = "jazzy"
) -> None:
    """Describe the files of a bag.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    counts = sum((file.counts for file in files), Counter[tuple[str, str]]())
    start, end = min(file.start for file in files), max(file.end for file in files)
    content = {
        "version": VERSION,
        "storage_identifier": "mcap",
        **_times(start, end),
        "message_count": counts.total(),
        "topics_with_message_count": [
            {"topic_metadata": _topic_metadata(topic), "message_count": counts[topic.key]} for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.path.name for file in files],
        "files": [
            {"path": file.path.name, **_times(file.start, file.end), "message_count": file.counts.total()}
            for file in files
        ],
        "custom_data": {WRITTEN_BY: PROGRAM},
        "ros_distro": ros_distro,
    }
    (folder / METADATA).write_text(yaml.safe_dump({"rosbag2_bagfile_information": content}, sort_keys=False))


def _times(start: int, end: int) -> dict[str, dict[str, int]]:
    return {
        "duration": {"nanoseconds": max(end - start, 0)},  # 0 without a message
        "starting_time": {"nanoseconds_since_epoch": start},
    }


def _topic_metadata(topic: StoredTopic) -> dict[str, Any]:
    try:
        profiles = yaml.safe_load(topic.metadata.get("offered_qos_profiles", ""))
    except yaml.YAMLError:  # of a damaged bag: its messages count more
        profiles = None
    return {
        "name": topic.name,
        "type": topic.type,
        "serialization_format": topic.serialization,
        "offered_qos_profiles": profiles or [],
        "type_description_hash": topic.metadata.get("topic_type_hash", ""),
    }
