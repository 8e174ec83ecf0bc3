"""An emulator in a process of its own, which shares its core with nothing else, and the handle to it.

A node needs its interpreter for its own messages, timers and parameters; the control steps cannot wait for those.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from multiprocessing import Pipe
from typing import Any

from amb_core.ground.errors import AmbError, ParameterError, TargetError
from amb_core.loop.pace import Pace
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.loop.real_time import RealTimeParameters
from amb_core.plant import PlantParameters
from amb_core.rig.emulation.emulator import Address
from amb_core.rig.emulation.faulty_link import LinkCount
from amb_core.rig.emulation.load import Load
from amb_core.rig.emulation.parameters import FaultParameters, LimitParameters
from amb_core.rig.link import TargetStatus

REPORT, REBOOT = "report", "reboot"
"""Requests to the process; a third kind is a set of faults. Each is answered by a report."""
LONGEST_BLOCK = 0.05  # s of wall-clock time; commands and requests wait as long
_PATIENCE = 20.0  # s, for an answer of a running process


@dataclass(frozen=True)
class EmulatorSettings:
    """Everything that an emulator process needs; see `TargetEmulator` and `PacedEmulator`.

    Attributes
    ----------
    plant : PlantParameters
        The machine.
    controller : ControllerParameters
        Gains and current limit of the target at boot.
    limits : LimitParameters
        Its other limits.
    faults : FaultParameters
        Faults at the start.
    address : Address
        Where it listens.
    block_steps : int
        Control steps in a block.
    real_time_factor : float
        Simulation time over wall-clock time (-); 0 for as fast as it can.
    real_time : RealTimeParameters
        Priority, memory and processors of its thread.
    host_patience : float, optional
        Longest wait of wall-clock time for the current of a host that closes the loop (s); 0 for none.
    plant_waits : bool, optional
        Whether the plant stands still in steps that are missed.

    Raises
    ------
    ParameterError
        If a block of steps would take so long that commands had to wait for it.
    """

    plant: PlantParameters
    controller: ControllerParameters
    limits: LimitParameters
    faults: FaultParameters
    address: Address
    block_steps: int
    real_time_factor: float
    real_time: RealTimeParameters
    host_patience: float = 0.0
    plant_waits: bool = False

    def __post_init__(self) -> None:
        least = self.block_steps / (self.plant.integration.sample_rate * LONGEST_BLOCK)
        if 0.0 < self.real_time_factor < least * (1.0 - 1e-9):
            raise ParameterError(
                f"real_time_factor = {self.real_time_factor:g} is not allowed with block_steps = {self.block_steps} at "
                f"{self.plant.integration.sample_rate:g} Hz; allowed: 0, or from {least:g} on"
            )

    @property
    def block_time(self) -> float:
        """Wall-clock time of a block (s); 0 without pace."""
        if self.real_time_factor == 0.0:
            return 0.0
        return self.block_steps / (self.plant.integration.sample_rate * self.real_time_factor)


@dataclass(frozen=True)
class Started:
    """An emulator that has started.

    Attributes
    ----------
    port : int
        UDP port on which it listens; 0 on a pseudo-terminal.
    where : str
        Address that its hosts use.
    load : Load
        How much of a core it needs.
    not_real_time : str
        What of the real-time options was not possible; empty if all was.
    """

    port: int
    where: str
    load: Load
    not_real_time: str


@dataclass(frozen=True)
class EmulatorReport:
    """The present state of an emulator.

    Attributes
    ----------
    steps : int
        Control steps since the start.
    boots : int
        How often the target has booted.
    enabled : bool
        Whether the amplifiers are on.
    trouble : str
        Why the amplifiers last reported a fault because of the plant; empty if they never did.
    status : TargetStatus or None
        What the target has sent last of its state; None before that.
    to_host, from_host : LinkCount
        What became of the frames of each direction of the network.
    unsent : int
        Frames that the operating system did not take.
    pace : Pace or None
        Deadlines of the blocks; None without pace.
    """

    steps: int
    boots: int
    enabled: bool
    trouble: str
    status: TargetStatus | None
    to_host: LinkCount
    from_host: LinkCount
    unsent: int
    pace: Pace | None


class EmulatorProcess:
    """Starts an emulator in a process of its own and waits until it runs.

    Parameters
    ----------
    settings : EmulatorSettings
        What to emulate.

    Attributes
    ----------
    started : Started
        What it reported at its start.
    latest : EmulatorReport
        The latest report.

    Raises
    ------
    AmbError
        If it cannot start.
    """

    def __init__(self, settings: EmulatorSettings) -> None:
        self._connection, other = Pipe()
        # In its own session: Ctrl-C in the terminal reaches this process alone, which then ends the other.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "amb_core.rig.emulation.worker", str(other.fileno())],
            pass_fds=[other.fileno()],
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        other.close()
        try:
            self._connection.send(settings)
            self.started: Started = self._received(None)
            self._asked = 0
            self._ask(REPORT)
            self.latest = self._report()
        except BaseException:
            self.close()
            raise

    def ask_for_report(self) -> None:
        """Take the reports that are there, and ask for the next one; returns at once.

        Raises
        ------
        TargetError
            If the process has ended.
        """
        while self._asked and self._connection.poll():
            self.latest = self._report()
        if not self._asked:
            self._ask(REPORT)

    def configure(self, faults: FaultParameters) -> None:
        """Use other faults from now on; they must name axes of the machine.

        Parameters
        ----------
        faults : FaultParameters
            The new faults.

        Raises
        ------
        TargetError
            If the process has ended.
        """
        self._ask(faults)

    def reboot(self) -> EmulatorReport:
        """Boot the target, and wait for it.

        Returns
        -------
        EmulatorReport
            The state after the boot.

        Raises
        ------
        TargetError
            If the process has ended or does not answer.
        """
        self._ask(REBOOT)
        while self._asked:
            self.latest = self._report()
        return self.latest

    @property
    def returncode(self) -> int | None:
        """Exit code of the process; None while it runs."""
        return self._process.poll()

    def close(self) -> None:
        """End the process."""
        self._connection.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _ask(self, request: object) -> None:
        try:
            self._connection.send(request)
        except OSError:
            raise self._ended() from None
        self._asked += 1

    def _report(self) -> EmulatorReport:
        report: EmulatorReport = self._received(_PATIENCE)
        self._asked -= 1
        return report

    def _received(self, patience: float | None) -> Any:
        try:
            if not self._connection.poll(patience):
                raise TargetError(f"the process of the emulator has not answered for {patience:g} s")
            answer = self._connection.recv()
        except (EOFError, OSError):
            raise self._ended() from None
        if isinstance(answer, AmbError):
            raise answer
        return answer

    def _ended(self) -> TargetError:
        return TargetError("the process of the emulator has ended; see the log of the node")
