"""Single frames to a target and what comes back, for the checks of a port: nothing is repeated or put in order here."""

from __future__ import annotations

import time
from dataclasses import dataclass

from amb_core.ground.errors import TargetError
from amb_core.rig.link.answers import Answer, Reply, TargetStatus, decode
from amb_core.rig.link.commands import Command, CommandWriter, heartbeat
from amb_core.rig.link.description import Description
from amb_core.rig.link.frames import Refusal, Session
from amb_core.rig.link.search import Search
from amb_core.rig.link.wire import open_wire, place


@dataclass(frozen=True)
class Received:
    """A datagram that came back, when (s of the monotonic clock), and what it is."""

    datagram: bytes
    time: float
    answer: Answer | Refusal


class Exchange:
    """A target under check.

    Parameters
    ----------
    address : str
        Of the target: IPv4 address or name, or `serial:DEVICE`.
    port : int
        Its UDP port.
    key : bytes
        Shared secret; empty: none.
    patience : float, optional
        Longest wait for an answer (s).

    Attributes
    ----------
    description : Description
        First page of its description, once it is known.
    session : Session
        Of that description.
    writer : CommandWriter
        Numbers commands.

    Raises
    ------
    TargetError
        If the address cannot be used.
    """

    description: Description
    session: Session
    writer: CommandWriter

    def __init__(self, address: str, port: int, key: bytes, patience: float = 1.0) -> None:
        self.key, self.patience, self.where = key, patience, place(address, port)
        try:
            self._wire = open_wire(address, port)
        except OSError as problem:
            raise TargetError(f"{self.where} cannot be reached: {problem.strerror or problem}") from None
        self._open: Session | None = None

    def close(self) -> None:
        """Close the wire."""
        self._wire.close()

    def send(self, frame: bytes) -> None:
        """Send a datagram.

        Parameters
        ----------
        frame : bytes
            Datagram to send.

        Raises
        ------
        TargetError
            If the target cannot be reached.
        """
        try:
            self._wire.send(frame)
        except OSError as problem:
            raise TargetError(f"{self.where} cannot be reached: {problem.strerror or problem}") from None

    def receive(self, until: float) -> Received | None:
        """The next datagram before a time of the monotonic clock; None if there is none.

        Parameters
        ----------
        until : float
            Time of `time.monotonic` up to which to wait (s).

        Returns
        -------
        Received or None
            The datagram with its time and content.
        """
        try:
            datagram = self._wire.receive(until - time.monotonic())
        except OSError:
            return None
        if datagram is None:
            return None
        return Received(datagram, time.monotonic(), decode(datagram, self._open))

    def find(self) -> str:
        """Have the target describe itself.

        Returns
        -------
        str
            What is wrong with the answer; empty if nothing is.
        """
        search = Search(self.key)
        reason, until = "no answer to HELLO", time.monotonic() + 3.0 * self.patience
        while time.monotonic() < until:
            for question in search.questions():
                self.send(question)
            received = self.receive(time.monotonic() + self.patience)
            if received is None:
                continue
            if isinstance(received.answer, Refusal):
                reason = received.answer.reason
            elif isinstance(received.answer, Description):
                reason = search.add(received.answer)
            if (pages := search.complete) is not None:
                self.description = pages[0]
                self.session = self._open = pages[0].session(self.key)
                self.writer = CommandWriter(self.session, pages[0].counter)
                return ""
        return reason

    def reply_to(self, frame: bytes, counter: int, patience: float | None = None) -> Reply | None:
        """The reply with this counter to a frame; None if there is none.

        Parameters
        ----------
        frame : bytes
            Frame to send.
        counter : int
            Counter that the reply must repeat.
        patience : float, optional
            Longest wait (s); by default that of the exchange.

        Returns
        -------
        Reply or None
            The reply.
        """
        self.send(frame)
        until = time.monotonic() + (self.patience if patience is None else patience)
        while (received := self.receive(until)) is not None:
            if isinstance(received.answer, Reply) and received.answer.counter == counter:
                return received.answer
        return None

    def command(self, command: Command) -> Reply:
        """The reply to a command.

        Parameters
        ----------
        command : Command
            What to send.

        Returns
        -------
        Reply
            The reply with the counter of the command.

        Raises
        ------
        TargetError
            If there is none.
        """
        reply = self.reply_to(self.writer.write(command), self.writer.counter)
        if reply is None:
            raise TargetError(f"no genuine reply to {command.type.name}")
        return reply

    def answers_before_heartbeat(self, frame: bytes) -> tuple[list[Received], TargetStatus]:
        """What comes between a frame, which is to have no answer, and the reply to a heartbeat after it.

        Parameters
        ----------
        frame : bytes
            Frame that is to have no answer.

        Returns
        -------
        (list of Received, TargetStatus)
            What came in between, and the state in the reply to the heartbeat.

        Raises
        ------
        TargetError
            If the heartbeat has no reply.
        """
        self.send(frame)
        self.send(self.writer.write(heartbeat()))
        between: list[Received] = []
        until = time.monotonic() + self.patience
        while (received := self.receive(until)) is not None:
            answer = received.answer
            if isinstance(answer, Reply) and answer.counter == self.writer.counter:
                return between, answer.status
            between.append(received)
        raise TargetError("no genuine reply to HEARTBEAT")

    def listen(self, seconds: float) -> list[Received]:
        """What arrives within a time.

        Parameters
        ----------
        seconds : float
            Time to listen (s).

        Returns
        -------
        list of Received
            What was received, oldest first.
        """
        until, heard = time.monotonic() + seconds, []
        while (received := self.receive(until)) is not None:
            heard.append(received)
        return heard
