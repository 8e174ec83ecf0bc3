"""The reference target and its plant in lock-step with a host in the same process: without sockets, as fast as it can.

Commands and answers are the frames of AMB-UDP, and the code that takes them is the C code of `target/`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import TargetError
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.plant import Plant, PlantParameters
from amb_core.rig.emulation.faulty_coils import FaultyCoils
from amb_core.rig.emulation.faulty_sensors import FaultySensors
from amb_core.rig.emulation.parameters import FaultParameters, LimitParameters
from amb_core.rig.emulation.switched_plant import SwitchedPlant
from amb_core.rig.link import ReferenceTarget, commands, decode, hello
from amb_core.rig.link.answers import Reply, TargetStatus, TelemetryBlock
from amb_core.rig.link.commanded import CommandedLink
from amb_core.rig.link.commands import Command, CommandWriter
from amb_core.rig.link.description import Description, machine_of
from amb_core.rig.link.layout import CHECKSUM, HEADER, LARGEST_FRAME, Code, Law, TelemetryOption
from amb_core.rig.link.link import LinkCount, LinkListener, TargetDescription, TargetSettings
from amb_core.rig.link.refusals import require_done
from amb_core.rig.link.upload import Upload, controller_upload

_OPTIONS = TelemetryOption.FLOAT64 | TelemetryOption.STATUS


class LockStepLink(CommandedLink):
    """A link to a target in this process; time passes in `advance` only.

    Parameters
    ----------
    plant : PlantParameters
        The machine.
    controller : ControllerParameters
        Gains of the target at boot, and the limit on its control currents.
    limits : LimitParameters
        Its other limits.
    faults : FaultParameters
        Faults of sensors, coils and amplifiers.
    library : Path
        The C code, from `reference_library`.
    watch : callable, optional
        Called after each step with the amplifiers on.

    Attributes
    ----------
    plant : Plant
        The plant.
    steps : int
        Control steps since the start.
    """

    def __init__(
        self,
        plant: PlantParameters,
        controller: ControllerParameters,
        limits: LimitParameters,
        faults: FaultParameters,
        library: Path,
        watch: Callable[[], None] = lambda: None,
    ) -> None:
        self.plant, self.steps, self.count = Plant(plant), 0, LinkCount()
        machine = self.plant.machine
        self._amplified = SwitchedPlant(self.plant)
        self._target = ReferenceTarget(
            library, machine, limits.with_current(controller.current_limit), controller,
            coils=len(self.plant.coil_currents),
        )  # fmt: skip
        names, rate = machine.axis_names, machine.sample_rate
        self._sensors = FaultySensors(names, faults.sensor, faults.seed, rate)
        self._coils = FaultyCoils(names, faults.coil, rate)
        self._faults, self._watch, self._uploads = faults, watch, itertools.count(1)

    def hold(self, position: NDArray[np.float64] | None) -> None:
        """Hold the rotor by hand, see `SwitchedPlant.hold`."""
        self._amplified.hold(position)

    def advance(self, steps: int) -> None:
        """So many control steps, and what the target sends meanwhile."""
        for _ in range(0, steps, self._rows):
            for _ in range(min(self._rows, steps)):
                self._step()
            self._command(commands.heartbeat())

    def _step(self) -> None:
        target, amplified, faults = self._target, self._amplified, self._faults
        target.position[:] = amplified.position
        target.coil_current[:] = amplified.coil_current
        self._sensors.apply(target.position, target.enabled)
        target.step(None, faults.temperature, faults.amplifier or bool(amplified.fault))
        self.steps += 1
        amplified.advance(target.enabled, self._coils.applied(target.current))
        if target.enabled:
            self._watch()

    def connect(self, listener: LinkListener) -> TargetDescription:
        """Find the target and start its telemetry."""
        self._listener = listener
        self._target.feed(hello())
        page = decode(self._target.take()[-1][0])
        if not isinstance(page, Description) or page.axes > len(page.page):
            raise TargetError("more axes than one description holds")
        self._session = page.session(b"")
        self._writer = CommandWriter(self._session, page.counter)
        self._machine = machine_of([page])
        self._rows = (LARGEST_FRAME - HEADER.size - 8 - CHECKSUM) // (8 * (3 * page.axes + 1))
        self._command(commands.stream(self._rows, _OPTIONS))
        return TargetDescription(
            self._machine, page.limits, page.firmware, page.waveform_bytes // (8 * page.axes), page.nonce
        )

    def close(self) -> None:
        """Nothing is open."""

    def configure(self, settings: TargetSettings) -> None:
        """Send controller, limits and references."""
        law = settings.controller.at_rate(self._machine.sample_rate)
        for command in commands.settings(settings, law, len(self._machine.axes)).values():
            self._command(command)
        if isinstance(law, LinearControl):
            self._bring(controller_upload(next(self._uploads), law.model))
        self._command(commands.controller(Law.STATE_SPACE if isinstance(law, LinearControl) else Law.PD))

    def reset_faults(self) -> None:
        """Forget latched trips, and measure anew."""
        self._command(commands.fault_reset())
        self.advance(1)

    def _bring(self, upload: Upload, cancelled: Callable[[], bool] = lambda: False) -> None:
        self._command(upload.begin)
        for chunk in range(upload.chunks):
            self._target.feed(self._writer.write(upload.chunk(chunk)))
        while self._command(upload.commit).code is Code.BUSY:
            pass

    def _command(self, command: Command) -> Reply:
        self._take()
        self._target.feed(self._writer.write(command))
        reply = self._take()
        assert reply is not None
        require_done("the target", command, reply)
        return reply

    def _take(self) -> Reply | None:
        """Pass on what the target has sent; the latest reply."""
        reply = None
        for frame, _ in self._target.take():
            answer = decode(frame, self._session)
            if isinstance(answer, Reply):
                reply = answer
            elif isinstance(answer, TelemetryBlock):
                self._listener.on_samples(answer)
            elif isinstance(answer, TargetStatus):
                self._listener.on_status(answer)
        return reply
