"""The session with a target over AMB-UDP: what arrives, and what keeps the target awake and known.

One thread receives, puts telemetry in order, shows the target that the host is there, and finds it again after a
silence.
"""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable

from amb_core.ground.errors import AmbError, TargetError, bounded
from amb_core.rig.link import commands
from amb_core.rig.link.answers import Answer, Reply, TargetStatus, TelemetryBlock, decode
from amb_core.rig.link.commands import Command, CommandWriter
from amb_core.rig.link.description import Description, machine_of
from amb_core.rig.link.frames import Refusal, require_key
from amb_core.rig.link.in_order import InOrder
from amb_core.rig.link.layout import CHECKSUM, HEADER, LARGEST_FRAME, ExcitationPhase, TelemetryOption
from amb_core.rig.link.link import LinkCount, LinkListener, TargetDescription
from amb_core.rig.link.search import Search
from amb_core.rig.link.wire import Wire, place

RECEIVE_TIMEOUT = 0.002  # s; also the precision of heartbeats
HELLO_PERIOD = 0.05  # s
HEARTBEAT_PERIOD, EXCITED_HEARTBEAT_PERIOD = 0.1, 0.005  # s; the target waits 20 ms while it is excited
UNREAD = 10.0  # times longer that silence must last while frames of anybody wait to be read
UNSEALED = 0.25  # s without a sealed reply after which it is asked for its boot and counter; all else can be forged
STREAM_TIMEOUT = 0.25  # s without samples after which telemetry is asked for again
CLOCK_PERIOD = 2.0  # s

logger = logging.getLogger(__name__)


