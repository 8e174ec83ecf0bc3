"""The experiment of the current run: telemetry is kept, and returned once all of it has arrived. Without ROS."""

from __future__ import annotations

import threading
import time

from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData
from amb_core.loop.experiments import AppliedExcitation, ExperimentBuffer, select_window
from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import RepeatedSteps

QUIET = 0.2  # s without telemetry, after which all telemetry of a run that has just ended is taken to have arrived
LONGEST_ARRIVAL = 2.0  # s


class LiveExperiment:
    """Telemetry and excitations of the current run; thread-safe.

    Parameters
    ----------
    max_steps : int
        Steps kept; older ones are dropped.
    """

    def __init__(self, max_steps: int) -> None:
        self._buffer = ExperimentBuffer(max_steps)
        self._repeated = RepeatedSteps()
        self._arrived = threading.Condition()

    @property
    def run(self) -> int | None:
        """The current run, None before the first telemetry."""
        return self._buffer.run

    @property
    def available(self) -> tuple[int, int]:
        """First step known, and the step after the last."""
        return self._buffer.available

    @property
    def conflict(self) -> str:
        """Steps that arrived twice with different samples, as text; empty if there are none."""
        return self._repeated.conflict

    def add_block(self, run: int, block: LoopRecord) -> None:
        """Add a block of telemetry."""
        self._repeated.add(run, block)
        self._buffer.add_block(run, block)
        with self._arrived:
            self._arrived.notify_all()

    def add_excitation(self, excitation: AppliedExcitation) -> None:
        """Add an excitation as the controller answered it."""
        self._buffer.add_excitation(excitation)

    def data(self, first_step: int, steps: int) -> IdentificationData:
        """The requested samples, selected as by `select_window`; waits a moment for samples that are still to arrive.

        Raises
        ------
        IdentificationError
            If there are none, or some are missing.
        """
        self._wait_for_arrival()
        run = self._buffer.run
        if run is None:
            raise IdentificationError("no telemetry received yet; run an experiment first or name a bag")
        window = select_window(self._buffer.available, self._buffer.experiment, first_step, steps)
        source = f"run {run}, steps {window[0]} to {window[1] - 1}"
        return IdentificationData.from_record(self._buffer.record(*window), source)

    def _wait_for_arrival(self) -> None:
        """Wait until the telemetry of the last experiment is complete, or until no more arrives."""
        deadline = time.monotonic() + LONGEST_ARRIVAL
        with self._arrived:
            while time.monotonic() < deadline:
                experiment = self._buffer.experiment
                if experiment is not None and self._buffer.available[1] >= experiment[1]:
                    return
                if not self._arrived.wait(QUIET) and self._buffer.run is not None:
                    return
