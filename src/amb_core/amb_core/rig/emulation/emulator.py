"""A real-time target in this process: the reference target's C code around a simulated plant, on a real UDP socket."""

from __future__ import annotations

import ipaddress
import os
import select
import time
from dataclasses import dataclass, field
from pathlib import Path

from amb_core.ground.errors import TargetError
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.plant import Plant, PlantParameters
from amb_core.rig.emulation.faulty_coils import FaultyCoils
from amb_core.rig.emulation.faulty_link import FaultyLink
from amb_core.rig.emulation.faulty_sensors import FaultySensors
from amb_core.rig.emulation.listening import PSEUDO_TERMINAL, Listening, SerialListening, UdpListening
from amb_core.rig.emulation.parameters import FaultParameters, LimitParameters
from amb_core.rig.emulation.switched_plant import SwitchedPlant
from amb_core.rig.link import PORT, FrameType, ReferenceTarget, Session, TargetStatus, decode
from amb_core.rig.link.answers import Reply
from amb_core.rig.link.layout import NONCE

LOCALHOST = "127.0.0.1"
MOST_RECEIVED = 64  # datagrams taken between two blocks of steps: a flood does not stop the control steps
LONGEST_PAUSE = 10_000  # steps; what the rotor does in a longer one makes no difference any more
_OFFSET_OF_TYPE = 5  # in a frame


@dataclass(frozen=True)
class Address:
    """Where the emulator listens.

    Attributes
    ----------
    host : str, optional
        IPv4 address, or `serial:pty` for a pseudo-terminal.
    port : int, optional
        UDP port; 0 for any that is free.
    key : bytes, optional
        Secret of its hosts; empty for commands from this machine only.

    Raises
    ------
    TargetError
        If it is no address, or one that other machines can reach and there is no key.
    """

    host: str = LOCALHOST
    port: int = PORT
    key: bytes = field(default=b"", repr=False)

    def __post_init__(self) -> None:
        if self.host == PSEUDO_TERMINAL:
            return
        try:
            loopback = ipaddress.IPv4Address(self.host).is_loopback
        except ValueError:
            raise TargetError(
                f"address '{self.host}' is not allowed; allowed: an IPv4 address, {PSEUDO_TERMINAL}"
            ) from None
        if not (self.key or loopback):
            raise TargetError(
                f"address '{self.host}' without a key is not allowed; allowed: {LOCALHOST}, or a key file, so that "
                "nobody else in the network can command the target"
            )


