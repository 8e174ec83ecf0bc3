"""Samples of telemetry that a link has lost lately, for the diagnostics of the bridge."""

from __future__ import annotations

from amb_core.rig.link import TargetLink
from amb_ros.alarms import RecentProblem


class RecentLosses:
    """Remembers how many samples were lost at the last report, and a loss for a while."""

    def __init__(self) -> None:
        self._lost = 0
        self._losing = RecentProblem()

    def text(self, link: TargetLink | None) -> str:
        """That samples have been lost since the last report, or shortly before; empty if none have.

        Parameters
        ----------
        link : TargetLink or None
            The link that counts them; None while there is none.

        Returns
        -------
        str
            A phrase for diagnostics.
        """
        before, self._lost = self._lost, link.count.samples.lost if link is not None else 0
        if self._lost > before:
            self._losing.note(f"{self._lost - before} samples of telemetry lost, {self._lost} since the connection")
        return self._losing.text
