"""builtin_interfaces/Time: the simulation time of a controller step."""

from __future__ import annotations

from typing import Any

SECOND = 1_000_000_000  # ns
LONGEST_TIME = 2**31 - 1  # s; the seconds of a stamp are an int32


def set_step_time(stamp: Any, step: int, sample_rate: float) -> None:
    """Set a stamp, in place, to the time of a controller step at a sample rate (Hz), rounded to the nanosecond."""
    nanoseconds = round(step * SECOND / sample_rate)
    stamp.sec = nanoseconds // SECOND
    stamp.nanosec = nanoseconds % SECOND


def last_stamped_step(sample_rate: float) -> int:
    """The last controller step with a time that a stamp can represent: after 68 years of simulation time."""
    return int(LONGEST_TIME * sample_rate)


def stamped_time(stamp: Any) -> float:
    """Time of a stamp (s)."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)