class TargetEmulator:
    """The C target around a plant, behind a UDP socket.

    The control steps of the target number from its boot. While its amplifiers are off the rotor rests at the plant's
    initial position. The step in which it switches them on is step 0 of the plant: the samples since then are those of
    `amb_core.plant.simulation.simulate`, bit for bit, for the same parameters, references and excitation.

    Parameters
    ----------
    plant : PlantParameters
        The machine.
    controller : ControllerParameters
        Gains of the target's PD controller at boot, and the limit on its control current references.
    limits : LimitParameters
        Its other limits.
    faults : FaultParameters
        Faults at the start; see `configure`.
    library : Path
        The C code, from `reference_library`.
    address : Address
        Where it listens.
    host_patience : float, optional
        Where the host closes the loop: longest wait of wall-clock time for its current after each step (s), in which
        the emulated time stands still; 0 for none. After a wait in vain the steps go on until it is back.
    plant_waits : bool, optional
        Whether the plant stands still in steps that are missed; otherwise it moves with the currents held, as a rotor
        does.

    Attributes
    ----------
    plant : Plant
        The plant.
    port : int
        UDP port on which it listens; 0 on a pseudo-terminal.
    where : str
        Address that its hosts use: the pseudo-terminal as they name it.
    steps : int
        Control steps since the start.
    boots : int
        How often the target has booted.
    trouble : str
        Why the amplifiers last reported a fault because of the plant; empty if they never did.
    to_host, from_host : FaultyLink
        The two directions of the network, with what became of the frames.
    unsent : int
        Frames that the operating system did not take.
    waited : float
        Wall-clock time for which it has waited for the host (s).
    in_lock_step : bool
        Whether it has waited for the host after its latest step, and not in vain.

    Raises
    ------
    AmbError
        If the parameters make no machine, or it does not fit into a target.
    TargetError
        If the port cannot be opened.
    """

    def __init__(
        self,
        plant: PlantParameters,
        controller: ControllerParameters,
        limits: LimitParameters,
        faults: FaultParameters,
        library: Path,
        address: Address,
        host_patience: float = 0.0,
        plant_waits: bool = False,
    ) -> None:
        self.plant = Plant(plant)
        self._machine = self.plant.machine
        self._amplified = SwitchedPlant(self.plant)
        self._target = ReferenceTarget(
            library,
            self._machine,
            limits.with_current(controller.current_limit),
            controller,
            address.key,
            coils=len(self.plant.coil_currents),
        )
        self._key, self._period = address.key, 1e9 / self._machine.sample_rate
        names, rate = self._machine.axis_names, self._machine.sample_rate
        self._sensors = FaultySensors(names, faults.sensor, faults.seed, rate)
        self._coils = FaultyCoils(names, faults.coil, rate)
        self.to_host = FaultyLink(faults.to_host, (faults.seed, 1))
        self.from_host = FaultyLink(faults.from_host, (faults.seed, 2))
        self._faults = faults
        self._patience, self.waited = host_patience, 0.0
        self._plant_waits = plant_waits
        self._in_vain = self.in_lock_step = False  # the latest wait for the host
        self.steps, self.boots, self._shift, self.unsent, self.trouble = 0, 0, 0.0, 0, ""
        self._open(address)
        self.reboot()

    def _open(self, address: Address) -> None:
        serial = address.host == PSEUDO_TERMINAL
        self._listening: Listening = SerialListening() if serial else UdpListening(address.host, address.port)
        self.port, self.where = self._listening.port, self._listening.where

    def fileno(self) -> int:
        """File descriptor of the socket or pseudo-terminal, to wait for frames with `select`.

        Returns
        -------
        int
            The descriptor.
        """
        return self._listening.fileno()

    def close(self) -> None:
        """Close the socket or pseudo-terminal."""
        self._listening.close()

    def configure(self, faults: FaultParameters) -> None:
        """Use other faults from now on.

        Parameters
        ----------
        faults : FaultParameters
            The new faults.

        Raises
        ------
        ParameterError
            If a fault names an axis that the machine lacks; nothing changes.
        """
        coils = FaultyCoils(self._machine.axis_names, faults.coil, self._machine.sample_rate)
        self._sensors.configure(faults.sensor)
        self._coils = coils if faults.coil != self._faults.coil else self._coils
        self.to_host.configure(faults.to_host)
        self.from_host.configure(faults.from_host)
        if faults.seed != self._faults.seed:
            self._sensors.restart(faults.seed)
            self.to_host.restart((faults.seed, 1))
            self.from_host.restart((faults.seed, 2))
        self._faults = faults

    def reboot(self) -> None:
        """Boot the target: it draws a new nonce and forgets everything; the amplifiers are off."""
        nonce = os.urandom(NONCE)
        while not any(nonce[:4]):
            nonce = os.urandom(NONCE)
        self._target.reboot(nonce)
        self._session = Session(nonce, len(self._machine.axes), len(self.plant.coil_currents), self._key)
        self._last_status = b""
        self._amplified.advance(False, self._target.current)
        self.boots += 1

    def shift(self, seconds: float) -> None:
        """Let the clock of the target run ahead of its steps: by so much (s) the next step is late.

        Parameters
        ----------
        seconds : float
            How far the clock moves (s).
        """
        before = self.time
        self._shift += 1e9 * seconds
        if self._plant_waits or not self._target.enabled:
            return
        for _ in range(min(round((self.time - before) / self._period), LONGEST_PAUSE)):
            self._amplified.advance(True, self._coils.applied(self._target.current))

    @property
    def time(self) -> int:
        """Time of the next step by the clock of the target (ns)."""
        return round(self.steps * self._period + self._shift)

    @property
    def enabled(self) -> bool:
        """Whether the amplifiers are on."""
        return self._target.enabled

    def run(self, steps: int) -> None:
        """Take what hosts have sent, make control steps, and send what the target has to send.

        Parameters
        ----------
        steps : int
            Number of control steps.
        """
        self._receive()
        for _ in range(steps):
            self.step()
        self._send()

    def step(self) -> None:
        """One control step, and the plant over one sample after it."""
        amplified, target, faults = self._amplified, self._target, self._faults
        target.position[:] = amplified.position
        target.coil_current[:] = amplified.coil_current
        self._sensors.apply(target.position, target.enabled)
        fault = faults.amplifier or bool(amplified.fault)
        self._in_vain = self._in_vain and target.waits
        target.step(self.time, faults.temperature, fault)
        self.steps += 1
        self.in_lock_step = bool(self._patience) and target.waits and not self._in_vain
        if self.in_lock_step:
            self._wait_for_host()
        amplified.advance(target.enabled, self._coils.applied(target.current))
        if amplified.fault:
            self.trouble = amplified.fault

    def _wait_for_host(self) -> None:
        """Exchange frames until the current of this step is there."""
        began = now = time.monotonic()
        self._send()
        while self._target.waits and now - began < self._patience:
            select.select([self._listening], [], [], self._patience - (now - began))
            self._receive()
            self._send()
            now = time.monotonic()
        self._in_vain = self._target.waits
        self.in_lock_step = not self._in_vain
        self.waited += now - began

    def status(self) -> TargetStatus | None:
        """The status that the target has sent last since its boot: in a reply, or while telemetry is on.

        Returns
        -------
        TargetStatus or None
            State, trips and counts of the target; None if it has sent none.
        """
        answer = decode(self._last_status, self._session) if self._last_status else None
        if isinstance(answer, Reply):
            return answer.status
        return answer if isinstance(answer, TargetStatus) else None

    def _receive(self) -> None:
        now = 1e-9 * self.time
        for _ in range(MOST_RECEIVED):
            received = self._listening.receive()
            if received is None:
                break
            datagram, peer = received
            if datagram:
                self.from_host.send(datagram, peer, now)
        for datagram, peer in self.from_host.received(now):
            self._target.feed(datagram, peer)
            self._take(now)

    def _send(self) -> None:
        now = 1e-9 * self.time
        self._take(now)
        for frame, peer in self.to_host.received(now):
            if not self._listening.send(frame, peer):  # as on a real network, it is lost
                self.unsent += 1
                self.to_host.not_delivered(frame)

    def _take(self, now: float) -> None:
        """Put what the target sends into the network."""
        for frame, peer in self._target.take():
            if frame[_OFFSET_OF_TYPE] in (FrameType.REPLY, FrameType.STATUS):
                self._last_status = frame
            self.to_host.send(frame, peer, now)
