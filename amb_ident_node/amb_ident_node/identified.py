"""The last identification of the node, with the loop of its data."""

from __future__ import annotations

from dataclasses import dataclass

from amb_core.data.analysis import RecordedLoop
from amb_core.identification import Identification


@dataclass(frozen=True, eq=False)
class Identified:
    """An identification, and the loop of its data."""

    result: Identification
    loop: RecordedLoop
