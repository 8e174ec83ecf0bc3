"""An emulator in real time: blocks of control steps, each at its absolute deadline.

A block that misses its deadline shifts the deadlines after it, and the clock of the target runs ahead of its steps by
as much. So the target counts the control steps that a late machine has cost, and its watchdog trips if they are too
many at a time. A block that wakes up less than a block late shifts nothing: on a real target, too, it would be jitter.
Nor does the time for which an emulator waits for its host; while the two are in lock-step, no late block costs a step.
"""

from __future__ import annotations

import time

from amb_core.loop.pace import Pace
from amb_core.rig.emulation.emulator import TargetEmulator
from amb_core.rig.emulation.parameters import FaultParameters


class PacedEmulator:
    """Runs an emulator block by block.

    Parameters
    ----------
    emulator : TargetEmulator
        The emulator.
    block_steps : int
        Control steps in a block.
    factor : float
        Simulation time over wall-clock time (-); 0 for as fast as it can.
    faults : FaultParameters
        For the drift of the clock.

    Attributes
    ----------
    pace : Pace or None
        Deadlines of the blocks; None without pace.
    """

    def __init__(self, emulator: TargetEmulator, block_steps: int, factor: float, faults: FaultParameters) -> None:
        self._emulator, self._steps, self._factor = emulator, block_steps, factor
        self.pace = Pace(self._period(faults)) if factor > 0.0 else None

    def configure(self, faults: FaultParameters) -> None:
        """Use other faults from now on, the drift of the clock among them.

        Parameters
        ----------
        faults : FaultParameters
            The new faults.
        """
        self._emulator.configure(faults)
        if self.pace is not None:
            self.pace.period = self._period(faults)

    def start(self) -> None:
        """Begin now: the first block is due after its own duration."""
        if self.pace is not None:
            self.pace.start(time.monotonic())

    def run_block(self) -> None:
        """Run a block, and wait for its deadline."""
        waited = self._emulator.waited
        self._emulator.run(self._steps)
        pace = self.pace
        if pace is None:
            return
        pace.postpone(self._emulator.waited - waited)
        before = pace.shift
        wait = pace.wait(time.monotonic())
        if wait > 0.0:
            time.sleep(wait)
            pace.published(time.monotonic())
        if pace.shift > before and not self._emulator.in_lock_step:
            self._emulator.shift(self._factor * (pace.shift - before))

    def _period(self, faults: FaultParameters) -> float:
        rate = self._emulator.plant.machine.sample_rate * (1.0 + 1e-6 * faults.clock_drift)
        return self._steps / (rate * self._factor)
