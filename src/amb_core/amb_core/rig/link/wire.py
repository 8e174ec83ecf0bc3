"""What carries the frames between host and target: UDP, or a serial line or USB port as a stream of bytes."""

from __future__ import annotations

import fcntl
import os
import re
import select
import socket
import termios
import threading
import time
import tty
from abc import ABC, abstractmethod
from collections import deque

from amb_core.ground.errors import TargetError
from amb_core.rig.link.byte_stream import StreamReader, to_stream
from amb_core.rig.link.layout import LARGEST_FRAME

SERIAL = "serial:"
BAUD = 115_200
_RECEIVE_BUFFER = 1 << 22  # bytes: half a second of telemetry of 16 axes
_FULL = 0.25  # s for which a line may take no bytes until a frame is given up
_READ = 1 << 16  # bytes


class Wire(ABC):
    """Carries single frames to one target and back; any of them may be lost."""

    @abstractmethod
    def send(self, frame: bytes) -> None:
        """Send a frame; OSError if that is not possible."""

    @abstractmethod
    def receive(self, timeout: float) -> bytes | None:
        """The next frame; None if there is none within a time (s). OSError if there can be none."""

    @abstractmethod
    def close(self) -> None:
        """Let the target go."""


class UdpWire(Wire):
    """Frames as datagrams.

    Parameters
    ----------
    address : str
        IPv4 address or name of the target.
    port : int
        Its UDP port.

    Raises
    ------
    OSError
        If there is no such address.
    """

    def __init__(self, address: str, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            self._socket.connect((address, port))
        except OSError:
            self._socket.close()
            raise

    def send(self, frame: bytes) -> None:
        """Send a frame."""
        self._socket.send(frame)

    def receive(self, timeout: float) -> bytes | None:
        """The next frame within a time (s)."""
        if not select.select([self._socket], [], [], max(timeout, 0.0))[0]:
            return None
        return self._socket.recv(2 * LARGEST_FRAME)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class SerialWire(Wire):
    """Frames in a stream of bytes: a serial line, a USB port that shows itself as one, a pseudo-terminal.

    Parameters
    ----------
    device : str
        Path of the device.
    baud : int, optional
        Bits a second; USB and pseudo-terminals ignore it.

    Raises
    ------
    OSError
        If the device cannot be opened, or another process uses it.
    TargetError
        If the system has no such rate.
    """

    def __init__(self, device: str, baud: int = BAUD) -> None:
        speed = getattr(termios, f"B{baud}", None)
        if speed is None or baud == 0:
            raise TargetError(f"baud = {baud} is not allowed; allowed: {', '.join(map(str, _bauds()))}")
        self._file = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            _prepare(self._file, speed)
        except (OSError, termios.error) as problem:
            os.close(self._file)
            raise OSError(problem.args[0], problem.args[1]) from None
        self._reader, self._frames = StreamReader(), deque[bytes]()
        self._sending = threading.Lock()
        self._cut = True  # the first frame begins with an end, whatever was in the line before

    def send(self, frame: bytes) -> None:
        """Send a frame. One for which the line has no room in time is lost."""
        with self._sending:
            left = (b"\0" if self._cut else b"") + to_stream(frame)
            self._cut = True
            until = time.monotonic() + _FULL
            while left:
                try:
                    left = left[os.write(self._file, left) :]
                    until = time.monotonic() + _FULL
                except BlockingIOError:
                    if not select.select([], [self._file], [], max(until - time.monotonic(), 0.0))[1]:
                        return
            self._cut = False

    def receive(self, timeout: float) -> bytes | None:
        """The next frame within a time (s); empty for one that was cut or too long."""
        until = time.monotonic() + timeout
        while not self._frames:
            if not select.select([self._file], [], [], max(until - time.monotonic(), 0.0))[0]:
                return None
            received = os.read(self._file, _READ)
            if not received:
                raise OSError("the device has gone")
            self._frames.extend(self._reader.take(received))
        return self._frames.popleft()

    def close(self) -> None:
        """Close the device."""
        with self._sending:
            os.close(self._file)


def open_wire(address: str, port: int) -> Wire:
    """The wire to a target.

    Parameters
    ----------
    address : str
        IPv4 address or name of the target, or `serial:DEVICE`, optionally with `?baud=N`.
    port : int
        Its UDP port; without meaning for a device.

    Returns
    -------
    Wire
        Open.

    Raises
    ------
    OSError
        If it cannot be opened.
    TargetError
        If the address of a device is not of that form.
    """
    if not address.startswith(SERIAL):
        return UdpWire(address, port)
    serial = re.fullmatch(r"serial:(/[^?]+)(?:\?baud=(\d+))?", address)
    if serial is None:
        raise TargetError(f"address '{address}' is not allowed; allowed: serial:/dev/DEVICE, or with ?baud={BAUD}")
    return SerialWire(serial[1], int(serial[2] or BAUD))


def place(address: str, port: int) -> str:
    """Where a target is, for messages.

    Parameters
    ----------
    address : str
        As for `open_wire`.
    port : int
        As for `open_wire`.

    Returns
    -------
    str
        Address and port, or the address of the device.
    """
    return address if address.startswith(SERIAL) else f"{address} port {port}"


def _prepare(file: int, speed: int) -> None:
    """Raw bytes, 8 bits without parity, no flow control, for this process alone."""
    tty.setraw(file)
    mode = termios.tcgetattr(file)
    mode[2] = (mode[2] & ~(termios.CSTOPB | termios.CRTSCTS | termios.HUPCL)) | termios.CREAD | termios.CLOCAL
    mode[4] = mode[5] = speed
    termios.tcsetattr(file, termios.TCSANOW, mode)
    fcntl.ioctl(file, termios.TIOCEXCL)
    termios.tcflush(file, termios.TCIFLUSH)


def _bauds() -> list[int]:
    return sorted(int(name[1:]) for name in dir(termios) if re.fullmatch(r"B[1-9]\d*", name))