class AmbUdpSession:
    """What a connection holds, and its thread; `AmbUdpLink` commands the target through it.

    Parameters are those of `AmbUdpLink`.
    """

    _listener: LinkListener

    def __init__(
        self,
        address: str,
        port: int,
        key: bytes,
        float64: bool,
        wait: int,
        timeout: float,
        silence: float,
        starting: Callable[[], object],
    ) -> None:
        require_key(key)
        self._where = f"the target at {place(address, port)}"
        self._address, self._key, self._wait, self._timeout = (address, port), key, wait, timeout
        self._starting, self._silence = starting, silence
        self._options = TelemetryOption.STATUS | (TelemetryOption.FLOAT64 if float64 else TelemetryOption(0))
        self._known: TargetDescription
        self._by_sample = False  # a frame of telemetry for every sample, since the host closes the loop
        self.count = LinkCount()
        self.error = ""
        self._wire: Wire | None = None  # until it connects
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._exchange = threading.Lock()  # held while a command is open
        self._replied = threading.Event()
        self._reply: Reply | None = None
        self._awaited = 0  # counter of the open command
        self._search, self._searching = Search(key), True
        self._recognised = 0  # times that the target has answered a search since it was connected
        self._silent = self._rebooted = False  # while it does not answer; while its new boot is being taken
        self._sent: dict[str, Command] | None = None  # settings of this boot, by kind
        # Times of the monotonic clock (s)
        self._next_hello = self._next_heartbeat = self._next_clock = -math.inf
        self._heard = self._sealed = self._sampled = -math.inf
        self._known_step = self._answered = 0  # step in the latest sealed reply, and the counter of its command
        self._frame_steps = self._reached = 0  # steps of a frame of telemetry; the step after the last sample
        self._clock: tuple[int, int] | None = None  # of host and target (ns), when the session began
        self._last_known: object = None  # state, excitation and trips in the latest reply

    def _find(self) -> None:
        """Wait for the description; what came instead is the reason if it does not come."""
        deadline = time.monotonic() + self._timeout
        reason = ""
        while self._search.complete is None:
            if time.monotonic() > deadline:
                if reason:
                    raise TargetError(f"{self._where} answers, but cannot be used: {reason}")
                raise TargetError(f"no answer from {self._where} within {self._timeout:g} s; is it on?")
            self._say_hello(time.monotonic())
            datagram = self._receive()
            answer = None if datagram is None else decode(datagram)
            if isinstance(answer, Refusal):
                reason = answer.reason
            elif isinstance(answer, Description):
                reason = self._search.add(answer)

    def close(self) -> None:
        """Leave the target as it is, and end."""
        self._closing.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
        if self._wire is not None:
            self._wire.close()
            self._wire = None

    def _run(self) -> None:
        self._starting()
        while not self._closing.is_set():
            try:
                datagram = self._receive()
                now = time.monotonic()
                if datagram is not None:
                    self._take(decode(datagram, self._session), now)
                self._keep_up(now, datagram is None)
            except Exception as error:  # of the listener; the target needs its heartbeats, and commands their replies
                self._note_error(error)
        self._silent = True  # commands end at once

    def _note_error(self, error: Exception) -> None:
        """Keep an error of the listener, and show it where it is another one than before."""
        text = bounded(f"internal error of the link's listener: {error!r}")
        if text != self.error:
            self.error = text
            logger.error(text, exc_info=error)

    def _take(self, answer: Answer | Refusal, now: float) -> None:
        if isinstance(answer, Refusal):
            self.count.refused += 1
            return
        if isinstance(answer, Description):
            self._recognise(answer, now)
            return
        self._heard = now
        if isinstance(answer, TelemetryBlock):
            self._sampled = now
            self._deliver(self._order.add(answer))
            return
        if isinstance(answer, TargetStatus):  # not authenticated: a reason to ask, and nothing more
            if (answer.state, answer.excitation, answer.trips) != self._last_known:
                self._next_heartbeat = now
            return
        if answer.counter <= self._answered:  # again, by the network or by somebody in it
            return
        self._answered, self._sealed, self._searching = answer.counter, now, False
        self._known_step = answer.status.step
        self._note_clock(answer)
        if answer.counter == self._awaited and not self._replied.is_set():
            self._reply = answer
            self._replied.set()
        status = answer.status
        if 0 <= status.step - self._reached < self._frame_steps:  # all that is due has come: the target stood still
            self._sampled = now
        self._last_known = status.state, status.excitation, status.trips
        self._excited = status.excitation is not ExcitationPhase.NONE
        if self._excited:
            self._next_heartbeat = min(self._next_heartbeat, now + EXCITED_HEARTBEAT_PERIOD)
        self._listener.on_status(status)

    def _deliver(self, blocks: list[TelemetryBlock]) -> None:
        for block in blocks:
            self._reached = block.first_step + block.steps
            self._listener.on_samples(block)

    def _keep_up(self, now: float, all_read: bool) -> None:
        """What is due by the clock; frames that wait to be read, after a pause of this thread, are no silence."""
        limit = self._silence if all_read else UNREAD * self._silence
        if self._silent or now - self._heard > limit:  # until it has described itself
            if not self._silent:
                self._silent = True
                self._deliver(self._order.flush())
                self._listener.on_silence()
            self._ask(now)
            return
        if now - self._sealed > UNSEALED:
            self._ask(now)
        if now >= self._next_heartbeat and self._exchange.acquire(blocking=False):
            try:  # not answered by anybody who waits: the status in the reply is what it is for
                self._send(self._writer.write(self._due(now, all_read)))
            finally:
                self._exchange.release()
            self._next_heartbeat = now + (EXCITED_HEARTBEAT_PERIOD if self._excited else HEARTBEAT_PERIOD)

    def _ask(self, now: float) -> None:
        """Ask the target for its boot and its counter, in a search of its own until something sealed has come."""
        if not self._searching or self._search.complete is not None:
            self._search.begin()
            self._searching = True
        self._say_hello(now)

    def _due(self, now: float, all_read: bool) -> Command:
        """What shows the target that the host is there: telemetry if it stopped, its clock at times, else nothing."""
        # It is there, but without samples; a new stream has a gap.
        if all_read and self._heard - self._sampled > STREAM_TIMEOUT:
            self._sampled = now
            return self._stream()
        if now >= self._next_clock:
            self._next_clock = now + CLOCK_PERIOD
            return commands.clock(time.monotonic_ns())
        return commands.heartbeat()

    def _note_clock(self, reply: Reply) -> None:
        if reply.clock is None:
            return
        host, target = reply.clock
        if self._clock is None:
            self._clock = host, target
        elif host > self._clock[0]:
            since = host - self._clock[0]
            self.count.clock_drift = 1e6 * ((target - self._clock[1]) / since - 1.0)

    def _recognise(self, description: Description, now: float) -> None:
        """The target has answered a search: the same boot, where its counter is now, or another boot."""
        if not self._searching or self._search.add(description):
            self.count.refused += 1
            return
        if (pages := self._search.complete) is None:
            return
        self._searching, silent = False, self._silent
        rebooted, known = pages[0].nonce != self._session.nonce, self._known
        if rebooted:
            self._silent = self._rebooted = True  # an open command ends
            try:
                with self._exchange:
                    known = self._begin_session()
            except AmbError:  # a machine that is none: searched for again
                self.count.refused += 1
                return
        self._writer.catch_up(pages[0].counter)
        self._recognised += 1
        self._silent = self._rebooted = False
        self._sealed, self._next_heartbeat = now, now
        if silent or rebooted:
            self._heard, self._sampled = now, -math.inf if rebooted else now
            self._listener.on_return(known, rebooted)

    def _begin_session(self) -> TargetDescription:
        pages = self._search.complete
        assert pages is not None
        page, machine = pages[0], machine_of(pages)
        self._session = page.session(self._key)
        self._writer = CommandWriter(self._session, page.counter)
        self._order, self._excited, self._clock = InOrder(self._wait, self.count.samples), False, None
        version = ".".join(map(str, page.firmware_version))
        room = page.waveform_bytes // (8 * page.axes)
        self._known = TargetDescription(machine, page.limits, f"{page.firmware} {version}", room, page.nonce)
        self._sent, self._known_step, self._answered = None, 0, 0
        return self._known

    # -- frames

    def _stream(self) -> Command:
        """Telemetry in frames as large as Ethernet carries."""
        width = 8 if self._options & TelemetryOption.FLOAT64 else 4
        row = width * (3 * self._session.axes + 1)
        self._frame_steps = 1 if self._by_sample else (LARGEST_FRAME - HEADER.size - 8 - CHECKSUM) // row
        return commands.stream(self._frame_steps, self._options)

    def _say_hello(self, now: float) -> None:
        if now >= self._next_hello:
            self._next_hello = now + HELLO_PERIOD
            for question in self._search.questions():
                self._send(question)

    def _send(self, frame: bytes) -> None:
        with contextlib.suppress(OSError):  # refused or unreachable for the moment: like a frame that was lost
            if self._wire is not None:
                self._wire.send(frame)

    def _receive(self) -> bytes | None:
        """The next frame; None if there is none for a moment."""
        assert self._wire is not None
        try:
            return self._wire.receive(RECEIVE_TIMEOUT)
        except OSError:  # nobody listens at the target's port, or its device has gone
            time.sleep(RECEIVE_TIMEOUT)
            return None
