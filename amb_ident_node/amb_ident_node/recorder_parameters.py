"""Parameters of the node `recorder`."""

from __future__ import annotations

from amb_core.ground.parameters import Parameters, choice, quantity, switch


class RecorderParameters(Parameters):
    """Parameters of the node."""

    directory: str = choice("bags", "folder for bags that are requested without a path or with a relative path")
    record_on_start: bool = switch(False, "start a bag named by date as soon as the node is up")
    chunk_period: float = quantity(
        0.5,
        "s",
        "period of writing to the disk; a killed recorder loses at most this much, and what the disk has not taken yet",
        0.05,
        10.0,
    )
    parameter_timeout: float = quantity(
        2.0, "s", "longest wait for an answer about the parameters or the state of a node", 0.05, 10.0
    )
    queue_size: float = quantity(
        200e6, "B", "memory for messages that wait for the disk; when it is full, messages are dropped", 1e6, 1e11
    )
    minimum_free_space: float = quantity(
        50e6, "B", "free space on the disk below which no recording starts, and a recording ends", 0.0, 1e15
    )
    split_size: float = quantity(0.0, "B", "size at which a file is closed and the next one begins; 0: none", 0.0, 1e15)
    split_period: float = quantity(0.0, "s", "time after which the next file begins; 0: none", 0.0, 1e9)
