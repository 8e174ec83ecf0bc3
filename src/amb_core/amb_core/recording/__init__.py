"""Recordings: MCAP files in rosbag2 folders, written message by message and read as the library's own types."""

from amb_core.recording.content import TopicInfo
from amb_core.recording.recording import Recording
from amb_core.recording.writer import BagWriter

__all__ = ["BagWriter", "Recording", "TopicInfo"]
