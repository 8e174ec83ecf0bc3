"""An emulated target that runs by itself in a thread, somewhat faster or slower than real time, for tests of hosts."""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Callable
from typing import Any, Self, TypeVar

from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.rig.emulation import (
    LOCALHOST,
    Address,
    FaultParameters,
    LimitParameters,
    TargetEmulator,
    reference_library,
)
from amb_core.rig.emulation.listening import PSEUDO_TERMINAL

BLOCK = 10  # steps
T = TypeVar("T")


class ServedEmulator:
    """A target emulator and the thread that runs it; a host that is late for a while is not silent for its limits."""

    def __init__(
        self,
        plant: PlantParameters | None = None,
        key: bytes = b"",
        limits: dict[str, float] | None = None,
        port: int = 0,
        host: str = LOCALHOST,
        block: int = BLOCK,
    ) -> None:
        self.emulator = TargetEmulator(
            plant or PlantParameters(),
            ControllerParameters(),
            validate(LimitParameters, {"host_time": 1e3} | (limits or {})),
            FaultParameters(),
            reference_library(),
            Address(host, port, key),
        )
        self.emulator.plant.advance([0.0] * len(self.emulator.plant.machine.axes))  # loads the kernel: no silence later
        self.emulator.plant.reset()
        self.port = self.emulator.port
        self.address = self.emulator.where if host == PSEUDO_TERMINAL else host
        self._lock = threading.Lock()
        self._paused = False
        self._steps = self._block = block
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *problem: object) -> None:
        self._ended.set()
        self._thread.join()
        self.emulator.close()

    def do(self, work: Callable[[TargetEmulator], T]) -> T:
        """What some work with the emulator returns, between two blocks of steps."""
        with self._lock:
            return work(self.emulator)

    def fail(self, **faults: Any) -> None:
        """Show faults from now on."""
        self.do(lambda emulator: emulator.configure(validate(FaultParameters, faults)))

    def pause(self, paused: bool) -> None:
        """Let the target stand still, without an answer to anybody."""
        self._paused = paused

    def stop_steps(self, stopped: bool) -> None:
        """Let the target make no control step, as on a machine that is late; it still answers."""
        self._block = 0 if stopped else self._steps

    def _run(self) -> None:
        while not self._ended.is_set():
            if not self._paused and self._has_room():
                with self._lock:
                    self.emulator.run(self._block)
            time.sleep(5e-4)

    def _has_room(self) -> bool:
        """Whether the line takes more: that of a pseudo-terminal fills up where a busy machine holds up the host."""
        return bool(select.select((), (self.emulator,), (), 0.0)[1])
