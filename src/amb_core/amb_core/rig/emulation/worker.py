"""The process of an emulator: `python -m amb_core.rig.emulation.worker FD`, started by `EmulatorProcess`."""

from __future__ import annotations

import gc
import sys
from collections import deque
from dataclasses import replace
from multiprocessing.connection import Connection

from amb_core.ground.errors import AmbError, TargetError, one_line
from amb_core.loop.real_time import enter_real_time
from amb_core.rig.emulation.emulator import TargetEmulator
from amb_core.rig.emulation.library import reference_library
from amb_core.rig.emulation.load import measure_load
from amb_core.rig.emulation.paced import PacedEmulator
from amb_core.rig.emulation.parameters import FaultParameters
from amb_core.rig.emulation.process import REBOOT, EmulatorReport, EmulatorSettings, Started

_BETWEEN_REQUESTS = 0.01  # s; to look for one takes as long as a control step
_MOST_BLOCKS = 10


def _serve(connection: Connection) -> None:
    """Emulate until the connection is closed."""
    settings: EmulatorSettings = connection.recv()
    try:
        emulator = TargetEmulator(
            settings.plant,
            settings.controller,
            settings.limits,
            settings.faults,
            reference_library(),
            settings.address,
            settings.host_patience,
            settings.plant_waits,
        )
        load = measure_load(settings.plant, settings.controller, settings.real_time_factor)
    except AmbError as problem:
        connection.send(TargetError(one_line(problem)))
        return
    paced = PacedEmulator(emulator, settings.block_steps, settings.real_time_factor, settings.faults)
    connection.send(Started(emulator.port, emulator.where, load, enter_real_time(settings.real_time)))
    gc.collect()
    gc.freeze()  # the collector need not traverse what stays
    paced.start()
    block_time = settings.block_time
    blocks = min(max(round(_BETWEEN_REQUESTS / block_time), 1), _MOST_BLOCKS) if block_time > 0.0 else _MOST_BLOCKS
    while True:
        for _ in range(blocks):
            paced.run_block()
        while connection.poll():
            _do(connection.recv(), emulator, paced)
            connection.send(_report_of(emulator, paced))


def _do(request: object, emulator: TargetEmulator, paced: PacedEmulator) -> None:
    if isinstance(request, FaultParameters):
        paced.configure(request)
    elif request == REBOOT:
        emulator.reboot()


def _report_of(emulator: TargetEmulator, paced: PacedEmulator) -> EmulatorReport:
    to_host, from_host = (replace(link.count, gaps=deque()) for link in (emulator.to_host, emulator.from_host))
    return EmulatorReport(
        steps=emulator.steps,
        boots=emulator.boots,
        enabled=emulator.enabled,
        trouble=emulator.trouble,
        status=emulator.status(),
        to_host=to_host,
        from_host=from_host,
        unsent=emulator.unsent,
        pace=paced.pace,
    )


def main() -> int:
    """Serve the connection whose file descriptor is the argument."""
    try:
        _serve(Connection(int(sys.argv[1])))
    except (EOFError, OSError):  # nobody asks any more
        return 0
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
