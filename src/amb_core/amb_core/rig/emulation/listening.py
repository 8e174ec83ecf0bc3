"""Where hosts reach an emulator: a UDP socket, or a pseudo-terminal as a serial line or USB port of a target."""

from __future__ import annotations

import contextlib
import os
import socket
import tty
from abc import ABC, abstractmethod
from collections import deque

from amb_core.ground.errors import TargetError
from amb_core.rig.link import LOOPBACK, Peer
from amb_core.rig.link.byte_stream import StreamReader, to_stream
from amb_core.rig.link.layout import LARGEST_FRAME

PSEUDO_TERMINAL = "serial:pty"
_ROOM = 1 << 18  # bytes that may wait for the host to read them
_READ = 1 << 16  # bytes
_TOO_LONG = bytes(LARGEST_FRAME + 1)


class Listening(ABC):
    """Takes frames from hosts and sends frames to them. Neither waits.

    Attributes
    ----------
    port : int
        UDP port; 0 for a pseudo-terminal.
    where : str
        Address that hosts use.
    """

    port: int
    where: str

    @abstractmethod
    def receive(self) -> tuple[bytes, Peer] | None:
        """The next frame and its sender; None if there is none."""

    @abstractmethod
    def send(self, frame: bytes, peer: Peer) -> bool:
        """Send a frame; False if that is not possible."""

    @abstractmethod
    def fileno(self) -> int:
        """File descriptor, to wait for frames."""

    @abstractmethod
    def close(self) -> None:
        """Listen no longer."""


class UdpListening(Listening):
    """Frames as datagrams.

    Parameters
    ----------
    host : str
        IPv4 address.
    port : int
        UDP port; 0 for any that is free.

    Raises
    ------
    TargetError
        If the port cannot be opened.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as problem:
            self._socket.close()
            reason = getattr(problem, "strerror", problem)
            other = "another one: parameter port of target_emulator (0: any that is free), link.port of hardware_bridge"
            raise TargetError(f"UDP port {port} of {host} cannot be opened: {reason}; {other}") from None
        self.port = self._socket.getsockname()[1]
        self.where = f"UDP port {self.port} of {host}"

    def receive(self) -> tuple[bytes, Peer] | None:
        """The next datagram and its sender."""
        try:
            datagram, (host, port) = self._socket.recvfrom(LARGEST_FRAME + 1)
        except OSError:  # none is there
            return None
        address = int.from_bytes(socket.inet_aton(host), "big")
        return datagram, Peer(address, port, address >> 24 == 127)

    def send(self, frame: bytes, peer: Peer) -> bool:
        """Send a datagram; False if there is no room or route, as on a real network."""
        try:
            self._socket.sendto(frame, (socket.inet_ntoa(peer.address.to_bytes(4, "big")), peer.port))
        except OSError:
            return False
        return True

    def fileno(self) -> int:
        """File descriptor of the socket."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class SerialListening(Listening):
    """Frames in the stream of a pseudo-terminal. Its host is on this machine, so it counts as the loopback address."""

    def __init__(self) -> None:
        self._file, self._device = os.openpty()  # the device stays open: without a host reads fail otherwise
        tty.setraw(self._device)
        os.set_blocking(self._file, False)
        self._reader, self._frames = StreamReader(), deque[bytes]()
        self._unsent = bytearray()
        self.port, self.where = 0, f"serial:{os.ttyname(self._device)}"

    def receive(self) -> tuple[bytes, Peer] | None:
        """The next frame."""
        self._flush()
        with contextlib.suppress(OSError):  # nothing is there
            if not self._frames:
                self._frames.extend(self._reader.take(os.read(self._file, _READ)))
        # One that was cut or too long comes as too long, for the target to count.
        return (self._frames.popleft() or _TOO_LONG, LOOPBACK) if self._frames else None

    def send(self, frame: bytes, peer: Peer) -> bool:
        """Send a frame; False if the host has not read for long."""
        self._flush()
        if len(self._unsent) + len(frame) > _ROOM:
            return False
        self._unsent += to_stream(frame)
        self._flush()
        return True

    def _flush(self) -> None:
        with contextlib.suppress(OSError):  # no room in the line for the moment
            while self._unsent:
                del self._unsent[: os.write(self._file, self._unsent)]

    def fileno(self) -> int:
        """File descriptor of the pseudo-terminal."""
        return self._file

    def close(self) -> None:
        """Close the pseudo-terminal; hosts lose it."""
        os.close(self._file)
        os.close(self._device)
