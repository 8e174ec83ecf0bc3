"""When the runs of a bag ended: machine and parameters may change from one run to the next."""

from __future__ import annotations


class RunEnds:
    """The ends of runs, from the times at which their telemetry was recorded.

    The controller publishes its last block late, when the run has stopped or even when the next one begins. So a run
    ends with the block before.
    """

    def __init__(self) -> None:
        self._times: dict[int, list[int]] = {}  # of the last two blocks; the run recorded last at the end

    def add(self, run: int, time: int) -> None:
        """Add a block of telemetry.

        Parameters
        ----------
        run : int
            Its run.
        time : int
            When it was recorded (ns since 1970).
        """
        self._times[run] = [*self._times.pop(run, []), time][-2:]

    def of(self, run: int) -> int | None:
        """The time up to which messages describe a run (ns since 1970).

        Parameters
        ----------
        run : int
            The run.

        Returns
        -------
        int or None
            The time; None for the last run, which all messages describe, and for one without telemetry.
        """
        if run not in self._times or run == next(reversed(self._times)):
            return None
        return self._times[run][0]
