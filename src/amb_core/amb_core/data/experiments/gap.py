"""Samples that are missing between experiments of one run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DataGap:
    """Samples that are missing between two experiments of one source, from `first_step` up to, not including, `stop`.

    Attributes
    ----------
    source : str
        The run in which they are missing.
    first_step, stop : int
        First missing sample, and the one after the last.
    """

    source: str
    first_step: int
    stop: int

    @property
    def steps(self) -> int:
        """Number of missing samples."""
        return self.stop - self.first_step
