"""Quality of service of the workbench's topics: nothing may be lost, and late listeners learn the current state."""

from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=2000,  # a full queue drops messages silently, so leave room for a listener that stalls for a moment
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""Samples and blocks of samples."""

HISTORY = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=2000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Telemetry and states of the plant: late joiners get the last 2000 messages too, so no listener misses a beginning."""

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""States: the last message is delivered to late joiners."""

EVERY_STATE = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""For listeners to latched topics that must not miss one of several states in a burst."""


def offered_profile(profile: QoSProfile, declared: QoSProfile) -> dict[str, Any]:
    """Quality of service of a publisher, in the format of rosbag2's metadata.

    Parameters
    ----------
    profile : QoSProfile
        As discovered; discovery does not report history and depth.
    declared : QoSProfile
        Source of history and depth.
    """
    return {
        "history": declared.history.name.lower(),
        "depth": declared.depth,
        "reliability": profile.reliability.name.lower(),
        "durability": profile.durability.name.lower(),
        "deadline": _time(profile.deadline),
        "lifespan": _time(profile.lifespan),
        "liveliness": profile.liveliness.name.lower(),
        "liveliness_lease_duration": _time(profile.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions,
    }


def _time(duration: Duration) -> dict[str, int]:
    """As seconds and nanoseconds; an unlimited time is rosbag2's largest time."""
    seconds, nanoseconds = divmod(duration.nanoseconds or 2**63 - 1, 1_000_000_000)
    return {"sec": seconds, "nsec": nanoseconds}
