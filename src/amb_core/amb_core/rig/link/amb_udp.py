"""The host's end of AMB-UDP (docs/reference/target-protocol.md): commands, which are repeated where they are lost.

They come from any thread, one open at a time; `AmbUdpSession` receives.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import random
import threading
import time
from collections.abc import Callable, Iterator, Sequence

from amb_core.ground.errors import AmbError, TargetError, one_line
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_parameters import require_order
from amb_core.rig.link import commands
from amb_core.rig.link.answers import Reply
from amb_core.rig.link.commanded import CommandedLink
from amb_core.rig.link.commands import Command
from amb_core.rig.link.in_order import InOrder
from amb_core.rig.link.layout import Code, Law, TelemetryOption
from amb_core.rig.link.link import (
    HostLoopLink,
    LevitatedError,
    LinkListener,
    RebootedError,
    TargetDescription,
    TargetSettings,
)
from amb_core.rig.link.refusals import require_done
from amb_core.rig.link.session import RECEIVE_TIMEOUT, AmbUdpSession
from amb_core.rig.link.upload import Upload, controller_upload
from amb_core.rig.link.wire import open_wire

PORT = 47_000
SILENCE = 0.4  # s
FIRST_REPEAT, LONGEST_REPEAT = 0.02, 0.1  # s after which a command without a reply is sent again
LAWS = {"": Law.PD, "off": Law.HOST, "land": Law.HOST_OR_LAND}  # by what a target does without the host
FORESEEN = 10.0  # s after the latest step that a sealed reply has named: no later one can have been measured
UNANSWERED = 2  # searches that the target answers while it does not reply to a command: it has not taken that
BURST = 48  # chunks of an upload before the target is asked which have arrived: less than any receive buffer holds


class AmbUdpLink(AmbUdpSession, CommandedLink, HostLoopLink):
    """A connection to a target by AMB-UDP.

    Parameters
    ----------
    address : str, optional
        IPv4 address or name of the target; or `serial:DEVICE`, optionally with `?baud=N`, for a byte stream.
    port : int, optional
        Its UDP port.
    key : bytes, optional
        Shared secret; empty: the target takes commands from its own host only.
    float64 : bool, optional
        Telemetry as float64, bit for bit, instead of float32.
    wait : int, optional
        Steps that may arrive after a missing one before it is given up.
    timeout : float, optional
        Longest wait for the reply to a command (s).
    silence : float, optional
        Time without a frame after which the target is taken for gone (s); its status comes every 100 ms.
    starting : callable, optional
        Called first in the thread of the link, to give it a real-time priority for example.
    take_over : bool, optional
        Whether it connects to a target whose rotor is levitated, and takes its telemetry away from another host.

    Raises
    ------
    TargetError
        If the key has a wrong length.
    """

    def __init__(
        self,
        address: str = "127.0.0.1",
        port: int = PORT,
        key: bytes = b"",
        float64: bool = False,
        wait: int = 200,
        timeout: float = 1.0,
        silence: float = SILENCE,
        starting: Callable[[], object] = lambda: None,
        take_over: bool = True,
    ) -> None:
        super().__init__(address, port, key, float64, wait, timeout, silence, starting)
        self._take_over = take_over
        self._waiting = 0  # commands that wait until an upload lets them pass
        self._uploads = itertools.count(random.randrange(1, 1 << 30))
        self._waiting_settings: TargetSettings | None = None  # until that rotor has landed

    def connect(self, listener: LinkListener) -> TargetDescription:
        """Find the target and start its telemetry.

        Parameters
        ----------
        listener : LinkListener
            Receives samples and states.

        Returns
        -------
        TargetDescription
            What the target says of itself and its machine.

        Raises
        ------
        TargetError
            If it does not answer in time, has another version or needs another key; LevitatedError if its rotor is
            levitated and may not be taken over.
        """
        self._listener = listener
        try:
            self._wire = open_wire(*self._address)
        except OSError as problem:
            raise TargetError(f"{self._where} cannot be reached: {problem.strerror or problem}") from None
        try:
            self._find()
            description = self._begin_session()
        except AmbError as problem:
            self.close()
            raise TargetError(one_line(problem)) from None
        self._heard = self._sealed = time.monotonic()
        self._sampled = math.inf  # no telemetry is due before it is asked for
        self._thread = threading.Thread(target=self._run, name="amb_udp", daemon=True)
        self._thread.start()
        try:
            self._begin_telemetry()
        except TargetError:
            self.close()
            raise
        return description

    def _begin_telemetry(self) -> None:
        """Ask for telemetry, unless another host needs it: it has one receiver, and may be what closes the loop."""
        status = self.status()
        if status.currents_on and not self._take_over:
            raise LevitatedError
        if not (status.currents_on and status.by_host):
            self._command(self._stream())
            self._sampled = time.monotonic()

    def configure(self, settings: TargetSettings) -> None:
        """Send controller, limits and references.

        A rotor that is levitated when the host connects stays as it is: nothing is sent until it has landed, since the
        host does not know what is in force. On one that this host has levitated, only what has changed is sent; a
        state-space controller in use stays.

        Parameters
        ----------
        settings : TargetSettings
            Controller, limits and references of the machine.

        Raises
        ------
        TargetError
            If the target refuses one.
        ParameterError
            If they are for another machine.
        """
        machine = self._known.machine
        axes = len(machine.axes)
        law = settings.controller.at_rate(machine.sample_rate)
        law.require_axes(axes)
        if isinstance(law, LinearControl):
            require_order(law.model, [axis.name for axis in machine.axes])
        status = self.status()
        levitated = status.currents_on
        by_host = bool(settings.without_host)
        if levitated and status.by_host != by_host:
            raise TargetError("the rotor is levitated in the other mode of the loop; land it first")
        wanted = commands.settings(settings, law, axes)
        if levitated and self._sent is None:
            self._waiting_settings = settings
        else:
            taken = dict(self._sent or {}) if levitated else {}
            self._sent = taken if levitated else None  # off, it is known once the law is chosen too
            self._send_changed(wanted, taken)
            if not levitated:
                self._choose(law, settings)
                self._sent = taken
        if by_host and not self._by_sample:
            self._by_sample, self._wait, self._order = True, 0, InOrder(0, self.count.samples)
            self._options |= TelemetryOption.FLOAT64
            self._command(self._stream())
            self._sampled = time.monotonic()

    @property
    def settings_wait(self) -> bool:
        """Whether the target keeps settings of before, until a rotor that was levitated already has landed."""
        return self._waiting_settings is not None

    def _send_changed(self, wanted: dict[str, Command], taken: dict[str, Command]) -> None:
        """Send the settings that the target has not taken; one that it refuses, or does not reply to, is unknown."""
        for kind, command in wanted.items():
            if taken.get(kind) != command:
                taken.pop(kind, None)
                self._command(command)
                taken[kind] = command

    def _choose(self, law: KnownController, settings: TargetSettings) -> None:
        """Choose who sets the currents; a rotor that is not levitated has all settings then."""
        chosen = LAWS[settings.without_host]
        if isinstance(law, LinearControl):
            self._bring(controller_upload(next(self._uploads), law.model), lambda: False)
            chosen = Law.STATE_SPACE
        self._command(commands.controller(chosen))
        self._waiting_settings = None

    def send_current(self, step: int, current: Sequence[float]) -> None:
        """Send the currents for a step that was measured, and not for one that somebody in the network has made up.

        Parameters
        ----------
        step : int
            Step of the target that was measured.
        current : sequence of float
            Control current references of all axes (A).
        """
        if step < self._known_step + FORESEEN * self._known.machine.sample_rate:
            self._send(commands.current(self._session, step, current))

    def levitate(self, seconds: float) -> None:
        """Close the loop over a time.

        Parameters
        ----------
        seconds : float
            Duration of the lift (s).
        """
        if self._waiting_settings is not None:
            self.configure(self._waiting_settings)
        super().levitate(seconds)

    def reset_faults(self) -> None:
        """Forget latched trips, and wait until the target has measured anew.

        Raises
        ------
        TargetError
            If the target refuses, or measures nothing afterwards.
        """
        step = self._command(commands.fault_reset()).status.step
        until = time.monotonic() + self._timeout
        while self.status().step == step:
            if time.monotonic() > until:
                raise TargetError(f"{self._where} has measured nothing since the reset")
            time.sleep(RECEIVE_TIMEOUT)

    def _command(self, command: Command) -> Reply:
        with self._open():
            return self._exchanged(command)

    @contextlib.contextmanager
    def _open(self) -> Iterator[None]:
        """The right to command: held for one command, or one burst of an upload, which lets others pass in between."""
        self._waiting += 1
        try:
            self._exchange.acquire()
        finally:
            self._waiting -= 1
        try:
            yield
        finally:
            self._exchange.release()

    def _exchanged(self, command: Command) -> Reply:
        """The reply to a command, which is sent again, byte for byte, until it is there."""
        frame = self._writer.write(command)
        self._awaited = self._writer.counter
        self._replied.clear()
        began = time.monotonic()
        pause, sent, recognised = FIRST_REPEAT, began, self._recognised
        self._send(frame)
        while not self._replied.wait(pause):
            if self._closing.is_set() or self._silent or time.monotonic() - began > self._timeout:
                if self._rebooted:
                    raise RebootedError
                raise TargetError(f"no reply from {self._where} to {command.type.name}")
            pause, sent = min(2.0 * pause, LONGEST_REPEAT), math.nan
            self.count.resent += 1
            overtaken = self._writer.counter != self._awaited  # the target has taken later ones, of another host
            same = self._recognised >= recognised + UNANSWERED  # or one of another host with the same counter
            if overtaken or same:
                recognised = self._recognised
                frame = self._writer.write(command)
                self._awaited = self._writer.counter
            self._send(frame)
        if not math.isnan(sent):
            self.count.round_trip = time.monotonic() - sent
        reply = self._reply
        assert reply is not None
        require_done(self._where, command, reply)
        return reply

    def _bring(self, upload: Upload, cancelled: Callable[[], bool]) -> None:
        """Bring an upload to the target, whole. One burst at a time, so that other commands can pass in between."""
        self._command(upload.begin)
        missing: tuple[int, ...] = tuple(range(upload.chunks))
        at = 0
        while missing:
            while self._waiting:
                time.sleep(RECEIVE_TIMEOUT)
            if cancelled():
                raise TargetError("the upload was called off")
            with self._open():
                for index in missing[at : at + BURST]:
                    self._send(self._writer.write(upload.chunk(index)))
                left = self._exchanged(upload.bitmap).missing
            at += BURST
            if at >= len(missing) and left is not None:  # a repeated reply has no bitmap
                missing, at = left, 0
        while self._command(upload.commit).code is Code.BUSY:
            time.sleep(RECEIVE_TIMEOUT)
