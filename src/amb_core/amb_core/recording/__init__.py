"""Bags: MCAP files in rosbag2 folders, written message by message and read as loop records."""

from amb_core.recording.reader import Bag, TopicInfo, read_bag
from amb_core.recording.writer import BagWriter

__all__ = ["Bag", "BagWriter", "TopicInfo", "read_bag"]
